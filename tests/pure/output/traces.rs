//! Shortest ways on which simpler rules made a register jump, or assigned a value of the gateway to the operator.

use std::time::Duration;

use isotherm_core::output::{Account, Action, Event, Fact, SavedOutput, Settings, Verify};
use isotherm_core::quantity::Counts;

use super::rig::Rig;
use super::world::settings;

/// Whole register with step 1, and `late` 4 s.
fn whole(stands: i64) -> Rig {
    Rig::new(
        settings(false, 5, 4),
        SavedOutput { in_order: true, stood: Some(Counts(stands)), ..SavedOutput::default() },
    )
}

/// Shared register with step 2.
fn shared(base: i64, share: i64) -> Rig {
    let account = Some(Account { base: Counts(base), share: Counts(share), doubt: None });
    Rig::new(settings(true, 5, 4), SavedOutput { in_order: true, account, ..SavedOutput::default() })
}

fn unread(stands: i64) -> Rig {
    let settings = Settings { verify: Verify::Echo, ..settings(false, 5, 4) };
    Rig::new(settings, SavedOutput { in_order: true, stood: Some(Counts(stands)), ..SavedOutput::default() })
}

fn is_late(event: &Event) -> bool {
    matches!(event, Event::OwnWriteArrivedLate { .. })
}

#[test]
fn a_repeat_is_not_sent_while_what_is_two_steps_away_may_arrive() {
    let mut rig = whole(-1);
    rig.settings.refresh = Some(Duration::from_secs(1));
    assert_eq!(rig.want(-2), Some(-2));
    rig.register = 0;
    rig.held();
    assert!(rig.has_reported(|event| matches!(event, Event::CncRestarted { stood: Counts(-1) })));
    assert_eq!(rig.seconds(3, 0), None, "neither a repeat of zero nor anything else");
    rig.register = -2;
    assert_eq!(rig.seconds(1, 0), Some(-2), "it is ours, and stands there");
    assert_eq!(rig.done(), None);
    assert_eq!(rig.seconds(1, 0), Some(-1), "from where it stands now");
}

#[test]
fn what_was_done_is_read_before_the_next_write() {
    let mut rig = whole(0);
    assert_eq!(rig.want(-1), Some(-1));
    rig.register = -1;
    rig.give(Fact::Done { left: rig.now });
    assert_eq!(rig.action, Action::Read);
    assert_eq!(rig.settle(), None);
    assert_eq!(rig.want(1), Some(0));
}

#[test]
fn of_two_copies_of_a_value_a_read_ends_one() {
    let mut rig = whole(0);
    assert_eq!(rig.want(-1), Some(-1));
    rig.held();
    assert_eq!(rig.seconds(2, -1), Some(-1), "the same again");
    assert_eq!(rig.done(), None);
    assert_eq!(rig.state.copies().under_way().count(), 1);
    assert_eq!(rig.want(-3), Some(-2));
    assert_eq!(rig.done(), None, "the first one may still arrive");
    rig.register = -1;
    assert_eq!(rig.seconds(2, -3), Some(-2));
    assert!(rig.has_reported(is_late) && !rig.blames_others());
}

#[test]
fn zero_in_a_read_ends_no_copy_of_zero() {
    let mut rig = whole(1);
    assert_eq!(rig.want(0), Some(0));
    rig.register = 0;
    rig.held();
    assert_eq!(rig.seconds(2, -2), Some(-1));
    assert_eq!(rig.done(), None, "the zero may still arrive");
    assert_eq!(rig.register, -1);
}

#[test]
fn only_a_read_asked_after_its_time_ends_a_copy() {
    let mut rig = whole(0);
    assert_eq!(rig.want(-1), Some(-1));
    let left = rig.now;
    rig.held();
    rig.now = left.after(Duration::from_millis(3990));
    assert_eq!(rig.want(1), None);
    assert_eq!(rig.state.copies().under_way().count(), 1);
    rig.register = -1;
    rig.now = left.after(Duration::from_millis(4010));
    assert_eq!(rig.want(1), None, "it is read and judged first");
    assert_eq!(rig.seconds(1, 1), Some(0), "not 1");
}

