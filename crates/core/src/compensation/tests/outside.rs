//! Tests of an axis whose inputs are outside the envelope: it reports this, and acts as the profile says.

use crate::quantity::of;
use proptest::prelude::*;

use super::*;
use crate::compensation::model::envelope::{Identified, agreed};
use crate::compensation::model::{Envelope, Input, Outside};

/// Difference of the gains of the two halves, µm/°C.
const APART: f64 = 1.0;

/// Model `Cz = 2·(bed − 20)`, identified on 18 to 28 °C.
fn model(outside: Outside) -> Model {
    let mut model = linear("rise", 0.0, &[term(BED, 2.0, Reference::Fixed(of(20.0)))]);
    let input = Input::of(BED, Reference::Fixed(of(0.0)), None);
    let known = Identified { input, mean: 23.0, range: (18.0, 28.0) };
    let envelope = Envelope::new(vec![known], &[vec![9.0]], Some(3.0), outside).unwrap();
    model.envelope = Some(envelope.of_halves(if outside == Outside::Agree { vec![APART] } else { vec![] }));
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
    for outside in [Outside::Warn, Outside::Hold, Outside::Shrink, Outside::Agree] {
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

#[test]
fn agree_takes_what_the_halves_agree_on_the_more_the_farther() {
    let mut rig = rig(Outside::Agree);
    // The reach of 3 is at 9 °C from the mean; the range of 10 °C ends 5 °C from it and counts first.
    for (bed, share) in [
        (28.0, 1.0),
        (28.9, 1.0),
        // At e = 0.225, half of the difference counts: (0.5·10.25)² compared with 20.5².
        (30.25, 1.0 / (1.0 + 0.25 * 0.25)),
        (31.5, 1.0 / (1.0 + 0.5 * 0.5)),
        (60.0, 1.0 / (1.0 + 0.5 * 0.5)),
    ] {
        let decision = rig.show(bed, 0.0).after(10.0);
        assert_eq!(decision.state, AxisState::Active);
        let (wanted, found) = (2.0 * (bed - 20.0) * share, decision.raw.unwrap().get());
        assert!((found - wanted).abs() < 1e-9, "{bed}: {found} {wanted}");
        if let Some(found) = decision.extrapolating {
            assert!((found.apart.unwrap().get() - APART * (bed - 20.0)).abs() < 1e-9, "{found:?}");
            assert!((found.gain - share).abs() < 1e-9);
        }
    }
}

#[test]
fn what_the_halves_agree_on_is_measured_from_the_datum() {
    let mut settings = axis(vec![model(Outside::Agree)]);
    settings.datum = Datum::Zero;
    let mut rig = Rig::new(settings);
    rig.show(27.0, 0.0).run(100.0);
    rig.compensation.zero(rig.now);
    rig.run(100.0);
    let far = rig.show(40.0, 0.0).after(10.0);
    // 13 °C from the datum: x = 26, d = 13.
    assert!((far.extrapolating.unwrap().apart.unwrap().get() - 13.0).abs() < 1e-9, "{far:?}");
    assert!((far.raw.unwrap().get() - 26.0 * 0.8).abs() < 1e-9, "{far:?}");
}

#[test]
fn where_halves_differ_and_cz_is_nothing_nothing_is_asked_for() {
    let mut settings = axis(vec![model(Outside::Agree)]);
    settings.datum = Datum::Zero;
    let mut rig = Rig::new(settings);
    rig.show(60.0, 0.0).run(100.0);
    rig.compensation.zero(rig.now);
    let decision = rig.run(100.0).pop().unwrap();
    assert_eq!((decision.raw, decision.extrapolating.unwrap().gain), (Some(Micron::ZERO), 1.0));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_temperature_makes_a_step_larger_than_allowed(beds in prop::collection::vec(-1e3..1e3_f64, 1..60), way in 0..4_usize) {
        let mut rig = rig([Outside::Warn, Outside::Hold, Outside::Shrink, Outside::Agree][way]);
        let mut last = Micron::ZERO;
        for bed in beds {
            let decision = rig.show(bed, 0.0).after(10.0);
            prop_assert!((decision.cz - last).abs() <= um(1.0 + 1e-9));
            prop_assert!(decision.cz.abs() <= um(40.0));
            last = decision.cz;
        }
    }

    #[test]
    fn what_the_halves_agree_on_is_continuous_and_never_more_than_the_model(
        excess in -0.5..2.0_f64,
        x in -50.0..50.0_f64,
        apart in -50.0..50.0_f64,
        little in 1e-9..1e-6_f64,
    ) {
        let cz = |excess: f64| x * agreed(excess, x, apart);
        prop_assert!((cz(excess + little) - cz(excess)).abs() <= 10.0 * little * (x.abs() + apart.abs()));
        prop_assert!(cz(excess).abs() <= x.abs() && cz(excess) * x >= 0.0);
        prop_assert!(excess > 0.1 || cz(excess).to_bits() == x.to_bits());
    }
}
