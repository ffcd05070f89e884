//! Outside the envelope of its model an axis says so, and acts as the profile says.

use crate::quantity::of;
use proptest::prelude::*;

use super::*;
use crate::compensation::model::envelope::Identified;
use crate::compensation::model::{Envelope, Input, Outside};

/// `Cz = 2·(bed − 20)`, identified on 18 to 28 °C.
fn model(outside: Outside) -> Model {
    let mut model = linear("rise", 0.0, &[term(BED, 2.0, Reference::Fixed(of(20.0)))]);
    let input = Input { signal: BED, reference: Reference::Fixed(of(0.0)), lag: None };
    let known = Identified { input, mean: 23.0, range: (18.0, 28.0) };
    model.envelope = Some(Envelope::new(vec![known], &[vec![9.0]], None, outside).unwrap());
    model
}

fn rig(outside: Outside) -> Rig {
    let mut settings = axis(vec![model(outside), bed_only()]);
    settings.guard = GuardSettings {
        step: um(1.0),
        rate: of(50.0),
        count: None,
        deadband: Micron::ZERO,
        ..settings.guard
    };
    Rig::new(settings)
}

#[test]
fn inside_nothing_is_said() {
    for outside in [Outside::Warn, Outside::Hold, Outside::Shrink] {
        let decision = rig(outside).show(27.0, 0.0).step();
        assert_eq!((decision.state, decision.extrapolating), (AxisState::Active, None));
        assert_eq!(decision.raw, Some(um(14.0)));
    }
}

#[test]
fn warn_follows_the_model_and_says_by_how_much() {
    let mut rig = rig(Outside::Warn);
    let decision = rig.show(30.0, 0.0).step();
    assert_eq!((decision.state, decision.raw), (AxisState::Active, Some(um(20.0))));
    let found = decision.extrapolating.unwrap();
    let farthest = found.farthest.unwrap();
    assert!(farthest.signal == BED && (farthest.by - 2.0).abs() < 1e-9, "{farthest:?}");
    assert_eq!(rig.show(27.0, 0.0).after(10.0).extrapolating, None);
}

#[test]
fn hold_keeps_the_last_value_for_as_long_as_it_lasts_and_comes_back_in_steps() {
    let mut rig = rig(Outside::Hold);
    rig.show(24.0, 0.0).run(200.0);
    let kept = rig.step().cz;
    assert_eq!(kept, um(8.0));
    rig.show(29.0, 0.0);
    for decision in rig.run(3600.0) {
        assert_eq!((decision.state.name(), decision.cz), ("holding", kept), "no ramp: this is no fault");
        assert_eq!((decision.raw, decision.lacks), (Some(um(18.0)), None));
    }
    let mut last = kept;
    for bed in [27.9, 28.1, 27.6] {
        assert_eq!(rig.show(bed, 0.0).after(10.0).state.name(), "holding", "{bed}: not clearly inside");
    }
    for decision in rig.show(27.4, 0.0).run(300.0) {
        assert_eq!(decision.state, AxisState::Active);
        assert!((decision.cz - last).abs() <= um(1.0 + 1e-9), "{decision:?}");
        last = decision.cz;
    }
    assert!((last - um(14.8)).abs() < um(1e-9));
    assert_eq!(rig.show(27.9, 0.0).after(10.0).state, AxisState::Active, "and outside begins at the edge");
}

#[test]
fn a_fault_that_follows_a_hold_waits_its_own_time() {
    let mut rig = rig(Outside::Hold);
    rig.show(24.0, 0.0).run(200.0);
    rig.show(29.0, 0.0).run(600.0);
    rig.show(f64::NAN, 0.0);
    let states: Vec<&str> = rig.run(90.0).iter().map(|decision| decision.state.name()).collect();
    assert_eq!(states.iter().position(|state| *state == "ramping"), Some(6), "after 60 s: {states:?}");
}

#[test]
fn shrink_takes_less_and_less_of_the_model() {
    let mut rig = rig(Outside::Shrink);
    let mut gains = Vec::new();
    for bed in [28.0, 32.0, 36.0, 60.0, 1000.0] {
        let decision = rig.show(bed, 0.0).after(10.0);
        assert_eq!(decision.state, AxisState::Active);
        gains.push(decision.raw.unwrap().get() / (2.0 * (bed - 20.0)));
    }
    assert!((gains[0] - 1.0).abs() < 1e-12);
    assert!(gains.windows(2).all(|pair| pair[1] < pair[0]), "{gains:?}");
    assert!(gains[4] < 1e-3);
}

#[test]
fn beyond_the_error_level_an_axis_that_holds_outside_takes_its_fault_action() {
    let mut settings = axis(vec![model(Outside::Hold)]);
    settings.levels.error = Some(um(60.0));
    let mut rig = Rig::new(settings);
    rig.show(24.0, 0.0).run(200.0);
    assert!(!rig.show(40.0, 0.0).after(10.0).tripped);
    assert_eq!(rig.step().state.name(), "holding");
    rig.show(60.0, 0.0);
    let decisions = rig.run(90.0);
    assert!(decisions.iter().all(|decision| decision.tripped && decision.extrapolating.is_some()));
    let states: Vec<&str> = decisions.iter().map(|decision| decision.state.name()).collect();
    assert_eq!(states.iter().position(|state| *state == "ramping"), Some(6), "after 60 s: {states:?}");
}

#[test]
fn what_shrinks_is_measured_from_its_datum() {
    let mut settings = axis(vec![model(Outside::Shrink)]);
    settings.datum = Datum::Zero;
    let mut rig = Rig::new(settings);
    rig.show(27.0, 0.0).run(100.0);
    rig.compensation.zero(rig.now);
    let inside = rig.run(100.0).pop().unwrap();
    assert_eq!((inside.raw, inside.extrapolating), (Some(Micron::ZERO), None));
    let (near, far) = (rig.show(29.0, 0.0).after(10.0), rig.show(1000.0, 0.0).after(10.0));
    let gain = near.extrapolating.unwrap().gain;
    assert!((near.raw.unwrap().get() - gain * 4.0).abs() < 1e-9, "{near:?}");
    assert!(far.raw.unwrap().abs() < um(1.0), "to zero, not to the datum with its sign turned: {far:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_temperature_makes_a_step_larger_than_allowed(beds in prop::collection::vec(-1e3..1e3_f64, 1..60), way in 0..3_usize) {
        let mut rig = rig([Outside::Warn, Outside::Hold, Outside::Shrink][way]);
        let mut last = Micron::ZERO;
        for bed in beds {
            let decision = rig.show(bed, 0.0).after(10.0);
            prop_assert!((decision.cz - last).abs() <= um(1.0 + 1e-9));
            prop_assert!(decision.cz.abs() <= um(40.0));
            last = decision.cz;
        }
    }
}
