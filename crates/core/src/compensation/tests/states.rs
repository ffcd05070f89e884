use super::*;
use crate::quantity::of;

const BAD: f64 = f64::NAN;

fn rig(on_fault: OnFault) -> Rig {
    Rig::new(AxisSettings { on_fault, ..axis(vec![difference(), bed_only()]) })
}

const RAMP: OnFault = OnFault::Ramp { after: Duration::from_secs(60) };

/// Returns a machine whose axis is in this state. Cz is 5 µm, in the states off and zeroed 0.
fn in_state(state: &str, on_fault: OnFault) -> Rig {
    let mut rig = rig(on_fault);
    if state == "off" {
        rig.permit(Permit::Off).step();
        return rig;
    }
    rig.found(5.0).show(27.5, 24.0).step();
    match state {
        "active" => {}
        "degraded" => drop(rig.show(27.5, BAD).after(10.0)),
        "holding" => drop(rig.show(BAD, BAD).after(10.0)),
        "ramping" => drop((rig.permit(Permit::Stopping).after(10.0), rig.permit(Permit::Unverified).step())),
        _ => drop(rig.permit(Permit::Stopping).run(100.0)),
    }
    assert_eq!(rig.compensation.decision(0).unwrap().state.name(), state);
    rig
}

#[test]
fn every_event_in_every_state_leads_where_the_diagram_says() {
    let events = [
        (Permit::Armed, 27.5, 24.0),
        (Permit::Armed, 27.5, BAD),
        (Permit::Armed, BAD, BAD),
        (Permit::Unverified, 27.5, 24.0),
        (Permit::Stopping, 27.5, 24.0),
        (Permit::Off, 27.5, 24.0),
    ];
    for (on_fault, from, to) in [
        (RAMP, "off", ["active", "degraded", "holding", "holding", "off", "off"]),
        (RAMP, "active", ["active", "degraded", "holding", "holding", "ramping", "off"]),
        (RAMP, "degraded", ["active", "degraded", "holding", "holding", "ramping", "off"]),
        (RAMP, "holding", ["active", "degraded", "holding", "holding", "ramping", "off"]),
        (RAMP, "ramping", ["active", "degraded", "ramping", "ramping", "ramping", "off"]),
        (RAMP, "zeroed", ["active", "degraded", "zeroed", "zeroed", "zeroed", "off"]),
        (OnFault::Hold, "active", ["active", "degraded", "holding", "holding", "holding", "off"]),
        (OnFault::Hold, "holding", ["active", "degraded", "holding", "holding", "holding", "off"]),
        (OnFault::Zero, "off", ["active", "degraded", "zeroed", "zeroed", "off", "off"]),
        (OnFault::Zero, "active", ["active", "degraded", "ramping", "ramping", "ramping", "off"]),
        (OnFault::Zero, "zeroed", ["active", "degraded", "zeroed", "zeroed", "zeroed", "off"]),
    ] {
        for ((permit, bed, wheelhead), expected) in events.into_iter().zip(to) {
            let mut rig = in_state(from, on_fault);
            let decision = rig.permit(permit).show(bed, wheelhead).after(10.0);
            assert_eq!(decision.state.name(), expected, "{on_fault:?}, {from}: {permit:?} {bed} {wheelhead}");
        }
    }
}

#[test]
fn an_axis_holds_ramps_at_its_rate_reaches_exactly_zero_and_says_so() {
    let mut rig = in_state("active", RAMP);
    let held = rig.compensation.decision(0).unwrap().cz;
    let decisions = rig.show(BAD, BAD).run(200.0);
    let began = decisions[0].at;
    for decision in &decisions {
        let since = decision.at.since(began).as_secs_f64();
        match decision.state {
            AxisState::Holding(_) => assert!(since < 60.0 && decision.cz == held, "{decision:?}"),
            AxisState::Ramping => assert!(since >= 60.0 && decision.cz.get() > 0.0, "{decision:?}"),
            _ => assert_eq!((decision.state, decision.cz), (AxisState::Zeroed, Micron::ZERO)),
        }
    }
    let ramp: Vec<_> = decisions.iter().filter(|d| d.state == AxisState::Ramping).collect();
    for pair in ramp.windows(2) {
        let speed = (pair[0].cz - pair[1].cz).get() / pair[1].at.since(pair[0].at).as_secs_f64();
        assert!((speed - 0.5).abs() < 1e-9, "{speed} µm/s");
    }
}

#[test]
fn a_long_update_period_delays_neither_the_ramp_nor_its_end() {
    for on_fault in [RAMP, OnFault::Zero] {
        let mut rig = in_state("active", on_fault);
        rig.compensation.axes[0].settings.every = seconds(600.0);
        rig.run(10.0);
        let decisions = rig.show(BAD, BAD).run(1300.0);
        let noticed = decisions.iter().find(|d| !d.state.is_following()).expect("the fault is noticed");
        let zeroed = decisions.iter().find(|d| d.state == AxisState::Zeroed).expect("it reaches zero");
        let waits = if on_fault == RAMP { 60.0 } else { 0.0 };
        let took = zeroed.at.since(noticed.at).as_secs_f64();
        assert!(took <= waits + 16.0, "{on_fault:?}: {took} s");
    }
}

