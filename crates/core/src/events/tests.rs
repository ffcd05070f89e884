use std::collections::BTreeSet;

use super::*;

/// Kinds of trouble without a hint, because there is nothing to do or the cause contains it.
const NOTHING_TO_DO: [EventKind; 2] = [EventKind::CommandRefused, EventKind::TakenFromEarlier];

#[test]
fn each_kind_has_a_name_of_its_own_and_a_meaning() {
    let names: BTreeSet<&str> = EventKind::ALL.iter().map(|kind| kind.name()).collect();
    assert_eq!(names.len(), EventKind::ALL.len());
    for kind in EventKind::ALL {
        assert!(kind.name().chars().all(|c| c.is_ascii_lowercase() || c == '-'), "{kind:?}");
        let meaning = kind.meaning();
        assert!(meaning.starts_with(char::is_uppercase) && meaning.ends_with('.'), "{kind:?}: {meaning}");
    }
    assert_eq!(EventKind::LinkDown.name(), "link-down");
    assert_eq!(EventKind::CommandDropped.name(), "command-dropped");
}

#[test]
fn each_kind_of_trouble_says_what_to_do_and_no_other() {
    for kind in EventKind::ALL {
        let is_trouble = kind.level() != Level::Info;
        assert_eq!(kind.hint().is_some(), is_trouble && !NOTHING_TO_DO.contains(&kind), "{kind:?}");
    }
}

#[test]
fn only_trouble_raises_an_alarm_and_only_a_raised_alarm_is_ended() {
    let raised: BTreeSet<&str> = EventKind::ALL.iter().filter_map(|kind| kind.raises()).collect();
    for kind in EventKind::ALL {
        let is_trouble = kind.level() != Level::Info;
        assert!(kind.raises().is_none() || is_trouble, "{kind:?}");
        // A kind that may report no trouble raises the alarm with trouble, and ends it without trouble.
        assert!(kind.raises().is_none() || kind.ends().is_empty() || kind.may_be_info(), "{kind:?}");
        assert!(kind.ends().iter().all(|alarm| raised.contains(alarm)), "{kind:?}");
    }
    let ended_by = |kind: EventKind| kind.ended_by().collect::<Vec<_>>();
    assert_eq!(ended_by(EventKind::LinkDown), [EventKind::LinkUp]);
    assert_eq!(
        ended_by(EventKind::ArmRefused),
        [EventKind::Armed, EventKind::ArmEnded, EventKind::WaitsToArm]
    );
    assert!(ended_by(EventKind::Zeroed).is_empty());
}
