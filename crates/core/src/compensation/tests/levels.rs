use super::*;

fn with_error(on_fault: OnFault) -> Rig {
    let levels = Levels { warn: Some(um(30.0)), error: Some(um(60.0)) };
    Rig::new(AxisSettings { levels, on_fault, ..axis(vec![difference(), bed_only()]) })
}

const RAMP: OnFault = OnFault::Ramp { after: Duration::from_secs(60) };

#[test]
fn a_model_beyond_the_error_level_is_not_followed_until_the_axis_is_armed_again() {
    let mut rig = with_error(RAMP);
    rig.found(5.0).show(27.5, 24.0).step();
    assert_eq!(rig.show(48.0, 24.0).after(10.0).state, AxisState::Active, "57.6 µm are held at the limit");
    let decision = rig.show(50.0, 24.0).after(10.0);
    assert_eq!((decision.state.name(), decision.tripped), ("holding", true));
    assert!((decision.raw.unwrap().get() - 62.4).abs() < 1e-9, "what it asked for is still shown");
    let decisions = rig.show(27.5, 24.0).run(300.0);
    assert!(decisions.iter().all(|decision| decision.tripped && !decision.state.is_following()));
    assert_eq!(decisions.last().unwrap().state, AxisState::Zeroed, "the fault action runs to its end");
    assert_eq!(rig.permit(Permit::Off).after(10.0).state, AxisState::Off);
    let decision = rig.permit(Permit::Armed).found(0.0).after(10.0);
    assert_eq!((decision.state, decision.tripped), (AxisState::Active, false));
}

#[test]
fn an_axis_that_is_off_does_not_trip_and_says_what_lies_beyond() {
    let mut rig = with_error(OnFault::Hold);
    assert!(!rig.permit(Permit::Off).show(50.0, 24.0).step().tripped);
    let readings = [50.0, 24.0, 0.0, 0.0].map(|value| Reading::good(value, rig.now));
    let snapshot = Snapshot::new(rig.now, &readings);
    let beyond = rig.compensation.beyond_error(0, &snapshot).unwrap();
    assert!((beyond.get() - 62.4).abs() < 1e-9);
    assert!(rig.permit(Permit::Armed).after(10.0).tripped);
}
