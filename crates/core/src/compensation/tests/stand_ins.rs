//! Tests of frozen and lost sensors: detection, replacement by stand-ins, and acceptance.

use proptest::prelude::*;

use super::*;
use crate::compensation::model::envelope::Identified;
use crate::compensation::model::stand_ins::{Described, Replaces};
use crate::compensation::model::{Envelope, Outside, StandIns};
use crate::quantity::of;

pub(super) const COLUMN: SignalId = SignalId(2);
/// Threshold θ of each sensor, °C: the predicted change after which a constant reading is suspected.
pub(super) const THRESHOLD: f64 = 0.3;

/// Predictions of the sensors: each is the mean of the others. The column is predicted from the bed alone, which is too
/// few for a stand-in.
pub(super) fn stand_ins(file: u64) -> StandIns {
    let sensor = |signal, terms| Described { signal, threshold: THRESHOLD, stands_in: true, terms };
    let bed = vec![Described::term(WHEELHEAD, None, 0.5), Described::term(COLUMN, None, 0.5)];
    let wheelhead = vec![Described::term(COLUMN, None, 0.5), Described::term(BED, None, 0.5)];
    let column = vec![Described::term(BED, None, 1.0)];
    StandIns::new(vec![sensor(BED, bed), sensor(WHEELHEAD, wheelhead), sensor(COLUMN, column)], file)
}

pub(super) fn rises() -> Model {
    let terms = [
        term(BED, 2.0, Reference::Start),
        lagged(BED, 3.0, Reference::Start, Some(seconds(1800.0))),
        term(WHEELHEAD, -1.0, Reference::Start),
    ];
    linear("rises", 0.0, &terms)
}

pub(super) fn settings(file: u64) -> AxisSettings {
    let watched = Model { stand_ins: Some(stand_ins(file)), ..rises() };
    in_large_steps(vec![watched, linear("wheelhead", 0.0, &[term(WHEELHEAD, 1.0, Reference::Start)])])
}

/// Returns an axis with a step that is larger than any change by a stand-in.
pub(super) fn in_large_steps(models: Vec<Model>) -> AxisSettings {
    let axis = axis(models);
    AxisSettings { guard: GuardSettings { step: um(5.0), ..axis.guard }, ..axis }
}

/// Two equal machines: one with failing sensors, and one without.
pub(super) struct Twins {
    pub(super) failing: Rig,
    pub(super) whole: Rig,
    pub(super) minutes: f64,
    /// Rate of the sensors, °C per minute.
    pub(super) slope: f64,
    pub(super) frozen: [Option<f64>; 3],
    pub(super) lost: [bool; 3],
}

impl Twins {
    pub(super) fn new(slope: f64) -> Twins {
        let (failing, whole) = (Rig::new(settings(1)), Rig::new(axis(vec![rises()])));
        Twins { failing, whole, minutes: 0.0, slope, frozen: [None; 3], lost: [false; 3] }
    }

    fn true_value(&self, place: usize) -> f64 {
        20.0 + place as f64 + self.slope * self.minutes
    }

    pub(super) fn freeze(&mut self, signal: SignalId) {
        self.frozen[signal.0] = Some(self.true_value(signal.0));
    }

    /// Simulates an operator who checks the sensors: disarms the axis with the failing sensors, and arms it again.
    pub(super) fn check(&mut self) {
        self.failing.control.trust = true;
        self.failing.permit(Permit::Off);
        self.run(0.1);
        self.failing.permit(Permit::Armed);
    }

    /// Steps both machines for this time, every ten seconds. Returns the largest difference of the Cz that their models
    /// request, µm, and the last decision of the failing machine.
    pub(super) fn run(&mut self, minutes: f64) -> (f64, Decision) {
        let (mut apart, end) = (0.0_f64, self.minutes + minutes);
        loop {
            let truth = [0, 1, 2].map(|place| self.true_value(place));
            for (place, truth) in truth.into_iter().enumerate() {
                self.whole.values[place] = truth;
                let shown = if self.lost[place] { f64::NAN } else { truth };
                self.failing.values[place] = self.frozen[place].unwrap_or(shown);
            }
            let (failing, whole) = (self.failing.step(), self.whole.step());
            if let (Some(failing), Some(whole)) = (failing.raw, whole.raw) {
                apart = apart.max((failing - whole).abs().get());
            }
            for rig in [&mut self.failing, &mut self.whole] {
                rig.now = rig.now.after(seconds(10.0));
            }
            self.minutes += 1.0 / 6.0;
            if self.minutes >= end {
                return (apart, failing);
            }
        }
    }
}

