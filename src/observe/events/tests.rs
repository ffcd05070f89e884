//! Tests of the events of trouble: each has its cause and its hint as separate fields.

use std::time::Duration;

use super::*;
use crate::clock::Correction;
use crate::observe::requester::Channel;
use crate::observe::status::DialDirection;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Micron;

/// Returns one event of each kind of trouble.
fn troubles() -> Vec<Event> {
    let name = || "z".to_owned();
    let um = |um| Micron::new(um).unwrap();
    let (way, who) = (Channel::Page, "10.0.0.7".to_owned());
    let axis_state = |to| {
        let why = "bed has an open circuit".into();
        Event::AxisState { axis: name(), from: "active", to, why, stopping: false }
    };
    let handshake = |fault| {
        let cause = "within 500 ms".into();
        Event::Handshake { set: "set plc".into(), fault, register: "coil:1".into(), cause }
    };
    let stand_in = |frozen| {
        let (axis, signal, span) = (name(), "bed".to_owned(), Duration::from_secs(9));
        Event::StandIn(StandIn::Taken { axis, signal, frozen, span, others: None })
    };
    let worse = |touches, ramps| {
        let (axis, without, with) = (name(), um(2.0), um(3.2));
        Event::Comparison(Comparison::Worse { axis, touches, without, with, ramps })
    };
    let moved = |moved| Event::SignChecked { axis: name(), moved, way, who: who.clone() };
    let mut all = vec![
        Event::LinkDown {
            bus: name(),
            address: "a:1".into(),
            fault: "closed".into(),
            excludes_wiring: false,
        },
        Event::DeviceLost { device: name(), at: " (unit 2)".into(), fault: "no answer".into() },
        Event::NotAsExpected { device: name(), found: "holding:7 is 3".into() },
        Event::SignalBad { signal: name(), reason: "open circuit".into() },
        Event::Rereferenced { signal: name(), unit: "mm".into(), from: 1.0, to: 2.0 },
        Event::ScaleChanged { signal: name(), unit: "degC".into(), from: 0.1, to: 0.01 },
        axis_state("degraded"),
        axis_state("holding"),
        axis_state("ramping"),
        axis_state("zeroed"),
        Event::CommandRefused {
            command: "arm".into(),
            axes: vec![],
            way,
            who: who.clone(),
            why: "no model".into(),
        },
        Event::CommandDropped {
            command: "arm".into(),
            axes: vec![],
            way,
            who: who.clone(),
            why: "gone".into(),
        },
        Event::ArmEnded { axis: name(), why: "expired".into() },
        moved(DialDirection::Minus),
        moved(DialDirection::None),
        Event::SignEnded { axis: name(), why: "frozen".into() },
        Event::Disarmed { axis: name(), why: "something else wrote".into() },
        Event::ArmRefused { axis: name(), why: "beyond its limit".into() },
        Event::AtLimit { axis: name(), wanted: um(60.0), limit: um(40.0) },
        Event::LimitLasts {
            axis: name(),
            wanted: um(60.0),
            limit: um(40.0),
            signals: vec!["bed".into(), "column".into()],
            contributions: vec![um(55.0), um(5.0)],
        },
        Event::Warned { axis: name(), cz: um(31.0), warn: um(30.0) },
        Event::BeyondError { axis: name(), wanted: um(60.0), error: um(50.0) },
        Event::Extrapolating { axis: name(), how: "bed is too warm".into() },
        Event::ProbeRefused { axis: name(), error: Some(um(7.0)), why: "too far".into() },
        Event::ProbeRefused { axis: name(), error: None, why: "no result".into() },
        Event::ModelAges { axis: name(), residual: um(7.0), warn: um(5.0) },
        worse(8, true),
        worse(0, false),
        Event::Saturated { output: name(), wanted: 40_000.0 },
        Event::NotApplied {
            output: name(),
            stands: "1 µm".into(),
            applies: "0 µm".into(),
            register: "r".into(),
        },
        Event::WriteFailed { output: name(), fault: "refused".into() },
        Event::ReadFailed { output: name(), fault: "refused".into() },
        Event::HeartbeatFailed { device: name(), place: "r".into(), fault: "refused".into() },
        Event::ForeignChange { output: name(), expected: "1".into(), found: "2".into() },
        Event::OwnWriteLate { output: name(), value: "1".into(), sent: "14:03".into() },
        Event::PerhapsFromBefore { output: name(), value: "1".into() },
        Event::WaitsForLateWrite { output: name(), seconds: 30 },
        Event::FirstAccount { output: name(), holds: "3".into() },
        Event::LedgerDoubt { output: name(), why: "it holds 3".into() },
        Event::OutputMoved { output: name(), why: Explained::new("it was there", "arm it") },
        Event::RegisterLeft {
            output: name(),
            register: "holding:104".into(),
            held: um(20.0),
            hint: "release it".into(),
        },
        Event::ReferenceForgotten { signal: name(), why: Explained::new("it was there", "measure a part") },
        Event::NamespaceMoved { bus: name(), uri: "urn:mill".into(), from: 2, to: 3 },
        Event::PositionFromZero { output: name() },
        Event::CncRestarted { output: name(), expected: "3".into() },
        Event::TemplateChanged { template: name(), changes: "a key".into() },
        Event::DefaultLimits {
            signals: vec!["bed".into(), "column".into()],
            limits: vec!["outside -40 to 200 °C".into()],
        },
        Event::CncBooted { device: name(), from: 1.0, to: 2.0 },
        Event::NodeReset { device: name(), node: 5, what: "was reset".into() },
        Event::Emergency { device: name(), what: "0x1000".into() },
        Event::BusTrouble { bus: name(), address: "can0".into(), what: "bus off".into() },
        Event::Overrun { bus: name(), what: "a read".into(), late: Duration::from_millis(30) },
        Event::PipelineGivenUp { bus: name(), fault: "no answer".into() },
        Event::GatewayTimeout {
            bus: name(),
            own: Duration::from_millis(1010),
            timeout: Duration::from_millis(500),
        },
        Event::Subscription { device: name(), what: "the server sends slower".into() },
        Event::StoodStill { span: Duration::from_secs(9) },
        Event::TaskFailed { task: name(), why: "it ended".into() },
        Event::ClockSet(Correction { from: Moment::default(), to: Moment::default() }),
        Event::ClockDoubtful { last: Moment::default() },
        Event::NotExclusive { why: "no socket".into() },
        Event::NotKept { what: "the log".into(), why: "the disk is full".into() },
        Event::NotBelieved { why: "it is damaged".into() },
        Event::HandoverRefused { why: "another process".into() },
        Event::ProfileDiffers { profile: "mill.toml".into(), files: vec!["matrix.csv".into()] },
        Event::TakenFromEarlier { what: "state", version: 3, kept: "it is kept".into() },
        Event::EventsLost { count: 3 },
        Event::EventsFull { bytes: 1 << 20 },
        stand_in(true),
        stand_in(false),
        Event::Adoption(Adoption::Superseded { axis: name(), model: "learned-2026-01-31-3fa2".into() }),
        Event::Adoption(Adoption::Failed { why: "exit code 1".into() }),
        Event::Page(PagePort::Closed { listen: "a:1".into(), why: "taken".into() }),
        Event::Page(PagePort::NotServed { listen: "a:1".into(), why: "the token is too short".into() }),
        Event::Token(PageToken::Gone { role: "viewer", why: "deleted".into() }),
        Event::Broker(Broker::Down { broker: name(), why: "no answer".into() }),
        Event::Broker(Broker::Dropped { broker: name(), count: 3 }),
        Event::Broker(Broker::NotKept { broker: name(), why: "the disk is full".into() }),
        Event::Broker(Broker::SubscriptionRefused { broker: name(), topic: "t".into() }),
        Event::Broker(Broker::PublishDenied { broker: name(), topic: "t".into() }),
        Event::Broker(Broker::HostOffline { broker: name(), host: "scada".into(), why: "it is offline" }),
        Event::OpcUaServer(OpcUaServerEvent::Closed { listen: "a:1".into(), why: "taken".into() }),
        Event::OpcUaServer(OpcUaServerEvent::ClientRefused {
            client: "CN=mes".into(),
            thumbprint: "5f3a".into(),
            others: 1,
        }),
        Event::Delivery(Delivery::Failed { notify: name(), to: "b".into(), why: "no answer".into() }),
        Event::Delivery(Delivery::Dropped { notify: name(), to: "b".into(), count: 3 }),
    ];
    all.extend([true, false].map(|is_in_a_node| {
        let (wrote, found) = ("1".to_owned(), "2".to_owned());
        Event::VerifyFailed { output: name(), wrote, found, is_in_a_node }
    }));
    all.extend(
        [
            HandshakeFault::AcknowledgeEarly,
            HandshakeFault::StrobeNotWritten,
            HandshakeFault::AcknowledgeMissing,
            HandshakeFault::AcknowledgeNotRead,
            HandshakeFault::StrobeNotDropped,
            HandshakeFault::AcknowledgeStuck,
        ]
        .map(handshake),
    );
    #[cfg(feature = "opcua")]
    all.extend(
        [
            (CertificateOwner::Gateway, true),
            (CertificateOwner::User, false),
            (CertificateOwner::Server, false),
            (CertificateOwner::OwnServer, true),
            (CertificateOwner::Client, false),
        ]
        .map(|(whose, is_over)| {
            let (bus, file) = (name(), "own.der".to_owned());
            Event::Certificate(Expiry { bus, file, whose, until: Moment::default(), is_over })
        }),
    );
    #[cfg(feature = "opcua")]
    all.extend([CertificateOwner::Client, CertificateOwner::Server].map(|whose| {
        let (bus, file, from) = (name(), "mes.der".to_owned(), Moment::default());
        Event::CertificateNotYetValid(EarlyCertificate { bus, file, whose, from })
    }));
    all
}

