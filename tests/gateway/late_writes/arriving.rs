//! Writes that something on the way delays for seconds, and the register when they arrive.

use std::time::Duration;

use isotherm::observe::status::Status;

use crate::late_writes::control::{Control, Fate, Shared};
use crate::late_writes::device::gateway::wait_until;
use crate::late_writes::rig::{
    LEDGER, Program, SET, all_at_once, beside, blames_nobody, nobody_is_blamed, profile_of, promises,
};

/// Warms the bed until 5 µm are requested. Cools it to −2 µm while the write is delayed, and lets the write arrive.
fn held(late: &str, span: Duration, more: &str) -> (Shared, Status) {
    let control = Control::of(move |write| if write == 3 { Fate::Held(span) } else { Fate::Done });
    let text = profile_of(&control, late, more);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "the write is held", |_| seen.lock().unwrap().writes >= 4);
        seen.lock().unwrap().words[0] = 180;
        std::thread::sleep(span + Duration::from_millis(500));
        wait_until(source, "it follows", |status| {
            seen.lock().unwrap().offset() == -20 && status.axes[0].state == "active"
        });
    });
    (control, status)
}

#[test]
fn a_write_that_is_held_and_comes_late_moves_the_register_by_a_step_at_most_and_is_known_as_ours() {
    let kinds = ["", "refresh = \"1s\"\n", LEDGER, SET];
    all_at_once(kinds.into_iter().map(|more| {
        move || {
            let (control, status) = held("12s", Duration::from_millis(2500), more);
            nobody_is_blamed(&control, &status, more);
        }
    }));
}

/// Kill of the program while its write is delayed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Killed {
    Never,
    /// As soon as the write has arrived at the delay, before its result is known.
    AtOnce,
    /// When it was not answered, and the program has saved that it may still arrive.
    Later,
}

const KILLS: [Killed; 3] = [Killed::Never, Killed::AtOnce, Killed::Later];