#[test]
fn a_sensor_that_freezes_while_the_machine_warms_is_found_and_replaced() {
    let mut twins = Twins::new(0.05);
    let (apart, decision) = twins.run(60.0);
    assert!(apart < 1e-9 && decision.state == AxisState::Active, "{apart} {decision:?}");
    twins.freeze(BED);
    let at = twins.failing.now;
    let (before, decision) = twins.run(5.0);
    assert_eq!(decision.stood_in, None, "its prediction has moved by no more than 0.3 °C");
    assert!(before > 0.3, "a frozen sensor is missing meanwhile: {before}");
    let (_, decision) = twins.run(7.0);
    let found = decision.stood_in.unwrap();
    assert_eq!((decision.state, decision.model), (AxisState::Degraded, Some(0)));
    assert_eq!((found.signal, found.frozen, found.others), (BED, true, 2));
    assert!(at.since(found.since) <= seconds(10.0), "since it last changed: {found:?}");
    let (apart, decision) = twins.run(600.0);
    assert_eq!(decision.state, AxisState::Degraded);
    // The mean of a minute is half a minute old, and one more until the next.
    assert!(apart < 0.05 * 2.0 * 5.0, "{apart}");
}

#[test]
fn a_sensor_of_a_machine_that_rests_is_never_frozen() {
    let mut twins = Twins::new(0.0);
    let (apart, decision) = twins.run(48.0 * 60.0);
    assert_eq!((apart, decision.state, decision.stood_in), (0.0, AxisState::Active, None));
}

#[test]
fn a_frozen_sensor_that_moves_again_is_believed_after_an_hour_of_agreement() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.freeze(BED);
    assert!(twins.run(30.0).1.stood_in.is_some());
    twins.frozen[0] = None;
    assert!(twins.run(58.0).1.stood_in.is_some());
    let (apart, decision) = twins.run(5.0);
    assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None));
    assert!(apart < 0.5, "{apart}");
}

#[test]
fn a_frozen_sensor_that_moves_and_does_not_agree_is_not_believed_until_a_person_has_looked() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.freeze(BED);
    twins.run(30.0);
    for shown in [30.0, 30.1, 30.2] {
        twins.frozen[0] = Some(shown);
        assert!(twins.run(40.0).1.stood_in.is_some(), "{shown}");
    }
    twins.failing.permit(Permit::Off);
    assert_eq!(twins.run(0.1).1.state, AxisState::Off);
    twins.failing.permit(Permit::Armed);
    assert!(
        twins.run(1.0).1.stood_in.is_some(),
        "it was switched off by the gateway itself: nobody has looked"
    );
    twins.check();
    twins.frozen[0] = None;
    let (_, decision) = twins.run(1.0);
    assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None));
}

#[test]
fn a_lost_sensor_is_replaced_at_once_and_a_line_that_was_lost_is_no_lost_sensor() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost[0] = true;
    let (apart, decision) = twins.run(2.0);
    assert_eq!((decision.state, decision.model), (AxisState::Degraded, Some(0)));
    assert!(!decision.stood_in.unwrap().frozen && apart < 0.5, "{apart} {decision:?}");
    twins.lost[0] = false;
    assert_eq!(twins.run(0.1).1.state, AxisState::Active);
    twins.lost[0] = true;
    assert!(twins.run(300.0).0 < 0.5);
    twins.lost[0] = false;
    assert_eq!(twins.run(50.0).1.state, AxisState::Degraded, "an hour has not gone by");
    assert_eq!(twins.run(15.0).1.state, AxisState::Active);
}

#[test]
fn a_stand_in_is_never_an_input_of_another() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost[0] = true;
    twins.run(10.0);
    // Both depend on each other: neither the model nor its fallback can be used.
    twins.lost[1] = true;
    let (_, decision) = twins.run(10.0);
    assert_eq!((decision.model, decision.lacks), (None, Some(Unusable::Signal(BED))));
    // When the bed is back and the operator has checked it, the wheelhead has its stand-in.
    twins.lost[0] = false;
    twins.check();
    let (apart, decision) = twins.run(5.0);
    assert_eq!(decision.stood_in.map(|found| found.signal), Some(WHEELHEAD));
    assert!(apart < 1.0, "{apart}");
}

