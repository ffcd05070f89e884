//! A set waits for a late write of one member. The Cz of another member must not run ahead of its register. If the
//! request reverses its direction, it is followed at once.

use std::time::Duration;

use crate::late_writes::control::{Control, Fate};
use crate::late_writes::device::gateway::wait_until;
use crate::late_writes::rig::{SET, beside, nobody_is_blamed, profile_of};

/// The other member follows its own sensor.
const COLUMN: &str = "[signal.column]\ndevice = \"cnc\"\nregister = \"holding:1\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"\n\
                      max_age = \"3s\"\nmax_rate = \"none\"\n[axis.y]";

fn temperature(tenths: i16) -> u16 {
    tenths.cast_unsigned()
}

/// The first axis is at 1 µm, the other one is on its way. A write of both is delayed for seven seconds of twenty. In
/// this time, 28 µm and then −36 µm are requested of the first axis.
#[test]
fn a_request_that_turns_round_while_its_set_waits_is_never_followed_the_old_way() {
    let control =
        Control::of(|write| if write == 6 { Fate::Held(Duration::from_secs(7)) } else { Fate::Done });
    (control.lock().unwrap().words[0], control.lock().unwrap().words[1]) =
        (temperature(210), temperature(450));
    let set = SET.replace("[axis.y]", COLUMN);
    let set = set.replace("signal = \"bed\", gain = -1.0", "signal = \"column\", gain = -1.0");
    let text = profile_of(&control, "20s", &set);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "a write is held", |_| seen.lock().unwrap().held.is_some());
        seen.lock().unwrap().words[0] = temperature(480);
        std::thread::sleep(Duration::from_secs(5));
        let (turned, highest) = {
            let mut control = seen.lock().unwrap();
            control.words[0] = temperature(-160);
            (control.stood.len() - 1, control.offset().max(control.held.unwrap()))
        };
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == -360);
        let stood = seen.lock().unwrap().stood[turned..].to_vec();
        assert!(stood.iter().all(|value| *value <= highest), "{stood:?} after it turned, {highest} at most");
    });
    nobody_is_blamed(&control, &status, "turned round");
}
