use super::*;
use crate::quantity::of;

/// Rig with model M13. K0 is the temperature of the wheelhead. The slope tanβ is 0.007 µm/mm for each degree of the bed
/// above 20 °C. The axis travels 300 mm to both sides of P0 = 0.
fn line(count: Option<f64>) -> Rig {
    let terms = vec![term(BED, 0.007, Reference::Fixed(of(20.0)))];
    let slope = Slope { position: ON, reference: of(0.0), travel: Some((of(-300.0), of(300.0))), terms };
    let terms = vec![term(WHEELHEAD, 1.0, Reference::Fixed(of(0.0)))];
    let kind = Kind::Linear(Linear { offset: of(0.0), terms, slope: Some(slope) });
    let intercept_slope = Some(InterceptSlope { reference: of(0.0), reach: of(300.0), count: count.map(um) });
    let model = Model::new("line".to_owned(), kind);
    let mut rig = Rig::new(AxisSettings { intercept_slope, ..axis(vec![model]) });
    rig.values[ON.0] = f64::NAN;
    rig
}

#[test]
fn m13_the_control_is_given_the_parts_wherever_the_axis_stands() {
    let mut rig = line(None);
    rig.found(0.0).show(25.0, 5.0);
    let decision = *rig.run(600.0).last().unwrap();
    let slope = decision.slope.get() / 300.0;
    assert_eq!(decision.raw, Some(um(5.0)), "no position is needed");
    assert!((slope - 0.035).abs() < 1e-12 && (decision.cz.get() - 5.0).abs() < 1e-12, "{decision:?}");
    assert!((decision.cz.get() + slope * -300.0 - -5.5).abs() < 1e-9);
}

#[test]
fn the_slopes_effect_obeys_step_limit_and_the_counts_of_its_own_register() {
    let mut rig = line(Some(0.3));
    let mut last = Micron::ZERO;
    for decision in rig.found(0.0).show(60.0, 5.0).run(1200.0) {
        assert!((decision.slope - last).abs().get() <= 1.0 + 1e-9);
        let counts = decision.slope.get() / 0.3;
        assert!((counts - counts.round()).abs() < 1e-9);
        last = decision.slope;
    }
    assert!((last.get() - 39.9).abs() < 1e-9, "84 µm at the reach are held at the limit: {last:?}");
}

#[test]
fn what_the_slopes_register_held_is_taken_over_and_a_fault_takes_both_parts_to_zero() {
    let mut rig = line(None);
    rig.control.take_over_slope = Some(um(-20.0));
    let decision = rig.found(3.0).show(25.0, 5.0).step();
    assert_eq!((decision.cz, decision.slope), (um(4.0), um(-19.0)));
    let decisions = rig.show(f64::NAN, 5.0).run(300.0);
    let end = decisions.last().unwrap();
    assert_eq!((end.state, end.cz, end.slope), (AxisState::Zeroed, Micron::ZERO, Micron::ZERO));
    let ramping = |decision: &&Decision| decision.state == AxisState::Ramping;
    assert!(decisions.iter().filter(ramping).count() > 5, "not before the larger part is there");
}
