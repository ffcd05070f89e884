use super::*;

fn zeroed_axis() -> AxisSettings {
    AxisSettings { datum: Datum::Zero, ..axis(vec![difference(), bed_only()]) }
}

fn raw(decision: Decision) -> f64 {
    decision.raw.unwrap().get()
}

#[test]
fn from_the_zero_on_cz_is_measured_from_what_it_was_there() {
    let mut rig = Rig::new(zeroed_axis());
    assert!((raw(rig.show(27.5, 24.0).step()) - 8.4).abs() < 1e-9, "never zeroed: the model's own zero");
    let mut last = rig.run(300.0).last().unwrap().cz;
    rig.compensation.zero(rig.now);
    for decision in rig.run(300.0) {
        assert!(raw(decision).abs() < 1e-9);
        assert!((decision.cz - last).abs().get() <= 1.0 + 1e-9, "no jump at the capture");
        last = decision.cz;
    }
    assert!((raw(rig.show(28.5, 24.0).after(10.0)) - 2.4).abs() < 1e-9);
}

#[test]
fn a_datum_is_the_mean_over_the_settling_time_and_the_old_one_serves_meanwhile() {
    let settings = MachineSettings { zero: Some(BUTTON), settle: seconds(20.0), signals: 4, on: None };
    let mut rig = Rig::with(settings, zeroed_axis());
    rig.show(27.5, 24.0).step();
    rig.values[BUTTON.0] = 1.0;
    assert!((raw(rig.after(10.0)) - 8.4).abs() < 1e-9);
    assert!((raw(rig.show(28.5, 24.0).after(10.0)) - 10.8).abs() < 1e-9);
    assert!(
        (raw(rig.show(28.5, 24.0).after(10.0)) - 0.8).abs() < 1e-9,
        "10.8 over the mean of 8.4, 10.8, 10.8"
    );
}

#[test]
fn each_model_has_its_datum_and_one_that_was_blind_takes_the_firsts() {
    for (at_zero, wanted) in [(24.0, [0.0, 0.0]), (f64::NAN, [2.4 * 3.5 - 2.4 * 4.1, 0.0])] {
        let mut rig = Rig::new(zeroed_axis());
        rig.show(27.5, at_zero).step();
        rig.compensation.zero(rig.now);
        rig.after(10.0);
        let b = |rig: &Rig| 2.4 * 2e-5 * (rig.now.as_secs_f64() - 10.0);
        let degraded = raw(rig.show(27.5, f64::NAN).after(10.0)) + b(&rig);
        let preferred = raw(rig.show(27.5, 24.0).after(10.0));
        assert!((degraded - wanted[1]).abs() < 1e-2, "{degraded}");
        assert!((preferred - wanted[0]).abs() < 1e-2, "{preferred}");
    }
}

#[test]
fn a_datum_survives_a_restart_one_being_taken_too() {
    let settings = MachineSettings { settle: seconds(30.0), signals: 4, ..MachineSettings::default() };
    let mut rig = Rig::with(settings.clone(), zeroed_axis());
    rig.show(27.5, 24.0).step();
    for complete in [false, true] {
        if !complete {
            rig.compensation.zero(rig.now);
            rig.after(10.0);
        }
        let kept = serde_json::to_string(&rig.compensation.remembered()).unwrap();
        rig.compensation =
            Compensation::new(settings.clone(), vec![zeroed_axis()], serde_json::from_str(&kept).unwrap());
        rig.run(40.0);
        assert!(raw(rig.step()).abs() < 1e-9, "complete: {complete}");
    }
}

#[test]
fn one_axis_is_zeroed_alone_where_no_other_counts_from_the_same_signals() {
    let from_zero = |signal, name: &str| AxisSettings {
        name: name.to_owned(),
        ..axis(vec![linear("rise", 0.0, &[term(signal, 1.0, Reference::Zero)])])
    };
    let machine = || MachineSettings { signals: 4, ..MachineSettings::default() };
    let zeroed = |axes: Vec<AxisSettings>| {
        let mut compensation = Compensation::new(machine(), axes, Remembered::default());
        let at = |second: f64| Moment::default().after(seconds(second));
        let step = |compensation: &mut Compensation, second, values: [f64; 4]| {
            let readings = values.map(|value| Reading::good(value, at(second)));
            let controls = [Control { permit: Permit::Armed, ..Control::default() }; 2];
            compensation.step(&Snapshot::new(at(second), &readings), &controls);
        };
        step(&mut compensation, 10.0, [20.0, 20.0, 0.0, 0.0]);
        let is_done = compensation.zero_axis(0, at(15.0));
        step(&mut compensation, 20.0, [25.0, 26.0, 0.0, 0.0]);
        let raw = |axis| compensation.decision(axis).unwrap().raw.unwrap().get();
        (is_done, raw(0), raw(1))
    };
    assert_eq!(zeroed(vec![from_zero(BED, "z"), from_zero(WHEELHEAD, "x")]), (true, 0.0, 6.0));
    assert_eq!(zeroed(vec![from_zero(BED, "z"), from_zero(BED, "x")]), (false, 5.0, 5.0));
}
