//! Options of a gateway.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use super::handover::Handover;
use crate::fieldbus::connection::Dial;
use crate::fieldbus::dial;
use crate::gateway::store::disk::{Disk, Files};
use crate::observe::events::EventListener;
use crate::observe::status::BrokerFigures;
use isotherm_profile::Bus;

/// Function that creates the connection of a bus.
pub type Dialer = Arc<dyn Fn(&Bus) -> Option<Box<dyn Dial>> + Send + Sync>;

/// Options of a gateway.
pub struct Options {
    /// Reads, computes and shows, but writes nothing.
    pub dry_run: bool,
    /// Directory of state and log; `None` keeps neither. Without it, the caller must ensure that no write of an earlier
    /// run can still arrive at a register.
    pub directory: Option<PathBuf>,
    /// State directory of a gateway that runs elsewhere. Its stored namespaces of servers are used. Nothing is written
    /// there.
    pub remembered_in: Option<PathBuf>,
    /// Access to the state in the directory.
    pub disk: Arc<dyn Disk>,
    /// Disk and watch have threads of their own. Without threads there is no watch and no log. Everything then runs in
    /// one runtime, and a simulation repeats bit for bit.
    pub has_threads: bool,
    /// Function that creates connections. Tests use another one than the default.
    pub dialer: Dialer,
    /// Maximum time without an action of a line task, before the watchdog stops the gateway. `None`: derived from the
    /// timeouts of the line. Tests set a short time.
    pub watch: Option<Duration>,
    /// Period of all polls and axes, independent of the profile. A bench is often faster than a profile may be.
    pub pace: Option<Pace>,
    /// Readings get the time of their answers, instead of that of their requests. Tests use it to show why the rule
    /// exists.
    #[doc(hidden)]
    pub is_unchecked: bool,
    /// State of publishing to a broker; `None` without one.
    pub broker: Option<Arc<BrokerFigures>>,
    /// Receiver of every event from the first on; `None` without one.
    pub listener: Option<EventListener>,
    /// Handover of the program before this one in the same process, or why it is rejected. `None` after an ordinary
    /// start.
    pub handover: Result<Option<Handover>, String>,
    /// Whether released registers may be moved, or why not.
    pub may_release: Result<(), String>,
    /// Callback if a stuck gateway cannot even stop.
    pub give_up: Arc<dyn Fn() + Send + Sync>,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            dry_run: false,
            directory: None,
            remembered_in: None,
            disk: Arc::new(Files),
            has_threads: true,
            dialer: Arc::new(dial),
            watch: None,
            pace: None,
            is_unchecked: false,
            broker: None,
            listener: None,
            handover: Ok(None),
            may_release: Ok(()),
            give_up: Arc::new(|| {}),
        }
    }
}

/// Periods of a gateway that replace those of the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    /// Period of every device's polls.
    pub polls: Duration,
    /// Period of every axis.
    pub axes: Duration,
}