#[test]
fn a_frozen_sensor_that_nobody_stands_in_for_is_reported_and_its_reading_is_used() {
    let mut settings = settings(1);
    let sensor = Described {
        signal: WHEELHEAD,
        threshold: THRESHOLD,
        stands_in: false,
        terms: vec![Described::term(BED, None, 1.0)],
    };
    settings.models[0].stand_ins = Some(StandIns::new(vec![sensor], 1));
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(settings);
    twins.run(60.0);
    twins.freeze(WHEELHEAD);
    let (apart, decision) = twins.run(20.0);
    assert_eq!((decision.model, decision.lacks), (Some(0), None));
    assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None));
    assert!(apart > 0.9 && apart < 1.1, "its gain is 1, and it has missed 1 °C: {apart}");
    let found: Vec<RejectedSensor> = twins.failing.compensation.rejected(0).collect();
    assert_eq!((found.len(), found[0].signal, found[0].frozen, found[0].others), (1, WHEELHEAD, true, None));
    twins.frozen[1] = None;
    let (_, decision) = twins.run(0.1);
    assert_eq!((decision.state, twins.failing.compensation.rejected(0).count()), (AxisState::Active, 0));
}

#[test]
fn a_prediction_that_does_not_replace_a_lost_sensor_replaces_a_frozen_one() {
    let sensor = |signal: SignalId, others: [SignalId; 2]| Described {
        signal,
        threshold: THRESHOLD,
        stands_in: false,
        terms: others.map(|other| Described::term(other, None, 0.5)).to_vec(),
    };
    let mut settings = settings(1);
    let sensors = vec![sensor(BED, [WHEELHEAD, COLUMN]), sensor(WHEELHEAD, [BED, COLUMN])];
    settings.models[0].stand_ins = Some(StandIns::new(sensors, 1));
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(settings);
    twins.run(60.0);
    twins.freeze(BED);
    let (_, decision) = twins.run(20.0);
    assert_eq!((decision.model, decision.stood_in.map(|found| found.signal)), (Some(0), Some(BED)));
    assert!(twins.run(300.0).0 < 0.5);
    twins.frozen[BED.0] = None;
    assert_eq!(twins.run(90.0).1.stood_in, None);
    twins.lost[BED.0] = true;
    let (_, decision) = twins.run(20.0);
    assert_eq!((decision.model, decision.stood_in), (Some(1), None), "a lost one: the model without it");
}

#[test]
fn one_other_sensor_stands_in_for_none_and_still_finds_a_frozen_one() {
    let mut twins = Twins::new(0.05);
    let watched = stand_ins(1).watched().collect::<Vec<_>>();
    assert_eq!(
        watched,
        [(BED, Replaces::FrozenOrLost), (WHEELHEAD, Replaces::FrozenOrLost), (COLUMN, Replaces::Nothing)]
    );
    twins.run(60.0);
    twins.freeze(COLUMN);
    assert_eq!(twins.run(20.0).1.stood_in, None);
    let found: Vec<RejectedSensor> = twins.failing.compensation.rejected(0).collect();
    assert_eq!((found.len(), found[0].signal, found[0].others), (1, COLUMN, None));
}

#[test]
fn a_substitution_that_moves_the_target_by_more_than_a_step_is_not_made() {
    for (step, is_made) in [(0.6, false), (1.6, true)] {
        let mut axis = settings(1);
        axis.guard.step = um(step);
        let mut twins = Twins::new(0.05);
        twins.failing = Rig::new(axis);
        twins.run(60.0);
        twins.freeze(BED);
        let before = twins.run(5.0).1.raw.unwrap();
        // 0.3 °C of the bed are 0.6 µm at once, and some of it through a lag.
        let mut last = before;
        for _ in 0..180 {
            let raw = twins.run(1.0 / 6.0).1.raw.unwrap();
            assert!((raw - last).abs().get() <= step.max(0.2), "{step}: {last} {raw}");
            last = raw;
        }
        let decision = *twins.failing.compensation.decision(0).unwrap();
        assert_eq!(decision.stood_in.is_some(), is_made, "{step}");
        assert_eq!((decision.model, twins.failing.compensation.rejected(0).count()), (Some(0), 1), "{step}");
    }
}

#[test]
fn what_the_envelope_fades_counts_in_what_a_substitution_moves() {
    // The bed and the wheelhead rise together. If one of them is frozen, their combination is new to the model.
    let covariance = [vec![1.0, 0.999], vec![0.999, 1.0]];
    for (outside, is_made) in [(Outside::Warn, true), (Outside::Shrink, false)] {
        let known = |signal| Identified {
            input: Input::of(signal, Reference::Start, None),
            mean: 1.0,
            range: (-1.0, 90.0),
        };
        let envelope = Envelope::new(vec![known(BED), known(WHEELHEAD)], &covariance, Some(5.0), outside);
        let mut axis = settings(1);
        axis.models[0].envelope = Some(envelope.unwrap());
        axis.guard.step = um(3.0);
        let mut twins = Twins::new(0.05);
        twins.failing = Rig::new(axis);
        twins.run(60.0);
        twins.freeze(BED);
        let (_, decision) = twins.run(30.0);
        assert_eq!((decision.model, decision.stood_in.is_some()), (Some(0), is_made), "{outside:?}");
        assert_eq!(twins.failing.compensation.rejected(0).count(), 1, "{outside:?}");
    }
}

