//! Each row of the tables in the documentation of the module.

use std::time::Duration;

use isotherm_core::output::{
    Account, Action, ArmState, Doubt, Event, Fact, Rule, Rules, SavedOutput, Settings, Verify, Who,
};
use isotherm_core::quantity::Counts;

use super::rig::Rig;
use super::world::settings;

fn whole(stands: i64) -> Rig {
    Rig::new(
        settings(false, 5, 4),
        SavedOutput { in_order: true, stood: Some(Counts(stands)), ..SavedOutput::default() },
    )
}

fn shared(base: i64, share: i64) -> Rig {
    let account = Some(Account { base: Counts(base), share: Counts(share), doubt: None });
    Rig::new(settings(true, 5, 4), SavedOutput { in_order: true, account, ..SavedOutput::default() })
}

fn doubt(rig: &Rig) -> Option<Doubt> {
    rig.reported.iter().find_map(|event| match event {
        Event::Doubted { doubt, .. } => Some(*doubt),
        _ => None,
    })
}

fn standing(rig: &Rig) -> ArmState {
    rig.state.shown(&rig.settings).standing
}

/// Creates an expired value that never arrived, with nothing under way.
fn expired(rig: &mut Rig, offset: i64) -> i64 {
    assert!(rig.want(offset).is_some());
    rig.settings.remembered = Duration::from_secs(60);
    let value = rig.held();
    let stays = rig.register - rig.state.kept().account.map_or(0, |account| account.base.0);
    for _ in 0..6 {
        // The value of a whole register is sent again, to show that it can be written.
        while let Some(again) = rig.seconds(1, stays) {
            assert_eq!((again, rig.done()), (rig.register, None));
        }
    }
    assert!(rig.state.copies().expired_of(Counts(value)).is_some());
    value
}

#[test]
fn the_same_is_nothing_new_and_is_shown_with_the_moment_it_was_asked() {
    let mut rig = whole(2);
    let before = rig.now;
    assert_eq!(rig.seconds(1, 2), None);
    let seen = rig.state.shown(&rig.settings).verified.unwrap();
    assert!(seen.value == Counts(2) && seen.asked > before && seen.asked < rig.now);
    assert!(rig.reported.is_empty());
}

#[test]
fn what_is_acknowledged_and_not_taken_is_tried_again_a_second_later() {
    for mut rig in [whole(0), shared(3, 0)] {
        let stands = rig.register;
        assert!(rig.want(5).is_some());
        rig.give(Fact::Done { left: rig.now });
        assert_eq!(rig.settle(), None);
        assert!(rig.has_reported(|event| matches!(event, Event::NotTaken { .. })) && !rig.blames_others());
        assert_eq!(rig.register, stands);
        assert!(rig.seconds(1, 5).is_some());
        rig.give(Fact::Done { left: rig.now });
        assert_eq!(rig.settle(), None);
        let reported = rig.reported.iter().filter(|event| matches!(event, Event::NotTaken { .. })).count();
        assert_eq!(reported, 1, "once, until a write stands there");
    }
}

#[test]
fn a_value_may_arrive_from_the_moment_it_is_sent_until_a_read_shows_it() {
    let may_arrive = |rig: &Rig| rig.state.may_arrive().collect::<Vec<_>>();
    for mut rig in [whole(0), shared(3, 0)] {
        let value = Counts(rig.want(2).unwrap());
        assert_eq!(may_arrive(&rig), [value], "nothing is known of the write yet");
        rig.give(Fact::Unknown { left: rig.now });
        assert_eq!(may_arrive(&rig), [value], "its answer was lost");
        rig.register = value.0;
        assert_eq!(rig.settle(), None);
        assert_eq!(may_arrive(&rig), [], "a read has shown it");
    }
}

#[test]
fn a_value_under_way_is_ours() {
    let mut rig = shared(3, 0);
    assert_eq!(rig.want(2), Some(5));
    rig.answer_lost();
    assert_eq!(rig.settle(), None);
    assert_eq!(rig.parts(), (3, 2));
    assert!(rig.reported.is_empty(), "its answer was lost, and it is not late");
}

#[test]
fn a_value_lately_sent_is_taken_over_in_a_whole_register() {
    let mut rig = whole(2);
    rig.register = expired(&mut rig, 3);
    assert_eq!(rig.seconds(2, 2), Some(2));
    assert!(rig.has_reported(|event| matches!(event, Event::OwnWriteArrivedLate { value: Counts(3), .. })));
    assert_eq!(standing(&rig), ArmState::Armed);
}

