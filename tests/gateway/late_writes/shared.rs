//! A register to which an operator also writes.

use std::sync::Arc;
use std::time::Duration;

use isotherm::observe::requester::{Channel, Requester};
use isotherm::observe::status::Command;

use crate::late_writes::control::{Control, Fate};
use crate::late_writes::device::gateway::{events, reported, wait_until};
use crate::late_writes::rig::{LEDGER, all_at_once, beside, nobody_is_blamed, profile_of};

/// Each write is executed but reported as failed, by a control with a shared register. An earlier version moved without
/// end.
#[test]
fn a_shared_register_never_runs_away_and_the_operator_keeps_what_is_his() {
    all_at_once([6, 11].into_iter().map(|code| move || denied_beside_an_operator(code)));
}

fn denied_beside_an_operator(code: u8) {
    let control = Control::of(move |_| Fate::DoneAndDenied(code));
    control.lock().unwrap().edits(1200);
    let text = profile_of(&control, "4s", LEDGER);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "a person is asked", |status| reported(status, "first-account") == 1);
        source.command(Command::Arm, None, &Arc::new(Requester::new(Channel::Api, "a test"))).unwrap();
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 1250);
        std::thread::sleep(Duration::from_secs(1));
        let shares = source.status().outputs[0].shares.unwrap();
        assert!((shares.base - 120.0).abs() < 0.01 && (shares.share - 5.0).abs() < 0.01, "{shares:?}");
    });
    nobody_is_blamed(&control, &status, &format!("{code}"));
    assert_eq!(reported(&status, "operator-change"), 0, "{:#?}", events(&status));
}

#[test]
fn an_edit_while_the_fate_of_a_write_is_unknown_is_a_question_and_the_answer_makes_it_right() {
    let control = Control::of(|write| if write == 2 { Fate::DoneAndEdited(900) } else { Fate::Done });
    let text = profile_of(&control, "2s", LEDGER);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "a person is asked", |status| reported(status, "ledger-doubt") == 1);
        let writes = seen.lock().unwrap().writes;
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(seen.lock().unwrap().writes, writes, "nothing is written while it is in question");
        // Two steps of the gateway had arrived at the last verification, and the register has three. The operator
        // corrects it.
        seen.lock().unwrap().edits(-10);
        source.command(Command::Arm, None, &Arc::new(Requester::new(Channel::Api, "a test"))).unwrap();
        wait_until(source, "it goes on", |status| status.axes[0].state == "active");
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 950);
    });
    control.lock().unwrap().never_jumped();
    assert!(events(&status).iter().any(|text| text.contains("perhaps")), "{:#?}", events(&status));
}
