//! Sensors that the kernel of this computer reads: IIO, hwmon and 1-Wire, in files below /sys.
//!
//! ```text
//! request ─► one thread per sensor: find it by its name, read its file ─► values that arrive by the timeout
//!                └─ a thread that hangs continues alone; its sensor is not read again until it returns
//! ```
//!
//! - A read of such a file returns when the driver answers, and cannot be cancelled. It takes almost a second for a
//!   1-Wire sensor, and for ever if its adapter hangs. Each read therefore has a separate thread. When the gateway
//!   ends, it does not wait for these threads.
//! - A value that arrives after its timeout is discarded.
//! - Each read searches for the sensor again, because the number of its directory changes when its driver is reloaded.

use std::path::PathBuf;
use std::time::Duration;

use super::kind::{BusKind, ScanKind, VirtualLine};
use crate::clock::WallTimeout;
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Boxed, Call, NodeReading, Request, SensorRequest, Stamped, Wire};
use isotherm_core::codec::DataType;
use isotherm_core::reading::Reason;
use isotherm_profile::{Bus, Transport};
use readers::Readers;

pub mod find;
pub mod readers;
pub mod request;
pub mod scan;
mod value;

/// Time that this program may need in addition to the timeout of the sensors.
const OWN: Duration = Duration::from_secs(1);

/// Description of the bus type that consists of the sensors of this computer.
pub const KIND: BusKind = BusKind {
    word: "sysfs",
    example: Some("/sys"),
    parse: |text| {
        let is_directory = text.starts_with('/') && !text.starts_with("/dev/");
        is_directory.then(|| Ok((Transport::Sysfs, text.to_owned())))
    },
    dial: |bus| Some(Box::new(SysfsDial::new(bus))),
    hint: |_| Some(AT_THIS_COMPUTER),
    scan: ScanKind::Other {
        is: "sensors of this computer",
        instead: "`isotherm scan --bus DIRECTORY` lists the sensors below a directory, for example /sys",
        scan: Some(scan::report),
    },
    virtual_line: VirtualLine::Absent(|bus| {
        format!(
            "bus {} is not simulated: the gateway reads the real sensors in {} (another directory: --set \
             bus.{}.address=DIRECTORY)",
            bus.name, bus.address, bus.name
        )
    }),
    ..BusKind::PLAIN
};

/// Remedy for every fault of this type of bus: only a driver that does not return can be the cause.
const AT_THIS_COMPUTER: &str = "the kernel driver of the sensors does not respond. Is an adapter or a cable \
                                unplugged? Does a 1-Wire sensor answer with a wrong checksum, so that the \
                                kernel repeats the reading for seconds? `dmesg` says more. The gateway reads \
                                each sensor again when its driver responds";

/// Connection opener for the sensors of this computer. Opening does nothing, because the sensors have no connection.
struct SysfsDial {
    root: PathBuf,
    timeout: Duration,
    /// Reads of sensors that have not returned yet. The list is kept when the connection is replaced, because a read
    /// may hang.
    readers: Readers,
}

impl SysfsDial {
    fn new(bus: &Bus) -> SysfsDial {
        SysfsDial { root: PathBuf::from(&bus.address), timeout: bus.timeout, readers: Readers::default() }
    }
}

impl Dial for SysfsDial {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let (root, readers) = (self.root.clone(), self.readers.clone());
        let wire = Sysfs { root, readers, timeout: self.timeout, patience: WallTimeout::new() };
        Box::pin(std::future::ready(Ok(Connection::Other(Box::new(wire)))))
    }
}

/// Connection whose requests read the sensors of this computer.
struct Sysfs {
    root: PathBuf,
    readers: Readers,
    timeout: Duration,
    patience: WallTimeout,
}

impl Sysfs {
    async fn exchange(&mut self, request: Request<'_>, send_guard: &mut SendGuard) -> Result<Answer, Fault> {
        let Request::Sensors(SensorRequest(sensors)) = request else {
            return Err(Fault::Caller(CallerFault::Function));
        };
        send_guard.leave()?;
        let found = self.readers.read(&self.root, sensors, self.timeout, &mut self.patience).await;
        // If one sensor has answered, the fault of another is its own, not that of the line.
        if found.iter().all(|value| *value == Err(Reason::Timeout)) {
            return Err(Fault::Timeout);
        }
        let reading = |value: Result<f64, Reason>| NodeReading {
            value: value.map(|celsius| DataType::F64.encode(celsius.to_bits())),
            stamped: Stamped::Unknown,
            asked: None,
        };
        Ok(Answer::Nodes(found.into_iter().map(reading).collect()))
    }
}

impl Wire for Sysfs {
    fn exchange<'a>(&'a mut self, _: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a> {
        Box::pin(self.exchange(request, send_guard))
    }

    fn time_under_way(&self, _: Request<'_>) -> Duration {
        OWN
    }
}
