use super::*;
use crate::quantity::of;

fn raw(rig: &mut Rig) -> f64 {
    rig.step().raw.unwrap().get()
}

#[test]
fn m1_the_difference_of_bed_and_wheelhead() {
    let mut rig = Rig::new(axis(vec![difference()]));
    assert!((raw(&mut rig) - 8.4).abs() < 1e-9);
}

#[test]
fn m2_one_sensor_and_machine_on_time() {
    let mut rig = Rig::new(axis(vec![bed_only()]));
    rig.step();
    rig.now = Moment::from_nanos(0).after(seconds(30_000.0));
    assert!((raw(&mut rig) - 8.4).abs() < 1e-9);
}

#[test]
fn m3_one_temperature_and_an_offset() {
    let mut rig = Rig::new(axis(vec![linear("edm", 80.0, &[term(BED, -4.0, Reference::Fixed(of(0.0)))])]));
    rig.show(23.5, 0.0);
    assert!((raw(&mut rig) - -14.0).abs() < 1e-9);
}

#[test]
fn a_fixed_reference_is_what_a_rise_is_measured_from() {
    let mut rig = Rig::new(axis(vec![linear("rise", 1.0, &[term(BED, 2.0, Reference::Fixed(of(20.0)))])]));
    assert!((raw(&mut rig) - 16.0).abs() < 1e-9);
}

#[test]
fn the_first_model_whose_signals_are_all_good_is_used() {
    let mut rig = Rig::new(axis(vec![difference(), bed_only()]));
    for (bed, wheelhead, model, state, lacks) in [
        (27.5, 24.0, Some(0), "active", None),
        (27.5, f64::NAN, Some(1), "degraded", Some(Unusable::Signal(WHEELHEAD))),
        (f64::NAN, 24.0, None, "holding", Some(Unusable::Signal(BED))),
        (27.5, 24.0, Some(0), "active", None),
    ] {
        let decision = rig.show(bed, wheelhead).after(10.0);
        assert_eq!((decision.model, decision.state.name(), decision.lacks), (model, state, lacks));
        assert_eq!(decision.raw.is_some(), model.is_some());
    }
}

#[test]
fn a_result_that_is_no_number_leaves_the_next_model_to_serve() {
    let mut rig = Rig::new(axis(vec![formula("root", "sqrt(A - 30)"), difference()]));
    let decision = rig.step();
    assert_eq!((decision.model, decision.lacks), (Some(1), Some(Unusable::NotANumber)));
    let enormous = linear("enormous", 0.0, &[term(BED, f64::MAX, Reference::Fixed(of(0.0)))]);
    let mut rig = Rig::new(axis(vec![enormous, difference()]));
    assert_eq!(rig.step().lacks, Some(Unusable::NotANumber));
}

#[test]
fn a_reference_is_waited_for_although_a_fallback_model_could_serve() {
    let settings = MachineSettings { settle: seconds(30.0), signals: 4, ..MachineSettings::default() };
    let rise = linear("rise", 0.0, &[term(BED, 2.0, Reference::Start)]);
    let mut rig = Rig::with(settings, axis(vec![rise, bed_only()]));
    for bed in [20.0, 21.0, 22.0] {
        let decision = rig.show(bed, 24.0).step();
        assert_eq!((decision.model, decision.lacks), (None, Some(Unusable::Reference(BED))));
        rig.now = rig.now.after(seconds(10.0));
    }
    let decision = rig.show(25.0, 24.0).step();
    assert_eq!(decision.model, Some(0));
    assert!((decision.raw.unwrap().get() - 8.0).abs() < 1e-9, "25 over the mean of 20, 21, 22");
}

#[test]
fn machine_on_time_by_a_signal_is_awaited() {
    let settings = MachineSettings { on: Some(ON), signals: 4, ..MachineSettings::default() };
    let mut rig = Rig::with(settings, axis(vec![bed_only()]));
    assert_eq!(rig.step().lacks, Some(Unusable::MachineOff));
    rig.values[ON.0] = 1.0;
    rig.after(3.0);
    rig.now = rig.now.after(seconds(30_000.0));
    assert!((raw(&mut rig) - 8.4).abs() < 1e-9, "counted from the edge, between two updates");
}

#[test]
fn a_short_press_between_two_updates_is_noticed() {
    let settings = MachineSettings { zero: Some(BUTTON), signals: 4, ..MachineSettings::default() };
    let rise = linear("rise", 0.0, &[term(BED, 2.0, Reference::Zero)]);
    let mut rig = Rig::with(settings, axis(vec![rise]));
    rig.show(20.0, 24.0).step();
    for (span, bed, button) in [(3.0, 22.0, 1.0), (0.5, 22.5, 0.0)] {
        rig.values[BUTTON.0] = button;
        let decision = rig.show(bed, 24.0).after(span);
        assert_eq!(decision.at, Moment::from_nanos(0), "the axis is not due");
    }
    let decision = rig.show(23.0, 24.0).after(6.5);
    assert!((decision.raw.unwrap().get() - 2.0).abs() < 1e-9, "{decision:?}");
}

#[test]
fn a_command_zeroes_like_the_button() {
    let rise = linear("rise", 0.0, &[term(BED, 2.0, Reference::Zero)]);
    let mut rig = Rig::new(axis(vec![rise]));
    rig.show(20.0, 24.0).step();
    rig.compensation.zero(rig.now);
    let decision = rig.show(22.0, 24.0).after(10.0);
    assert_eq!(decision.raw, Some(Micron::ZERO));
}
