//! A reading that is not believed is used for nothing: no lag, no reference, no lesson, no other sensor's prediction.

use super::stand_ins::{COLUMN, THRESHOLD, Twins, rises, settings, stand_ins};
use super::*;
use crate::compensation::model::envelope::Identified;
use crate::compensation::model::stand_ins::Described;
use crate::compensation::model::{Envelope, Outside, StandIns};

/// A switch that says whether the machine is on.
const SWITCH: SignalId = SignalId(3);

/// Twins of this axis whose machines have a switch.
fn twins(axis: AxisSettings) -> Twins {
    let machine = MachineSettings { signals: 4, on: Some(SWITCH), ..MachineSettings::default() };
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::with(machine.clone(), axis);
    twins.whole = Rig::with(machine, super::axis(vec![rises()]));
    switch(&mut twins, 1.0);
    twins
}

fn switch(twins: &mut Twins, to: f64) {
    (twins.failing.values[3], twins.whole.values[3]) = (to, to);
}

fn signals(twins: &Twins) -> Vec<(SignalId, bool, bool)> {
    let all = twins.failing.compensation.distrusted(0);
    all.map(|found| (found.signal, found.frozen, found.others.is_some())).collect()
}

/// With the bed frozen, and found.
fn frozen_bed() -> Twins {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.freeze(BED);
    assert!(twins.run(30.0).1.stood_in.is_some());
    twins
}

#[test]
fn the_lags_wait_while_nobody_says_what_a_frozen_sensor_would_read() {
    let mut twins = frozen_bed();
    twins.lost[2] = true;
    assert_ne!(twins.run(120.0).1.model, Some(0));
    twins.lost[2] = false;
    twins.run(3.0);
    let (apart, decision) = twins.run(5.0);
    assert_eq!((decision.model, decision.stood_in.map(|found| found.signal)), (Some(0), Some(BED)));
    assert!(apart < 0.5, "{apart}");
}

#[test]
fn a_sensor_that_has_returned_is_not_used_unproven_where_its_stand_in_pauses() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost[0] = true;
    twins.run(60.0);
    twins.lost[2] = true;
    twins.run(10.0);
    twins.lost[0] = false;
    twins.frozen[0] = Some(50.0);
    let (_, decision) = twins.run(10.0);
    assert_eq!((decision.model, decision.lacks), (Some(1), Some(Unusable::Unproven(BED))));
    twins.lost[2] = false;
    let (apart, decision) = {
        twins.run(3.0);
        twins.run(30.0)
    };
    assert_eq!((decision.model, decision.stood_in.map(|found| found.signal)), (Some(0), Some(BED)));
    assert!(apart < 0.5, "{apart}");
}

#[test]
fn a_missing_sample_of_another_changes_nothing_and_a_minute_of_them_ends_the_stand_in() {
    let mut twins = frozen_bed();
    twins.lost[2] = true;
    let mut least = twins.run(0.1).1.model;
    twins.lost[2] = false;
    for _ in 0..20 {
        least = least.max(twins.run(0.1).1.model);
    }
    assert_eq!(least, Some(0));
    twins.lost[2] = true;
    assert_eq!(twins.run(0.5).1.model, Some(0));
    assert_eq!(twins.run(2.0).1.model, Some(1));
}

#[test]
fn what_a_shadow_has_followed_is_kept_while_nobody_predicts() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.freeze(BED);
    twins.run(4.0);
    twins.lost[2] = true;
    assert_eq!(twins.run(2.7).1.stood_in, None);
    twins.lost[2] = false;
    twins.run(3.0);
    let (apart, decision) = twins.run(5.0);
    assert_eq!(decision.stood_in.map(|found| found.signal), Some(BED));
    assert!(apart < 0.6, "{apart}");
}

