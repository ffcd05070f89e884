//! A reading that has a stand-in is not used for lags, references, learning or predictions. A suspected reading is used
//! for everything except predictions.

use super::stand_ins::{COLUMN, THRESHOLD, Twins, in_large_steps, rises, settings, stand_ins};
use super::*;
use crate::compensation::model::envelope::Identified;
use crate::compensation::model::stand_ins::Described;
use crate::compensation::model::{Envelope, Outside, StandIns};

/// Signal of a switch that tells whether the machine is on.
const SWITCH: SignalId = SignalId(3);

/// Returns two equal machines with one axis each, and with a switch that shows whether the machine is on.
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
    let all = twins.failing.compensation.rejected(0);
    all.map(|found| (found.signal, found.frozen, found.others.is_some())).collect()
}

/// Returns two machines after the bed sensor of one froze, and was detected as frozen.
fn frozen_bed() -> Twins {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.freeze(BED);
    assert!(twins.run(30.0).1.stood_in.is_some());
    twins
}

#[test]
fn while_nobody_says_what_a_frozen_sensor_would_read_the_last_serves_for_ten_minutes_and_then_its_reading() {
    let stood_in = |decision: Decision| decision.stood_in.map(|found| found.signal);
    let mut twins = frozen_bed();
    twins.lost[2] = true;
    let (apart, decision) = twins.run(8.0);
    assert_eq!((decision.model, stood_in(decision)), (Some(0), Some(BED)));
    assert!(apart < 0.05 * 8.0 * 5.0, "it stays what it was: {apart}");
    twins.lost[2] = false;
    twins.run(3.0);
    let (apart, decision) = twins.run(5.0);
    assert_eq!((decision.model, stood_in(decision)), (Some(0), Some(BED)));
    assert!(apart < 1.0, "{apart}");
    twins.lost[2] = true;
    let (_, decision) = twins.run(112.0);
    assert_eq!((decision.model, decision.lacks, stood_in(decision)), (Some(0), None, None));
    assert_eq!(decision.state, AxisState::Active);
    assert_eq!(signals(&twins), [(BED, true, false), (COLUMN, false, false)]);
    twins.lost[2] = false;
    let (_, decision) = twins.run(30.0);
    assert_eq!(stood_in(decision), None, "it would move the target by far more than a step");
    twins.frozen[0] = None;
    assert_eq!((twins.run(0.1).1.state, signals(&twins)), (AxisState::Active, vec![]));
}

#[test]
fn a_sensor_that_is_back_and_that_nobody_can_prove_is_believed_after_an_hour() {
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost[0] = true;
    twins.run(60.0);
    twins.lost[2] = true;
    twins.run(10.0);
    twins.lost[0] = false;
    let (_, decision) = twins.run(55.0);
    assert_eq!((decision.model, decision.lacks), (Some(1), Some(Unusable::Unproven(BED))));
    let (_, decision) = twins.run(10.0);
    assert_eq!((decision.state, decision.model, decision.stood_in), (AxisState::Active, Some(0), None));
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
    let mut twins = Twins::new(0.05);
    twins.run(60.0);
    twins.lost[0] = true;
    twins.run(30.0);
    twins.lost[2] = true;
    assert_eq!(twins.run(0.5).1.model, Some(0));
    assert_eq!(twins.run(2.0).1.model, Some(1), "of a lost one no reading is left");
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
    twins.run(6.0);
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
    let resumed = kept.resumed(before, after, Stop { by_the_clock: Some(stop) });
    twins.failing.compensation = Compensation::new(machine, vec![settings(1)], resumed);
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
    assert_eq!(decision.stood_in.map(|found| found.signal), Some(BED), "and it is rejected for that");
}

