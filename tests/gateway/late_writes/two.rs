//! A second gateway on another computer, with the same profile, writes to the same register.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::late_writes::control::{Control, Fate};
use crate::late_writes::rig::{LEDGER, Program, profile_of};
use crate::support::process::PATIENCE;
use crate::support::tell;

const REASON: &str = "a second gateway";

/// Profile of a gateway on another computer. On the same computer the second one would refuse to start.
fn elsewhere(text: &str) -> String {
    text.replace("127.0.0.1", "127.0.0.2")
}

/// Returns whether it has reported that another gateway writes to the register.
fn is_off(program: &mut Program) -> bool {
    program.running.so_far().iter().any(|line| line.contains(REASON))
}

/// A gateway that finds steps of the other twice in a row switches its axis off. After that, the other one may find no
/// more of them, and continues alone.
#[test]
fn of_two_gateways_at_one_shared_register_one_or_both_go_off_and_say_why() {
    let control = Control::of(|_| Fate::Done);
    control.lock().unwrap().edits(1200);
    let text = profile_of(&control, "2s", LEDGER);
    let mut both = [Program::start(&text), Program::start(&elsewhere(&text))];
    for program in &mut both {
        program.running.receives("if the whole value is the operator offset");
        program.is_armed();
    }
    // The machine warms and cools until one of them has detected the other.
    let bed = control.clone();
    let is_over = Arc::new(AtomicBool::new(false));
    let is_seen = is_over.clone();
    let machine = std::thread::spawn(move || {
        for celsius in [550, 250].into_iter().cycle().take_while(|_| !is_seen.load(Ordering::Relaxed)) {
            bed.lock().unwrap().words[0] = celsius;
            std::thread::sleep(Duration::from_secs(6));
        }
    });
    // A busy computer is slow, which is no failure.
    for _ in 0..10 * PATIENCE.as_secs() {
        if both.iter_mut().any(is_off) {
            break;
        }
        std::thread::sleep(Duration::from_secs(1));
    }
    assert!(both.iter_mut().any(is_off), "none of them is off");
    is_over.store(true, Ordering::Relaxed);
    machine.join().unwrap();
    control.lock().unwrap().never_jumped();
    if both.iter_mut().all(is_off) {
        let stands = control.lock().unwrap().offset();
        std::thread::sleep(Duration::from_secs(3));
        assert_eq!(control.lock().unwrap().offset(), stands, "nobody writes any more");
    }
    for program in both {
        program.ends();
    }
    control.lock().unwrap().never_jumped();
}

#[test]
fn of_two_gateways_at_one_whole_register_the_one_that_finds_the_others_step_goes_off_and_says_why() {
    let control = Control::of(|_| Fate::Done);
    control.lock().unwrap().words[0] = 500;
    let text = profile_of(&control, "2s", "");
    let mut first = Program::start(&text);
    let seen = control.clone();
    first.waits_until("it has arrived", move || seen.lock().unwrap().offset() == 300);
    let mut second = Program::start(&elsewhere(&text));
    second.running.receives("axis z: armed");
    std::thread::sleep(Duration::from_secs(3));
    let mut both = [first, second];
    // On a busy computer one of them may have made all steps before the other one reads. Then more steps follow.
    for (asked, stands) in [(520, 320), (500, 300)].into_iter().cycle().take(20) {
        control.lock().unwrap().words[0] = asked;
        let seen = control.clone();
        both[0].waits_until("one of both follows", move || seen.lock().unwrap().offset() == stands);
        if both.iter_mut().any(is_off) {
            break;
        }
    }
    let said = both.map(Program::ends);
    let who_said = |words: &str| {
        let has_said = |lines: &&Vec<String>| lines.iter().any(|line| line.contains(words));
        said.iter().filter(has_said).count()
    };
    // A gateway that finds several steps at once switches its axis off as well, but does not name another gateway.
    if who_said(REASON) == 0 && who_said("this gateway did not write") > 0 {
        tell("two gateways at one register: void, one of them stood still while the other made its steps");
    } else {
        assert_eq!(who_said(REASON), 1, "{said:#?}");
    }
    control.lock().unwrap().never_jumped();
}
