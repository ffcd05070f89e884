//! Writes that are executed but reported as failed, or lost; and the reports about them.

use crate::late_writes::control::{Control, Fate};
use crate::late_writes::device::gateway::{events, reported, wait_until};
use crate::late_writes::rig::{LEDGER, SET, all_at_once, beside, nobody_is_blamed, profile_of};

#[test]
fn a_write_that_is_done_and_denied_or_lost_is_looked_for_and_the_axis_goes_on() {
    let denials: Vec<Fate> = [4, 5, 6, 11, 200].map(Fate::DoneAndDenied).to_vec();
    let fates = denials.into_iter().chain([Fate::DoneAndGarbled, Fate::DoneAndSilent, Fate::Lost]);
    let cases = fates.flat_map(|fate| [(fate, ""), (fate, LEDGER), (fate, SET)]);
    all_at_once(cases.map(|(fate, more)| move || denied(fate, more)));
}

/// Gives every second write this fate. Of lost writes it is every fourth, because the same value follows, in a set
/// twice.
fn denied(fate: Fate, more: &str) {
    let each = if fate == Fate::Lost { 4 } else { 2 };
    let control = Control::of(move |write| if write % each == 1 { fate } else { Fate::Done });
    let text = profile_of(&control, "2s", more);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 50);
    });
    nobody_is_blamed(&control, &status, &format!("{fate:?} {more}"));
}

#[test]
fn a_control_that_is_read_and_whose_writes_are_never_answered_is_reported_with_cause_and_count() {
    let control = Control::of(|_| Fate::DoneAndSilent);
    let text = profile_of(&control, "2s", "");
    let status = beside(&text, move |source| {
        wait_until(source, "that is reported", |status| reported(status, "write-failed") == 1);
        wait_until(source, "the axis says so", |status| {
            status.axes[0].why.cause.contains("is unverified: no answer in time")
        });
    });
    let texts = events(&status);
    assert!(texts.iter().any(|text| text.contains("no answer in time, 3 times in a row")), "{texts:#?}");
}

#[test]
fn what_somebody_else_wrote_and_where_stands_in_the_reason_of_the_axis() {
    let control = Control::of(|_| Fate::Done);
    let text = profile_of(&control, "2s", "");
    let seen = control.clone();
    beside(&text, move |source| {
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 50);
        seen.lock().unwrap().edits(123);
        wait_until(source, "it is off", |status| !status.axes[0].arming.armed);
        wait_until(source, "why", |status| {
            let why = &status.axes[0].why.cause;
            why.contains("17.3 µm") && why.contains("cnc_z") && why.contains("holding:10")
        });
        assert!(source.arming(None).unwrap_err().starts_with("axis z is not armed: "));
    });
}
