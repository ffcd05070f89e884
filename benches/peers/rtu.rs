//! Device on a pseudo-terminal, which takes the place of a serial port.

use std::fs::File;
use std::io::{Read, Write};

use isotherm::clock::Clock;
use isotherm_core::codec::checksum;
use rustix::fs::{Mode, OFlags};
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;

use super::devices::server::{Counts, Device, answer};

/// Length of each request of the contenders: message of six bytes, and checksum.
const REQUEST: usize = 8;
const MESSAGE: usize = 6;

/// Prints the path of the port, then for each line of input the counts so far.
pub(super) fn serve() {
    let counts = Counts::printed_on_request();
    let end = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    rustix::pty::grantpt(&end).unwrap();
    rustix::pty::unlockpt(&end).unwrap();
    let mut termios = rustix::termios::tcgetattr(&end).unwrap();
    termios.make_raw();
    rustix::termios::tcsetattr(&end, OptionalActions::Now, &termios).unwrap();
    let path = rustix::pty::ptsname(&end, Vec::new()).unwrap().into_string().unwrap();
    // While this process has the port open too, the port does not hang up before a contender opens it.
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let _port = rustix::fs::open(&path, flags, Mode::empty()).unwrap();
    println!("{path}");
    let mut end = File::from(end);
    let mut device = Device::new(Clock::wall().now());
    let (mut bytes, mut received, mut reply) = ([0; 64], Vec::with_capacity(64), Vec::with_capacity(64));
    loop {
        let count = end.read(&mut bytes).unwrap();
        received.extend_from_slice(&bytes[..count]);
        while received.len() >= REQUEST {
            reply.clear();
            answer(&received[..MESSAGE], &counts, &mut device, &mut reply);
            let sum = checksum(&reply).to_le_bytes();
            reply.extend_from_slice(&sum);
            received.drain(..REQUEST);
            end.write_all(&reply).unwrap();
        }
    }
}
