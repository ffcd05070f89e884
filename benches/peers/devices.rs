//! The devices: servers that do as little as one can, and count.

use std::io::{BufRead, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

const REQUEST: usize = 12;

/// Reads and writes so far.
#[derive(Default)]
struct Counts(AtomicU64, AtomicU64);

/// Prints the port, then, for each line that comes in, the reads and writes so far.
pub(super) fn serve(delay: Duration) {
    let counts = Arc::new(Counts::default());
    let counted = counts.clone();
    std::thread::spawn(move || {
        for _ in std::io::stdin().lock().lines() {
            println!("{} {}", counted.0.load(Ordering::Relaxed), counted.1.load(Ordering::Relaxed));
        }
        std::process::exit(0);
    });
    let listener = std::net::TcpListener::bind("0.0.0.0:0").unwrap();
    println!("{}", listener.local_addr().unwrap().port());
    if delay.is_zero() { at_once(&listener, &counts) } else { late(listener, delay, &counts) }
}

/// A thread for each connection: what has come together is answered together.
fn at_once(listener: &std::net::TcpListener, counts: &Arc<Counts>) {
    let begun = Clock::wall().now();
    for stream in listener.incoming() {
        let (mut stream, counts) = (stream.unwrap(), counts.clone());
        stream.set_nodelay(true).unwrap();
        std::thread::spawn(move || {
            let (mut requests, mut replies) = ([0; 8 * REQUEST], Vec::with_capacity(512));
            let mut stands = [0; 2];
            while let Ok(length @ REQUEST..) = stream.read(&mut requests) {
                replies.clear();
                for request in requests[..length].chunks_exact(REQUEST) {
                    answer(request, begun, &counts, &mut stands, &mut replies);
                }
                if stream.write_all(&replies).is_err() {
                    return;
                }
            }
        });
    }
}

/// A task for each connection, which takes its time.
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
                let mut stands = [0; 2];
                while stream.read_exact(&mut request).await.is_ok() {
                    tokio::time::sleep(delay).await;
                    reply.clear();
                    answer(&request, begun, &counts, &mut stands, &mut reply);
                    if stream.write_all(&reply).await.is_err() {
                        return;
                    }
                }
            });
        }
    });
}

/// `stands`: what the register holds that is written.
fn answer(request: &[u8], begun: Moment, counts: &Counts, stands: &mut [u8; 2], replies: &mut Vec<u8>) {
    if request[7] == 3 {
        replies
            .extend_from_slice(&[request[0], request[1], 0, 0, 0, 5, request[6], 3, 2, stands[0], stands[1]]);
        return;
    }
    if request[7] != 4 {
        counts.1.fetch_add(1, Ordering::Relaxed);
        stands.copy_from_slice(&request[10..]);
        replies.extend_from_slice(request);
        return;
    }
    counts.0.fetch_add(1, Ordering::Relaxed);
    replies.extend_from_slice(&[request[0], request[1], 0, 0, 0, 19, request[6], 4, 16]);
    // The first is a temperature that rises and falls by 0.1 K in a tenth of a second, 4 K about 27.5 °C.
    let phase = Clock::wall().now().since(begun).as_millis() % 8_000;
    let tenths = u16::try_from(phase.min(8_000 - phase) / 100).unwrap();
    replies.extend_from_slice(&(255 + tenths).to_be_bytes());
    // The second one stays; the last is a position.
    replies.extend_from_slice(&[0, 240, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 4, 210]);
}
