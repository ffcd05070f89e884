//! Sensors that the kernel of this computer reads: IIO, hwmon, 1-Wire, in files below /sys.
//!
//! ```text
//! request ─► a thread for each sensor: find it by its name, read its file ─► what has come by the timeout
//!                └─ one that hangs is left alone, and its sensor is not asked again before it is back
//! ```
//!
//! - A read of such a file lasts as long as the driver takes, and nobody can call it off: for a 1-Wire sensor most of a second, for one
//!   whose adapter is stuck for ever. So each has a thread of its own, which nothing waits for when the gateway ends.
//! - What comes after its timeout is thrown away.
//! - A sensor is found anew at each read: the number of its directory changes when its driver is loaded again.

use std::path::PathBuf;
use std::time::Duration;

use super::connection::{Connection, Dial};
use super::departure::Departure;
use super::error::{CallerFault, Fault};
use super::trace::Tap;
use super::wire::{Answer, Boxed, NodeReading, Request, Stamped, Wire};
use crate::clock::Patience;
use isotherm_core::codec::DataType;
use isotherm_core::reading::Reason;
use isotherm_profile::Bus;
use readers::Readers;

pub mod find;
pub mod readers;
mod value;

/// What this end needs itself, beyond the timeout of the sensors.
const OWN: Duration = Duration::from_secs(1);

/// Opens nothing: the files are there, or are not.
pub(super) struct SysfsDial {
    root: PathBuf,
    timeout: Duration,
    /// Kept beyond a connection: what hangs still does.
    readers: Readers,
}

impl SysfsDial {
    pub(super) fn new(bus: &Bus) -> SysfsDial {
        SysfsDial { root: PathBuf::from(&bus.address), timeout: bus.timeout, readers: Readers::default() }
    }
}

impl Dial for SysfsDial {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let (root, readers) = (self.root.clone(), self.readers.clone());
        let wire = Sysfs { root, readers, timeout: self.timeout, patience: Patience::new() };
        Box::pin(std::future::ready(Ok(Connection::Other(Box::new(wire)))))
    }
}

/// The sensors of this computer.
struct Sysfs {
    root: PathBuf,
    readers: Readers,
    timeout: Duration,
    patience: Patience,
}

impl Sysfs {
    async fn exchange(&mut self, request: Request<'_>, departure: &mut Departure) -> Result<Answer, Fault> {
        let Request::Sensors(sensors) = request else { return Err(Fault::Caller(CallerFault::Function)) };
        departure.leave()?;
        let found = self.readers.read(&self.root, sensors, self.timeout, &mut self.patience).await;
        // Where one has answered, the others are its neighbours with a fault of their own.
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
    fn exchange<'a>(
        &'a mut self,
        _: u8,
        request: Request<'a>,
        departure: &'a mut Departure,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.exchange(request, departure))
    }

    fn time_under_way(&self, _: Request<'_>) -> Duration {
        OWN
    }
}