#[test]
fn what_cannot_be_read_is_sent_again_when_a_late_write_is_over() {
    let mut rig = unread(0);
    assert_eq!(rig.want(-1), Some(-1));
    rig.held();
    rig.register = -1;
    assert_eq!(rig.seconds(9, 1), Some(0), "what was acknowledged last");
    assert_eq!(rig.done(), None);
    assert_eq!(rig.want(1), Some(1));
}

#[test]
fn what_cannot_be_read_is_sent_again_after_a_kill() {
    let mut rig = unread(0);
    assert_eq!(rig.want(-1), Some(-1));
    rig.kill();
    assert_eq!(rig.seconds(9, 1), Some(0));
    rig.register = -1;
    assert_eq!(rig.done(), None);
    assert_eq!(rig.want(1), Some(1));
}

#[test]
fn after_a_kill_nothing_is_written_before_everything_from_before_has_arrived() {
    let mut rig = whole(0);
    assert_eq!(rig.want(-1), Some(-1));
    rig.kill();
    assert_eq!(rig.seconds(3, 1), None);
    rig.register = -1;
    assert_eq!(rig.seconds(9, 1), Some(0));
    assert!(rig.has_reported(|event| *event == Event::PerhapsFromBefore { value: Counts(-1) }));
}

#[test]
fn a_stop_with_something_under_way_is_not_in_order() {
    let mut rig = whole(0);
    assert_eq!(rig.want(-1), Some(-1));
    rig.held();
    let kept = rig.state.end();
    assert!(!kept.in_order);
    rig.disk = Some(kept);
    rig.kill();
    assert_eq!(rig.seconds(3, 1), None);
}

#[test]
fn what_stood_there_at_a_kill_may_still_arrive() {
    let mut rig = shared(3, 2);
    rig.settings.remembered = Duration::from_secs(60);
    assert_eq!(rig.want(4), Some(7));
    rig.kill();
    assert_eq!(rig.want(1), None, "4 is too far from the promised 7");
    assert_eq!(rig.seconds(9, 1), Some(4));
    rig.done();
    rig.register = 5;
    assert_eq!(rig.seconds(1, 1), None);
    assert_eq!(rig.parts().0, 3, "the operator's part is what it was");
    assert!(!rig.has_reported(|event| matches!(event, Event::OperatorChanged { .. })));
}

#[test]
fn a_promise_stays_what_it_is_when_the_base_moves() {
    let mut rig = shared(3, 0);
    assert_eq!(rig.want(2), Some(5));
    rig.held();
    rig.register = 0;
    assert_eq!(rig.seconds(1, 2), None);
    assert_eq!(rig.parts(), (0, 0));
    rig.register = 5;
    rig.seconds(1, 2);
    assert_eq!(rig.parts(), (0, 5));
    assert!(rig.has_reported(is_late) && !rig.blames_others());
}

#[test]
fn a_newer_verified_value_drops_no_promise() {
    let mut rig = shared(3, 1);
    assert_eq!(rig.want(3), Some(6));
    rig.held();
    assert_eq!(rig.seconds(2, 3), Some(6));
    assert_eq!(rig.done(), None);
    assert_eq!(rig.want(2), Some(5));
    assert_eq!(rig.done(), None);
    let promised: Vec<i64> = rig.disk.unwrap().promises.iter().map(|promise| promise.value.0).collect();
    assert_eq!(promised, [6]);
    rig.register = 6;
    rig.seconds(1, 2);
    assert_eq!(rig.parts().0, 3);
    assert!(rig.has_reported(is_late) && !rig.blames_others());
}

#[test]
fn an_edit_on_top_of_an_unanswered_write_is_doubt() {
    let mut rig = shared(3, 2);
    assert_eq!(rig.want(1), Some(4));
    rig.answer_lost();
    rig.register = 3;
    assert_eq!(rig.settle(), None);
    assert!(
        rig.has_reported(|event| matches!(event, Event::Doubted { found: Counts(3), share: Counts(2), .. }))
    );
    assert_eq!(rig.seconds(20, 1), None);
}