/// Kind of the output.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// A register without an operator, with these keys of the output.
    Whole(&'static str),
    /// A register that cannot be read, with these keys.
    Unread(&'static str),
    Shared,
    Set,
}

const REFRESH: &str = "refresh = \"1s\"\n";
const ECHO: &str = "verify = \"echo\"\n";
const ECHO_AND_REFRESH: &str = "verify = \"echo\"\nrefresh = \"1s\"\n";
const KINDS: [Kind; 8] = [
    Kind::Whole(""),
    Kind::Whole(REFRESH),
    Kind::Whole(ECHO),
    Kind::Whole(ECHO_AND_REFRESH),
    Kind::Unread(ECHO),
    Kind::Unread(ECHO_AND_REFRESH),
    Kind::Shared,
    Kind::Set,
];
/// The same unit as a device of which nothing can be read.
const BLIND: &str =
    "[device.blind]\nbus = \"cell\"\nunit = 1\nevery = \"250ms\"\nfunctions = [\"write-single\"]\n";
/// Default of `late`.
const LATE: &str = "30s";

impl Kind {
    fn profile(self, control: &Shared) -> String {
        match self {
            Kind::Whole(more) => profile_of(control, LATE, more),
            Kind::Unread(more) => {
                let text = profile_of(control, LATE, more) + BLIND;
                text.replace("device = \"cnc\"\nwrites", "device = \"blind\"\nwrites")
            }
            Kind::Shared => profile_of(control, LATE, LEDGER),
            Kind::Set => profile_of(control, LATE, SET),
        }
    }
}

/// A write was delayed, and has arrived.
struct Came {
    name: String,
    control: Shared,
    program: Program,
}

impl Came {
    /// Delays the fourth write, on the way to 5 µm, for this many seconds, while −2 µm are requested. If that is longer
    /// than `late`, the write arrives when the axis is at −2 µm.
    fn after(span: u64, kind: Kind, killed: Killed) -> Came {
        let name = format!("{span} s, {kind:?}, killed {killed:?}");
        let fate = move |write| if write == 3 { Fate::Held(Duration::from_secs(span)) } else { Fate::Done };
        let control = Control::of(fate);
        control.lock().unwrap().comes_over = (span > 30).then_some(-20);
        let mut program = Program::start(&kind.profile(&control));
        program.waits_until(&name, || control.lock().unwrap().writes >= 4);
        control.lock().unwrap().words[0] = 180;
        if killed == Killed::Later {
            std::thread::sleep(Duration::from_secs(1));
            // On a slow disk this takes longer.
            let held = i64::from(control.lock().unwrap().held.unwrap());
            let document = program.document();
            program.waits_until(&name, || promises(&document).contains(&held));
        }
        if killed != Killed::Never {
            program = program.starts_again_after_a_kill();
        }
        program.waits_until(&name, || control.lock().unwrap().late.is_some());
        Came { name, control, program }
    }

    #[track_caller]
    fn arrives(&mut self, at: i16) {
        let control = self.control.clone();
        self.program.waits_until(&self.name, || control.lock().unwrap().offset() == at);
    }

    /// Checks that the register keeps its value, and ends the program. Returns everything that the program has printed.
    fn ends(self) -> (String, Shared, Vec<String>) {
        let stands = self.control.lock().unwrap().offset();
        std::thread::sleep(Duration::from_secs(2));
        let said = self.program.ends();
        let control = self.control.lock().unwrap();
        assert_eq!(control.offset(), stands, "{}: {said:#?}", self.name);
        println!(
            "{}: came as {:?}, {:?}, told {:?}",
            self.name,
            control.late,
            control.stood,
            reported(&said)
        );
        drop(control);
        (self.name, self.control, said)
    }
}

/// Number of messages that the write arrived late, that it was perhaps an own write, and that a write is waited for.
fn reported(said: &[String]) -> [usize; 3] {
    let count = |text| said.iter().filter(|line| line.contains(text)).count();
    ["arrived late", "perhaps a write from before", "waiting for a late write"].map(count)
}

/// Checks a write that is delayed for less than `late`.
fn in_time(span: u64, kind: Kind, killed: Killed) {
    let mut came = Came::after(span, kind, killed);
    came.arrives(-20);
    let (name, control, said) = came.ends();
    control.lock().unwrap().never_jumped();
    blames_nobody(&name, &said);
    assert!(reported(&said)[2] > 0, "{name}: {said:#?}");
    if !matches!(kind, Kind::Unread(_)) && control.lock().unwrap().is_late_read {
        assert!(reported(&said)[0] + reported(&said)[1] > 0, "{name}: {said:#?}");
    }
}

/// Checks a write that is delayed for longer than `late`. Its effect cannot be prevented. It is detected if the
/// register can be read.
fn too_late(kind: Kind, killed: Killed) {
    let mut came = Came::after(35, kind, killed);
    let (stood, late) = came.control.lock().unwrap().late.unwrap();
    let mut jumps = vec![(stood, late)];
    if !matches!(kind, Kind::Unread(_)) && came.was_replaced_unread() {
        println!("{}: void, because the value was replaced between a read and the next write", came.name);
        came.control.lock().unwrap().words[0] = 170;
        came.arrives(-30);
        let (name, control, _) = came.ends();
        jumps.push((late, stood));
        return assert_eq!(control.lock().unwrap().jumps(), jumps, "{name}");
    }
    let is_known = match (kind, killed) {
        (Kind::Unread(ECHO), _) => {
            // An unread register keeps the value until it is written again.
            jumps.push((late, -30));
            false
        }
        (Kind::Unread(_), _) => {
            came.arrives(stood);
            jumps.push((late, stood));
            false
        }
        (Kind::Shared, _) => {
            // The operator confirms the division and corrects the register. The edit is no jump of the gateway, and
            // undoes this one.
            came.program.running.receives("the gateway share in it is assumed to be");
            came.is_left_alone();
            came.control.lock().unwrap().edits(stood - late);
            jumps = vec![(2 * stood - late, stood)];
            came.program.is_armed();
            false
        }
        (_, Killed::AtOnce) => {
            // If the program was killed at once, it does not know the write, which may come from another client. If the
            // kill came a moment later, the program knows the write.
            let said = came.program.running.hears_one_of(&["this gateway did not write", "arrived late"]);
            if said.contains("this gateway did not write") {
                came.is_left_alone();
                let (name, control, _) = came.ends();
                return assert_eq!(control.lock().unwrap().jumps(), jumps, "{name}");
            }
            true
        }
        _ => true,
    };
    came.control.lock().unwrap().words[0] = 170;
    came.arrives(-30);
    let (name, control, said) = came.ends();
    assert_eq!(control.lock().unwrap().jumps(), jumps, "{name}");
    if is_known {
        blames_nobody(&name, &said);
        assert!(reported(&said)[0] > 0, "{name}: {said:#?}");
    }
}

impl Came {
    /// Waits until the program has read the value of the delayed write, or has replaced it without a read.
    fn was_replaced_unread(&mut self) -> bool {
        let control = self.control.clone();
        self.program.waits_until(&self.name, || {
            let control = control.lock().unwrap();
            control.is_late_read || control.is_late_overwritten
        });
        self.control.lock().unwrap().is_late_overwritten
    }

    /// Checks that no offset is written.
    #[track_caller]
    fn is_left_alone(&self) {
        let stands = self.control.lock().unwrap().offset();
        std::thread::sleep(Duration::from_secs(1));
        assert_eq!(self.control.lock().unwrap().offset(), stands, "{}", self.name);
    }
}

#[test]
fn however_long_a_write_is_held_it_moves_the_register_by_a_step_or_after_late_is_found_also_after_a_kill() {
    let cases = KINDS.into_iter().flat_map(|kind| KILLS.map(|killed| (kind, killed)));
    all_at_once(cases.flat_map(|(kind, killed)| {
        [8, 19, 35].map(|span| {
            move || match span {
                35 => too_late(kind, killed),
                _ => in_time(span, kind, killed),
            }
        })
    }));
}
