//! Corrected positions, as a display shows them. A write that is executed but reported as failed changes the Cz in the
//! position by one step at most.

use crate::late_writes::control::{Control, Fate, SCALE};
use crate::late_writes::device::gateway::wait_until;
use crate::late_writes::rig::{all_at_once, beside, machine, nobody_is_blamed};

const READOUT: &str = r#"
[signal.scale_z]
device = "cnc"
register = "holding:5"
type = "u16"
scale = 0.0001
unit = "mm"
max_age = "3s"
[output.readout]
axis = "z"
device = "cnc"
writes = "corrected"
position = "scale_z"
register = "holding:10"
type = "i32"
word_order = "msw-first"
scale = 0.0001
"#;
/// Words that belong to the number: in the same request, and in a separate one.
const BESIDE: &str = "beside = [ { register = \"holding:12\", good = 1, degraded = 2, fault = 3 } ]\n";
const APART: &str = "beside = [ { register = \"holding:14\", good = 1, degraded = 2, fault = 3 } ]\n";

/// Offset in a corrected position, from the position that was read last.
fn inside(words: &[u16]) -> [i16; 2] {
    let shown = i32::from(words[10].cast_signed()) << 16 | i32::from(words[11]);
    [i16::try_from(shown - i32::from(words[SCALE])).unwrap(), 0]
}

/// Gives every second write this fate. If the number has two requests, it is every number.
fn denied(fate: Fate, more: &str) {
    let each = if more.contains("14") { 3 } else { 2 };
    let control = Control::of(move |write| if write % each == 1 { fate } else { Fate::Done });
    (control.lock().unwrap().moves, control.lock().unwrap().offsets) = (7, inside);
    let text = machine(&control, "2s") + READOUT + more;
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 50);
        seen.lock().unwrap().words[0] = 180;
        wait_until(source, "it goes back", |_| seen.lock().unwrap().offset() == -20);
    });
    nobody_is_blamed(&control, &status, &format!("{fate:?} {more}"));
}

#[test]
fn a_corrected_position_that_is_written_and_denied_has_its_offset_moved_by_a_step_at_most_and_arrives() {
    let denials: Vec<Fate> = [4, 5, 6, 11, 200].map(Fate::DoneAndDenied).to_vec();
    let fates = denials.into_iter().chain([Fate::DoneAndGarbled, Fate::DoneAndSilent]);
    let kinds = ["verify = \"echo\"\n", "verify = \"read-back\"\n", BESIDE, APART];
    let cases = fates.flat_map(|fate| kinds.map(|more| (fate, more)));
    all_at_once(cases.map(|(fate, more)| move || denied(fate, more)));
}
