//! The program is stopped by SIGSTOP at each place of an exchange, and then continues. The pause is longer than its
//! readings may be used, and longer than a write may be under way. Nothing that was decided before the pause is written
//! after it.

use std::net::TcpListener;
use std::time::Duration;

use crate::late_writes::device::gate::{At, Of, Place};
use crate::late_writes::device::{self, Device, STEP, Seen, Times, What};
use crate::late_writes::process::PATIENCE;
use crate::late_writes::rig::{LEDGER, Program, all_at_once, blames_nobody};
use crate::support::starved::Starved;
use crate::support::tell;

const MAX_AGE: Duration = Duration::from_secs(1);
const LATE: Duration = Duration::from_secs(2);
const STOPPED: Duration = Duration::from_millis(3500);
/// Longest wait of the program for a processor with which the age of its readings is known.
const KEPT_WAITING: Duration = Duration::from_millis(100);
const TIMES: Times =
    Times { timeout: Duration::from_millis(400), every: Duration::from_millis(500), max_age: MAX_AGE };

/// Time at which the device continues.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Then {
    /// During the pause of the program.
    Meanwhile,
    /// When the program has already continued.
    Afterwards,
}

fn profile(device: &Device, more: &str) -> String {
    let late = format!("late = \"{}s\"\ntimeout = ", LATE.as_secs());
    let pauses = "quirks = { pause_after_connect = \"100ms\", ";
    let text = device::profile(device.address(), TIMES);
    text.replacen("timeout = ", &late, 1).replacen("quirks = { ", pauses, 1) + more
}

/// Checks that every change is based on a temperature that was requested after this index. Returns the errors.
fn rests_on_what_was_asked(seen: &[Seen], before: usize) -> Vec<String> {
    let mut wrong = Vec::new();
    for (place, one) in seen.iter().enumerate().skip(before) {
        let What::Wrote { from, to } = one.what else { continue };
        let asks = |seen: &Seen| match seen.what {
            What::Asked { answered: Some(asked) } => (asked - from).signum() == (to - from).signum(),
            _ => false,
        };
        if from != to && !seen[before..place].iter().any(asks) {
            wrong.push(format!("{from} → {to} was decided before the pause"));
        }
    }
    wrong
}

/// Moves up, is stopped at this place, and is requested to move down when it continues.
fn stopped(place: Place, then: Then, more: &str) {
    let name = format!("{place:?}, {then:?}, {more:?}");
    let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
    let mut program = Program::start(&profile(&device, more));
    let starved = Starved::of(program.running.id());
    device.asks(50 * STEP);
    program.waits_until(&name, || device.offset() >= 2 * STEP);
    device.gate().close(place);
    if place.0 == Of::Connection {
        device.hangs_up();
    }
    assert!(device.gate().is_reached(PATIENCE), "{name}: nobody comes there");
    program.running.stands_still();
    if then == Then::Meanwhile {
        device.gate().open();
    }
    // A request that was sent is still on its way, and is answered with the old value.
    std::thread::sleep(Duration::from_millis(200));
    let asked = device.offset() - 4 * STEP;
    device.asks(asked);
    std::thread::sleep(STOPPED);
    let before = device.state().seen.len();
    program.running.resumes();
    if then == Then::Afterwards {
        std::thread::sleep(Duration::from_millis(100));
        device.gate().open();
    }
    program.waits_until(&name, || device.offset() == asked);
    std::thread::sleep(MAX_AGE);
    let said = program.ends();
    let seen = device.state().seen.clone();
    let mut wrong = rests_on_what_was_asked(&seen, before);
    let is_old = |text: &String| text.contains("rests on a reading");
    let (old, others): (Vec<String>, Vec<String>) =
        device::acted_wrongly(&seen, MAX_AGE).into_iter().partition(is_old);
    wrong.extend(others);
    // A program may have to wait for a processor between its last clock sample and the write.
    if starved.longest() < KEPT_WAITING {
        wrong.extend(old);
    } else if !old.is_empty() {
        tell(&format!("{name}: the age of its readings is void, the computer was too busy: {old:?}"));
    }
    let pauses = said.iter().filter(|line| line.contains("stood still")).count();
    println!("{name}: {} writes, {pauses} pauses, wrong: {wrong:?}", device.state().writes());
    assert!(wrong.is_empty() && pauses > 0, "{name}: {wrong:#?}\n{}", said.join("\n"));
    assert_eq!(device.offset(), asked, "{name}");
    blames_nobody(&name, &said);
}

/// Every place, with the time at which the device continues there. A write that has arrived is executed before `late`
/// is over.
fn places() -> impl Iterator<Item = (Place, Then)> {
    use Then::{Afterwards, Meanwhile};
    let exchanges = [Of::Temperature, Of::Look, Of::Write, Of::ReadBack];
    let unanswered = exchanges.into_iter().flat_map(|of| [Place(of, At::CarriedOut), Place(of, At::Half)]);
    let either = unanswered.chain([Place(Of::Connection, At::Come)]);
    let either = either.flat_map(|place| [(place, Meanwhile), (place, Afterwards)]);
    let answered = exchanges.map(|of| (Place(of, At::Answered), Meanwhile));
    either.chain(answered).chain([(Place(Of::Write, At::Come), Meanwhile)])
}

#[test]
fn stopped_at_any_place_of_an_exchange_it_writes_nothing_that_was_decided_before_and_goes_on() {
    let kinds = ["", LEDGER, "verify = \"echo\"\n"];
    let cases = places().flat_map(|(place, then)| kinds.map(|more| (place, then, more)));
    all_at_once(cases.map(|(place, then, more)| move || stopped(place, then, more)));
}