#[test]
fn a_sensor_that_was_lost_when_the_machine_started_rises_as_the_others_say() {
    let mut twins = Twins::new(0.05);
    twins.lost[0] = true;
    let (apart, decision) = twins.run(300.0);
    assert_eq!((decision.state, decision.model), (AxisState::Degraded, Some(0)));
    assert!(apart < 0.5, "{apart}");
    let mut absolute = Twins::new(0.05);
    let mut settings = settings(1);
    let Kind::Linear(linear) = &mut settings.models[0].kind else { panic!("linear") };
    linear.terms[0].input.reference = Reference::Fixed(of(20.0));
    absolute.failing = Rig::new(settings);
    absolute.lost[0] = true;
    assert_eq!(absolute.run(60.0).1.model, Some(1), "nobody knows how warm it was");
}

#[test]
fn a_run_that_goes_on_elsewhere_decides_the_same_bit_for_bit() {
    let mut twins = Twins::new(0.05);
    twins.run(60.3);
    twins.freeze(BED);
    for span in [3.2, 6.1, 17.7] {
        twins.run(span);
        let kept = serde_json::to_string(&twins.failing.compensation.running()).unwrap();
        let kept = serde_json::from_str(&kept).unwrap();
        let machine = MachineSettings { signals: 4, ..MachineSettings::default() };
        twins.whole.compensation = Compensation::new(machine, vec![settings(1)], kept);
        let mut values = twins.failing.values;
        for _ in 0..60 {
            values[1] += 0.05;
            values[2] += 0.05;
            (twins.failing.values, twins.whole.values) = (values, values);
            let (there, here) = (twins.failing.after(10.0), twins.whole.after(10.0));
            assert_eq!(here, there);
        }
        twins.minutes += 10.0;
    }
    assert!(twins.failing.compensation.decision(0).unwrap().stood_in.is_some());
}

#[test]
fn what_was_kept_with_another_file_is_not_taken_up() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.freeze(BED);
    twins.run(30.0);
    let kept = twins.failing.compensation.remembered();
    for (file, frozen) in [(1, true), (2, false)] {
        let machine = MachineSettings { signals: 4, ..MachineSettings::default() };
        twins.failing.compensation = Compensation::new(machine, vec![settings(file)], kept.clone());
        assert_eq!(twins.failing.step().stood_in.is_some(), frozen, "{file}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whenever_it_freezes_it_is_found_when_the_others_have_moved_by_the_threshold(
        slope in prop_oneof![-0.1..-0.01_f64, 0.01..0.1_f64],
        after in 5.0..90.0_f64,
    ) {
        let mut twins = Twins::new(slope);
        prop_assert!(twins.run(after).0 < 1e-9);
        twins.freeze(BED);
        let moved = THRESHOLD / slope.abs();
        if moved > 4.0 {
            prop_assert_eq!(twins.run(moved - 1.5).1.stood_in, None);
        }
        prop_assert!(twins.run(8.0 + moved).1.stood_in.is_some());
        prop_assert!(twins.run(120.0).0 < slope.abs() * 2.0 * 5.0);
    }

    #[test]
    fn whatever_freezes_the_axis_follows_its_model(
        slope in -0.1..0.1_f64,
        acts in prop::collection::vec((0..8_u8, 1.0..40.0_f64), 1..8),
    ) {
        let mut twins = Twins::new(slope);
        for (frozen, minutes) in acts {
            for place in 0..3 {
                match ((frozen >> place) & 1 == 1, twins.frozen[place]) {
                    (true, None) => twins.freeze(SignalId(place)),
                    (false, Some(_)) => twins.frozen[place] = None,
                    _ => {}
                }
            }
            let end = twins.minutes + minutes;
            while twins.minutes < end {
                let (_, decision) = twins.run(0.1);
                prop_assert_eq!((decision.model, decision.lacks), (Some(0), None), "{:?}", decision);
                prop_assert!(decision.state.is_following(), "{:?}", decision);
            }
        }
    }
}
