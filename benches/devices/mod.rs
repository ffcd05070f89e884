//! Process that simulates the devices of a benchmark, and counts their reads and writes.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

pub(crate) mod server;

/// Process of the devices, which is killed when this value is dropped.
pub(crate) struct Devices {
    process: Child,
    requests: ChildStdin,
    replies: BufReader<ChildStdout>,
    /// TCP port of the devices, or path of their serial port.
    pub(crate) port: String,
}

impl Devices {
    /// Starts this program with these arguments, with which it serves the devices.
    pub(crate) fn start(arguments: &[&str]) -> Devices {
        let mut process = Command::new(std::env::current_exe().unwrap())
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (requests, replies) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        let replies = BufReader::new(replies);
        let mut devices = Devices { process, requests, replies, port: String::new() };
        devices.port = devices.line();
        devices
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.replies.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }

    pub(crate) fn counts(&mut self) -> Counts {
        writeln!(self.requests).unwrap();
        let counts: Vec<u64> = self.line().split(' ').map(|count| count.parse().unwrap()).collect();
        let [reads, writes, half, most] = counts[..] else { panic!("four counts") };
        Counts { reads, writes, half_us: half as f64 / 1e3, most_us: most as f64 / 1e3 }
    }
}

/// Reads and writes so far, and the median and the 99th percentile of the reaction time since the last request.
#[allow(dead_code, reason = "not each benchmark uses all counts")]
pub(crate) struct Counts {
    pub(crate) reads: u64,
    pub(crate) writes: u64,
    pub(crate) half_us: f64,
    pub(crate) most_us: f64,
}

impl Drop for Devices {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
