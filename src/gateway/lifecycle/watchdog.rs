//! Watchdog of the bus lines, in a separate thread. If the task of a line no longer works, the watchdog stops the
//! gateway. If the gateway does not stop, the watchdog ends the process. The watchdog reports to the service manager
//! (systemd) only while the tasks of all lines work.

use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use super::systemd::Report;
use crate::clock::StallDetector;
use crate::fieldbus::line::LONGEST_GATEWAY_WAIT;
use crate::gateway::shared::shared_state::Shared;
use crate::observe::events::Event;
use isotherm_profile::{BusId, Profile};

const LOOK_EVERY: Duration = Duration::from_millis(500);

/// Running watchdog. Dropping it ends the thread.
#[derive(Debug)]
pub(in crate::gateway) struct Watchdog {
    _ends_with_this: Sender<()>,
}

impl Watchdog {
    /// Starts the watchdog for all bus lines. `stop` requests the gateway to stop. The watchdog calls `give_up` if
    /// the gateway has not stopped in time.
    pub(in crate::gateway) fn start(
        shared: Arc<Shared>,
        patience: Option<Duration>,
        stop: impl Fn() + Send + 'static,
        give_up: impl Fn() + Send + 'static,
    ) -> Watchdog {
        let (sender, receiver) = channel();
        let looks =
            |span: Duration| u32::try_from(span.as_millis() / LOOK_EVERY.as_millis()).unwrap_or(u32::MAX);
        let mut lines: Vec<LineObservation> = (0..shared.profile.buses.len())
            .map(|bus| patience.unwrap_or_else(|| limit(&shared.profile, BusId(bus))))
            .map(|limit| LineObservation { turns: 0, looks: 0, most: looks(limit).max(1) })
            .collect();
        let mut own = StallDetector::begin(shared.clock.now(), shared.profile.shortest_age());
        let watch = move || {
            let mut stuck = Duration::ZERO;
            let mut is_reported = false;
            let mut report = Report::begin();
            own.away_for(LOOK_EVERY);
            while receiver.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                let (last, now) = (own.last(), shared.clock.now());
                let gap = own.sample(now);
                own.away_for(LOOK_EVERY);
                if shared.clock.is_virtual() {
                    // Virtual time may be stopped. No line task can act then.
                    if now == last {
                        continue;
                    }
                } else if let Some(since) = gap {
                    shared.stalled_at(since);
                    continue;
                }
                let Some((task, why)) = stuck_task(&shared, &mut lines, &mut stuck) else {
                    report.lives(&shared, LOOK_EVERY);
                    continue;
                };
                if !is_reported {
                    is_reported = true;
                    shared.report(&Event::TaskFailed { task, why: why.to_owned() });
                    stop();
                } else if stuck > Duration::from_secs(10) {
                    give_up();
                }
                stuck += LOOK_EVERY;
            }
        };
        // Without a thread there is no watchdog of the lines. The watchdog of the service manager then detects that.
        let _ = std::thread::Builder::new().name("watch".to_owned()).spawn(watch);
        Watchdog { _ends_with_this: sender }
    }
}

/// Observations of one bus line. The line counts as blocked after a number of checks without progress. The limit is
/// not a time, because a pause of the computer is not a fault of the line.
struct LineObservation {
    turns: u64,
    /// Number of consecutive checks in which the line task has made no progress.
    looks: u32,
    /// Maximum of `looks`. The line counts as blocked if `looks` is larger.
    most: u32,
}

/// Returns a part of the gateway that has not worked for too long, with the cause: the task of a bus line, or the shared
/// state, which a task keeps locked.
fn stuck_task(
    shared: &Shared,
    lines: &mut [LineObservation],
    stuck: &mut Duration,
) -> Option<(String, &'static str)> {
    if !shared.is_free() {
        *stuck += LOOK_EVERY;
        let why = "a task keeps the state of the gateway locked";
        return (*stuck > Duration::from_secs(5)).then(|| ("state".to_owned(), why));
    }
    for (place, seen) in lines.iter_mut().enumerate() {
        let turns = shared.turns(BusId(place));
        seen.looks = if turns == seen.turns { seen.looks.saturating_add(1) } else { 0 };
        seen.turns = turns;
        if seen.looks > seen.most {
            let task = format!("bus {}", shared.profile.bus(BusId(place)).name);
            return Some((task, "the task of this bus has stopped running"));
        }
    }
    *stuck = Duration::ZERO;
    None
}

/// Returns an upper limit for the duration of one cycle of a bus line. The limit includes all pauses, and is
/// valid even if every request opens a connection and times out.
fn limit(profile: &Profile, bus: BusId) -> Duration {
    let devices = profile.devices_on(bus).map(|(_, device)| device);
    let pauses = devices
        .clone()
        .map(|device| device.quirks.pause_after_connect.max(device.quirks.pause_between_requests));
    let longest = devices.clone().map(|device| device.every).max().unwrap_or_default();
    let requests =
        devices.count() + profile.signals.len() + 4 * profile.outputs.len() + 8 * profile.sets.len();
    let requests = u32::try_from(requests).unwrap_or(u32::MAX);
    let request = profile.bus(bus).timeout + pauses.max().unwrap_or_default();
    let has_gateway = profile.devices_on(bus).any(|(device, _)| profile.is_behind_gateway(device));
    let wait = if has_gateway { LONGEST_GATEWAY_WAIT } else { Duration::ZERO };
    Duration::from_secs(5) + wait + longest * 4 + request.saturating_mul(requests.saturating_mul(2))
}
