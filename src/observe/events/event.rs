//! Events of the gateway. Each event has fields, which are its data for programs, and a sentence for people. The
//! catalogue [`isotherm_core::events`] contains the level, the alarms and the hint of each event.

use std::time::Duration;

use serde::Serialize;

use super::adoption::Adoption;
use super::broker::Broker;
#[cfg(feature = "opcua")]
use super::certificate::{EarlyCertificate, Expiry};
use super::comparison::Comparison;
use super::data::{both_in_text, in_seconds, in_text};
use super::delivery::Delivery;
use super::description::{EventDescription, Sentence, caused, hint_with, plain};
use super::opcua_server::OpcUaServerEvent;
use super::page::{PagePort, PageToken};
use super::stand_in::StandIn;
use crate::clock::Correction;
use crate::observe::requester::Channel;
use crate::observe::status::DialDirection;
use isotherm_core::compensation::AxisState;
use isotherm_core::events::EventKind;
use isotherm_core::explained::Explained;
use isotherm_core::output::HandshakeFault;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{counted, duration_text};

/// Hint about an OPC UA node that still has its old value after a write.
const NODE_KEEPS_VALUE: &str = "the server answered Good, but kept the old value: check whether another \
                                client writes the node, and whether writing is enabled";

fn seconds(span: &Duration) -> String {
    duration_text(Duration::from_secs(span.as_secs()))
}

/// Formats a measured duration in tenths of a second, for example `1 s` or `0.8 s`.
fn about(span: Duration) -> String {
    let tenths = (span.as_secs_f64() * 10.0).round();
    format!("{} s", tenths / 10.0)
}

/// Joins the first five names, and adds the number of the remaining names, for example `a, b, c, d, e and 3 more`.
fn listed(names: &[String]) -> String {
    let named = names.iter().take(5).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(5) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}

/// Kind of an event variant. By default, the kind has the same name as the variant.
macro_rules! kind {
    ($name:ident) => {
        EventKind::$name
    };
    ($name:ident $kind:expr) => {
        $kind
    };
}