#[test]
fn a_value_lately_sent_is_doubt_in_a_shared_register() {
    let mut rig = shared(3, 0);
    rig.register = expired(&mut rig, 2);
    assert_eq!(rig.seconds(1, 0), None);
    assert_eq!((doubt(&rig), standing(&rig)), (Some(Doubt::YoursOrOurs), ArmState::Barred));
}

#[test]
fn a_value_lately_sent_and_sent_again_is_ended_by_no_pair_of_reads() {
    let mut rig = whole(2);
    let value = expired(&mut rig, 3);
    assert_eq!(rig.seconds(1, 3), Some(value));
    rig.answer_lost();
    assert_eq!(rig.settle(), None);
    assert_eq!(rig.state.copies().under_way().count(), 1, "it may have been the old one that arrived");
}

#[test]
fn zero_is_a_restart_and_the_walk_begins_there() {
    let mut rig = whole(3);
    rig.register = 0;
    assert_eq!(rig.seconds(1, 3), None, "what was decided went by what stood there before");
    assert_eq!(rig.seconds(1, 3), Some(1));
    assert!(rig.has_reported(|event| matches!(event, Event::CncRestarted { stood: Counts(3) })));
    let mut rig = shared(3, 2);
    rig.register = 0;
    assert_eq!(rig.seconds(2, 2), Some(2));
    assert_eq!(rig.parts(), (0, 0));
}

#[test]
fn zero_is_doubt_where_a_write_of_ours_would_make_it_and_something_is_his() {
    let mut rig = shared(-2, 0);
    // The operator's edit makes the sum of the sent share and the operator offset zero.
    assert_eq!(rig.want(1), Some(-1));
    rig.held();
    rig.register = 0;
    assert_eq!(rig.seconds(1, 1), None);
    assert_eq!(rig.parts(), (0, 0), "nothing of ours would make it zero: it was cleared");
    let kept = SavedOutput {
        account: Some(Account { base: Counts(2), share: Counts(1), doubt: None }),
        promises: vec![isotherm_core::output::Promise { value: Counts(0), at: rig.now, is_under_way: true }]
            .try_into()
            .unwrap(),
        ..SavedOutput::default()
    };
    let mut rig = Rig::new(settings(true, 5, 4), kept);
    rig.register = 0;
    assert_eq!(rig.seconds(1, 1), None);
    assert_eq!(doubt(&rig), Some(Doubt::ZeroOrOurs));
}

#[test]
fn anything_else_in_a_whole_register_is_somebody_else_and_switches_off() {
    let mut rig = whole(3);
    rig.register = 5;
    assert_eq!(rig.seconds(20, 3), None);
    assert!(
        rig.has_reported(|event| *event == Event::ForeignValue { expected: Counts(3), found: Counts(5) })
    );
    rig.give(Fact::Armed { by: Who::Policy });
    assert_eq!(rig.seconds(1, 3), None, "only a person arms it again");
    rig.give(Fact::Armed { by: Who::Person });
    assert_eq!(rig.seconds(1, 3), Some(4), "from what stands there");
}

#[test]
fn anything_else_in_a_shared_register_is_the_operators_change() {
    let mut rig = shared(3, 2);
    rig.register = 9;
    assert_eq!(rig.seconds(1, 2), None);
    assert_eq!(rig.parts(), (7, 2));
    assert!(rig.has_reported(|event| *event == Event::OperatorChanged { from: Counts(3), to: Counts(7) }));
}

#[test]
fn twice_a_change_of_just_the_size_of_a_refused_write_is_doubt() {
    let mut rig = shared(3, 0);
    for _ in 0..2 {
        assert!(rig.seconds(2, 2).is_some());
        // The device answers with a refusal, but carries out the write.
        let Action::Write { value, .. } = rig.action else { panic!("a write") };
        rig.register = value.0;
        rig.give(Fact::Refused);
        assert_eq!(rig.settle(), None);
        rig.seconds(1, 0);
    }
    assert_eq!(doubt(&rig), Some(Doubt::LikeOurOwn));
}

#[test]
fn a_restart_that_was_reported_and_another_value_is_doubt_where_something_was_ours() {
    let mut rig = shared(3, 2);
    rig.register = 4;
    rig.give(Fact::Restarted);
    assert_eq!(rig.settle(), None);
    assert_eq!(doubt(&rig), Some(Doubt::Rebooted));
}

