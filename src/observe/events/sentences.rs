//! The sentence of each event, its word for programs, and how much it matters.

use std::time::Duration;

use super::{Described, Event, Level, error, info, warning};
use crate::clock::Correction;
use crate::observe::status::Moved;
use isotherm_core::compensation::AxisState;
use isotherm_profile::{counted, duration_text};

fn seconds(span: &Duration) -> String {
    duration_text(Duration::from_secs(span.as_secs()))
}

/// A few of them by name, the others by their number.
fn listed(names: &[String]) -> String {
    let named = names.iter().take(5).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(5) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}

impl Event {
    pub(super) fn described(&self) -> Described {
        match self {
            Event::Started { machine, bus_requests } => info(
                "started",
                format!("{machine}: the gateway runs, {} a round", counted(bus_requests, "read request")),
            ),
            Event::Stopping { holds, within } => {
                let does = if *holds { "the registers keep what they hold" } else { "the fault actions run" };
                info("stopping", format!("stopping: {does}, at most {}", seconds(within)))
            }
            Event::Stopped { left } => info("stopped", format!("stopped; {left}")),
            Event::LinkDown { bus, address, fault } => {
                warning("link-down", format!("bus {bus} ({address}): {fault}"))
            }
            Event::LinkUp { bus, address, attempts } => info(
                "link-up",
                format!("bus {bus} ({address}): connected after {}", counted(attempts, "attempt")),
            ),
            Event::DeviceLost { device, at, fault } => {
                warning("device-lost", format!("device {device}{at}: {fault}"))
            }
            Event::DeviceBack { device, at, missed } => info(
                "device-back",
                format!(
                    "device {device}{at}: is there again, {} since it was lost",
                    counted(missed, "failure")
                ),
            ),
            Event::NotAsExpected { device, found } => {
                error("not-as-expected", format!("device {device}: {found}"))
            }
            Event::AsExpected { device } => {
                info("as-expected", format!("device {device}: set as the profile expects it"))
            }
            Event::SignalBad { signal, reason } => {
                warning("signal-bad", format!("signal {signal}: {reason}"))
            }
            Event::SignalGood { signal, bad_for } => {
                info("signal-good", format!("signal {signal}: good again after {}", seconds(bad_for)))
            }
            Event::Rereferenced { signal, unit, from, to } => warning(
                "rereferenced",
                format!(
                    "signal {signal}: re-referenced, {from:.4} {unit} is {to:.4} {unit} now; a step that the axis \
                     cannot make is no motion"
                ),
            ),
            Event::AxisState { axis, from, to, why, stopping } => {
                let is_well = *stopping || !matches!(*to, "holding" | "ramping" | "degraded" | "zeroed");
                let [from, to] = [from, to].map(|name| AxisState::display_of(name));
                let why = if why.is_empty() { String::new() } else { format!(": {why}") };
                let level = if is_well { Level::Info } else { Level::Warning };
                ("axis-state", level, format!("axis {axis}: {from} → {to}{why}"))
            }
            Event::Command { command, way, who, answer, .. } => {
                info("command", format!("{command}, {}: {answer}", way.by(who)))
            }
            Event::CommandRefused { command, way, who, why, .. } => {
                warning("command-refused", format!("{command}, {}: refused: {why}", way.by(who)))
            }
            Event::CommandDropped { command, way, who, why, .. } => warning(
                "command-dropped",
                format!("{command}, {}: not done, and never will be: {why}", way.by(who)),
            ),
            Event::WaitsToArm { axis, why } => {
                info("waits-to-arm", format!("axis {axis}: waiting to arm: {why}"))
            }
            Event::ArmEnded { axis, why } => warning("arm-ended", format!("axis {axis}: not armed: {why}")),
            Event::Armed { axis, from, way, who } => {
                info("armed", format!("axis {axis}: armed, starting from {from}, {}", way.by(who)))
            }
            Event::GoesOn { axis, from, .. } => {
                info("goes-on", format!("axis {axis}: armed as before the restart, going on from {from}"))
            }
            Event::SignChecked { axis, moved, way, who } => {
                let text = format!("axis {axis}: {} ({})", moved.sentence(axis), way.by(who));
                if *moved == Moved::Plus { info("sign-checked", text) } else { error("sign-checked", text) }
            }
            Event::SignEnded { axis, why } => {
                warning("sign-ended", format!("axis {axis}: its sign check is over, Cz goes back: {why}"))
            }
            Event::Disarmed { axis, why } => warning("disarmed", format!("axis {axis}: off: {why}")),
            Event::ArmRefused { axis, why } => {
                error("arm-refused", format!("axis {axis}: cannot be armed: {why}"))
            }
            Event::AtLimit { axis, wanted, limit } => warning(
                "at-limit",
                format!("axis {axis}: the model asks for {wanted}, held at its limit of ±{limit}"),
            ),
            Event::Warned { axis, cz, warn } => {
                warning("warned", format!("axis {axis}: Cz is {cz}, beyond its warning level of ±{warn}"))
            }
            Event::BeyondError { axis, wanted, error: level } => error(
                "beyond-error",
                format!(
                    "axis {axis}: the model asks for {wanted}, beyond its error level of ±{level}; the fault action \
                     runs, and it stays off until it is armed"
                ),
            ),
            Event::Extrapolating { axis, how } => warning("extrapolating", format!("axis {axis}: {how}")),
            Event::Interpolating { axis } => {
                info("interpolating", format!("axis {axis}: extrapolates no more"))
            }
            Event::Probed { axis, error, residual, correction } => info(
                "probed",
                format!(
                    "axis {axis}: probed {error}; the model was wrong by {residual}, its correction is {correction} \
                     now"
                ),
            ),
            Event::ProbeRefused { axis, error: Some(error), why } => {
                warning("probe-refused", format!("axis {axis}: probed {error}, not learned from: {why}"))
            }
            Event::ProbeRefused { axis, error: None, why } => {
                warning("probe-refused", format!("axis {axis}: a probing is not learned from: {why}"))
            }
            Event::ProbeForgotten { axis } => {
                info("probe-forgotten", format!("axis {axis}: what probings have taught is taken back"))
            }
            Event::ModelAges { axis, residual, warn } => warning(
                "model-ages",
                format!(
                    "axis {axis}: the model was wrong by {residual}, beyond ±{warn}; where that repeats, identify it \
                     anew"
                ),
            ),
            Event::Saturated { output, wanted } => warning(
                "saturated",
                format!("output {output}: {wanted} does not fit the register and was cut"),
            ),
            Event::VerifyFailed { output, wrote, found, is_in_a_node } => {
                let why = match is_in_a_node {
                    true => {
                        ": the server said Good and kept the old value: does something else write it, is writing \
                         released?"
                    }
                    false => "",
                };
                error("verify-failed", format!("output {output}: wrote {wrote}, read back {found}{why}"))
            }
            Event::NotApplied { output, stands, applies, register } => error(
                "not-applied",
                format!(
                    "output {output}: {stands} stand in its register, the control applies {applies} ({register})"
                ),
            ),
            Event::WriteFailed { output, fault } => {
                warning("write-failed", format!("output {output}: not written: {}", fault.cause))
            }
            Event::ReadFailed { output, fault } => warning(
                "read-failed",
                format!("output {output}: its register cannot be read: {}", fault.cause),
            ),
            Event::HeartbeatFailed { device, place, fault } => {
                warning("heartbeat-failed", format!("heartbeat ({place} of {device}): not written: {fault}"))
            }
            Event::HeartbeatWritten { device, place } => {
                info("heartbeat-written", format!("heartbeat ({place} of {device}): written again"))
            }
            Event::Verified { output, failures } => info(
                "verified",
                format!("output {output}: written and verified again after {}", counted(failures, "failure")),
            ),
            Event::ForeignChange { output, expected, found } => error(
                "foreign-change",
                format!("output {output}: somebody else wrote {found} where {expected} stood; left alone"),
            ),
            Event::OwnWriteLate { output, value, sent } => warning(
                "own-write-late",
                format!(
                    "output {output}: our own write of {value} from {sent} arrived late; going on from there"
                ),
            ),
            Event::PerhapsFromBefore { output, value } => warning(
                "perhaps-from-before",
                format!(
                    "output {output}: {value} appeared, perhaps our own from before the start; going on from there"
                ),
            ),
            Event::WaitsForLateWrite { output, seconds } => warning(
                "waits-for-late-write",
                format!(
                    "output {output}: waiting for a late write, {seconds} s at most: until then the next step could \
                     be more than one from it"
                ),
            ),
            Event::NotReadBack { output } => info(
                "not-read-back",
                format!("output {output}: acknowledged, not read back: its register cannot be read"),
            ),
            Event::OperatorChange { output, from, to, share } => info(
                "operator-change",
                format!(
                    "output {output}: the operator's part went from {from} to {to}; kept, our share stays {share}"
                ),
            ),
            Event::LedgerOpened { output, base, share } => info(
                "ledger-opened",
                format!("output {output}: {base} in its register are the operator's, {share} are ours"),
            ),
            Event::FirstAccount { output, holds } => warning(
                "first-account",
                format!(
                    "output {output}: its register holds {holds}, and nothing of ours is known in it: if all of that \
                     is your own value, arm the axis; if not, make it your own value first"
                ),
            ),
            Event::LedgerDoubt { output, why } => error("ledger-doubt", format!("output {output}: {why}")),
            Event::CncRestarted { output, expected } => warning(
                "cnc-restarted",
                format!("output {output}: back at zero where {expected} stood; the CNC was restarted"),
            ),
            Event::TemplateChanged { template, changes } => warning(
                "template-changed",
                format!("template {template} is not as it was in the last run: {changes}"),
            ),
            Event::CncBooted { device, from, to } => warning(
                "cnc-booted",
                format!(
                    "device {device}: its boot counter went from {from} to {to}; the CNC was restarted, its registers \
                     are read anew"
                ),
            ),
            Event::Handshake { set, fault, register, cause } => {
                error(fault.kind(), fault.sentence(set, register, cause))
            }
            Event::NodeReset { device, node, what } => {
                warning("node-reset", format!("device {device} (node {node}): {what}"))
            }
            Event::Emergency { device, what } => {
                warning("emergency", format!("device {device}: emergency: {what}"))
            }
            Event::EmergencyOver { device, count } => info(
                "emergency-over",
                format!("device {device}: its emergencies are over, {} came", counted(count, "message")),
            ),
            Event::BusTrouble { bus, address, what } => {
                warning("bus-trouble", format!("bus {bus} ({address}): {what}"))
            }
            Event::BusWell { bus, address, count, what, within } => {
                let span = seconds(&(*within).max(Duration::from_secs(1)));
                info("bus-well", format!("bus {bus} ({address}): well again: {count} {what} within {span}"))
            }
            Event::Interlocked { output, when } => {
                info("interlocked", format!("output {output}: held, because not {when}"))
            }
            Event::Released { output } => info("released", format!("output {output}: interlock released")),
            Event::MachineStarted => info(
                "machine-started",
                "the machine was started: the time since machine start begins".to_owned(),
            ),
            Event::Zeroed => info("zeroed", "zero: references are captured from now on".to_owned()),
            Event::Overrun { bus, what, late } => warning(
                "overrun",
                format!(
                    "bus {bus}: more is asked of it than it can carry: {what} was {} ms late; `isotherm check` shows \
                     the load of each line",
                    late.as_millis()
                ),
            ),
            Event::PipelineGivenUp { bus, fault } => warning(
                "pipeline-given-up",
                format!(
                    "bus {bus}: two questions at a time did not do ({fault}); one at a time from now on: remove `pipeline` \
                     from the profile"
                ),
            ),
            Event::Subscription { device, what } => {
                warning("subscription", format!("device {device}: its subscription: {what}"))
            }
            Event::StoodStill { span } => warning(
                "stood-still",
                format!(
                    "this computer stood still for {:.1} s (stopped, suspended or too busy): nothing from before is \
                     used, and everything is read again",
                    span.as_secs_f64()
                ),
            ),
            Event::TaskFailed { task, why } => error("task-failed", format!("{task} failed: {why}")),
            Event::ClockSet(Correction { from, to }) => {
                warning("clock-set", format!("the computer's clock was set, from {from} to {to}"))
            }
            Event::ClockDoubtful { last } => warning(
                "clock-doubtful",
                format!(
                    "the computer's clock does not go on from {last}, the newest stamp in state and log: how long nothing \
                     was measured is not known, and it is taken for long"
                ),
            ),
            Event::LogsDeleted { names, why } => {
                info("logs-deleted", format!("deleted {}: {why}", listed(names)))
            }
            Event::NotExclusive { why } => warning(
                "not-exclusive",
                format!(
                    "other gateways of this computer cannot be seen: {why}; one that writes to the same registers would not be \
                     refused"
                ),
            ),
            Event::NotKept { what, why } => warning("not-kept", format!("{what} cannot be kept: {why}")),
            Event::NotBelieved { why } => {
                error("not-believed", format!("{why}; every axis is off until a person arms it"))
            }
            Event::HandoverRefused { why } => warning(
                "handover-refused",
                format!("{why}; every axis starts as after a stop: arm those that are off"),
            ),
            Event::ProfileDiffers { profile, files } => warning(
                "profile-differs",
                format!(
                    "changed after the new program had checked the profile, and not used: {}; to use what is there now: \
                     `isotherm restart {profile} --keep`",
                    listed(files)
                ),
            ),
            Event::TakenFromEarlier { what, version, kept } => warning(
                "taken-from-earlier",
                format!("the {what} of an earlier version of the program (layout {version}) is used; {kept}"),
            ),
            Event::EventsLost { count } => warning(
                "events-lost",
                format!("the disk did not keep {} in time: what is kept has a gap", counted(count, "event")),
            ),
            Event::EventsFull { bytes } => warning(
                "events-full",
                format!(
                    "the file of this day's events is full ({} MB): no more of them are kept",
                    bytes >> 20
                ),
            ),
            Event::KeptAgain { what } => info("kept-again", format!("{what} is kept again")),
            Event::StandIn(found) => found.described(),
            Event::Page(port) => port.described(),
            Event::Token(token) => token.described(),
            Event::Broker(broker) => broker.described(),
            Event::Delivery(delivery) => delivery.described(),
            #[cfg(feature = "opcua")]
            Event::Certificate(expiry) => expiry.described(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::events::{Broker, Delivery};

    /// Every event that counts something, which is one.
    fn of_one() -> Vec<Event> {
        let text = String::new;
        vec![
            Event::Started { machine: text(), bus_requests: 1 },
            Event::LinkUp { bus: text(), address: text(), attempts: 1 },
            Event::DeviceBack { device: text(), at: text(), missed: 1 },
            Event::Verified { output: text(), failures: 1 },
            Event::EmergencyOver { device: text(), count: 1 },
            Event::EventsLost { count: 1 },
            Event::Broker(Broker::Up { broker: text(), attempts: 1 }),
            Event::Broker(Broker::Dropped { broker: text(), count: 1 }),
            Event::Delivery(Delivery::Back { notify: text(), to: text(), attempts: 1 }),
            Event::Delivery(Delivery::Dropped { notify: text(), to: text(), count: 1 }),
        ]
    }

    #[test]
    fn one_of_something_has_no_plural() {
        for event in of_one() {
            let (kind, _, text) = event.described();
            let (_, after) = text.split_once("1 ").unwrap_or_else(|| panic!("{kind}: {text}"));
            let noun = after.split([' ', ';', ':', ',']).find(|word| !matches!(*word, "read" | "wrong"));
            assert!(noun.is_some_and(|noun| !noun.ends_with('s')), "{kind}: {text}");
        }
    }

    #[test]
    fn days_stand_apart_from_their_number() {
        let event = Event::SignalGood { signal: "bed".into(), bad_for: Duration::from_secs(9 * 86_400 + 60) };
        assert_eq!(event.described().2, "signal bed: good again after 9 days 1m");
    }
}
