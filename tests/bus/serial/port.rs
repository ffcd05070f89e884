//! Hardware end of a serial port, and a line of the gateway on it.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::dial;
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::line::{DeviceLine, RequestObserver};
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::{Register, Table, checksum};
use isotherm_core::continuity::Break;
use isotherm_profile::{Bus, BusId, Device, DeviceId, Functions, Quirks, ReadBy, Transport};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;

use crate::support::frames::{Frames, Received};

/// Hardware end of a new pseudo-terminal.
pub(crate) struct Plug {
    end: OwnedFd,
    pub(crate) path: PathBuf,
    frames: Frames,
}

impl Plug {
    pub(crate) fn new() -> Plug {
        Plug::with(Frames::Rtu)
    }

    /// Returns the end of a port on which masters send these frames.
    pub(crate) fn with(frames: Frames) -> Plug {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let end = rustix::pty::openpt(flags).unwrap();
        rustix::pty::grantpt(&end).unwrap();
        rustix::pty::unlockpt(&end).unwrap();
        let mut termios = rustix::termios::tcgetattr(&end).unwrap();
        termios.make_raw();
        rustix::termios::tcsetattr(&end, OptionalActions::Now, &termios).unwrap();
        rustix::fs::fcntl_setfl(&end, rustix::fs::fcntl_getfl(&end).unwrap() | OFlags::NONBLOCK).unwrap();
        let path = PathBuf::from(rustix::pty::ptsname(&end, Vec::new()).unwrap().into_string().unwrap());
        Plug { end, path, frames }
    }

    /// Points this name to the port, as the system does when an adapter is plugged in.
    pub(crate) fn under(&self, name: &Path) {
        let _ = fs::remove_file(name);
        symlink(&self.path, name).unwrap();
    }

    pub(crate) fn say(&self, bytes: &[u8]) {
        // If no program has the port open, the bytes are lost.
        let _ = rustix::io::write(&self.end, bytes);
    }

    /// Waits until all written bytes are in the buffer of the port: polling the other end makes the kernel move them.
    /// That end must exist.
    pub(crate) fn hand_over(&self) {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let Ok(end) = rustix::fs::open(&self.path, flags, rustix::fs::Mode::empty()) else { return };
        let mut polled = [PollFd::new(&end, PollFlags::IN)];
        rustix::event::poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap();
    }

    /// Returns whether a program has the port open.
    pub(crate) fn is_open(&self) -> bool {
        let mut polled = [PollFd::new(&self.end, PollFlags::IN)];
        rustix::event::poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap();
        !polled[0].revents().contains(PollFlags::HUP)
    }

    /// Returns the received bytes; none if nothing has arrived, or no program has the port open.
    fn heard(&self) -> Vec<u8> {
        let mut bytes = [0; 256];
        match rustix::io::read(&self.end, &mut bytes) {
            Ok(count) => bytes[..count].to_vec(),
            Err(Errno::AGAIN | Errno::IO) => Vec::new(),
            Err(error) => panic!("{}", io::Error::from(error)),
        }
    }

    /// Waits for the next read request: unit, function, first register, count.
    pub(crate) async fn asked(&self) -> (u8, u8, u16, u16) {
        let mut received = Received::new(self.frames);
        loop {
            received.push(&self.heard());
            let received = &received.bytes;
            if let Some(place) = (0..received.len()).find(|place| is_frame(&received[*place..])) {
                let bytes = &received[place..place + 8];
                let word = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
                return (bytes[0], bytes[1], word(2), word(4));
            }
            tokio::time::sleep(Duration::from_micros(500)).await;
        }
    }
}

fn is_frame(bytes: &[u8]) -> bool {
    bytes.len() >= 8 && checksum(&bytes[..6]).to_le_bytes() == bytes[6..8]
}

/// Returns the frame of a protocol data unit.
pub(crate) fn framed(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut bytes = [&[unit], pdu].concat();
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// Value of a register: unit and register number. It shows an answer to another request.
pub(crate) fn word(unit: u8, register: u16) -> u16 {
    u16::from(unit) << 12 | register
}

/// Returns the answer to a read.
pub(crate) fn answer((unit, function, from, count): (u8, u8, u16, u16)) -> Vec<u8> {
    let words = (from..from + count).flat_map(|register| word(unit, register).to_be_bytes());
    framed(unit, &[vec![function, u8::try_from(2 * count).unwrap()], words.collect()].concat())
}

pub(crate) fn read(from: u16, count: u16) -> Request<'static> {
    Request::read_registers(Register { table: Table::Holding, offset: from }, count)
}

pub(crate) fn bus(transport: Transport, address: &str, timeout: Duration) -> Bus {
    let quirks = Quirks::default();
    let (name, address) = ("rs485".to_owned(), address.to_owned());
    Bus {
        name,
        transport,
        address,
        tls: None,
        opcua: None,
        timeout,
        late: transport.late(timeout),
        pipeline: 1,
        quirks,
        sync: None,
    }
}

pub(crate) fn serial(baud: u32) -> Transport {
    Frames::Rtu.on_port(baud)
}

/// Devices that may have been exchanged, in the order of the reports.
#[derive(Clone, Default)]
pub(crate) struct Exchanges(Arc<Mutex<Vec<Option<DeviceId>>>>);

impl RequestObserver for Exchanges {
    fn note(&self, _: DeviceId, _: Request<'_>, _: Result<(), Fault>, _: (u32, Fault)) {}

    fn breaks(&self, device: Option<DeviceId>, _: Break) {
        self.0.lock().unwrap().push(device);
    }
}

impl Exchanges {
    /// Returns the reports since the last call.
    pub(crate) fn said(&self) -> Vec<Option<DeviceId>> {
        std::mem::take(&mut self.0.lock().unwrap())
    }
}

/// Returns a line with units 1 to `count`, as devices in this order.
pub(crate) fn line(bus: &Bus, count: u8) -> DeviceLine {
    let device = |unit: u8| Device {
        label: String::new(),
        verify: Vec::new(),
        template: None,
        can: None,
        source_time: None,
        is_pc: false,
        read: ReadBy::Poll,
        name: format!("unit{unit}"),
        bus: BusId(0),
        unit,
        every: Duration::from_secs(1),
        functions: Functions::ALL,
        quirks: bus.quirks,
    };
    let devices: Vec<Device> = (1..=count).map(device).collect();
    let devices: Vec<_> =
        devices.iter().enumerate().map(|(place, device)| (DeviceId(place), device)).collect();
    DeviceLine::new(bus, &devices, dial(bus).unwrap(), &Clock::wall())
}

/// Sends a request to a device, and returns its answer.
pub(crate) async fn asked(
    line: &mut DeviceLine,
    device: DeviceId,
    request: Request<'_>,
) -> Result<Answer, Fault> {
    line.request(device, request, SendDeadline::None).await.map(|answered| answered.answer)
}