#[test]
fn the_first_account_that_is_not_zero_waits_for_a_person() {
    let mut rig = Rig::new(settings(true, 5, 4), SavedOutput { in_order: true, ..SavedOutput::default() });
    assert_eq!(rig.parts(), (0, 0), "a register that holds nothing is nobody's");
    rig.disk = None;
    rig.register = 7;
    rig.kill();
    assert!(rig.has_reported(|event| *event == Event::FirstAccount { found: Counts(7) }));
    assert_eq!(rig.seconds(2, 2), None);
    rig.give(Fact::Armed { by: Who::Person });
    assert_eq!(rig.settle(), None);
    assert_eq!((rig.parts(), standing(&rig)), ((7, 0), ArmState::Armed));
    assert_eq!(rig.want(2), Some(9));
}

#[test]
fn what_a_person_types_while_it_is_in_doubt_ends_no_copy() {
    let mut rig = shared(3, 0);
    assert_eq!(rig.want(2), Some(5));
    rig.held();
    rig.register = 4;
    rig.give(Fact::Restarted);
    rig.settle();
    assert_eq!(standing(&rig), ArmState::Barred);
    rig.register = 5;
    rig.seconds(1, 2);
    assert_eq!(rig.state.copies().under_way().count(), 1);
}

#[test]
fn a_register_that_turns_to_what_may_be_ours_while_a_person_arms_stays_in_doubt() {
    for (turns_to, standing_then) in [(5, ArmState::Barred), (0, ArmState::Barred), (6, ArmState::Armed)] {
        let mut rig = shared(3, 1);
        assert_eq!(rig.want(2), Some(5));
        rig.held();
        rig.register = 9;
        rig.give(Fact::Restarted);
        assert_eq!(rig.settle(), None);
        rig.give(Fact::Armed { by: Who::Person });
        rig.register = turns_to;
        assert_eq!(rig.settle(), None);
        assert_eq!(standing(&rig), standing_then, "{turns_to}");
        rig.register = if standing_then == ArmState::Armed { 6 } else { 7 };
        rig.give(Fact::Armed { by: Who::Person });
        assert_eq!(rig.settle(), None);
        assert_eq!(standing(&rig), ArmState::Armed, "{turns_to}");
        let (base, share) = rig.parts();
        assert_eq!(base + share, rig.register);
    }
}

#[test]
fn a_device_that_stores_something_else_than_it_acknowledges_is_no_operator() {
    let mut rig = shared(3, 0);
    for doubts in [false, true] {
        let wrote = rig.seconds(6, 5).unwrap();
        rig.give(Fact::Done { left: rig.now });
        rig.register = wrote + 1;
        assert_eq!(rig.settle(), None);
        let is_reported =
            rig.has_reported(|event| matches!(event, Event::Doubted { doubt: Doubt::Unsteady, .. }));
        assert_eq!(is_reported, doubts);
    }
}

#[test]
fn nothing_is_sent_that_the_register_cannot_hold() {
    let range = (Counts(0), Counts(4));
    let kept = SavedOutput {
        in_order: true,
        account: Some(Account { base: Counts(3), ..Account::default() }),
        ..SavedOutput::default()
    };
    let mut rig = Rig::new(Settings { range, ..settings(true, 5, 4) }, kept);
    assert_eq!(rig.want(5), Some(4));
    assert_eq!(rig.done(), None);
    assert_eq!((rig.want(5), rig.parts()), (None, (3, 1)));
    rig.seconds(3, -5);
    assert_eq!(rig.parts().0, 3);
}

#[test]
fn what_is_wanted_is_cut_to_what_the_register_holds_wherever_its_zero_is() {
    let bias = Counts(100);
    let around = Settings { bias, range: (Counts(0), Counts(200)), ..settings(false, 5, 4) };
    for offset in [3, -3] {
        let kept = SavedOutput { in_order: true, stood: Some(bias), ..SavedOutput::default() };
        Rig::new(around, kept).go(offset);
    }
    let kept = SavedOutput {
        in_order: true,
        account: Some(Account { base: Counts(5), ..Account::default() }),
        ..SavedOutput::default()
    };
    let narrow = Settings { step: Counts(4), range: (Counts(0), Counts(11)), ..settings(true, 40, 4) };
    let mut rig = Rig::new(narrow, kept);
    assert_eq!((rig.want(20), rig.done()), (Some(9), None));
    assert_eq!((rig.want(20), rig.done()), (Some(11), None));
    assert_eq!(rig.want(20), None);
}