/// Declaration of the events: each variant with its fields and its sentence. A variant below `parts` has a separate
/// type for its fields.
macro_rules! events {
    (
        $(#[$outer:meta])*
        pub enum $event:ident {
            $(
                $name:ident $({ $($(#[$on_field:meta])* $field:ident: $type:ty),+ $(,)? })? $(as $kind:expr)?
                    => $sentence:expr;
            )+
        }
        parts {
            $($(#[$on_part:meta])* $part:ident($(#[$on_type:meta])* $of:ty) as $is:ident => $described:expr;)+
        }
    ) => {
        $(#[$outer])*
        pub enum $event {
            $($name $({ $($(#[$on_field])* $field: $type),+ })?,)+
            $($(#[$on_part])* $part($(#[$on_type])* $of),)+
        }

        impl $event {
            /// Returns kind, level and sentence of the event.
            #[allow(unused_variables, reason = "a sentence does not contain every field")]
            pub(super) fn described(&self) -> EventDescription {
                match self {
                    $($event::$name $({ $($field),+ })? => Sentence::of($sentence, kind!($name $($kind)?)),)+
                    $($(#[$on_part])* $event::$part($is) => $described,)+
                }
            }
        }
    };
}

events! {
    /// Event of the gateway. The fields use the names of the profile. For programs, the fields are the data
    /// of the event.
    #[derive(Clone, Debug, PartialEq, Serialize)]
    #[serde(untagged)]
    #[allow(
        missing_docs,
        reason = "the catalogue describes each kind; each field is a name of the profile, or a figure in its unit"
    )]
    pub enum Event {
        Started { machine: String, bus_requests: usize } => plain(
            format!("{machine}: the gateway runs, {} per cycle", counted(bus_requests, "read request"))
        );
        Stopping {
            holds: bool,
            #[serde(rename = "within_s", serialize_with = "in_seconds")]
            within: Duration,
        } => {
            let does = if *holds { "the registers keep their values" } else { "the fault actions run" };
            plain(format!("stopping: {does}; this takes at most {}", seconds(within)))
        };
        // `left`: values that stay in the registers.
        Stopped { left: String } => plain(format!("stopped; {left}"));
        LinkDown {
            bus: String,
            address: String,
            fault: Explained,
            /// Whether the power supply and the cable of the device are certainly not the cause. The hint of
            /// the catalogue names both, and is then omitted.
            #[serde(skip)]
            excludes_wiring: bool,
        } => {
            let sentence = caused(format!("bus {bus} ({address})"), fault.clone());
            if *excludes_wiring { sentence.without_hint() } else { sentence }
        };
        LinkUp { bus: String, address: String, attempts: u64 } =>
            plain(format!("bus {bus} ({address}): connected after {}", counted(attempts, "attempt")));
        DeviceLost { device: String, at: String, fault: Explained } =>
            caused(format!("device {device}{at}"), fault.clone());
        DeviceBack { device: String, at: String, missed: u64 } =>
            plain(format!("device {device}{at}: answers again, after {}", counted(missed, "failure")));
        NotAsExpected { device: String, found: Explained } => caused(format!("device {device}"), found.clone());
        AsExpected { device: String } => plain(format!("device {device}: its settings agree with the profile"));
        SignalBad { signal: String, reason: Explained } => caused(format!("signal {signal}"), reason.clone());
        SignalGood {
            signal: String,
            #[serde(rename = "bad_for_s", serialize_with = "in_seconds")]
            bad_for: Duration,
        } => plain(format!("signal {signal}: good again after {}", seconds(bad_for)));
        Rereferenced { signal: String, unit: String, from: f64, to: f64 } => caused(
            format!("signal {signal}"),
            format!(
                "the encoder was re-referenced: the position changed from {from:.4} {unit} to {to:.4} \
                 {unit}, too far for a movement of the axis"
            )
        );
        // `from` and `to` are the values of one count.
        ScaleChanged { signal: String, unit: String, from: f64, to: f64 } => caused(
            format!("signal {signal}"),
            format!(
                "the device has changed the scale: one count of the raw value was {from} {unit}, and is now {to} {unit}"
            )
        );
        // If the cause of the state has changed, `from` and `to` are the same.
        AxisState {
            axis: String,
            from: &'static str,
            to: &'static str,
            why: Explained,
            /// Whether the gateway was asked to stop. In this case, the new state is not a fault.
            #[serde(skip)]
            stopping: bool,
        } => {
            let is_well = *stopping || !matches!(*to, "holding" | "ramping" | "degraded" | "zeroed");
            let [was, is] = [from, to].map(|name| AxisState::display_of(name));
            let about = if from == to { format!("still {is}") } else { format!("{was} → {is}") };
            let about = format!("axis {axis}: {about}");
            match (is_well, why.cause.as_str()) {
                (true, "") => plain(about).well(),
                (true, cause) => caused(about, cause).well(),
                (false, "") => caused(about, "the cause has already ended").without_hint(),
                (false, _) => caused(about, why.clone()),
            }
        };
        // `axes` is empty if a command concerns no axis.
        Command { command: String, axes: Vec<String>, way: Channel, who: String, answer: String } =>
            plain(format!("{command}, {}: {answer}", way.by(who)));
        CommandRefused { command: String, axes: Vec<String>, way: Channel, who: String, why: Explained } =>
            caused(format!("{command}, {}: refused", way.by(who)), why.clone());
        CommandDropped { command: String, axes: Vec<String>, way: Channel, who: String, why: String } =>
            caused(format!("{command}, {}: not carried out", way.by(who)), why);
        WaitsToArm { axis: String, why: Explained } => caused(format!("axis {axis}: waiting to arm"), why.clone());
        ArmEnded { axis: String, why: Explained } => caused(format!("axis {axis}: not armed"), why.clone());
        // `from`: register value when the axis was armed.
        Armed {
            axis: String,
            #[serde(rename = "from_um")]
            from: Micron,
            way: Channel,
            who: String,
        } => plain(format!("axis {axis}: armed, starting from {from}, {}", way.by(who)));
        GoesOn {
            axis: String,
            #[serde(rename = "from_um")]
            from: Micron,
            way: Channel,
        } => plain(format!("axis {axis}: armed as before the restart, continuing from {from}"));
        SignChecked { axis: String, moved: DialDirection, way: Channel, who: String } => {
            let (about, why) = (format!("axis {axis}, {}", way.by(who)), moved.explained(axis));
            match moved {
                DialDirection::Plus => plain(format!("{about}: {why}")).well(),
                DialDirection::Minus | DialDirection::None => caused(about, why),
            }
        };
        SignEnded { axis: String, why: Explained } =>
            caused(format!("axis {axis}: the sign check has ended, Cz returns"), why.clone());
        Disarmed { axis: String, why: Explained } => caused(format!("axis {axis}: off"), why.clone());
        ArmRefused { axis: String, why: Explained } =>
            caused(format!("axis {axis}: cannot be armed"), why.clone());
        AtLimit {
            axis: String,
            #[serde(rename = "wanted_um")]
            wanted: Micron,
            #[serde(rename = "limit_um")]
            limit: Micron,
        } => {
            let cause = format!("the model requests {wanted}, and Cz is held at its limit of ±{limit}");
            let hint = hint_with(EventKind::AtLimit, &[("axis", axis)]);
            caused(format!("axis {axis}"), Explained::new(cause, hint))
        };
        // `signals`: those with the largest contributions to the requested Cz.
        LimitLasts {
            axis: String,
            #[serde(rename = "wanted_um")]
            wanted: Micron,
            #[serde(rename = "limit_um")]
            limit: Micron,
            signals: Vec<String>,
            #[serde(rename = "contributions_um")]
            contributions: Vec<Micron>,
        } => {
            let parts: Vec<String> =
                signals.iter().zip(contributions).map(|(signal, cz)| format!("{signal} {cz}")).collect();
            let parts = match parts.as_slice() {
                [] => "the contributions of the signals are not known".to_owned(),
                parts => format!("largest contributions: {}", parts.join(", ")),
            };
            caused(
                format!("axis {axis}"),
                format!(
                    "the model requests {wanted}, and Cz has been at its limit of ±{limit} for more than five minutes; \
                     {parts}"
                )
            )
        };
        LimitOver { axis: String } =>
            plain(format!("axis {axis}: Cz is no longer at its limit"));
        Warned {
            axis: String,
            #[serde(rename = "cz_um")]
            cz: Micron,
            #[serde(rename = "warn_um")]
            warn: Micron,
        } => caused(format!("axis {axis}"), format!("Cz is {cz}, beyond the warning level of ±{warn}"));
        BeyondError {
            axis: String,
            #[serde(rename = "wanted_um")]
            wanted: Micron,
            #[serde(rename = "error_um")]
            error: Micron,
        } => caused(
            format!("axis {axis}"),
            format!(
                "the model requests {wanted}, beyond its error level of ±{error}; the fault action runs, then the \
                 axis is off until it is armed"
            )
        );
        Extrapolating { axis: String, how: Explained } => caused(format!("axis {axis}"), how.clone());
        Interpolating { axis: String } =>
            plain(format!("axis {axis}: the inputs are inside the range of the model again"));
        Probed {
            axis: String,
            #[serde(rename = "error_um")]
            error: Micron,
            #[serde(rename = "residual_um")]
            residual: Micron,
            #[serde(rename = "correction_um")]
            correction: Micron,
        } => plain(format!(
            "axis {axis}: probed {error}; the model was wrong by {residual}; the correction is {correction} now"
        ));
        ProbeRefused {
            axis: String,
            #[serde(rename = "error_um")]
            error: Option<Micron>,
            why: Explained,
        } => {
            let probed = error.map_or("a probing was".to_owned(), |error| format!("probed {error},"));
            caused(format!("axis {axis}: {probed} not used for the correction"), why.clone())
        };
        ProbeForgotten { axis: String } => plain(format!("axis {axis}: the correction from probings is removed"));
        ModelAges {
            axis: String,
            #[serde(rename = "residual_um")]
            residual: Micron,
            #[serde(rename = "warn_um")]
            warn: Micron,
        } => caused(format!("axis {axis}"), format!("the model was wrong by {residual}, beyond ±{warn}"));
        Saturated { output: String, wanted: f64 } => caused(
            format!("output {output}"),
            format!("{wanted} is outside the range of the register and was limited")
        );
        VerifyFailed {
            output: String,
            wrote: String,
            found: String,
            /// Whether the value is in a node of an OPC UA server.
            #[serde(skip)]
            is_in_a_node: bool,
        } => {
            let cause = format!("wrote {wrote}, read back {found}");
            let why = if *is_in_a_node { Explained::new(cause, NODE_KEEPS_VALUE) } else { cause.into() };
            caused(format!("output {output}"), why)
        };
        NotApplied { output: String, stands: String, applies: String, register: String } => caused(
            format!("output {output}"),
            format!("the register holds {stands}, but the control applies {applies} ({register})")
        );
        WriteFailed { output: String, fault: Explained } =>
            caused(format!("output {output}: not written"), fault.clone());
        ReadFailed { output: String, fault: Explained } =>
            caused(format!("output {output}: the register cannot be read"), fault.clone());
        // `place`: register or node of the heartbeat.
        HeartbeatFailed { device: String, place: String, fault: Explained } =>
            caused(format!("heartbeat ({place} of {device}): not written"), fault.clone());
        HeartbeatWritten { device: String, place: String } =>
            plain(format!("heartbeat ({place} of {device}): written again"));
        Verified { output: String, failures: u64 } => plain(if *failures == 0 {
            format!("output {output}: verified again")
        } else {
            format!("output {output}: written and verified again after {}", counted(failures, "failure"))
        });
        ForeignChange { output: String, expected: String, found: String } => caused(
            format!("output {output}"),
            format!(
                "the register holds {found}, which this gateway did not write ({expected} expected); the value is kept"
            )
        );
        OwnWriteLate { output: String, value: String, sent: String } => caused(
            format!("output {output}"),
            format!(
                "a write of {value} that the gateway sent at {sent} arrived late; the gateway continues from this value"
            )
        );
        PerhapsFromBefore { output: String, value: String } => caused(
            format!("output {output}"),
            format!(
                "the register holds {value}, perhaps a write from before the gateway started; the gateway continues \
                 from this value"
            )
        );
        WaitsForLateWrite { output: String, seconds: u64 } => caused(
            format!("output {output}"),
            format!(
                "waiting for a late write, {seconds} s at most: if this write arrived after the next write, the axis \
                 could step too far"
            )
        );
        WaitsAfterStart {
            output: String,
            #[serde(rename = "late_s", serialize_with = "in_seconds")]
            late: Duration,
        } => plain(format!(
            "output {output}: the last run did not stop normally, or its end is unknown. The gateway waits \
             {} for late writes before it changes the register",
            duration_text(*late)
        ));
        NotReadBack { output: String } =>
            plain(format!("output {output}: writes are acknowledged, not verified; the register cannot be \
                           read"));
        OperatorChange { output: String, from: String, to: String, share: String } => plain(format!(
            "output {output}: the operator offset changed from {from} to {to} and is not overwritten; the \
             gateway share stays \
             {share}"
        ));
        LedgerOpened { output: String, base: String, share: String } =>
            plain(format!("output {output}: the operator offset is {base}, the gateway share is {share}"));
        FirstAccount { output: String, holds: String } => caused(
            format!("output {output}"),
            format!("the register holds {holds}, and the gateway share in it is not known")
        );
        LedgerDoubt { output: String, why: Explained } => caused(format!("output {output}"), why.clone());
        OutputMoved { output: String, why: Explained } => caused("", why.clone());
        RegisterLeft {
            output: String,
            register: String,
            #[serde(rename = "held_um")]
            held: Micron,
            #[serde(skip)]
            hint: String,
        } => {
            let cause = format!("{held} from the gateway were verified in {register}, but no output uses \
                                 this register any longer");
            caused(format!("output {output}"), Explained::new(cause, hint.clone()))
        };
        RegisterReleased { output: String, register: String } =>
            plain(format!("output {output}: the former register, {register}, is back at its base value"));
        PlaceConfirmed { output: String } =>
            plain(format!("output {output}: the operator has confirmed its new register"));
        ReferenceForgotten { signal: String, why: Explained } => caused("", why.clone());
        NamespaceRecorded { bus: String, index: u16, uri: String } =>
            plain(format!("bus {bus}: the OPC UA namespace ns={index} is {uri}; the gateway saves this URI"));
        NamespaceMoved { bus: String, uri: String, from: u16, to: u16 } => {
            let cause = format!(
                "namespace {uri} is ns={to} at the server, not ns={from}; the gateway uses the nodes at the new index"
            );
            let hint = hint_with(EventKind::NamespaceMoved, &[("uri", uri), ("from", &from.to_string())]);
            caused(format!("bus {bus}"), Explained::new(cause, hint))
        };
        PositionFromZero { output: String } => caused(
            format!("output {output}"),
            "the last Cz of the corrected position is unknown, because the saved state was rejected: the \
             output begins at Cz 0"
        );
        CncRestarted { output: String, expected: String } => caused(
            format!("output {output}"),
            format!("the register went from {expected} to zero; the CNC was restarted")
        );
        TemplateChanged { template: String, changes: String } =>
            caused("", format!("template {template} has changed since the last run: {changes}"));
        // `limits`: conditions under which a reading of these signals is rejected.
        DefaultLimits { signals: Vec<String>, limits: Vec<String> } => {
            let about = if signals.len() == 1 { "signal" } else { "signals" };
            caused(
                format!("{about} {}", signals.join(", ")),
                format!(
                    "readings {} are rejected from now on, because the profile states no other limits",
                    limits.join(" or ")
                )
            )
        };
        CncBooted { device: String, from: f64, to: f64 } => caused(
            format!("device {device}"),
            format!(
                "the boot counter went from {from} to {to}: the CNC was restarted; the gateway reads the registers again"
            )
        );
        // A control did not take a written value. `set` is "output cnc_z" or "set plc".
        Handshake { set: String, fault: HandshakeFault, register: String, cause: String } as fault.kind() =>
            caused("", fault.sentence(set, register, cause));
        NodeReset { device: String, node: u8, what: String } =>
            caused(format!("device {device} (node {node})"), what);
        Emergency { device: String, what: Explained } =>
            caused(format!("device {device}: emergency"), what.clone());
        // `count`: number of messages.
        EmergencyOver { device: String, count: u64 } =>
            plain(format!("device {device}: the emergencies have ended, after {}", counted(count, "message")));
        BusTrouble { bus: String, address: String, what: Explained } =>
            caused(format!("bus {bus} ({address})"), what.clone());
        BusWell {
            bus: String,
            address: String,
            count: u64,
            what: &'static str,
            #[serde(rename = "within_s", serialize_with = "in_seconds")]
            within: Duration,
        } => {
            let span = seconds(&(*within).max(Duration::from_secs(1)));
            plain(format!("bus {bus} ({address}): works again: {count} {what} within {span}"))
        };
        Interlocked { output: String, when: String } =>
            plain(format!("output {output}: not written, because its condition is not met: {when}"));
        Released { output: String } => plain(format!("output {output}: interlock released"));
        MachineStarted => plain("the machine was started: the time since machine start is counted from now");
        Zeroed => plain("zero: references are captured from now on");
        Overrun {
            bus: String,
            what: String,
            #[serde(rename = "late_s", serialize_with = "in_seconds")]
            late: Duration,
        } => caused(
            format!("bus {bus}"),
            format!("the bus is overloaded: {what} was {} ms late", late.as_millis())
        );
        PipelineGivenUp { bus: String, fault: String } => caused(
            format!("bus {bus}"),
            format!("two requests at a time failed ({fault}); the gateway now sends one at a time")
        );
        GatewayTimeout {
            bus: String,
            #[serde(rename = "own_s", serialize_with = "in_seconds")]
            own: Duration,
            #[serde(rename = "timeout_s", serialize_with = "in_seconds")]
            timeout: Duration,
        } => caused(
            format!("bus {bus}"),
            format!(
                "the Modbus gateway waits for a device that does not answer: the timeout of the Modbus gateway (about {}) \
                 is longer than `timeout` ({})",
                about(*own),
                duration_text(*timeout)
            )
        );
        Subscription { device: String, what: String } => caused(format!("device {device}: the subscription"), what);
        StoodStill {
            #[serde(rename = "span_s", serialize_with = "in_seconds")]
            span: Duration,
        } => caused("", format!(
            "this computer stood still for {:.1} s (stopped, suspended or too busy): the gateway discards \
             the old values and reads all signals again",
            span.as_secs_f64()
        ));
        TaskFailed { task: String, why: String } => caused(format!("{task} failed"), why);
        ClockDoubtful {
            #[serde(serialize_with = "in_text")]
            last: Moment,
        } => caused("", format!(
            "the computer's clock does not continue from {last}, the newest time stamp in state and log. The \
             length of the stop is unknown, and assumed to be long"
        ));
        LogsDeleted { names: Vec<String>, why: String } => plain(format!("deleted {}: {why}", listed(names)));
        NotExclusive { why: String } => caused("", format!(
            "other gateways on this computer cannot be detected: {why}; a second one could write to the same registers"
        ));
        NotKept { what: String, why: Explained } => caused(format!("{what} cannot be saved"), why.clone());
        NotBelieved { why: String } =>
            caused("", format!("{why}; every axis is off until the operator arms it"));
        HandoverRefused { why: String } =>
            caused("", format!("{why}; every axis starts as after a normal stop"));
        ProfileDiffers { profile: String, files: Vec<String> } => {
            let cause = format!(
                "these files changed after the new program had checked the profile, and are not used: {}",
                listed(files)
            );
            let hint = hint_with(EventKind::ProfileDiffers, &[("profile", profile)]);
            caused("", Explained::new(cause, hint))
        };
        TakenFromEarlier { what: &'static str, version: u32, kept: String } => caused(
            "",
            format!("the {what} of an earlier version of the program (layout {version}) is used; {kept}")
        );
        EventsLost { count: u64 } => caused("", format!(
            "the disk did not save {} in time: the saved events have a gap",
            counted(count, "event")
        ));
        EventsFull { bytes: usize } => caused("", format!(
            "the file of this day's events is full ({} MB): further events of this day are not saved",
            bytes >> 20
        ));
        KeptAgain { what: String } => plain(format!("{what} is saved again"));
    }
    parts {
        ClockSet(#[serde(serialize_with = "both_in_text")] Correction) as set => caused(
            "",
            format!("the computer's clock was set, from {} to {}", set.from, set.to)
        ).of(EventKind::ClockSet);
        StandIn(StandIn) as found => found.described();
        Comparison(Comparison) as found => found.described();
        Adoption(Adoption) as adoption => adoption.described();
        Page(PagePort) as port => port.described();
        Token(PageToken) as token => token.described();
        Broker(Broker) as broker => broker.described();
        OpcUaServer(OpcUaServerEvent) as server => server.described();
        Delivery(Delivery) as delivery => delivery.described();
        #[cfg(feature = "opcua")]
        Certificate(Expiry) as expiry => expiry.described();
        #[cfg(feature = "opcua")]
        CertificateNotYetValid(EarlyCertificate) as early => early.described();
    }
}

#[cfg(test)]
mod tests;
