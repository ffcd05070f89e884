//! The sentence of each event, its word for programs, and its severity.

use std::time::Duration;

use super::{Event, EventDescription, error, info, warning};
use crate::clock::Correction;
use crate::observe::status::DialDirection;
use isotherm_core::compensation::AxisState;
use isotherm_core::explained::Explained;
use isotherm_profile::{counted, duration_text};

/// Hint for a device or line that does not answer, if the fault has no hint of its own.
const DOES_NOT_ANSWER: &str =
    "is it powered, is its cable plugged in? `isotherm check --online` asks it again";
/// Hint for a device whose answers are lost now and then.
const LOSES_ANSWERS: &str =
    "if this happens often, answers are lost: check the cable, the converter and the load of the device";

fn seconds(span: &Duration) -> String {
    duration_text(Duration::from_secs(span.as_secs()))
}

/// Joins the first five names, and adds the number of the others: `a, b, c, d, e and 3 more`.
fn listed(names: &[String]) -> String {
    let named = names.iter().take(5).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(5) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}

impl Event {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Event::Started { machine, bus_requests } => info(
                "started",
                format!("{machine}: the gateway runs, {} per cycle", counted(bus_requests, "read request")),
            ),
            Event::Stopping { holds, within } => {
                let does = if *holds { "the registers keep their values" } else { "the fault actions run" };
                info("stopping", format!("stopping: {does}; this takes at most {}", seconds(within)))
            }
            Event::Stopped { left } => info("stopped", format!("stopped; {left}")),
            Event::LinkDown { bus, address, fault } => {
                warning("link-down", format!("bus {bus} ({address})"), fault.clone().or_hint(DOES_NOT_ANSWER))
            }
            Event::LinkUp { bus, address, attempts } => info(
                "link-up",
                format!("bus {bus} ({address}): connected after {}", counted(attempts, "attempt")),
            ),
            Event::DeviceLost { device, at, fault } => {
                warning("device-lost", format!("device {device}{at}"), fault.clone().or_hint(DOES_NOT_ANSWER))
            }
            Event::DeviceBack { device, at, missed } => info(
                "device-back",
                format!("device {device}{at}: answers again, after {}", counted(missed, "failure")),
            ),
            Event::NotAsExpected { device, found } => {
                let hint = "change the setting at the device, or correct the profile; until then, no axis \
                            that needs the device is armed";
                error("not-as-expected", format!("device {device}"), found.clone().or_hint(hint))
            }
            Event::AsExpected { device } => {
                info("as-expected", format!("device {device}: set as the profile expects it"))
            }
            Event::SignalBad { signal, reason } => {
                let hint = "look at the sensor, its cable and its channel";
                warning("signal-bad", format!("signal {signal}"), reason.clone().or_hint(hint))
            }
            Event::SignalGood { signal, bad_for } => {
                info("signal-good", format!("signal {signal}: good again after {}", seconds(bad_for)))
            }
            Event::Rereferenced { signal, unit, from, to } => warning(
                "rereferenced",
                format!("signal {signal}"),
                Explained::new(
                    format!(
                        "the encoder was re-referenced: {from:.4} {unit} is now {to:.4} {unit}, a step \
                         larger than the axis can move"
                    ),
                    "if the operator has not referenced the axis, check the encoder and its power supply",
                ),
            ),
            Event::AxisState { axis, from, to, why, stopping } => {
                let is_well = *stopping || !matches!(*to, "holding" | "ramping" | "degraded" | "zeroed");
                let [was, is] = [from, to].map(|name| AxisState::display_of(name));
                let about = if from == to { format!("still {is}") } else { format!("{was} → {is}") };
                let about = format!("axis {axis}: {about}");
                if is_well {
                    let why = Some(why.cause.as_str()).filter(|cause| !cause.is_empty()).map(Explained::from);
                    return EventDescription { why, ..info("axis-state", about) };
                }
                let hint = "look at the alarms of the signals, devices and outputs of the axis";
                let why = match why.cause.as_str() {
                    "" => "the cause has already ended".into(),
                    _ => why.clone().or_hint(hint),
                };
                warning("axis-state", about, why)
            }
            Event::Command { command, way, who, answer, .. } => {
                info("command", format!("{command}, {}: {answer}", way.by(who)))
            }
            Event::CommandRefused { command, way, who, why, .. } => {
                warning("command-refused", format!("{command}, {}: refused", way.by(who)), why.clone())
            }
            Event::CommandDropped { command, way, who, why, .. } => warning(
                "command-dropped",
                format!("{command}, {}: not carried out", way.by(who)),
                Explained::new(why, "give the command again"),
            ),
            Event::WaitsToArm { axis, why } => EventDescription {
                why: Some(why.clone()),
                ..info("waits-to-arm", format!("axis {axis}: waiting to arm"))
            },
            Event::ArmEnded { axis, why } => warning(
                "arm-ended",
                format!("axis {axis}: not armed"),
                why.clone().or_hint("arm the axis again if it is needed"),
            ),
            Event::Armed { axis, from, way, who } => {
                info("armed", format!("axis {axis}: armed, starting from {from}, {}", way.by(who)))
            }
            Event::GoesOn { axis, from, .. } => {
                info("goes-on", format!("axis {axis}: armed as before the restart, continuing from {from}"))
            }
            Event::SignChecked { axis, moved, way, who } => {
                let (about, why) = (format!("axis {axis}, {}", way.by(who)), moved.explained(axis));
                match moved {
                    DialDirection::Plus => info("sign-checked", format!("{about}: {why}")),
                    DialDirection::Minus | DialDirection::None => error("sign-checked", about, why),
                }
            }
            Event::SignEnded { axis, why } => warning(
                "sign-ended",
                format!("axis {axis}: the sign check has ended, Cz returns"),
                why.clone().or_hint("check the sign again"),
            ),
            Event::Disarmed { axis, why } => warning(
                "disarmed",
                format!("axis {axis}: off"),
                why.clone().or_hint("arm the axis when the cause is corrected"),
            ),
            Event::ArmRefused { axis, why } => error(
                "arm-refused",
                format!("axis {axis}: cannot be armed"),
                why.clone().or_hint("correct the cause, then arm the axis"),
            ),
            Event::AtLimit { axis, wanted, limit } => warning(
                "at-limit",
                format!("axis {axis}"),
                Explained::new(
                    format!("the model requests {wanted}, held at its limit of ±{limit}"),
                    format!("are its sensors and references right? If they are, raise axis.{axis}.limit"),
                ),
            ),
            Event::Warned { axis, cz, warn } => warning(
                "warned",
                format!("axis {axis}"),
                Explained::new(
                    format!("Cz is {cz}, beyond the warning level of ±{warn}"),
                    "measure a part, and compare the sensors of the axis with each other",
                ),
            ),
            Event::BeyondError { axis, wanted, error: level } => error(
                "beyond-error",
                format!("axis {axis}"),
                Explained::new(
                    format!(
                        "the model requests {wanted}, beyond its error level of ±{level}; the fault action \
                         runs, then the axis is off until it is armed"
                    ),
                    "find the cause, for example a faulty sensor, then arm the axis",
                ),
            ),
            Event::Extrapolating { axis, how } => {
                warning("extrapolating", format!("axis {axis}"), how.clone().or_hint("measure a part"))
            }
            Event::Interpolating { axis } => {
                info("interpolating", format!("axis {axis}: no longer extrapolates"))
            }
            Event::Probed { axis, error, residual, correction } => info(
                "probed",
                format!(
                    "axis {axis}: probed {error}; the model was wrong by {residual}; the correction is \
                     {correction} now"
                ),
            ),
            Event::ProbeRefused { axis, error, why } => {
                let probed = error.map_or("a probing was".to_owned(), |error| format!("probed {error},"));
                let about = format!("axis {axis}: {probed} not used for the correction");
                warning("probe-refused", about, why.clone().or_hint("measure again"))
            }
            Event::ProbeForgotten { axis } => {
                info("probe-forgotten", format!("axis {axis}: the correction from probings is removed"))
            }
            Event::ModelAges { axis, residual, warn } => warning(
                "model-ages",
                format!("axis {axis}"),
                Explained::new(
                    format!("the model was wrong by {residual}, beyond ±{warn}"),
                    "if this happens again, identify the model again",
                ),
            ),
            Event::Saturated { output, wanted } => warning(
                "saturated",
                format!("output {output}"),
                Explained::new(
                    format!("{wanted} is outside the range of the register and was limited"),
                    "check `scale`. If it is right, write to a wider register, or lower the limit of the \
                     axis",
                ),
            ),
            Event::VerifyFailed { output, wrote, found, is_in_a_node } => {
                let hint = match is_in_a_node {
                    true => {
                        "the server answered Good and kept the old value: does another client write the \
                         node, is writing enabled?"
                    }
                    false => {
                        "does another client write the register, does the control accept values now, do \
                         `type` and `scale` fit the register?"
                    }
                };
                let cause = format!("wrote {wrote}, read back {found}");
                error("verify-failed", format!("output {output}"), Explained::new(cause, hint))
            }
            Event::NotApplied { output, stands, applies, register } => error(
                "not-applied",
                format!("output {output}"),
                Explained::new(
                    format!("the register holds {stands}, but the control applies {applies} ({register})"),
                    "is the compensation function on in the control, does it need longer than `settle`?",
                ),
            ),
            Event::WriteFailed { output, fault } => warning(
                "write-failed",
                format!("output {output}: not written"),
                fault.clone().or_hint(DOES_NOT_ANSWER),
            ),
            Event::ReadFailed { output, fault } => warning(
                "read-failed",
                format!("output {output}: the register cannot be read"),
                fault.clone().or_hint(DOES_NOT_ANSWER),
            ),
            Event::HeartbeatFailed { device, place, fault } => warning(
                "heartbeat-failed",
                format!("heartbeat ({place} of {device}): not written"),
                fault.clone().or_hint(DOES_NOT_ANSWER),
            ),
            Event::HeartbeatWritten { device, place } => {
                info("heartbeat-written", format!("heartbeat ({place} of {device}): written again"))
            }
            Event::Verified { output, failures } => info(
                "verified",
                format!("output {output}: written and verified again after {}", counted(failures, "failure")),
            ),
            Event::ForeignChange { output, expected, found } => error(
                "foreign-change",
                format!("output {output}"),
                Explained::new(
                    format!(
                        "the register holds {found}, which this gateway did not write ({expected} expected); \
                         the value is kept"
                    ),
                    "find what changed the offset, correct the value at the control, then arm the axis",
                ),
            ),
            Event::OwnWriteLate { output, value, sent } => warning(
                "own-write-late",
                format!("output {output}"),
                Explained::new(
                    format!(
                        "a write of {value} that the gateway sent at {sent} arrived late; the gateway \
                         continues from this value"
                    ),
                    LOSES_ANSWERS,
                ),
            ),
            Event::PerhapsFromBefore { output, value } => warning(
                "perhaps-from-before",
                format!("output {output}"),
                Explained::new(
                    format!(
                        "the register holds {value}, perhaps a write from before the gateway started; the \
                         gateway continues from this value"
                    ),
                    "if the gateway did not write the value, disarm the axis and correct the value at the \
                     control",
                ),
            ),
            Event::WaitsForLateWrite { output, seconds } => warning(
                "waits-for-late-write",
                format!("output {output}"),
                Explained::new(
                    format!(
                        "waiting for a late write, {seconds} s at most: if it arrived after the next write, \
                         the step could be too large"
                    ),
                    LOSES_ANSWERS,
                ),
            ),
            Event::NotReadBack { output } => info(
                "not-read-back",
                format!("output {output}: acknowledged, not read back: the register cannot be read"),
            ),
            Event::OperatorChange { output, from, to, share } => info(
                "operator-change",
                format!(
                    "output {output}: the operator offset changed from {from} to {to} and is kept; the \
                     gateway share stays {share}"
                ),
            ),
            Event::LedgerOpened { output, base, share } => info(
                "ledger-opened",
                format!("output {output}: {base} are the operator offset, {share} are the gateway share"),
            ),
            Event::FirstAccount { output, holds } => warning(
                "first-account",
                format!("output {output}"),
                Explained::new(
                    format!("the register holds {holds}, and the gateway share in it is not known"),
                    "if the whole value is your own offset, arm the axis; if not, first set the register to \
                     your own offset",
                ),
            ),
            Event::LedgerDoubt { output, why } => error(
                "ledger-doubt",
                format!("output {output}"),
                why.clone().or_hint("set the register to your own offset, then arm the axis"),
            ),
            Event::OutputMoved { why, .. } => error("output-moved", String::new(), why.clone()),
            Event::RegisterLeft { output, register, held, hint } => warning(
                "register-left",
                format!("output {output}"),
                Explained::new(
                    format!(
                        "{held} from the gateway were verified in {register}, which no output uses any more"
                    ),
                    hint.clone(),
                ),
            ),
            Event::RegisterReleased { output, register } => info(
                "register-released",
                format!("output {output}: the former register, {register}, is back at its base value"),
            ),
            Event::PlaceConfirmed { output } => {
                info("place-confirmed", format!("output {output}: the operator has confirmed its place"))
            }
            Event::ReferenceForgotten { why, .. } => {
                warning("reference-forgotten", String::new(), why.clone())
            }
            Event::NamespaceRecorded { bus, index, uri } => {
                info("namespace-recorded", format!("bus {bus}: ns={index} is {uri}, which is remembered"))
            }
            Event::NamespaceMoved { bus, uri, from, to } => warning(
                "namespace-moved",
                format!("bus {bus}"),
                Explained::new(
                    format!(
                        "namespace {uri} is ns={to} at the server, not ns={from}; the gateway uses the nodes \
                         at the new index"
                    ),
                    format!("write nsu={uri};... in place of ns={from};... in the profile"),
                ),
            ),
            Event::PositionFromZero { output } => warning(
                "position-from-zero",
                format!("output {output}"),
                Explained::new(
                    "the Cz of the corrected position was not saved: the output begins at Cz 0",
                    "compare the position at the display with the scale before a part is made",
                ),
            ),
            Event::CncRestarted { output, expected } => warning(
                "cnc-restarted",
                format!("output {output}"),
                Explained::new(
                    format!("the register went from {expected} to zero; the CNC was restarted"),
                    "if the CNC was not restarted, find what sets the register to zero",
                ),
            ),
            Event::TemplateChanged { template, changes } => warning(
                "template-changed",
                String::new(),
                Explained::new(
                    format!("template {template} has changed since the last run: {changes}"),
                    "compare what `isotherm check` prints before the machine makes parts",
                ),
            ),
            Event::CncBooted { device, from, to } => warning(
                "cnc-booted",
                format!("device {device}"),
                Explained::new(
                    format!(
                        "the boot counter went from {from} to {to}: the CNC was restarted; the gateway reads \
                         the registers again"
                    ),
                    "if the operator did not restart the CNC, check its power supply",
                ),
            ),
            Event::Handshake { set, fault, register, cause } => error(
                fault.kind(),
                String::new(),
                Explained::new(fault.sentence(set, register, cause), fault.hint()),
            ),
            Event::NodeReset { device, node, what } => warning(
                "node-reset",
                format!("device {device} (node {node})"),
                Explained::new(
                    what,
                    "if the operator did not cause this, check the power supply and the plug of the node",
                ),
            ),
            Event::Emergency { device, what } => warning(
                "emergency",
                format!("device {device}: emergency"),
                what.clone().or_hint("the manual of the device says what the code means"),
            ),
            Event::EmergencyOver { device, count } => info(
                "emergency-over",
                format!("device {device}: the emergencies have ended, after {}", counted(count, "message")),
            ),
            Event::BusTrouble { bus, address, what } => warning(
                "bus-trouble",
                format!("bus {bus} ({address})"),
                what.clone().or_hint("is the bus terminated at both ends, has every node the same bitrate?"),
            ),
            Event::BusWell { bus, address, count, what, within } => {
                let span = seconds(&(*within).max(Duration::from_secs(1)));
                info("bus-well", format!("bus {bus} ({address}): works again: {count} {what} within {span}"))
            }
            Event::Interlocked { output, when } => info(
                "interlocked",
                format!("output {output}: not written, because its condition is not met: {when}"),
            ),
            Event::Released { output } => info("released", format!("output {output}: interlock released")),
            Event::MachineStarted => info(
                "machine-started",
                "the machine was started: the time since machine start begins".to_owned(),
            ),
            Event::Zeroed => info("zeroed", "zero: references are captured from now on".to_owned()),
            Event::Overrun { bus, what, late } => warning(
                "overrun",
                format!("bus {bus}"),
                Explained::new(
                    format!("the bus is overloaded: {what} was {} ms late", late.as_millis()),
                    "`isotherm check` shows the load of each bus",
                ),
            ),
            Event::PipelineGivenUp { bus, fault } => warning(
                "pipeline-given-up",
                format!("bus {bus}"),
                Explained::new(
                    format!("two requests at a time failed ({fault}); the gateway now sends one at a time"),
                    "remove `pipeline` from the profile",
                ),
            ),
            Event::Subscription { device, what } => warning(
                "subscription",
                format!("device {device}: the subscription"),
                Explained::new(
                    what,
                    "let the server send values as often as `every` says, or write a longer `every`",
                ),
            ),
            Event::StoodStill { span } => warning(
                "stood-still",
                String::new(),
                Explained::new(
                    format!(
                        "this computer stood still for {:.1} s (stopped, suspended or too busy): the gateway \
                         discards the values from before and reads all again",
                        span.as_secs_f64()
                    ),
                    "does another program use the computer, is automatic suspend on? A gateway needs a \
                     computer of its own",
                ),
            ),
            Event::TaskFailed { task, why } => error(
                "task-failed",
                format!("{task} failed"),
                Explained::new(
                    why,
                    "keep the log of this hour and report the failure; restart the gateway if it does not \
                     restart by itself",
                ),
            ),
            Event::ClockSet(Correction { from, to }) => warning(
                "clock-set",
                String::new(),
                Explained::new(
                    format!("the computer's clock was set, from {from} to {to}"),
                    "if the operator did not set the clock, check the time server of this computer",
                ),
            ),
            Event::ClockDoubtful { last } => warning(
                "clock-doubtful",
                String::new(),
                Explained::new(
                    format!(
                        "the computer's clock does not continue from {last}, the newest time stamp in state \
                         and log: the time without measurements is assumed to be long"
                    ),
                    "set the clock; if the time is lost at each start, replace the battery of the clock",
                ),
            ),
            Event::LogsDeleted { names, why } => {
                info("logs-deleted", format!("deleted {}: {why}", listed(names)))
            }
            Event::NotExclusive { why } => warning(
                "not-exclusive",
                String::new(),
                Explained::new(
                    format!(
                        "other gateways on this computer cannot be detected: {why}; a second one could write \
                         to the same registers"
                    ),
                    "make sure that only one gateway writes to each register",
                ),
            ),
            Event::NotKept { what, why } => warning(
                "not-kept",
                format!("{what} cannot be saved"),
                why.clone().or_hint("free space in that directory, or name another one (`--state`)"),
            ),
            Event::NotBelieved { why } => error(
                "not-believed",
                String::new(),
                Explained::new(
                    format!("{why}; every axis is off until the operator arms it"),
                    "compare the registers of the control with what they should hold, then arm the axes",
                ),
            ),
            Event::HandoverRefused { why } => warning(
                "handover-refused",
                String::new(),
                Explained::new(
                    format!("{why}; every axis starts as after a stop"),
                    "arm the axes that are off",
                ),
            ),
            Event::ProfileDiffers { profile, files } => warning(
                "profile-differs",
                String::new(),
                Explained::new(
                    format!(
                        "these files changed after the new program had checked the profile, and are not \
                         used: {}",
                        listed(files)
                    ),
                    format!("to use the changed files: `isotherm restart {profile} --keep`"),
                ),
            ),
            Event::TakenFromEarlier { what, version, kept } => warning(
                "taken-from-earlier",
                String::new(),
                Explained::from(format!(
                    "the {what} of an earlier version of the program (layout {version}) is used; {kept}"
                )),
            ),
            Event::EventsLost { count } => warning(
                "events-lost",
                String::new(),
                Explained::new(
                    format!(
                        "the disk did not save {} in time: the saved events have a gap",
                        counted(count, "event")
                    ),
                    "is the disk full, slow or broken?",
                ),
            ),
            Event::EventsFull { bytes } => warning(
                "events-full",
                String::new(),
                Explained::new(
                    format!(
                        "the file of this day's events is full ({} MB): further events of this day are not \
                         saved",
                        bytes >> 20
                    ),
                    "`isotherm events` shows which events are so frequent",
                ),
            ),
            Event::KeptAgain { what } => info("kept-again", format!("{what} is saved again")),
            Event::StandIn(found) => found.described(),
            Event::Comparison(found) => found.described(),
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
mod tests;
