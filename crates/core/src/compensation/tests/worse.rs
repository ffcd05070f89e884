//! A model that is worse than no compensation: found by touches, reported, and not followed if the profile says so.

use super::super::probe::{Refused, Worse};
use super::super::settings::{Filter, OnWorse, ProbeSettings};
use super::probes::{correction, learning, near, probe, probed_axis, zeroing_machine};
use super::*;

/// Axis whose model requests 8.4 µm. Its rate is half of a step for each update.
fn wrong(worse: OnWorse, on_fault: OnFault) -> AxisSettings {
    let axis = probed_axis(ProbeSettings { worse, ..probe() });
    let guard = GuardSettings { rate: of(0.05), ..axis.guard };
    AxisSettings { guard, on_fault, ..axis }
}

impl Rig {
    /// Passes a probing of a machine that has this error without compensation, µm. Returns the decision.
    fn touched(&mut self, without: f64) -> Decision {
        let acting = self.compensation.decision(0).unwrap().cz.get();
        self.probe(without + acting, acting)
    }

    fn worse(&self) -> Option<Worse> {
        self.compensation.decision(0).unwrap().worse
    }
}

#[test]
fn by_default_a_model_that_is_worse_is_reported_and_followed() {
    let mut rig = Rig::new(wrong(OnWorse::Warn, OnFault::Hold));
    rig.run(300.0);
    assert_eq!(rig.touched(0.0).worse, None, "one touch is none");
    let decision = rig.touched(0.0);
    let worse = decision.worse.unwrap();
    assert_eq!((worse.touches, worse.without), (2, Micron::ZERO));
    // Half of it is learned from the first one.
    near(worse.with.get(), ((8.4_f64.powi(2) + 4.2_f64.powi(2)) / 2.0).sqrt());
    assert_eq!(decision.state, AxisState::Active);
    near(rig.run(300.0).last().unwrap().cz.get(), 2.1);
}

#[test]
fn with_ramp_cz_goes_to_zero_at_the_rate_and_returns_when_the_model_is_better() {
    for on_fault in [OnFault::Hold, OnFault::Zero, OnFault::Ramp { after: seconds(60.0) }] {
        let mut rig = Rig::new(wrong(OnWorse::Ramp, on_fault));
        near(rig.run(300.0).last().unwrap().cz.get(), 8.4);
        rig.touched(0.0);
        assert_eq!(rig.touched(0.0).state, AxisState::Ramping, "{on_fault:?}");
        let mut last = rig.compensation.decision(0).unwrap().cz;
        for decision in rig.run(300.0) {
            assert!((decision.cz - last).abs().get() <= 0.6 + 1e-9, "{on_fault:?}: {decision:?}");
            assert!(matches!(decision.state, AxisState::Ramping | AxisState::Zeroed), "{decision:?}");
            near(decision.raw.unwrap().get(), 8.4 + correction(decision));
            last = decision.cz;
        }
        assert_eq!((rig.after(10.0).state, last), (AxisState::Zeroed, Micron::ZERO), "{on_fault:?}");
        // The machine now behaves as the model says.
        let raw = rig.after(10.0).raw.unwrap().get();
        let needed = (1..=8).find(|_| rig.touched(-raw).worse.is_none());
        assert!(needed.is_some_and(|needed| needed >= 2), "{on_fault:?}: {needed:?}");
        let decisions = rig.run(300.0);
        for decision in &decisions {
            assert!((decision.cz - last).abs().get() <= 0.6 + 1e-9, "{on_fault:?}: {decision:?}");
            last = decision.cz;
        }
        assert_eq!(decisions.last().unwrap().state, AxisState::Active);
        assert!((last.get() - raw).abs() < 0.2, "{on_fault:?}: {last} {raw}");
    }
}

#[test]
fn a_model_is_compared_whatever_the_axis_does() {
    for permit in [Permit::Off, Permit::Held, Permit::Unverified, Permit::Stopping] {
        let mut rig = Rig::new(wrong(OnWorse::Ramp, OnFault::Hold));
        rig.run(300.0);
        rig.permit(permit);
        rig.touched(0.0);
        assert!(rig.touched(0.0).worse.is_some(), "{permit:?}");
    }
    let mut rig = Rig::new(wrong(OnWorse::Ramp, OnFault::Hold));
    rig.run(300.0);
    rig.permit(Permit::Off);
    rig.touched(0.0);
    rig.touched(0.0);
    rig.permit(Permit::Armed).found(8.4);
    assert_eq!(rig.after(1.0).state, AxisState::Ramping, "armed again");
}