#[test]
fn what_was_predicted_before_a_stop_is_not_used_after_it() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost[0] = true;
    assert_eq!(twins.run(30.0).1.model, Some(0));
    let kept = twins.failing.compensation.remembered();
    let stop = seconds(8.0 * 3600.0);
    let (before, after) = (twins.failing.now, twins.failing.now.after(stop));
    let machine = MachineSettings { signals: 4, ..MachineSettings::default() };
    let going_on = kept.going_on(before, after, Stop { by_the_clock: Some(stop) });
    twins.failing.compensation = Compensation::new(machine, vec![settings(1)], going_on);
    (twins.failing.now, twins.whole.now) = (after, after);
    assert_eq!(twins.run(0.1).1.model, Some(1));
    let (apart, decision) = {
        twins.run(1.5);
        twins.run(30.0)
    };
    assert_eq!((decision.model, decision.stood_in.map(|found| found.signal)), (Some(0), Some(BED)));
    assert!(apart < 1.0, "{apart}");
    for rig in [&mut twins.failing, &mut twins.whole] {
        rig.now = rig.now.after(seconds(300.0));
    }
    assert_eq!(twins.run(0.1).1.model, Some(1), "nobody looked for five minutes");
    let (_, decision) = twins.run(3.0);
    assert_eq!(decision.stood_in.map(|found| found.signal), Some(BED), "and it is not believed for that");
}

#[test]
fn a_second_frozen_sensor_is_found_and_used_for_nothing() {
    let mut twins = frozen_bed();
    twins.freeze(COLUMN);
    let (_, decision) = twins.run(30.0);
    assert_eq!(signals(&twins), [(BED, true, false), (COLUMN, true, false)]);
    assert_eq!((decision.model, decision.lacks), (Some(1), Some(Unusable::Frozen(BED))));
}

#[test]
fn a_sensor_that_was_missing_at_the_start_comes_back_by_agreement_and_its_start_with_it() {
    let mut twins = twins(settings(1));
    twins.lost[0] = true;
    twins.run(300.0);
    twins.lost[0] = false;
    let (apart, decision) = twins.run(50.0);
    assert_eq!((decision.state, decision.model), (AxisState::Degraded, Some(0)));
    assert!(apart < 0.5, "{apart}");
    let (apart, decision) = twins.run(20.0);
    assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None));
    assert!(apart < 0.5, "{apart}");
    assert!(twins.run(200.0).0 < 0.5);
}

#[test]
fn a_sensor_that_is_frozen_across_a_start_comes_back_by_agreement_and_its_start_with_it() {
    let mut twins = twins(settings(1));
    twins.run(60.0);
    twins.freeze(BED);
    assert!(twins.run(60.0).1.stood_in.is_some());
    switch(&mut twins, 0.0);
    twins.run(0.1);
    switch(&mut twins, 1.0);
    twins.run(3.0);
    let (apart, decision) = twins.run(100.0);
    assert_eq!((decision.model, decision.stood_in.map(|found| found.signal)), (Some(0), Some(BED)));
    assert!(apart < 0.5, "{apart}");
    twins.frozen[0] = None;
    assert!(twins.run(50.0).1.stood_in.is_some());
    twins.run(15.0);
    let (apart, decision) = twins.run(100.0);
    assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None));
    assert!(apart < 0.5, "{apart}");
}

#[test]
fn a_start_while_a_sensor_is_still_missing_begins_its_lags_anew() {
    let mut twins = twins(settings(1));
    twins.lost[0] = true;
    twins.run(120.0);
    switch(&mut twins, 0.0);
    twins.run(0.1);
    switch(&mut twins, 1.0);
    twins.run(3.0);
    let (apart, decision) = twins.run(60.0);
    assert_eq!((decision.model, decision.stood_in.map(|found| found.signal)), (Some(0), Some(BED)));
    assert!(apart < 0.5, "{apart}");
}

#[test]
fn a_datum_is_not_taken_from_a_frozen_sensor() {
    let sensor = Described {
        signal: WHEELHEAD,
        threshold: THRESHOLD,
        stands_in: false,
        terms: vec![Described::term(BED, None, 1.0)],
    };
    let watched = Model { stand_ins: Some(StandIns::new(vec![sensor], 1)), ..rises() };
    let bed = linear("bed", 0.0, &[term(BED, 1.0, Reference::Start)]);
    let mut axis = axis(vec![watched, bed]);
    axis.datum = Datum::Zero;
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(axis);
    twins.run(60.0);
    twins.freeze(WHEELHEAD);
    let (_, decision) = twins.run(20.0);
    assert_eq!((decision.model, decision.lacks), (Some(1), Some(Unusable::Frozen(WHEELHEAD))));
    twins.failing.compensation.zero(twins.failing.now);
    twins.run(0.3);
    let bed = 0.05 * twins.minutes;
    twins.frozen[1] = None;
    twins.look();
    let raw = twins.run(0.1).1.raw.unwrap().get();
    let whole = twins.whole.step().raw.unwrap().get();
    assert!(
        (raw - (whole - bed)).abs() < 0.2,
        "the datum is that of the one that had a value: {raw}, {whole}, {bed}"
    );
}

