//! Devices: minimal servers that count reads and writes.

use std::io::{BufRead, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

const REQUEST: usize = 12;

/// Resolution of reaction times, which are counted up to a millisecond.
const STEP: Duration = Duration::from_nanos(250);
const STEPS: usize = 4000;

/// Reads and writes so far.
struct Counts {
    reads: AtomicU64,
    writes: AtomicU64,
    /// Histogram of the time between a read and the write that follows it, since the last request.
    reactions: Vec<AtomicU64>,
}

impl Counts {
    fn new() -> Counts {
        let reactions = (0..STEPS).map(|_| AtomicU64::new(0)).collect();
        Counts { reads: AtomicU64::new(0), writes: AtomicU64::new(0), reactions }
    }

    fn reacted(&self, after: Duration) {
        let step = (after.as_nanos() / STEP.as_nanos()).min(STEPS as u128 - 1);
        self.reactions[step as usize].fetch_add(1, Ordering::Relaxed);
    }

    /// Reads, writes, and the median and the 99th percentile of the reaction time in nanoseconds.
    fn line(&self) -> String {
        let counted: Vec<u64> = self.reactions.iter().map(|step| step.swap(0, Ordering::Relaxed)).collect();
        let all: u64 = counted.iter().sum();
        let within = |percent: u64| {
            let mut sum = 0;
            let places = counted.iter().take_while(|count| {
                sum += *count;
                100 * sum < percent * all
            });
            (places.count() as u128 + 1) * STEP.as_nanos()
        };
        let (reads, writes) = (self.reads.load(Ordering::Relaxed), self.writes.load(Ordering::Relaxed));
        format!("{reads} {writes} {} {}", within(50), within(99))
    }
}

/// State of one device.
struct Device {
    begun: Moment,
    /// Value of the register that clients write.
    stands: [u8; 2],
    read_at: Option<Moment>,
}

/// Prints the port, then for each line of input the counts so far.
pub(super) fn serve(delay: Duration) {
    let counts = Arc::new(Counts::new());
    let counted = counts.clone();
    std::thread::spawn(move || {
        for _ in std::io::stdin().lock().lines() {
            println!("{}", counted.line());
        }
        std::process::exit(0);
    });
    let listener = std::net::TcpListener::bind("0.0.0.0:0").unwrap();
    println!("{}", listener.local_addr().unwrap().port());
    if delay.is_zero() { at_once(&listener, &counts) } else { late(listener, delay, &counts) }
}

/// Serves each connection in a thread. Requests that arrive together are answered together.
fn at_once(listener: &std::net::TcpListener, counts: &Arc<Counts>) {
    let begun = Clock::wall().now();
    for stream in listener.incoming() {
        let (mut stream, counts) = (stream.unwrap(), counts.clone());
        stream.set_nodelay(true).unwrap();
        std::thread::spawn(move || {
            let (mut requests, mut replies) = ([0; 8 * REQUEST], Vec::with_capacity(512));
            let mut device = Device { begun, stands: [0; 2], read_at: None };
            while let Ok(length @ REQUEST..) = stream.read(&mut requests) {
                replies.clear();
                for request in requests[..length].chunks_exact(REQUEST) {
                    answer(request, &counts, &mut device, &mut replies);
                }
                if stream.write_all(&replies).is_err() {
                    return;
                }
            }
        });
    }
}

/// Serves each connection in a task that answers after the delay.
fn late(listener: std::net::TcpListener, delay: Duration, counts: &Arc<Counts>) {
    let begun = Clock::wall().now();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        listener.set_nonblocking(true).unwrap();
        let listener = tokio::net::TcpListener::from_std(listener).unwrap();
        loop {
            let (mut stream, counts) = (listener.accept().await.unwrap().0, counts.clone());
            stream.set_nodelay(true).unwrap();
            tokio::spawn(async move {
                let (mut request, mut reply) = ([0; REQUEST], Vec::with_capacity(32));
                let mut device = Device { begun, stands: [0; 2], read_at: None };
                while stream.read_exact(&mut request).await.is_ok() {
                    tokio::time::sleep(delay).await;
                    reply.clear();
                    answer(&request, &counts, &mut device, &mut reply);
                    if stream.write_all(&reply).await.is_err() {
                        return;
                    }
                }
            });
        }
    });
}

fn answer(request: &[u8], counts: &Counts, device: &mut Device, replies: &mut Vec<u8>) {
    let [high, low] = device.stands;
    if request[7] == 3 {
        replies.extend_from_slice(&[request[0], request[1], 0, 0, 0, 5, request[6], 3, 2, high, low]);
        return;
    }
    let now = Clock::wall().now();
    if request[7] != 4 {
        if let Some(read_at) = device.read_at.take() {
            counts.reacted(now.since(read_at));
        }
        counts.writes.fetch_add(1, Ordering::Relaxed);
        device.stands.copy_from_slice(&request[10..]);
        replies.extend_from_slice(request);
        return;
    }
    device.read_at = Some(now);
    counts.reads.fetch_add(1, Ordering::Relaxed);
    replies.extend_from_slice(&[request[0], request[1], 0, 0, 0, 19, request[6], 4, 16]);
    // The first register is a temperature that rises or falls by 0.1 °C per 0.1 s, between 25.5 and 29.5 °C.
    let phase = now.since(device.begun).as_millis() % 8_000;
    let tenths = u16::try_from(phase.min(8_000 - phase) / 100).unwrap();
    replies.extend_from_slice(&(255 + tenths).to_be_bytes());
    // The second register is constant; the last one is a position.
    replies.extend_from_slice(&[0, 240, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 4, 210]);
}
