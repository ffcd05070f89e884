//! Options of a gateway that are not in its profile.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use super::handover::Handover;
use super::learner::LearnCommand;
use crate::fieldbus::connection::Dial;
use crate::fieldbus::dial;
use crate::gateway::store::disk::{Disk, Files};
use crate::observe::events::{EventListener, LoggedText};
use crate::observe::status::{BrokerFigures, ProfileChanges};
use isotherm_profile::Bus;

/// Function that creates the connection of a bus. It returns `None` for a bus that needs no connection.
pub type Dialer = Arc<dyn Fn(&Bus) -> Option<Box<dyn Dial>> + Send + Sync>;

/// Settings of a gateway that are not in its profile, for example directories, threads and interfaces that tests
/// replace.
pub struct Options {
    /// Whether the gateway only reads, calculates and shows values, and writes nothing to a device.
    pub dry_run: bool,
    /// Directory of state and logs; with `None`, nothing is stored. The caller must then ensure that no write of an
    /// earlier run can still arrive at a register.
    pub directory: Option<PathBuf>,
    /// State directory of another, running gateway. Only its saved OPC UA namespaces are read, and nothing is written
    /// there.
    pub remembered_in: Option<PathBuf>,
    /// File system in which the state is stored.
    pub disk: Arc<dyn Disk>,
    /// Whether threads write the logs and watch the lines. Without threads there is neither log nor watchdog, and a
    /// simulation gives the same result in each run.
    pub has_threads: bool,
    /// Function that creates the connections. Tests replace it.
    pub dialer: Dialer,
    /// Maximum time without an action of a line task, before the watchdog stops the gateway. With `None`, the time
    /// results from the timeouts of the line.
    pub watch: Option<Duration>,
    /// Period of all polls and of all axes, instead of the periods of the profile. A test bench is often faster than a
    /// profile permits.
    pub pace: Option<Pace>,
    /// Whether readings get the time of their answers instead of that of their requests. Tests use this wrong time to
    /// show why the time of the request is correct.
    #[doc(hidden)]
    pub is_unchecked: bool,
    /// Figures about publishing to an MQTT broker; `None` without a broker.
    pub broker: Option<Arc<BrokerFigures>>,
    /// Files of the profile that have changed on disk. Empty if no task compares the files.
    pub profile_changes: Arc<ProfileChanges>,
    /// Receiver of every event since the start; `None` if no program receives the events.
    pub listener: Option<EventListener>,
    /// Text of events in the log of the program: with or without the hint to the operator.
    pub logged_text: LoggedText,
    /// Handover from the previous program in the same process, or the reason why it is rejected. `Ok(None)` after an
    /// ordinary start.
    pub handover: Result<Option<Handover>, String>,
    /// Program that learns the models of the axes once a day; `None` if no program learns.
    pub learn: Option<LearnCommand>,
    /// Whether released registers may be moved to their base values. The error is the reason why not.
    pub may_release: Result<(), String>,
    /// Function that ends the process. The watchdog calls it if a blocked gateway cannot even stop.
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
            profile_changes: Arc::default(),
            listener: None,
            logged_text: LoggedText::default(),
            handover: Ok(None),
            learn: None,
            may_release: Ok(()),
            give_up: Arc::new(|| {}),
        }
    }
}

/// Periods that replace the periods in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    /// Period in which each device is polled.
    pub polls: Duration,
    /// Period in which each axis is calculated.
    pub axes: Duration,
}
