//! State and settings of a CAN interface, as the kernel reports them by netlink. A virtual interface has no settings.

use std::fmt;

use socketcan::CanInterface;
use socketcan::nl::{CanState, Mtu};

use crate::fieldbus::error::CanFault;

/// State of a CAN interface.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Whether the interface is up, so that it can send and receive frames.
    pub is_up: bool,
    /// Whether the interface supports CAN FD frames.
    pub does_fd: bool,
    /// Bits per second; `None` if the driver has no bit rate, as for a virtual interface.
    pub bitrate: Option<u32>,
    /// Pause in milliseconds after which the controller restarts from bus-off. 0: the controller does not
    /// restart by itself. `None` if the driver does not report the pause.
    pub restart_ms: Option<u32>,
    /// State of the controller as text, for example `stopped`; `None` if the driver does not report the state.
    pub state: Option<&'static str>,
    /// Error counters of the controller: (transmit errors, receive errors). `None` if the driver does not report the
    /// counters.
    pub errors: Option<(u16, u16)>,
}

impl Interface {
    /// Reads the state of the interface with this name.
    ///
    /// # Errors
    /// The interface does not exist, or the kernel does not report its state.
    pub fn query(name: &str) -> Result<Interface, CanFault> {
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

    /// Returns whether the controller, once it is bus-off, stays off the bus until another program restarts it.
    pub fn stays_off(&self) -> bool {
        self.restart_ms == Some(0)
    }
}

const fn state_name(state: CanState) -> &'static str {
    match state {
        CanState::ErrorActive => "well",
        CanState::ErrorWarning => "warning: many errors",
        CanState::ErrorPassive => "passive: too many errors",
        CanState::BusOff => "bus-off: the controller has disconnected itself from the bus",
        CanState::Stopped => "stopped",
        CanState::Sleeping => "asleep",
    }
}

/// State as text, for example `up, 250000 bit/s, restart 100 ms after bus-off, controller well`.
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
            write!(f, ", error counters {sending} (sending) and {receiving} (receiving)")?;
        }
        Ok(())
    }
}
