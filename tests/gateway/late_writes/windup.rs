//! While a register waits for a late write, Cz does not run ahead of it: a request that turns round is followed at once.

use std::time::Duration;

use crate::late_writes::control::{Control, Fate};
use crate::late_writes::device::gateway::wait_until;
use crate::late_writes::rig::{SET, all_at_once, beside, nobody_is_blamed, profile_of};

/// 45 °C and 10 °C: 25 µm, and -10 µm.
const WARM: u16 = 450;
const COLD: u16 = 100;

#[test]
fn a_request_that_turns_round_while_its_register_waits_is_never_followed_the_old_way() {
    all_at_once(["", SET].map(|more| move || turned_round(more)).into_iter());
}

/// The fourth write is held for seven seconds of eight. Meanwhile it becomes cold.
fn turned_round(more: &'static str) {
    let control =
        Control::of(|write| if write == 3 { Fate::Held(Duration::from_secs(7)) } else { Fate::Done });
    control.lock().unwrap().words[0] = WARM;
    let text = profile_of(&control, "8s", more);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "a write is held", |_| seen.lock().unwrap().held.is_some());
        std::thread::sleep(Duration::from_secs(5));
        let (turned, highest) = {
            let mut control = seen.lock().unwrap();
            control.words[0] = COLD;
            let held = control.held.unwrap();
            (control.stood.len() - 1, control.offset().max(held))
        };
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == -100);
        let stood = seen.lock().unwrap().stood[turned..].to_vec();
        assert!(
            stood.iter().all(|value| *value <= highest),
            "{more}: {stood:?} once it was cold, {highest} at most"
        );
    });
    nobody_is_blamed(&control, &status, more);
}