/// Kinds of events without a hint, because there is nothing to do or the cause contains it.
const NOTHING_TO_DO: [&str; 2] = ["command-refused", "taken-from-earlier"];

#[test]
fn each_event_that_tells_of_trouble_has_cause_and_hint_and_a_sentence_of_both() {
    let mut without = Vec::new();
    for event in troubles() {
        let Entry { kind, level, text, data, .. } = event.entry(Moment::default());
        assert_ne!(level, Level::Info, "{kind}");
        let field = |name: &str| data[name].as_str().unwrap_or_default().to_owned();
        let (cause, hint) = (field("cause"), field("hint"));
        let is_bare = NOTHING_TO_DO.contains(&&*kind);
        let says_both = text.contains(&cause) && (is_bare || text.ends_with(&hint));
        if cause.is_empty() || !says_both || (hint.is_empty() && !is_bare) {
            without.push(format!("{kind}: {text}"));
        }
        assert!(text.matches(&hint).count() <= 1 || hint.is_empty(), "{kind} says its hint twice: {text}");
    }
    assert!(without.is_empty(), "{} of {}:\n{}", without.len(), troubles().len(), without.join("\n"));
}

#[test]
fn power_and_cable_are_not_named_if_they_cannot_be_the_cause() {
    let down = |excludes_wiring| {
        let fault = "the server has no free channel: close another client".into();
        let event = Event::LinkDown { bus: "cell".into(), address: "a:1".into(), fault, excludes_wiring };
        event.entry(Moment::default())
    };
    let unknown = down(false);
    assert!(unknown.text.contains("check the power and the cable"), "{}", unknown.text);
    let answered = down(true);
    assert_eq!(answered.text, "bus cell (a:1): the server has no free channel: close another client");
    let field = |name: &str| answered.data.get(name);
    assert!(field("cause").is_some(), "{}", answered.data);
    assert_eq!((field("hint"), field("excludes_wiring")), (None, None));
}

#[test]
fn the_wait_after_a_kill_is_stated_also_if_it_is_shorter_than_a_second() {
    for (milliseconds, said) in [(600, "waits 600ms for late writes"), (30_000, "waits 30s for late writes")]
    {
        let late = Duration::from_millis(milliseconds);
        let entry = Event::WaitsAfterStart { output: "z".to_owned(), late }.entry(Moment::default());
        assert!(entry.text.contains(said), "{}", entry.text);
    }
}
