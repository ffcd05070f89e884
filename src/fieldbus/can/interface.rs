//! Whether a CAN interface is up, and how it is set, as the kernel says by netlink. A virtual one has no settings.

use std::fmt;

use socketcan::CanInterface;
use socketcan::nl::{CanState, Mtu};

use crate::fieldbus::error::CanFault;

/// A CAN interface as it is now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// It carries frames.
    pub is_up: bool,
    /// It carries frames of CAN FD.
    pub does_fd: bool,
    /// Bits per second; `None` where its driver has no bits, as a virtual one.
    pub bitrate: Option<u32>,
    /// Milliseconds after which a controller that took itself off the bus comes back; 0: never by itself.
    pub restart_ms: Option<u32>,
    /// What its controller thinks of the bus, in words.
    pub state: Option<&'static str>,
    /// Errors counted by the controller, sending and receiving.
    pub errors: Option<(u16, u16)>,
}

impl Interface {
    /// The interface of this name.
    ///
    /// # Errors
    /// There is none, or the kernel does not say.
    pub fn look(name: &str) -> Result<Interface, CanFault> {
        let interface = CanInterface::open(name).map_err(|_| CanFault::NoInterface)?;
        let details = interface.details().map_err(|_| CanFault::NoInterface)?;
        Ok(Interface {
            is_up: details.is_up,
            does_fd: details.mtu == Some(Mtu::Fd),
            bitrate: details.can.bit_timing.map(|timing| timing.bitrate).filter(|rate| *rate > 0),
            restart_ms: details.can.restart_ms,
            state: details.can.state.map(state_name),
            errors: details.can.berr_counter.map(|count| (count.txerr, count.rxerr)),
        })
    }

    /// A controller that takes itself off the bus stays off it.
    pub fn stays_off(&self) -> bool {
        self.restart_ms == Some(0)
    }
}

const fn state_name(state: CanState) -> &'static str {
    match state {
        CanState::ErrorActive => "well",
        CanState::ErrorWarning => "warning: many errors",
        CanState::ErrorPassive => "passive: so many errors that it is not believed any more",
        CanState::BusOff => "bus-off: it has taken itself off the bus",
        CanState::Stopped => "stopped",
        CanState::Sleeping => "asleep",
    }
}

/// `up, 250000 bit/s, restart after 100 ms, controller well`.
impl fmt::Display for Interface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.is_up { "up" } else { "down" })?;
        if let Some(rate) = self.bitrate {
            write!(f, ", {rate} bit/s")?;
        }
        if self.does_fd {
            f.write_str(", CAN FD")?;
        }
        match self.restart_ms {
            Some(0) => f.write_str(", no restart after bus-off")?,
            Some(pause) => write!(f, ", restart {pause} ms after bus-off")?,
            None => {}
        }
        if let Some(state) = self.state {
            write!(f, ", controller {state}")?;
        }
        if let Some((sending, receiving)) = self.errors.filter(|errors| *errors != (0, 0)) {
            write!(f, ", errors {sending} sending and {receiving} receiving")?;
        }
        Ok(())
    }
}