#[test]
fn a_ramp_in_tiny_steps_does_not_busy_the_gateway() {
    let mut settings = axis(vec![difference()]);
    settings.guard = GuardSettings { step: um(1e-6), rate: of(1e6), count: None, ..settings.guard };
    let mut rig = Rig::new(settings);
    rig.found(5.0).step();
    let decisions = rig.permit(Permit::Stopping).run(1.0);
    assert!(decisions.len() <= 11, "{} updates in a second", decisions.len());
}

#[test]
fn a_changed_permit_or_a_take_over_is_acted_upon_without_waiting_for_the_period() {
    for (permit, state) in
        [(Permit::Stopping, "ramping"), (Permit::Unverified, "holding"), (Permit::Off, "off")]
    {
        let mut rig = in_state("active", RAMP);
        assert_eq!(rig.permit(permit).after(0.1).state.name(), state);
    }
    let mut rig = in_state("active", RAMP);
    assert_eq!(rig.permit(Permit::Unverified).found(-3.0).after(0.1).cz, um(-3.0));
}

#[test]
fn acting_early_does_not_shift_the_updates() {
    let mut rig = in_state("active", RAMP);
    rig.permit(Permit::Unverified).after(3.0);
    rig.permit(Permit::Armed).after(1.0);
    assert_eq!(rig.compensation.next_due(), Some(Moment::from_nanos(10_000_000_000)));
}

#[test]
fn stopping_runs_the_fault_action_without_waiting() {
    let decision = in_state("active", RAMP).permit(Permit::Stopping).after(10.0);
    assert_eq!((decision.state, decision.cz), (AxisState::Ramping, um(5.0)));
    let decision = in_state("active", OnFault::Hold).permit(Permit::Stopping).after(10.0);
    assert_eq!((decision.state.name(), decision.cz), ("holding", um(6.0)));
}

#[test]
fn an_axis_that_was_never_armed_writes_nothing_when_the_gateway_stops() {
    let decision = in_state("off", RAMP).permit(Permit::Stopping).after(10.0);
    assert_eq!(decision.state, AxisState::Off);
}

#[test]
fn arming_starts_from_what_stands_in_the_register() {
    let mut rig = in_state("off", RAMP);
    let decision = rig.permit(Permit::Armed).found(-12.0).after(10.0);
    assert_eq!((decision.state, decision.cz), (AxisState::Active, um(-11.0)));
}

#[test]
fn what_stands_in_the_register_is_taken_over_in_every_state() {
    for state in ["active", "degraded", "holding", "ramping", "zeroed"] {
        let mut rig = in_state(state, RAMP);
        let last = rig.permit(Permit::Unverified).found(20.0).after(10.0);
        assert!((last.cz.get() - 20.0).abs() <= 1.0 + 1e-9, "{state}: {last:?}");
        let decision = rig.permit(Permit::Armed).show(27.5, 24.0).after(10.0);
        assert!((decision.cz - last.cz).abs().get() <= 1.0 + 1e-9, "{state}: {decision:?}");
    }
}

#[test]
fn a_value_put_into_a_zeroed_register_is_ramped_out_again() {
    let mut rig = in_state("zeroed", RAMP);
    assert_eq!(rig.found(2.0).after(1.0).state, AxisState::Ramping);
    assert_eq!(rig.run(20.0).last().map(|d| d.state), Some(AxisState::Zeroed));
}

#[test]
fn switching_models_and_coming_back_never_steps_further_than_step() {
    for state in ["degraded", "holding", "ramping", "zeroed"] {
        let mut rig = in_state(state, RAMP);
        let mut last = rig.compensation.decision(0).unwrap().cz;
        rig.permit(Permit::Armed).show(37.5, 24.0);
        for decision in rig.run(600.0) {
            assert_eq!(decision.state, AxisState::Active);
            assert!((decision.cz - last).abs().get() <= 1.0 + 1e-9, "{state}: {last:?} to {decision:?}");
            last = decision.cz;
        }
        assert!((last.get() - 32.4).abs() < 1e-9, "{state}: it follows again: {last:?}");
    }
}

#[test]
fn an_axis_whose_writes_are_not_verified_is_never_active() {
    let mut rig = in_state("active", RAMP);
    let held = rig.permit(Permit::Unverified).show(37.5, 24.0).after(0.5);
    assert_eq!((held.state.name(), held.cz), ("holding", um(6.0)));
    assert!(rig.run(300.0).iter().all(|decision| !decision.state.is_following()));
    assert_eq!(rig.permit(Permit::Armed).step().state, AxisState::Active);
}

#[test]
fn a_hold_that_saw_time_run_back_still_ends() {
    let mut rig = in_state("active", RAMP);
    rig.now = rig.now.after(seconds(7200.0));
    rig.show(BAD, BAD).step();
    rig.now = Moment::from_nanos(0);
    rig.step();
    let decisions = rig.run(70.0);
    assert!(decisions.iter().any(|decision| decision.state == AxisState::Ramping));
}