#[test]
fn a_new_file_on_a_warm_machine_finds_nothing_frozen_until_its_lags_have_settled() {
    let sensor = |lag| Described {
        signal: BED,
        threshold: THRESHOLD,
        stands_in: true,
        terms: vec![Described::term(COLUMN, Some(seconds(lag)), 1.0)],
    };
    let mut twins = Twins::new(0.05);
    twins.run(300.0);
    (0..3).for_each(|place| twins.frozen[place] = Some(twins.failing.values[place]));
    let kept = twins.failing.compensation.remembered();
    let mut settings = settings(2);
    settings.models[0].stand_ins = Some(StandIns::new(vec![sensor(3600.0)], 2));
    let machine = MachineSettings { signals: 4, ..MachineSettings::default() };
    twins.failing.compensation = Compensation::new(machine, vec![settings], kept);
    for _ in 0..40 {
        let (_, decision) = twins.run(15.0);
        assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None), "{}", twins.minutes);
    }
    twins.frozen[2] = None;
    assert!(twins.run(120.0).1.stood_in.is_some(), "and then it does");
}

#[test]
fn nobody_stands_in_or_is_found_frozen_beyond_the_range_of_the_others() {
    let known = |signal| Identified {
        input: Input::of(signal, Reference::Start, None),
        mean: 1.0,
        range: (-1.0, 4.0),
    };
    let covariance = [vec![1.0, 0.0], vec![0.0, 1.0]];
    let envelope = Envelope::new(vec![known(BED), known(WHEELHEAD)], &covariance, Some(100.0), Outside::Warn);
    let mut settings = settings(1);
    settings.models[0].envelope = Some(envelope.unwrap());
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(settings);
    twins.run(50.0);
    twins.lost[0] = true;
    assert_eq!(twins.run(35.0).1.model, Some(0), "4.25 °C: less than a tenth of 5 °C beyond 4");
    assert_eq!(twins.run(15.0).1.model, Some(1), "5 °C");
    twins.slope = -0.05;
    twins.minutes = -85.0;
    assert_eq!(twins.run(3.0).1.model, Some(1), "still beyond");
    twins.minutes = -50.0;
    assert_eq!(twins.run(5.0).1.model, Some(0), "inside again");
}

#[test]
fn a_rise_from_a_zero_before_it_froze_is_known_and_from_a_later_one_is_not() {
    let watched =
        Model { stand_ins: Some(stand_ins(1)), ..linear("zero", 0.0, &[term(BED, 2.0, Reference::Zero)]) };
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(axis(vec![watched]));
    twins.whole = Rig::new(axis(vec![linear("zero", 0.0, &[term(BED, 2.0, Reference::Zero)])]));
    twins.run(60.0);
    twins.freeze(BED);
    twins.run(20.0);
    let (apart, decision) = twins.run(60.0);
    assert_eq!(decision.stood_in.map(|found| found.signal), Some(BED));
    assert!(apart < 0.3, "{apart}");
    twins.failing.compensation.zero(twins.failing.now);
    let (_, decision) = twins.run(1.0);
    assert_eq!((decision.model, decision.lacks), (None, Some(Unusable::Frozen(BED))));
}

#[test]
fn the_sensors_of_a_bus_that_was_lost_for_long_are_believed_at_once() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost = [true; 3];
    assert_eq!(twins.run(30.0).1.model, None);
    twins.lost = [false; 3];
    let (_, decision) = twins.run(0.1);
    assert_eq!((decision.state, decision.stood_in), (AxisState::Active, None));
}

#[test]
fn a_lost_sensor_that_returns_with_the_value_it_had_has_moved() {
    let mut twins = Twins::new(0.0);
    twins.run(60.0);
    twins.lost[0] = true;
    twins.run(30.0);
    twins.lost[0] = false;
    assert_eq!(twins.run(50.0).1.state, AxisState::Degraded);
    assert_eq!(twins.run(15.0).1.state, AxisState::Active);
}