#[test]
fn nothing_under_way_is_sent_again_beyond_the_limit() {
    let mut rig = shared(5, 1);
    rig.settings.limit = Counts(2);
    assert_eq!(rig.want(-1), Some(4));
    rig.held();
    // After two reads, the operator's change cannot hide a step of the gateway.
    assert_eq!(rig.want(1), None);
    rig.register = 8;
    for _ in 0..20 {
        let mut write = rig.seconds(1, -2);
        while let Some(value) = write {
            assert!((value - rig.parts().0).abs() <= 2, "{value}");
            write = rig.done();
        }
    }
    assert_eq!((rig.parts(), rig.register), ((7, -2), 5));
}

#[test]
fn the_sum_zero_is_never_sent_while_something_is_the_operators() {
    let mut rig = shared(2, 1);
    assert_eq!(rig.want(-2), Some(1));
    assert_eq!(rig.done(), None, "the count beside zero is near enough");
    rig.register = 0;
    rig.seconds(1, -2);
    assert!(rig.has_reported(|event| matches!(event, Event::CncRestarted { stood: Counts(1) })));
    assert_eq!(rig.parts().0, 0);
}

#[test]
fn nothing_is_promised_that_an_operator_has_just_typed() {
    let mut rig = shared(5, 0);
    rig.register = 6;
    rig.give(Fact::Decided {
        offset: Counts(1),
        target: None,
        not_after: rig.now.after(Duration::from_secs(1)),
    });
    assert_eq!(rig.action, Action::Read, "before the promise");
    let write = rig.settle();
    assert_eq!((write, rig.parts()), (Some(7), (6, 0)));
}

#[test]
fn a_promise_that_grew_old_before_it_was_sent_is_made_anew_for_what_is_wanted_then() {
    let mut rig = shared(5, 0);
    let late = rig.now.after(Duration::from_secs(1));
    rig.give(Fact::Decided { offset: Counts(1), target: None, not_after: late });
    rig.give(Fact::Read { found: Counts(5), asked: rig.now });
    rig.give(Fact::Kept);
    rig.now = late;
    assert_eq!(rig.settle(), None, "its readings are too old");
    rig.give(Fact::Decided {
        offset: Counts(3),
        target: None,
        not_after: rig.now.after(Duration::from_secs(1)),
    });
    assert_eq!((rig.settle(), rig.parts()), (Some(7), (5, 0)));
    // A young decision is sent, so that a slow disk does not block it permanently.
    let mut rig = shared(5, 0);
    rig.give(Fact::Decided {
        offset: Counts(1),
        target: None,
        not_after: rig.now.after(Duration::from_secs(1)),
    });
    rig.give(Fact::Read { found: Counts(5), asked: rig.now });
    let young = rig.now.after(Duration::from_millis(10));
    rig.give(Fact::Decided {
        offset: Counts(3),
        target: None,
        not_after: rig.now.after(Duration::from_secs(2)),
    });
    rig.give(Fact::Kept);
    rig.give(Fact::Read { found: Counts(5), asked: rig.now });
    assert!(rig.now < young);
    assert!(
        matches!(rig.action, Action::Write { value: Counts(6), not_after, .. } if not_after < young.after(Duration::from_secs(1)))
    );
}

#[test]
fn an_edit_between_promise_and_write_is_seen() {
    let mut rig = shared(5, 0);
    rig.give(Fact::Decided {
        offset: Counts(1),
        target: None,
        not_after: rig.now.after(Duration::from_secs(1)),
    });
    rig.give(Fact::Read { found: Counts(5), asked: rig.now });
    assert_eq!(rig.action, Action::Keep);
    rig.register = 8;
    assert_eq!(rig.settle(), Some(9));
    assert_eq!(rig.parts(), (8, 0));
}

#[test]
fn the_time_of_a_copy_begins_when_it_has_left() {
    let mut rig = whole(0);
    assert_eq!(rig.want(-1), Some(-1));
    // The computer was paused between the last clock sample and the last byte.
    rig.now = rig.now.after(Duration::from_secs(3));
    rig.held();
    assert_eq!(rig.seconds(3, 1), None);
    assert_eq!(rig.state.copies().under_way().count(), 1);
    rig.register = -1;
    assert_eq!(rig.seconds(9, 1), Some(0));
}
