//! Tests with an output whose register is behind the decisions: Cz stays within one step of the register value.

use super::*;

fn rises() -> Rig {
    let mut rig = Rig::new(axis(vec![linear("rise", 0.0, &[term(BED, 1.0, Reference::Fixed(of(20.0)))])]));
    rig.found(0.0).show(50.0, 0.0);
    rig
}

/// Steps `count` times with an output register that stays at the Cz `at`, µm. Returns the decided Cz of each step.
fn waits(rig: &mut Rig, at: f64, count: usize) -> Vec<f64> {
    let one = |rig: &mut Rig| {
        rig.control.behind = Some(um(at));
        rig.after(10.0).cz.get()
    };
    (0..count).map(|_| one(rig)).collect()
}

#[test]
fn while_an_output_waits_cz_stays_within_one_step_of_it() {
    let mut rig = rises();
    rig.run(30.0);
    let cz = waits(&mut rig, 1.0, 5);
    assert!(cz.iter().all(|cz| (*cz - 2.0).abs() < 1e-9), "{cz:?}");
    let decision = rig.after(10.0);
    assert_eq!((decision.cz, decision.target), (um(3.0), um(30.0)), "it resumes from that value");
}

/// The model changes the direction of its request. The next decision already moves back, from the value of the output
/// that is behind.
#[test]
fn a_request_that_turns_round_is_followed_from_the_output_that_waits() {
    let mut rig = rises();
    rig.run(30.0);
    waits(&mut rig, 1.0, 3);
    rig.show(-10.0, 0.0);
    let cz = waits(&mut rig, 1.0, 3);
    assert_eq!(cz, [1.0, 0.0, 0.0]);
}

/// An axis that keeps its value after a fault does not move, even if an output is behind its decision. Its target is
/// the kept value.
#[test]
fn an_axis_that_holds_keeps_its_value_beside_an_output_that_waits() {
    let mut rig = rises();
    rig.run(50.0);
    let held = rig.after(10.0).cz;
    rig.show(f64::NAN, 0.0);
    rig.control.behind = Some(um(0.0));
    let decision = rig.after(10.0);
    assert_eq!((decision.cz, decision.target), (held, held));
}

#[test]
fn the_target_is_within_the_limit_and_that_of_the_fault_action() {
    let mut rig = rises();
    rig.show(500.0, 0.0);
    rig.after(10.0);
    assert_eq!(rig.after(10.0).target, um(40.0));
    rig.permit(Permit::Stopping);
    assert_eq!(rig.after(10.0).target, Micron::ZERO);
}
