use super::*;
use crate::compensation::model::Reference::{Start, Zero};
use crate::reading::{Reading, Reason};

const BED: SignalId = SignalId(0);
const ON: SignalId = SignalId(1);
const BUTTON: SignalId = SignalId(2);

fn settings(settle: u64) -> MachineSettings {
    MachineSettings { on: Some(ON), zero: Some(BUTTON), settle: Duration::from_secs(settle), signals: 3 }
}

fn at(seconds: u64) -> Moment {
    Moment::from_nanos(0).after(Duration::from_secs(seconds))
}

/// Machine whose readings the test sets, row by row. NaN stands for a bad reading.
struct Shown {
    settings: MachineSettings,
    machine: Machine,
}

impl Shown {
    fn new(settings: MachineSettings) -> Shown {
        Shown { settings, machine: Machine::default() }
    }

    fn check(&mut self, seconds: u64, values: [f64; 3]) -> MachineChange {
        let readings = values.map(|value| reading(value, seconds));
        self.machine.observe(&self.settings, &Snapshot::new(at(seconds), &readings))
    }

    fn would_notice(&self, seconds: u64, values: [f64; 3]) -> bool {
        let readings = values.map(|value| reading(value, seconds));
        let snapshot = Snapshot::new(at(seconds), &readings);
        self.machine.would_notice(&self.settings, |id| snapshot.value(id), || snapshot.has_usable())
    }
}

fn reading(value: f64, seconds: u64) -> Reading {
    if value.is_nan() {
        Reading::bad(at(seconds), Reason::Timeout)
    } else {
        Reading::good(value, at(seconds))
    }
}

fn captured(shown: &Shown, reference: Reference, signal: SignalId) -> Option<f64> {
    shown.machine.captured(reference, signal).map(|captured| captured.value.get())
}

#[test]
fn machine_on_time_begins_with_the_rising_edge_of_its_signal() {
    let mut shown = Shown::new(settings(0));
    assert!(!shown.check(100, [20.0, 0.0, 0.0]).started);
    assert_eq!(shown.machine.on_time(at(150)), None);
    assert!(shown.check(200, [20.0, 1.0, 0.0]).started);
    assert!(!shown.check(210, [20.0, 1.0, 0.0]).started);
    assert_eq!(shown.machine.on_time(at(260)), Some(Duration::from_secs(60)));
}

#[test]
fn machine_on_time_begins_anew_with_the_next_edge_and_a_lost_reading_is_no_edge() {
    let mut shown = Shown::new(settings(0));
    shown.check(0, [20.0, 1.0, 0.0]);
    assert!(!shown.check(10, [20.0, f64::NAN, 0.0]).started);
    assert!(!shown.check(20, [20.0, 1.0, 0.0]).started, "lost and back is not switched on");
    shown.check(30, [20.0, 0.0, 0.0]);
    assert!(shown.check(40, [20.0, 1.0, 0.0]).started);
    assert_eq!(shown.machine.on_time(at(41)), Some(Duration::from_secs(1)));
}

#[test]
fn without_a_signal_machine_on_time_begins_with_the_first_good_reading() {
    let mut shown = Shown::new(MachineSettings { on: None, zero: None, ..settings(0) });
    assert!(!shown.check(5, [f64::NAN; 3]).started);
    assert!(!shown.would_notice(6, [f64::NAN; 3]));
    assert!(shown.would_notice(7, [20.0, 0.0, 0.0]), "it does not wait for an axis to be due");
    assert!(shown.check(7, [20.0, 0.0, 0.0]).started);
    assert_eq!(shown.machine.on_time(at(17)), Some(Duration::from_secs(10)));
}

#[test]
fn time_that_runs_back_before_the_start_counts_as_no_time() {
    let mut shown = Shown::new(settings(0));
    shown.check(100, [20.0, 1.0, 0.0]);
    assert_eq!(shown.machine.on_time(at(50)), Some(Duration::ZERO));
}

#[test]
fn start_takes_the_first_good_reading() {
    let mut shown = Shown::new(settings(0));
    shown.check(0, [19.0, 0.0, 0.0]);
    shown.check(10, [f64::NAN, 1.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), None);
    shown.check(20, [20.5, 1.0, 0.0]);
    shown.check(30, [30.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), Some(20.5));
}

#[test]
fn a_settling_reference_is_the_mean_of_what_was_read_before_its_time_was_over() {
    let mut shown = Shown::new(settings(30));
    for (seconds, value) in [(0, 20.0), (10, 21.0), (20, f64::NAN)] {
        shown.check(seconds, [value, 1.0, 0.0]);
        assert_eq!(captured(&shown, Start, BED), None);
    }
    shown.check(30, [25.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), Some(20.5));
}

#[test]
fn a_sensor_that_is_silent_while_references_settle_begins_with_its_first_good_reading() {
    let mut shown = Shown::new(settings(30));
    for seconds in [0, 10, 20, 30] {
        shown.check(seconds, [f64::NAN, 1.0, 0.0]);
        assert_eq!(captured(&shown, Start, BED), None);
    }
    shown.check(40, [25.0, 1.0, 0.0]);
    shown.check(50, [26.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), Some(25.0));
}

