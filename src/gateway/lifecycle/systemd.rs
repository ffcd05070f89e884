//! Notifications to the service manager (systemd): the readiness of the gateway, its status text, and the
//! maximum remaining time of a stop. Without a service manager, nothing is sent.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

use sd_notify::NotifyState;

use crate::gateway::shared::shared_state::Shared;
use isotherm_core::compensation::AxisState;
use isotherm_profile::BusId;

/// Maximum wait for bus lines that have not yet tried to open their connection. After this time, the gateway reports
/// readiness without them.
const OPENING: Duration = Duration::from_secs(10);
/// Time that is added to the reported duration of a stop, because the last save may wait for the disk.
const LAST_WORDS: Duration = Duration::from_secs(10);
/// Maximum number of axes or devices that the systemd status text lists by name.
const NAMED: usize = 5;

/// State of the notifications: readiness, and the status text that was sent last.
#[derive(Debug)]
pub(in crate::gateway) struct Report {
    /// Whether a service manager has asked for notifications.
    is_received: bool,
    is_ready: bool,
    waited: Duration,
    status: String,
}

impl Report {
    pub(in crate::gateway) fn begin() -> Report {
        let is_received = std::env::var_os("NOTIFY_SOCKET").is_some();
        Report { is_received, is_ready: false, waited: Duration::ZERO, status: String::new() }
    }

    /// Reports that the tasks of all bus lines work. The watchdog calls this function regularly. `after` is the time
    /// since the last call.
    pub(in crate::gateway) fn lives(&mut self, shared: &Shared, after: Duration) {
        if !self.is_received {
            return;
        }
        tell(&[NotifyState::Watchdog]);
        self.waited += after;
        let status = in_words(shared);
        let is_new = status.as_ref().is_some_and(|status| *status != self.status);
        self.status = status.unwrap_or_default();
        if !self.is_ready && (self.waited >= OPENING || are_tried(shared)) {
            // The service manager waits for this: a lost notification is sent again.
            self.is_ready = tell(&[NotifyState::Ready, NotifyState::Status(&self.status)]);
        } else if is_new {
            tell(&[NotifyState::Status(&self.status)]);
        }
    }
}

/// Reports that the gateway stops. `does` is a text about the kind of stop, and `within` is its maximum duration.
pub(in crate::gateway) fn stopping(does: &str, within: Duration) {
    tell(&[NotifyState::Stopping, NotifyState::Status(does)]);
    takes(within);
}

/// Reports the maximum remaining time of the current operation. The service manager then does not kill the process
/// before this time.
pub(in crate::gateway) fn takes(within: Duration) {
    let micros = within.saturating_add(LAST_WORDS).as_micros();
    tell(&[NotifyState::Custom(&format!("EXTEND_TIMEOUT_USEC={micros}"))]);
}

/// Reports that another program replaces this program in the same process. The other program then reports when it is
/// ready.
pub(in crate::gateway) fn reloading(does: &str) {
    let mut states = vec![NotifyState::Reloading, NotifyState::Status(does)];
    states.extend(NotifyState::monotonic_usec_now());
    tell(&states);
}

/// Sends notifications. Returns whether they were delivered. (`sd_notify::notify` would block while the service manager
/// does not read; the gateway must not block.)
fn tell(states: &[NotifyState<'_>]) -> bool {
    let said: String = states.iter().map(|state| format!("{state}\n")).collect();
    std::env::var_os("NOTIFY_SOCKET").is_some_and(|to| send(&to, &said).is_ok())
}

fn send(to: &OsStr, said: &str) -> io::Result<()> {
    let address = match to.as_bytes() {
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
        _ => SocketAddr::from_pathname(to)?,
    };
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    socket.send_to_addr(said.as_bytes(), &address).map(|_| ())
}

/// Returns whether each bus line has opened its connection, or has tried to open it. A missing device does not delay
/// the readiness of the gateway.
fn are_tried(shared: &Shared) -> bool {
    let profile = &shared.profile;
    let core = shared.core();
    (0..profile.buses.len()).map(BusId).all(|bus| {
        let count = &core.device_health.buses[bus.0];
        let mut devices = profile.devices_on(bus).map(|(id, _)| &core.device_health.devices[id.0]);
        count.connected || count.down.is_some() || devices.any(|one| one.requests > 0 || one.answered)
    })
}

/// Returns the status text: what the axes do, and which devices do not answer. `None` during a stop, which has its own
/// text.
fn in_words(shared: &Shared) -> Option<String> {
    let profile = &shared.profile;
    let core = shared.core();
    if core.phase.is_stopping() {
        return None;
    }
    let mut states: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (place, axis) in profile.axes.iter().enumerate() {
        let state = core.compensation.decision(place).map_or(AxisState::Off, |decision| decision.state);
        let intent = core.arming[place].intent(profile, place);
        let display = core.outputs.display(place, (state, intent), (&core.device_health, shared.dry_run));
        states.entry(display.words()).or_default().push(&axis.settings.name);
    }
    let is_lost = |place: &usize| !core.device_health.devices[*place].is_here();
    let lost: Vec<&str> = (0..profile.devices.len())
        .filter(is_lost)
        .map(|place| profile.devices[place].name.as_str())
        .collect();
    let mut words: Vec<String> =
        states.iter().map(|(state, axes)| format!("{} {state}", listed(axes))).collect();
    if !lost.is_empty() {
        words.push(format!("no answer from {}", listed(&lost)));
    }
    Some(if shared.dry_run { format!("dry run: {}", words.join("; ")) } else { words.join("; ") })
}

fn listed(names: &[&str]) -> String {
    let named = names.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(NAMED) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manager_that_does_not_listen_is_waited_for_by_nobody() {
        let directory = tempfile::tempdir().unwrap();
        let at = directory.path().join("notify");
        let manager = UnixDatagram::bind(&at).unwrap();
        let refused = (0..1000).map(|_| send(at.as_os_str(), "WATCHDOG=1\n")).find_map(Result::err);
        assert_eq!(refused.map(|why| why.kind()), Some(io::ErrorKind::WouldBlock));
        let mut heard = [0; 32];
        let long = manager.recv(&mut heard).unwrap();
        assert_eq!(&heard[..long], b"WATCHDOG=1\n");
        send(at.as_os_str(), "READY=1\n").unwrap();
        drop(manager);
        assert!(send(at.as_os_str(), "READY=1\n").is_err());
    }
}
