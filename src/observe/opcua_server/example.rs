//! Status of a small machine, for the tests.

use std::collections::BTreeMap;

use crate::observe::events::{Alarm, Entry, Level};
use crate::observe::status::{
    ArmingStatus, AxisStatus, DeviceStatus, OutputStatus, ProbeStatus, SharesStatus, SignalStatus, Status,
};
use isotherm_core::display::Display;

fn signal(name: &str, value: Option<f64>, quality: &'static str, age_s: Option<f64>) -> SignalStatus {
    SignalStatus {
        name: name.to_owned(),
        label: String::new(),
        device: "module".to_owned(),
        value,
        unit: "degC",
        quality,
        reason: if quality == "good" { String::new() } else { quality.to_owned() },
        hint: None,
        remedy: None,
        age_s,
    }
}

pub(super) fn event(text: &str) -> Entry {
    Entry {
        at: "2026-07-02T11:59:00Z".to_owned(),
        kind: "signal-bad".into(),
        level: Level::Warning,
        text: text.to_owned(),
        data: serde_json::Value::Null,
    }
}

/// Status with one axis, two signals, one output, one device, one alarm and two events.
pub(super) fn status() -> Status {
    Status {
        machine: "press".to_owned(),
        label: "研削盤".to_owned(),
        description: String::new(),
        version: "1.2.3",
        now: "2026-07-02T12:00:00Z".to_owned(),
        zone: "Europe/Berlin".to_owned(),
        clock: "synchronised",
        uptime_s: 61.0,
        machine_on_s: None,
        language: None,
        overridden: Vec::new(),
        profile_changed: Vec::new(),
        dry_run: false,
        stopping: false,
        ready: true,
        axes: vec![axis()],
        signals: vec![
            signal("bed", Some(21.25), "good", Some(0.5)),
            signal("air", None, "open-circuit", None),
        ],
        buses: Vec::new(),
        devices: vec![DeviceStatus {
            name: "module".to_owned(),
            label: "Box 3".to_owned(),
            bus: "cell".to_owned(),
            unit: 1,
            at: " (unit 1)".to_owned(),
            state: "ok",
            fault: String::new(),
            hint: None,
            requests: 40,
            failures: BTreeMap::new(),
        }],
        outputs: vec![output()],
        left: Vec::new(),
        log_dropped: 3,
        alarms: vec![Alarm {
            id: "signal air".to_owned(),
            kind: "signal-bad".to_owned(),
            level: Level::Warning,
            since: "2026-07-02T11:59:00Z".to_owned(),
            text: "signal air: open circuit".to_owned(),
            cause: Some("open circuit".to_owned()),
            hint: None,
            acknowledged: None,
        }],
        events: vec![event("signal air: open circuit"), event("signal bed: good again")],
        event_counts: [("signal-bad", 2)].into(),
        mqtt: None,
        lock_held: Vec::new(),
    }
}

fn axis() -> AxisStatus {
    AxisStatus {
        name: "z".to_owned(),
        label: String::new(),
        state: "active",
        shown: Display::Active,
        has_model: true,
        why: String::new().into(),
        waiting: None,
        model: Some("bed".to_owned()),
        raw_um: Some(12.75),
        expected_um: None,
        expected_touches: 0,
        cz_um: 12.5,
        verified_um: Some(12.5),
        verified_age_s: Some(2.0),
        acted: vec!["step", "round"],
        limit_um: 60.0,
        warn_um: None,
        warned: false,
        error_um: None,
        tripped: false,
        arming: ArmingStatus { armed: true, left_off: false, release: false },
        sign: None,
        sign_checked: None,
        truth: None,
        probe: Some(ProbeStatus {
            correction_um: -1.5,
            limit_um: 10.0,
            warn_um: None,
            max_error_um: 25.0,
            last: None,
            history: Vec::new(),
            gains: Vec::new(),
            worse: None,
        }),
        learned: None,
        extrapolating: None,
        excess: None,
        stood_in: None,
    }
}

fn output() -> OutputStatus {
    OutputStatus {
        name: "cnc_z".to_owned(),
        axis: "z".to_owned(),
        device: "cnc".to_owned(),
        register: "40101 (holding 100)".to_owned(),
        writes: "offset",
        state: "verified",
        handshake: String::new(),
        value: Some(12.5),
        shares: Some(SharesStatus { base: 2.0, share: 10.5 }),
        applied: None,
        note: String::new(),
        waits_s: None,
        writes_done: 9,
        age_s: Some(2.0),
    }
}