#[test]
fn zero_is_captured_by_the_edge_of_its_signal_and_the_old_one_serves_meanwhile() {
    let mut shown = Shown::new(settings(20));
    for seconds in [0, 10, 20] {
        shown.check(seconds, [20.0, 1.0, 0.0]);
    }
    assert_eq!(captured(&shown, Zero, BED), Some(20.0), "the first start zeroes a machine never zeroed");
    assert!(shown.check(100, [24.0, 1.0, 1.0]).zeroed);
    assert!(!shown.check(110, [26.0, 1.0, 1.0]).zeroed, "a button held down is one press");
    assert_eq!(captured(&shown, Zero, BED), Some(20.0));
    shown.check(120, [25.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Zero, BED), Some(25.0));
    assert_eq!(captured(&shown, Start, BED), Some(20.0));
}

#[test]
fn a_command_captures_zero_as_the_button_does() {
    let mut shown = Shown::new(settings(0));
    shown.check(0, [20.0, 1.0, 0.0]);
    let settings = shown.settings.clone();
    shown.machine.zero(&settings, at(5));
    assert_eq!(captured(&shown, Zero, BED), Some(20.0));
    shown.check(10, [24.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Zero, BED), Some(24.0));
}

#[test]
fn a_new_start_forgets_the_start_reference_and_keeps_zero() {
    let mut shown = Shown::new(settings(10));
    for (seconds, on) in [(0, 1.0), (10, 1.0), (20, 0.0)] {
        shown.check(seconds, [20.0, on, 0.0]);
    }
    shown.check(30, [24.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), None);
    assert_eq!(captured(&shown, Zero, BED), Some(20.0));
    shown.check(40, [26.0, 1.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), Some(24.0));
}

#[test]
fn an_edge_is_noticed_between_two_updates_and_nothing_else_is() {
    let mut shown = Shown::new(settings(0));
    shown.check(0, [20.0, 1.0, 0.0]);
    assert!(!shown.would_notice(1, [25.0, 1.0, 0.0]));
    assert!(!shown.would_notice(1, [25.0, f64::NAN, f64::NAN]));
    assert!(shown.would_notice(1, [20.0, 1.0, 1.0]));
    assert!(
        shown.would_notice(1, [20.0, 0.0, 0.0]),
        "without the falling edge the next rising one would be lost"
    );
}

#[test]
fn what_was_captured_survives_a_restart_and_nothing_starts_again() {
    let mut shown = Shown::new(settings(0));
    shown.check(0, [20.1, 1.0, 0.0]);
    let kept = serde_json::to_string(&shown.machine).unwrap();
    shown.machine = serde_json::from_str(&kept).unwrap();
    assert!(!shown.check(3600, [24.0, 1.0, 0.0]).started);
    assert_eq!(captured(&shown, Start, BED), Some(20.1));
    assert_eq!(shown.machine.on_time(at(7200)), Some(Duration::from_secs(7200)));
}

#[test]
fn every_digit_of_a_captured_reference_survives_a_restart() {
    let mut shown = Shown::new(settings(0));
    for step in 0..2000u32 {
        let value = 20.0 + f64::from(step).sqrt() / 7.0;
        shown.machine = Machine::default();
        shown.check(0, [value, 1.0, 0.0]);
        let kept = serde_json::to_string(&shown.machine).unwrap();
        let back: Machine = serde_json::from_str(&kept).unwrap();
        assert_eq!(back, shown.machine);
    }
}

#[test]
fn a_signal_added_to_a_running_machine_gets_its_references_too() {
    let mut shown = Shown::new(MachineSettings { on: None, zero: None, signals: 1, ..settings(0) });
    shown.check(0, [20.0, 0.0, 0.0]);
    shown.settings.signals = 3;
    shown.check(10, [21.0, 30.0, 40.0]);
    for reference in [Start, Zero] {
        assert_eq!(captured(&shown, reference, BED), Some(20.0));
        assert_eq!(captured(&shown, reference, ON), Some(30.0));
    }
}

#[test]
fn a_forgotten_signal_is_captured_again_and_the_others_keep_what_they_have() {
    let mut shown = Shown::new(MachineSettings { on: None, zero: None, signals: 3, ..settings(0) });
    shown.check(0, [20.0, 30.0, 40.0]);
    shown.check(10, [21.0, 31.0, 41.0]);
    // As after a restart: facts that are derived from the captures are not stored.
    shown.machine = serde_json::from_str(&serde_json::to_string(&shown.machine).unwrap()).unwrap();
    assert!(shown.machine.forget(BED), "it was captured");
    assert!(!shown.machine.forget(BED), "nothing is left to forget");
    for reference in [Start, Zero] {
        assert_eq!(captured(&shown, reference, BED), None);
    }
    assert!(!shown.check(20, [26.0, 32.0, 42.0]).started, "the machine has not started again");
    for reference in [Start, Zero] {
        assert_eq!(captured(&shown, reference, BED), Some(26.0));
        assert_eq!(captured(&shown, reference, ON), Some(30.0));
    }
}

#[test]
fn a_forgotten_signal_settles_like_any_other() {
    let mut shown = Shown::new(MachineSettings { on: None, zero: None, signals: 1, ..settings(30) });
    for (seconds, value) in [(0, 20.0), (30, 20.0)] {
        shown.check(seconds, [value, 0.0, 0.0]);
    }
    assert_eq!(captured(&shown, Start, BED), Some(20.0));
    shown.machine.forget(BED);
    for (seconds, value) in [(100, 25.0), (110, 27.0)] {
        shown.check(seconds, [value, 0.0, 0.0]);
        assert_eq!(captured(&shown, Start, BED), None);
    }
    shown.check(130, [30.0, 0.0, 0.0]);
    assert_eq!(captured(&shown, Start, BED), Some(26.0));
}