#[test]
fn whatever_interrupts_a_decision_ends_it() {
    let interruptions = [Fact::Paused, Fact::Interlocked, Fact::Off, Fact::NotSent, Fact::Refused];
    for fact in interruptions {
        let mut rig = whole(0);
        assert_eq!(rig.want(1), Some(1));
        rig.give(fact);
        if rig.action == (Action::Nothing { until: isotherm_core::quantity::Moment::END }) {
            rig.give(Fact::NotSent);
        }
        assert_eq!(rig.settle(), None, "{fact:?}");
        rig.give(Fact::Released);
        assert_eq!(rig.settle(), None, "{fact:?}");
        rig.now = rig.now.after(Duration::from_secs(2));
        rig.give(Fact::Look);
        let again = rig.settle();
        let shows = (fact == Fact::Refused).then_some(0);
        assert_eq!(
            again, shows,
            "{fact:?}: what was refused shows with what stands there that it can be written"
        );
    }
}

#[test]
fn what_the_disk_does_not_keep_is_not_sent() {
    let mut rig = shared(3, 0);
    rig.give(Fact::Decided {
        offset: Counts(2),
        target: None,
        not_after: rig.now.after(Duration::from_secs(1)),
    });
    rig.give(Fact::Read { found: Counts(3), asked: rig.now });
    assert_eq!(rig.action, Action::Keep);
    rig.give(Fact::NotKept);
    assert_eq!(rig.reported, [Event::DiskDoesNotKeep]);
    assert!(!matches!(rig.action, Action::Write { .. } | Action::Keep));
    assert_eq!(rig.seconds(1, 2), Some(5), "a second later it is tried again");
}

#[test]
fn a_wait_is_reported_once_with_its_seconds() {
    let mut rig = whole(0);
    assert_eq!(rig.want(1), Some(1));
    rig.held();
    assert_eq!(rig.seconds(3, -1), None);
    let waits: Vec<_> =
        rig.reported.iter().filter(|event| matches!(event, Event::WaitingForLateWrite { .. })).collect();
    assert_eq!(waits, [&Event::WaitingForLateWrite { seconds: 2 }]);
    assert!(rig.state.shown(&rig.settings).waits_until.is_some());
    assert_eq!(rig.seconds(3, -1), Some(-1));
}

#[test]
fn what_is_full_waits_and_forgets_nothing() {
    let settings = Settings { step: Counts(20), late: Duration::from_secs(60), ..settings(false, 20, 4) };
    let mut rig = Rig::new(settings, SavedOutput { in_order: true, ..SavedOutput::default() });
    let sent = (1..=12).filter(|offset| rig.seconds(1, *offset).map(|_| rig.held()).is_some()).count();
    assert_eq!((sent, rig.state.copies().under_way().count()), (8, 8));
}

#[test]
fn the_same_value_sent_again_and_again_without_an_answer_takes_one_place() {
    let mut rig = whole(0);
    rig.settings.late = Duration::from_secs(60);
    for _ in 0..12 {
        assert_eq!(rig.seconds(2, 1), Some(1));
        rig.held();
    }
    assert_eq!(rig.state.copies().under_way().count(), 1);
    rig.register = 1;
    rig.seconds(2, 1);
    assert_eq!(rig.state.copies().under_way().count(), 1, "one arriving says nothing of the others");
}

