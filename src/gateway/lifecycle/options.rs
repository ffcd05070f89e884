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
    /// Whether this is a dry run: the gateway reads, calculates and shows values, but writes nothing to a device.
    pub dry_run: bool,
    /// Directory of state and logs; with `None`, the gateway stores nothing. The caller must then ensure that a late
    /// write of an earlier run can no longer reach a register.
    pub directory: Option<PathBuf>,
    /// State directory of another gateway that is running. This gateway only reads the saved OPC UA namespaces in it,
    /// and writes nothing to it.
    pub remembered_in: Option<PathBuf>,
    /// File system in which the state is stored.
    pub disk: Arc<dyn Disk>,
    /// Whether threads write the logs and watch the bus lines. Without these threads, there is no log and no
    /// watchdog, and a simulation gives the same result in each run.
    pub has_threads: bool,
    /// Function that creates the connection of each bus. Tests pass a function of their own.
    pub dialer: Dialer,
    /// Maximum time without progress of the task of a bus line. After this time, the watchdog stops the gateway. With
    /// `None`, the time is calculated from the timeouts of the bus.
    pub watch: Option<Duration>,
    /// Periods that replace all periods of polls and axes in the profile. On a test bench, they may be shorter than a
    /// profile permits.
    pub pace: Option<Pace>,
    /// Whether a reading gets the time of the answer, in place of the time of the request. The time of the answer is
    /// wrong; tests use this option to show the resulting error.
    #[doc(hidden)]
    pub is_unchecked: bool,
    /// Figures about the messages that are published to an MQTT broker; `None` without a broker.
    pub broker: Option<Arc<BrokerFigures>>,
    /// Files of the profile that have changed on disk. Empty if no task checks the files for changes.
    pub profile_changes: Arc<ProfileChanges>,
    /// Receiver of every event since the start; `None` if no program receives the events.
    pub listener: Option<EventListener>,
    /// Whether the log of the program shows an event with or without the hint to the operator.
    pub logged_text: LoggedText,
    /// Handover from the previous program in the same process, or the reason why it is rejected. `Ok(None)` after an
    /// ordinary start.
    pub handover: Result<Option<Handover>, String>,
    /// Program that learns the models of the axes once a day; `None` if no program learns.
    pub learn: Option<LearnCommand>,
    /// Whether the gateway may move released registers to their base values. If not, the error is the reason.
    pub may_release: Result<(), String>,
    /// Function that ends the process. The watchdog calls it if the gateway is blocked and cannot stop in the usual
    /// way.
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