#[test]
fn a_second_frozen_sensor_is_found_and_the_first_one_is_taken_from_it_no_more() {
    let mut twins = frozen_bed();
    twins.freeze(COLUMN);
    let (_, decision) = twins.run(30.0);
    assert_eq!(signals(&twins), [(BED, true, false), (COLUMN, true, false)]);
    assert_eq!((decision.model, decision.lacks, decision.stood_in), (Some(0), None, None));
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
fn a_new_file_on_a_warm_machine_finds_nothing_frozen_until_its_lags_have_settled() {
    let sensor = |lag| Described {
        signal: BED,
        threshold: THRESHOLD,
        stands_in: true,
        terms: vec![
            Described::term(COLUMN, Some(seconds(lag)), 0.5),
            Described::term(WHEELHEAD, Some(seconds(lag)), 0.5),
        ],
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
    assert_eq!(twins.run(30.0).1.model, Some(0), "4 °C");
    assert_eq!(twins.run(10.0).1.model, Some(1), "4.5 °C");
    twins.slope = -0.001;
    twins.minutes = -4020.0;
    assert_eq!(twins.run(3.0).1.model, Some(1), "4.02 °C: not inside");
    twins.minutes = -3000.0;
    assert_eq!(twins.run(5.0).1.model, Some(0), "inside again");
}

#[test]
fn no_sensor_is_suspected_while_another_is_beyond_its_range_and_a_frozen_one_keeps_its_value_from_inside() {
    let known = |signal, range| {
        let input = Input::of(signal, Reference::Start, None);
        Identified { input, mean: 1.0, range }
    };
    let covariance = [vec![1.0, 0.0], vec![0.0, 1.0]];
    let envelope = |bed, wheelhead| {
        let known = vec![known(BED, (-1.0, bed)), known(WHEELHEAD, (-1.0, wheelhead))];
        Envelope::new(known, &covariance, Some(1000.0), Outside::Warn).unwrap()
    };
    let twins = |bed, wheelhead| {
        let mut settings = settings(1);
        settings.models[0].envelope = Some(envelope(bed, wheelhead));
        let mut twins = Twins::new(0.05);
        twins.failing = Rig::new(settings);
        twins.run(60.0);
        twins.freeze(BED);
        twins
    };
    // The wheelhead is at 3 °C; then the bed is, which is a third of its range beyond it.
    for (bed, wheelhead) in [(90.0, 2.0), (2.0, 90.0)] {
        let mut outside = twins(bed, wheelhead);
        assert_eq!((outside.run(300.0).1.state, signals(&outside)), (AxisState::Active, vec![]));
    }
    // A predictor leaves its range, and the stand-in of the bed leaves its own.
    for (bed, wheelhead) in [(90.0, 4.0), (4.0, 90.0)] {
        let mut frozen = twins(bed, wheelhead);
        assert!(frozen.run(15.0).1.stood_in.is_some(), "3.75 °C");
        let (apart, decision) = frozen.run(30.0);
        assert_eq!((decision.model, decision.lacks), (Some(0), None), "5.25 °C");
        assert_eq!(signals(&frozen), [(BED, true, true)]);
        assert!((3.0..5.0).contains(&apart), "with its reading of 3 °C it would be more than 7: {apart}");
    }
}

#[test]
fn a_stand_in_beyond_the_range_of_its_sensor_is_not_used() {
    let known = |signal, to| {
        let input = Input::of(signal, Reference::Start, None);
        Identified { input, mean: 1.0, range: (-1.0, to) }
    };
    let covariance = [vec![1.0, 0.0], vec![0.0, 1.0]];
    let known = vec![known(BED, 4.0), known(WHEELHEAD, 90.0)];
    let mut settings = settings(1);
    settings.models[0].envelope =
        Some(Envelope::new(known, &covariance, Some(1000.0), Outside::Warn).unwrap());
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(settings);
    twins.run(60.0);
    twins.lost[0] = true;
    assert_eq!(twins.run(15.0).1.model, Some(0), "3.75 °C");
    assert_eq!(twins.run(10.0).1.model, Some(1), "4.25 °C");
}

#[test]
fn a_fallback_model_is_not_used_outside_its_own_envelope_and_is_when_it_is_clearly_inside() {
    let known = Identified {
        input: Input::of(WHEELHEAD, Reference::Fixed(of(0.0)), None),
        mean: 23.0,
        range: (20.0, 25.0),
    };
    let envelope = Envelope::new(vec![known], &[vec![4.0]], Some(100.0), Outside::Warn).unwrap();
    let fallback = linear("wheelhead", 0.0, &[term(WHEELHEAD, 1.0, Reference::Fixed(of(20.0)))]);
    let models = vec![difference(), Model { envelope: Some(envelope), ..fallback }];
    let mut rig = Rig::new(axis(models));
    rig.show(f64::NAN, 24.0).step();
    for (wheelhead, model) in
        [(24.0, Some(1)), (25.1, None), (24.9, None), (24.6, Some(1)), (24.9, Some(1)), (19.9, None)]
    {
        let decision = rig.show(f64::NAN, wheelhead).after(10.0);
        assert_eq!((decision.model, decision.lacks), (model, Some(Unusable::Signal(BED))), "{wheelhead}");
    }
    // The preferred model is followed as its own envelope defines.
    assert_eq!(rig.show(27.5, 30.0).after(10.0).model, Some(0));
}

#[test]
fn a_rise_from_a_zero_before_it_froze_is_known_and_from_a_later_one_is_not() {
    let watched =
        Model { stand_ins: Some(stand_ins(1)), ..linear("zero", 0.0, &[term(BED, 2.0, Reference::Zero)]) };
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(in_large_steps(vec![watched]));
    twins.whole = Rig::new(axis(vec![linear("zero", 0.0, &[term(BED, 2.0, Reference::Zero)])]));
    twins.run(60.0);
    twins.freeze(BED);
    twins.run(20.0);
    let (apart, decision) = twins.run(60.0);
    assert_eq!(decision.stood_in.map(|found| found.signal), Some(BED));
    assert!(apart < 0.3, "{apart}");
    twins.failing.compensation.zero(twins.failing.now);
    let (_, decision) = twins.run(1.0);
    assert_eq!((decision.model, decision.lacks, decision.stood_in), (Some(0), None, None));
    assert_eq!(decision.raw, Some(Micron::ZERO), "its reading is used, and the zero is taken of it");
}

#[test]
fn a_frozen_sensor_whose_place_in_the_envelope_is_not_known_any_more_is_read_again() {
    let known = Identified { input: Input::of(BED, Reference::Zero, None), mean: 1.0, range: (-90.0, 90.0) };
    let envelope = Envelope::new(vec![known], &[vec![1.0]], Some(1000.0), Outside::Warn).unwrap();
    let mut settings = settings(1);
    settings.models[0].envelope = Some(envelope);
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(settings);
    twins.run(60.0);
    twins.freeze(BED);
    assert!(twins.run(30.0).1.stood_in.is_some());
    twins.failing.compensation.zero(twins.failing.now);
    let (_, decision) = twins.run(1.0);
    assert_eq!((decision.model, decision.lacks, decision.stood_in), (Some(0), None, None));
    let (_, decision) = twins.run(30.0);
    assert_eq!((decision.model, decision.lacks, decision.stood_in), (Some(0), None, None));
    assert_eq!(signals(&twins), [(BED, true, false)]);
}

#[test]
fn a_sensor_that_one_model_takes_from_others_is_read_by_each_model_whose_watch_does_not() {
    let one_other = Described {
        signal: BED,
        threshold: THRESHOLD,
        stands_in: true,
        terms: vec![Described::term(WHEELHEAD, None, 1.0)],
    };
    let suspecting = Model { stand_ins: Some(StandIns::new(vec![one_other], 2)), ..rises() };
    let replacing =
        Model { name: "replacing".to_owned(), stand_ins: Some(stand_ins(1)), ..suspecting.clone() };
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(in_large_steps(vec![suspecting, replacing.clone()]));
    twins.run(60.0);
    twins.freeze(BED);
    let (_, decision) = twins.run(30.0);
    assert_eq!((decision.state, decision.model, decision.lacks), (AxisState::Active, Some(0), None));
    assert_eq!((decision.stood_in, signals(&twins)), (None, vec![(BED, true, false)]));

    let bed = linear("bed", 0.0, &[term(BED, 1.0, Reference::Start)]);
    let mut twins = Twins::new(0.05);
    twins.failing = Rig::new(in_large_steps(vec![replacing, bed]));
    twins.run(60.0);
    twins.freeze(BED);
    assert!(twins.run(30.0).1.stood_in.is_some());
    twins.lost[1] = true;
    let (_, decision) = twins.run(5.0);
    assert_eq!((decision.state, decision.model), (AxisState::Degraded, Some(1)), "{decision:?}");
    assert_eq!(decision.lacks, Some(Unusable::Signal(WHEELHEAD)));
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