#[test]
fn what_is_kept_comes_back_as_it_was() {
    let mut rig = shared(3, 2);
    assert_eq!(rig.want(4), Some(7));
    let kept = rig.disk.unwrap();
    let text = serde_json::to_string(&kept).unwrap();
    assert_eq!(serde_json::from_str::<SavedOutput>(&text).unwrap(), kept);
    assert!(text.contains(r#""promises":[{"value":7"#), "{text}");
}

#[test]
fn what_cannot_be_read_is_acknowledged_and_that_is_no_trouble() {
    let settings = Settings { verify: Verify::Echo, ..settings(false, 5, 4) };
    let mut rig =
        Rig::new(settings, SavedOutput { in_order: true, stood: Some(Counts(0)), ..SavedOutput::default() });
    rig.go(3);
    assert_eq!(rig.reported, [Event::AcknowledgedNotReadBack]);
    assert!(rig.state.shown(&rig.settings).is_only_acknowledged);
    assert_eq!(rig.state.copies().under_way().count(), 0);
}

#[test]
fn a_change_after_a_long_time_without_a_read_is_doubt_while_something_may_arrive() {
    for (seconds, doubts) in [(1, None), (5, Some(Doubt::ChangedMeanwhile))] {
        let mut rig = shared(3, 0);
        rig.settings.late = Duration::from_secs(60);
        assert_eq!(rig.want(2), Some(5));
        rig.held();
        rig.now = rig.now.after(Duration::from_secs(seconds));
        rig.register = 4;
        assert_eq!(rig.want(2).is_none(), doubts.is_some());
        assert_eq!(doubt(&rig), doubts);
    }
}

#[test]
fn only_a_write_begun_after_its_time_ends_a_copy_that_cannot_be_read() {
    let settings = Settings { verify: Verify::Echo, ..settings(false, 5, 4) };
    let mut rig =
        Rig::new(settings, SavedOutput { in_order: true, stood: Some(Counts(0)), ..SavedOutput::default() });
    assert_eq!(rig.want(-1), Some(-1));
    rig.held();
    rig.settings.refresh = Some(Duration::from_secs(1));
    rig.now = rig.now.after(Duration::from_millis(3900));
    rig.give(Fact::Look);
    assert_eq!(rig.settle(), Some(0), "what was acknowledged last is refreshed");
    rig.now = rig.now.after(Duration::from_millis(500));
    rig.give(Fact::Done { left: rig.now });
    assert_eq!(rig.state.copies().under_way().count(), 1);
}

#[test]
fn what_was_sent_beside_another_part_of_the_operators_is_not_taken_for_a_share_beyond_the_limit() {
    let mut rig = shared(3, 0);
    assert_eq!(rig.want(2), Some(5));
    rig.held();
    rig.register = 103;
    assert_eq!(rig.seconds(1, 2), None);
    assert_eq!((doubt(&rig), rig.parts()), (None, (103, 0)));
    rig.register = 5;
    assert_eq!(rig.seconds(1, 2), None);
    assert_eq!((doubt(&rig), standing(&rig)), (Some(Doubt::YoursOrOurs), ArmState::Barred));
    assert_eq!(rig.parts(), (103, 0), "no share of nearly a hundred");
}

/// The guard is on the other side of the register, which waits for it. A write does not pass the target either.
#[test]
fn a_guard_that_is_ahead_never_takes_the_register_away_from_the_target() {
    let kept = SavedOutput { in_order: true, ..SavedOutput::default() };
    let mut rig = Rig::new(Settings { step: Counts(3), ..settings(false, 40, 4) }, kept);
    assert_eq!(rig.want_towards(28, -36), None);
    assert_eq!((rig.want_towards(-1, -36), rig.done()), (Some(-1), None));
    assert_eq!((rig.want_towards(-9, -2), rig.done()), (Some(-2), None));
    assert_eq!(rig.want_towards(-9, -2), None);
}

/// The zero of a restarted control is avoided by one count, which may be beyond the target.
#[test]
fn where_the_target_is_a_zero_that_is_avoided_the_register_goes_one_count_beyond() {
    let mut rig = shared(1, 0);
    assert_eq!(rig.want_towards(-1, -1), None, "1 - 1 is zero, and 1 is as near as -1");
    assert_eq!(rig.want_towards(-2, -2), Some(-1));
}

/// Observed on a machine: the register waited at 1 while the guard went to 28, and the target became -36. Moving by one
/// count per second, they met at 15, fourteen counts in the wrong direction.
#[test]
fn a_register_that_waited_goes_to_the_new_target_at_once() {
    let highest = |rules| {
        let mut rig = Rig::new(
            Settings { rules, ..settings(false, 40, 4) },
            SavedOutput { in_order: true, ..SavedOutput::default() },
        );
        rig.go(1);
        let mut highest = rig.register;
        for guard in (-36..=28).rev() {
            rig.now = rig.now.after(Duration::from_secs(1));
            if rig.want_towards(guard, -36).is_some() {
                assert_eq!(rig.done(), None);
            }
            highest = highest.max(rig.register);
        }
        assert_eq!(rig.register, -36);
        highest
    };
    assert_eq!((highest(Rules::default()), highest(Rules::without(Rule::NoWindup))), (1, 15));
}
