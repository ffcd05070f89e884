use super::*;

fn rig() -> Rig {
    let mut rig = Rig::new(axis(vec![difference()]));
    rig.found(0.0).show(27.5, 26.0).step();
    rig.run(100.0);
    rig
}

fn steps(rig: &mut Rig, to: f64, count: usize) -> Vec<f64> {
    let one = |_| {
        rig.control.sign = Some(um(to));
        rig.now = rig.compensation.next_due().unwrap();
        rig.step().cz.get()
    };
    (0..count).map(one).collect()
}

#[test]
fn a_sign_check_takes_cz_there_and_back_within_step_and_rate_as_fast_as_it_may() {
    let mut rig = rig();
    let from = rig.compensation.decision(0).unwrap().cz.get();
    assert!((from - 3.6).abs() < 0.11, "{from}");
    rig.control.sign = Some(um(from + 5.0));
    let begun = rig.now;
    // The first step comes with the period of the axis. The others come with the pace that step and rate allow: 2 s.
    let there = steps(&mut rig, from + 5.0, 7);
    assert!(there.windows(2).all(|pair| pair[1] - pair[0] <= 1.0 + 1e-9), "{there:?}");
    assert!((there[6] - from - 5.0).abs() < 0.11, "{there:?}");
    assert!(rig.now.since(begun) <= seconds(30.0), "{:?}", rig.now.since(begun));
    assert_eq!(rig.compensation.decision(0).unwrap().state, AxisState::Active);
    // The request of the model is shown meanwhile, and followed again afterwards.
    assert!((rig.compensation.decision(0).unwrap().raw.unwrap().get() - 3.6).abs() < 1e-9);
    let back = rig.run(100.0);
    assert!((back.last().unwrap().cz.get() - 3.6).abs() < 0.11);
    assert!(back.windows(2).all(|pair| (pair[1].cz - pair[0].cz).get().abs() <= 1.0 + 1e-9));
}

#[test]
fn a_fault_and_the_limit_come_before_a_sign_check() {
    let mut rig = rig();
    let at_limit = steps(&mut rig, 44.0, 60);
    assert!((at_limit[59] - 40.0).abs() < 1e-9, "{at_limit:?}");
    rig.show(f64::NAN, 26.0);
    let held = steps(&mut rig, 0.0, 3);
    assert!(held.iter().all(|cz| (cz - 40.0).abs() < 1e-9), "{held:?}");
    assert_eq!(rig.compensation.decision(0).unwrap().state.name(), "holding");
    rig.permit(Permit::Off);
    assert!((steps(&mut rig, 0.0, 2)[1] - 40.0).abs() < 1e-9, "an axis that is off moves nothing");
}

#[test]
fn an_axis_without_a_model_goes_to_zero_and_follows_only_a_sign_check() {
    let mut rig = Rig::new(axis(Vec::new()));
    let begun = rig.found(3.0).step();
    assert_eq!((begun.state, begun.model, begun.raw), (AxisState::Active, None, None));
    let rest = rig.run(100.0);
    assert!(rest.windows(2).all(|pair| (pair[1].cz - pair[0].cz).get().abs() <= 1.0 + 1e-9), "{rest:?}");
    assert!(rest.last().unwrap().cz.get().abs() < 1e-9, "{rest:?}");
    let there = steps(&mut rig, 5.0, 7);
    assert!((there[6] - 5.0).abs() < 1e-9, "{there:?}");
    let back = rig.run(100.0);
    assert!(back.last().unwrap().cz.get().abs() < 1e-9, "{back:?}");
    rig.permit(Permit::Unverified);
    assert_eq!(rig.after(10.0).state.name(), "holding", "a write that is not verified moves nothing");
    rig.permit(Permit::Off);
    assert_eq!(rig.after(10.0).state, AxisState::Off);
}

#[test]
fn a_stop_leaves_no_sign_check_behind_on_an_axis_without_a_model() {
    let settings = AxisSettings { on_fault: OnFault::Hold, ..axis(Vec::new()) };
    let longest = settings.time_to_rest(um(5.0)).as_secs_f64();
    let mut rig = Rig::new(settings);
    rig.found(0.0).step();
    let there = steps(&mut rig, 5.0, 7);
    assert!((there[6] - 5.0).abs() < 1e-9, "{there:?}");
    let back = rig.permit(Permit::Stopping).run(longest);
    let last = back.last().unwrap();
    assert_eq!((last.state, last.cz), (AxisState::Zeroed, Micron::ZERO), "{back:?}");
    let kept = AxisSettings { on_fault: OnFault::Hold, ..axis(vec![difference()]) };
    assert_eq!(kept.time_to_rest(um(5.0)), Duration::ZERO, "a model goes on from the value that is kept");
}