#[test]
fn a_model_that_is_wrong_beyond_belief_is_found_worse_by_the_second_touch() {
    let mut rig = Rig::new(wrong(OnWorse::Warn, OnFault::Hold));
    // The model requests 48 µm, of which 40 may act; 25 are plausible.
    rig.show(44.0, 24.0).run(900.0);
    rig.touched(0.0);
    assert_eq!((rig.refused(), rig.worse()), (Some(Refused::Implausible), None));
    rig.touched(0.0);
    assert_eq!(rig.refused(), Some(Refused::Implausible));
    near(correction(*rig.compensation.decision(0).unwrap()), 0.0);
    near(rig.worse().unwrap().with.get(), 40.0);
}

#[test]
fn a_right_model_is_not_found_worse_by_a_chip_nor_while_cz_is_under_way() {
    let filter = Filter::Weighed { repeat: 0.5, walk: 4.0 };
    let mut rig = Rig::new(probed_axis(ProbeSettings { filter, worse: OnWorse::Ramp, ..probe() }));
    rig.step();
    for (place, chip) in [0.0, 0.0, 40.0, 0.0, 0.0, -12.0, 0.0, 0.0, 20.0, -20.0, 0.0].into_iter().enumerate()
    {
        let decision = rig.touched(chip - 8.4);
        assert_eq!((decision.worse, decision.state), (None, AxisState::Active), "{place}");
        near(correction(decision), 0.0);
        rig.run(5.0);
    }
}

#[test]
fn a_new_datum_discards_the_touches_and_what_is_taken_back_the_verdict() {
    let axis = AxisSettings { datum: Datum::Zero, ..wrong(OnWorse::Warn, OnFault::Hold) };
    let mut rig = Rig::with(zeroing_machine(), axis);
    rig.run(300.0);
    rig.touched(0.0);
    rig.touched(0.0);
    assert_eq!(rig.worse().map(|worse| worse.touches), Some(2));
    rig.compensation.zero(rig.now);
    rig.after(10.0);
    assert_eq!(
        rig.touched(0.0).worse.map(|worse| worse.touches),
        Some(2),
        "while it is captured none counts"
    );
    rig.run(60.0);
    assert_eq!(rig.worse().map(|worse| worse.touches), Some(0));
    rig.control.forget = true;
    assert_eq!(rig.after(1.0).worse, None);
    rig.touched(0.0);
    assert_eq!(rig.worse(), None, "what the model asks for from the new datum on is next to nothing");
}

#[test]
fn a_verdict_outlives_a_restart_and_times_without_a_model_and_a_new_model_does_not_get_it() {
    let axis = || wrong(OnWorse::Ramp, OnFault::Hold);
    let mut rig = Rig::new(axis());
    rig.run(300.0);
    rig.touched(0.0);
    let before = rig.touched(0.0).worse;
    assert!(before.is_some());
    rig.show(f64::NAN, f64::NAN);
    assert_eq!((rig.after(10.0).worse, rig.after(10.0).model), (before, None));
    rig.show(27.5, 24.0);
    rig.restart(axis());
    assert_eq!(rig.after(1.0).worse, before);
    let absolute = Reference::Fixed(of(0.0));
    let other = linear("difference", 0.0, &[term(BED, 2.5, absolute), term(WHEELHEAD, -2.4, absolute)]);
    rig.restart(AxisSettings { models: vec![other], ..axis() });
    assert_eq!(rig.after(1.0).worse, None);
}

#[test]
fn a_row_of_a_log_goes_on_with_the_same_verdict() {
    for settings in [probe(), learning()] {
        let axis = probed_axis(ProbeSettings { worse: OnWorse::Ramp, ..settings });
        let mut rig = Rig::new(axis.clone());
        rig.run(300.0);
        rig.touched(0.0);
        rig.touched(0.0);
        let kept = serde_json::to_string(&rig.compensation.running()).unwrap();
        let machine = rig.compensation.settings.clone();
        let mut there = Rig::new(axis.clone());
        there.compensation = Compensation::new(machine, vec![axis], serde_json::from_str(&kept).unwrap());
        there.now = rig.now;
        for turn in 0..60 {
            let (one, other) = match turn % 7 {
                0 => (rig.touched(-9.0), there.touched(-9.0)),
                _ => (rig.after(10.0), there.after(10.0)),
            };
            assert_eq!(one, other, "{turn}");
        }
    }
}
