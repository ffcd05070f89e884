//! Two gateways that write to one register, and an operator for comparison.

use std::time::Duration;

use isotherm_core::output::{Account, ArmState, Doubt, Event, SavedOutput};
use isotherm_core::quantity::Counts;

use super::rig::Rig;
use super::world::settings;

fn gateway(is_shared: bool) -> Rig {
    let account = is_shared.then_some(Account { base: Counts(30), ..Account::default() });
    let stood = (!is_shared).then_some(Counts(30));
    Rig::new(
        settings(is_shared, 80, 4),
        SavedOutput { in_order: true, account, stood, ..SavedOutput::default() },
    )
}

/// Executes the turn of one gateway, with the register value that the other one left. Returns whether it wrote.
fn turn(rig: &mut Rig, register: &mut i64, offset: i64) -> bool {
    rig.register = *register;
    let is_written = rig.seconds(1, offset).is_some();
    if is_written {
        assert_eq!(rig.done(), None);
    }
    *register = rig.register;
    is_written
}

fn why_off(rig: &Rig) -> Option<Doubt> {
    let standing = rig.state.shown(&rig.settings).standing;
    let mut doubts = rig.reported.iter().filter_map(|event| match event {
        Event::Doubted { doubt, .. } => Some(*doubt),
        _ => None,
    });
    doubts.next_back().filter(|_| standing == ArmState::Barred)
}

#[test]
fn two_gateways_on_one_shared_register_notice_each_other_and_both_go_off() {
    let mut both = [gateway(true), gateway(true)];
    let mut register = 30;
    let mut writes = 0;
    // Both follow the same drift of one count per second, alternately.
    for offset in 1..30 {
        writes += both.iter_mut().filter_map(|one| turn(one, &mut register, offset).then_some(())).count();
    }
    assert_eq!(both.map(|one| why_off(&one)), [Some(Doubt::SecondGateway); 2]);
    assert_eq!(writes, 25, "twelve of one, thirteen of the other");
}

/// In a quarter of the turns the order of the two is exchanged, and in an eighth one of them decides nothing new.
#[test]
fn so_do_two_that_take_their_turns_as_it_comes() {
    let mut random = 0x5eed_u64;
    let mut draw = |below: u64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) % below
    };
    let (mut furthest, mut alone) = (0, 0);
    for day in 0..500 {
        let mut both = [gateway(true), gateway(true)];
        let (mut register, mut wanted, mut first) = (30, [0; 2], 0);
        for offset in 1..=80 {
            first = if draw(4) == 0 { 1 - first } else { first };
            for place in [first, 1 - first] {
                let place = usize::try_from(place).unwrap();
                if draw(8) > 0 {
                    wanted[place] = offset;
                }
                turn(&mut both[place], &mut register, wanted[place]);
            }
        }
        let off = both.iter().filter(|one| why_off(one) == Some(Doubt::SecondGateway)).count();
        assert!(off > 0, "day {day}");
        alone += i32::from(off == 1);
        furthest = furthest.max(register - 30);
    }
    println!("one alone on {alone} of 500 days, at most {furthest} counts");
    assert!(furthest < 100, "both together want 160: {furthest}");
    assert!(alone <= 10, "on {alone} of 500 days one goes on alone");
}

#[test]
fn of_two_gateways_on_one_whole_register_the_one_that_finds_the_others_value_goes_off() {
    let (mut one, mut other) = (gateway(false), gateway(false));
    let mut register = 30;
    for offset in 31..40 {
        turn(&mut one, &mut register, offset);
        turn(&mut other, &mut register, offset);
    }
    assert!(other.has_reported(|event| matches!(event, Event::ForeignValue { .. })));
    assert!(!one.reported.iter().any(|event| event.switches_off()), "it is alone now");
    assert_eq!(register, 39);
}

#[test]
fn an_operator_who_follows_our_changes_now_and_then_is_no_gateway() {
    let slow = Duration::from_secs(60);
    let follows = |pause: Duration, edit: i64, ours: i64| {
        let mut rig = gateway(true);
        for offset in 1..20 {
            let mut register = rig.register;
            for change in 0..ours {
                turn(&mut rig, &mut register, offset * ours + change);
            }
            rig.now = rig.now.after(pause);
            rig.register = register + edit;
        }
        why_off(&rig)
    };
    assert_eq!(follows(Duration::ZERO, 1, 1), Some(Doubt::SecondGateway), "always at once, and small");
    assert_eq!(follows(slow, 1, 1), None, "not at once");
    assert_eq!(follows(Duration::ZERO, 5, 1), None, "larger than a step of ours");
    assert_eq!(follows(Duration::ZERO, 1, 3), None, "now and then");
}
