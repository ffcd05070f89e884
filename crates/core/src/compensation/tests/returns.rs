//! The settings of a sensor were changed: an axis that keeps its value returns to its earlier value.

use super::*;
use crate::compensation::ReturnTo;

/// Returns a machine whose axis had the Cz `cz` before the settings of its sensor were changed, and has moved since.
/// Also returns the Cz before the change.
fn changed_at(cz: f64, on_fault: OnFault) -> (Rig, Micron) {
    let mut settings = axis(vec![linear("rise", 0.0, &[term(BED, 1.0, Reference::Fixed(of(20.0)))])]);
    settings.on_fault = on_fault;
    let mut rig = Rig::new(settings);
    rig.found(0.0).show(20.0 + cz, 0.0);
    rig.run(400.0);
    let before = rig.after(10.0).cz;
    assert_eq!(before, um(cz));
    // Whole degrees instead of tenths.
    rig.show(2.0, 0.0);
    let moved = rig.run(40.0).last().unwrap().cz;
    assert!(moved < before, "{moved}");
    rig.show(f64::NAN, 0.0);
    rig.control.return_to = Some(ReturnTo { cz: before, slope: Micron::ZERO });
    (rig, before)
}

#[test]
fn an_axis_that_holds_goes_back_in_steps() {
    let (mut rig, before) = changed_at(10.0, OnFault::Hold);
    let mut last = rig.after(10.0);
    for _ in 0..40 {
        rig.control.return_to = Some(ReturnTo { cz: before, slope: Micron::ZERO });
        let decision = rig.after(10.0);
        assert!((decision.cz - last.cz).abs() <= um(1.0), "{} after {}", decision.cz, last.cz);
        assert_eq!(decision.target, before);
        assert!(matches!(decision.state, AxisState::Holding(_)), "{:?}", decision.state);
        last = decision;
    }
    assert_eq!(last.cz, before);
}

#[test]
fn an_output_that_is_in_trouble_is_not_asked_for_what_wrong_readings_required() {
    let (mut rig, before) = changed_at(10.0, OnFault::Hold);
    rig.permit(Permit::Unverified);
    let mut last = rig.after(10.0);
    for _ in 0..40 {
        assert_eq!(last.target, before);
        rig.control.return_to = Some(ReturnTo { cz: before, slope: Micron::ZERO });
        last = rig.after(10.0);
    }
    assert_eq!(last.cz, before);
}

#[test]
fn an_interlock_that_is_open_keeps_it_where_it_is() {
    let (mut rig, _) = changed_at(10.0, OnFault::Hold);
    rig.permit(Permit::Held);
    let held = rig.after(10.0).cz;
    assert_eq!(rig.run(100.0).last().unwrap().cz, held);
}

#[test]
fn an_axis_that_goes_to_zero_goes_there() {
    let (mut rig, _) = changed_at(10.0, OnFault::Zero);
    assert_eq!(rig.run(400.0).last().unwrap().cz, Micron::ZERO);
}
