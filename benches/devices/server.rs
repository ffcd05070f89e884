//! Simulated Modbus devices that count reads and writes.

use std::io::{BufRead, Read, Write};
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

/// Length of each request of Modbus TCP: header of six bytes, and message.
const REQUEST: usize = 12;
/// Length of the field before the message: transaction, protocol and length.
const HEADER: usize = 6;

/// Maximum number of connections that wait to be accepted. Thousands of lines connect at the same time.
const BACKLOG: i32 = 4096;

/// Resolution of reaction times, which are counted up to ten milliseconds.
const STEP: Duration = Duration::from_nanos(250);
const STEPS: usize = 40_000;

/// Reads and writes so far.
pub(crate) struct Counts {
    reads: AtomicU64,
    writes: AtomicU64,
    /// Histogram of the time between a read and the write that follows it, since the last request.
    reactions: Vec<AtomicU64>,
}

impl Counts {
    /// Returns new counts, which a thread prints for each line of input. The process ends with its input.
    pub(crate) fn printed_on_request() -> Arc<Counts> {
        let reactions = (0..STEPS).map(|_| AtomicU64::new(0)).collect();
        let counts = Arc::new(Counts { reads: AtomicU64::new(0), writes: AtomicU64::new(0), reactions });
        let counted = counts.clone();
        std::thread::spawn(move || {
            for _ in std::io::stdin().lock().lines() {
                println!("{}", counted.line());
            }
            std::process::exit(0);
        });
        counts
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
pub(crate) struct Device {
    begun: Moment,
    /// Value of the register that clients write.
    written: [u8; 2],
    read_at: Option<Moment>,
}

impl Device {
    pub(crate) fn new(begun: Moment) -> Device {
        Device { begun, written: [0; 2], read_at: None }
    }
}

/// Serves any number of devices over Modbus TCP. Prints the port, then for each line of input the counts so far.
pub(crate) fn serve(delay: Duration) {
    let counts = Counts::printed_on_request();
    let listener = TcpListener::bind("0.0.0.0:0").unwrap();
    rustix::net::listen(&listener, BACKLOG).unwrap();
    println!("{}", listener.local_addr().unwrap().port());
    if delay.is_zero() { at_once(&listener, &counts) } else { late(listener, delay, &counts) }
}

/// Serves each connection in a thread. Requests that arrive together are answered together.
fn at_once(listener: &TcpListener, counts: &Arc<Counts>) {
    let begun = Clock::wall().now();
    for stream in listener.incoming() {
        let (mut stream, counts) = (stream.unwrap(), counts.clone());
        stream.set_nodelay(true).unwrap();
        std::thread::spawn(move || {
            let (mut requests, mut replies) = ([0; 8 * REQUEST], Vec::with_capacity(512));
            let mut device = Device::new(begun);
            while let Ok(length @ REQUEST..) = stream.read(&mut requests) {
                replies.clear();
                for request in requests[..length].chunks_exact(REQUEST) {
                    answer_with_header(request, &counts, &mut device, &mut replies);
                }
                if stream.write_all(&replies).is_err() {
                    return;
                }
            }
        });
    }
}

/// Serves each connection in a task that answers after the delay.
fn late(listener: TcpListener, delay: Duration, counts: &Arc<Counts>) {
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
                let mut device = Device::new(begun);
                while stream.read_exact(&mut request).await.is_ok() {
                    tokio::time::sleep(delay).await;
                    reply.clear();
                    answer_with_header(&request, &counts, &mut device, &mut reply);
                    if stream.write_all(&reply).await.is_err() {
                        return;
                    }
                }
            });
        }
    });
}

/// Appends the answer to a request of Modbus TCP.
fn answer_with_header(request: &[u8], counts: &Counts, device: &mut Device, replies: &mut Vec<u8>) {
    let begin = replies.len();
    replies.extend_from_slice(&request[..HEADER]);
    answer(&request[HEADER..], counts, device, replies);
    let length = u16::try_from(replies.len() - begin - HEADER).unwrap();
    replies[begin + 4..begin + HEADER].copy_from_slice(&length.to_be_bytes());
}

/// Appends the answer to a message: unit, function, register, and value or number of registers.
pub(crate) fn answer(message: &[u8], counts: &Counts, device: &mut Device, replies: &mut Vec<u8>) {
    let (unit, function) = (message[0], message[1]);
    if function == 3 {
        let [high, low] = device.written;
        replies.extend_from_slice(&[unit, function, 2, high, low]);
        return;
    }
    let now = Clock::wall().now();
    if function != 4 {
        if let Some(read_at) = device.read_at.take() {
            counts.reacted(now.since(read_at));
        }
        counts.writes.fetch_add(1, Ordering::Relaxed);
        device.written.copy_from_slice(&message[4..6]);
        replies.extend_from_slice(message);
        return;
    }
    device.read_at = Some(now);
    counts.reads.fetch_add(1, Ordering::Relaxed);
    // The first register is a temperature that rises or falls by 0.1 °C per 0.1 s, between 25.5 and 29.5 °C.
    let phase = now.since(device.begun).as_millis() % 8_000;
    let tenths = u16::try_from(phase.min(8_000 - phase) / 100).unwrap();
    // The second register is constant; the last one is a position.
    let mut registers = [0, 0, 0, 240, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 4, 210];
    registers[..2].copy_from_slice(&(255 + tenths).to_be_bytes());
    let length = 2 * message[5].min(8);
    replies.extend_from_slice(&[unit, function, length]);
    replies.extend_from_slice(&registers[..usize::from(length)]);
}
