//! Tests of units behind a gateway to a serial line.

use super::*;
use isotherm_profile::{Gateway, Transport};

/// Read of another register, with an answer of the same form.
const OIL: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 100 }, 1);
/// Read with an answer of another form.
const LONG: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 100 }, 2);
const MISSED: Result<Answer, Fault> = Err(Fault::Exception(11));

fn asked(script: &Shared) -> usize {
    script.lock().unwrap().asked.len()
}

/// Returns a line with timeouts of 300 ms. A late answer may arrive until 1200 ms.
fn behind(gateway: Gateway) -> (Rig, Shared) {
    line(|device| device.quirks.gateway = gateway)
}

/// Sends 100 reads to the first unit, which answers at once.
async fn is_prompt(line: &mut Rig) {
    for _ in 0..100 {
        assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    }
}

#[tokio::test(start_paused = true)]
async fn after_exception_10_or_11_or_a_timeout_the_unit_waits_for_its_late_answer() {
    let timeout = Err(Fault::Timeout);
    let wrong = Err(Fault::Peer(PeerFault::Foreign));
    for (turn, fault) in [
        (Turn::Gives(MISSED), MISSED),
        (Turn::Gives(Err(Fault::Exception(10))), Err(Fault::Exception(10))),
        (Turn::NeverEnds, timeout),
        (Turn::Gives(wrong.clone()), wrong),
    ] {
        let (mut line, script) = behind(Gateway::ByUnits);
        assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
        answers(&script, &[turn]);
        assert_eq!(line.ask(0, READ, 10).await, fault);
        for read in [READ, OIL, LONG] {
            assert_eq!(line.ask(0, read, 1200).await, fault, "not asked");
        }
        assert_eq!(line.ask(1, READ, 1200).await, Ok(good()), "the other unit is");
        assert_eq!(asked(&script), 3, "{fault:?}");
        assert_eq!(line.ask(0, OIL, 1220).await, Ok(good()));
    }
}

#[tokio::test(start_paused = true)]
async fn a_late_answer_that_is_still_under_way_is_waited_for_whatever_the_clock_says() {
    let (mut line, script) = behind(Gateway::ByUnits);
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    answers(&script, &[Turn::Gives(MISSED)]);
    assert_eq!(line.ask(0, READ, 0).await, MISSED);
    assert_eq!(line.ask(0, OIL, 1200).await, Ok(good()));
    let script = script.lock().unwrap();
    assert_eq!(script.asked.last().map(|(.., at)| *at), Some(900), "three timeouts later");
}

#[tokio::test(start_paused = true)]
async fn of_a_prompt_unit_only_what_could_be_confused_with_the_late_answer_waits() {
    let (mut line, script) = behind(Gateway::ByUnits);
    is_prompt(&mut line).await;
    answers(&script, &[Turn::Gives(MISSED)]);
    assert_eq!(line.ask(0, READ, 0).await, MISSED);
    assert_eq!(line.ask(0, LONG, 1).await, Ok(good()), "its answer has another length");
    assert_eq!(line.ask(0, OIL, 800).await, MISSED, "not asked");
    assert_eq!(line.ask(0, OIL, 950).await, Ok(good()));
    assert_eq!((asked(&script), script.lock().unwrap().dialled), (104, 1), "with a control question");
    assert_eq!(script.lock().unwrap().asked.last().map(|(.., at)| *at), Some(900));
}

#[tokio::test(start_paused = true)]
async fn a_prompt_unit_is_asked_the_same_again_and_another_register_waits_for_the_second_answer() {
    let (mut line, script) = behind(Gateway::ByUnits);
    is_prompt(&mut line).await;
    answers(&script, &[Turn::Gives(MISSED)]);
    assert_eq!(line.ask(0, READ, 0).await, MISSED);
    assert_eq!(line.ask(0, READ, 1).await, Ok(good()), "whichever answer it is, it is of this register");
    assert_eq!(line.ask(0, OIL, 2).await, Ok(good()));
    let script = script.lock().unwrap();
    assert_eq!(script.asked.last().map(|(.., at)| *at), Some(15), "three times the longest answer");
}

/// The gateway gives up after 200 ms. The late answer may arrive for another 900 ms.
#[tokio::test(start_paused = true)]
async fn a_request_fails_at_once_while_the_late_answer_has_its_time_after_the_gateway_gave_up() {
    let (mut line, script) = behind(Gateway::ByUnits);
    is_prompt(&mut line).await;
    answers(&script, &[Turn::Misses(Duration::from_millis(200))]);
    let time = line.time.clone();
    let passes = async {
        tokio::time::sleep(Duration::from_millis(199)).await;
        *time.lock().unwrap() = Duration::from_millis(200);
    };
    assert_eq!(tokio::join!(line.ask(0, READ, 0), passes).0, MISSED);
    for at in [901, 1099] {
        assert_eq!(line.ask(0, OIL, at).await, MISSED, "{at}: not asked");
    }
    assert_eq!(asked(&script), 101, "and not waited for");
    tokio::time::sleep(Duration::from_millis(900)).await;
    assert_eq!(line.ask(0, OIL, 1101).await, Ok(good()));
}

#[tokio::test(start_paused = true)]
async fn a_unit_that_is_not_behind_a_gateway_does_not_wait() {
    let (mut line, script) = behind(Gateway::Absent);
    answers(&script, &[Turn::Gives(MISSED)]);
    assert_eq!(line.ask(0, READ, 0).await, MISSED);
    assert_eq!(line.ask(0, OIL, 0).await, Ok(good()));
    let (mut line, script) = behind(Gateway::Present);
    answers(&script, &[Turn::Gives(Err(Fault::Exception(4)))]);
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Exception(4)), "the unit has answered");
    assert_eq!(line.ask(0, OIL, 0).await, Ok(good()));
}

#[tokio::test(start_paused = true)]
async fn an_answer_of_another_unit_of_the_line_with_the_present_transaction_shows_that_the_gateway_confuses_them()
 {
    for (from, returns_numbers) in [(2, false), (9, true)] {
        let (mut line, script) = behind(Gateway::ByUnits);
        answers(&script, &[Turn::Gives(Err(Fault::Peer(PeerFault::Unit(from))))]);
        assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Peer(PeerFault::Unit(from))));
        assert_eq!(line.line.gateway.returns_numbers(), returns_numbers, "unit {from}");
    }
}

/// The live unit was read at 0 and asked something else at 4000.
#[tokio::test(start_paused = true)]
async fn a_dead_unit_waits_for_the_readings_of_the_other_one_and_not_for_its_other_answers() {
    for (is_round, at, rests) in [(true, 4400, false), (true, 4401, true), (false, 4401, false)] {
        let (mut line, script) = behind(Gateway::ByUnits);
        line.line = line.line.with_ages(|_| Duration::from_secs(5));
        assert_eq!(line.ask(1, READ, 0).await, Ok(good()));
        if is_round {
            line.line.note_round(DeviceId(1), line.begun);
        }
        answers(&script, &[Turn::NeverEnds]);
        assert_eq!(line.ask(0, READ, 10).await, Err(Fault::Timeout));
        assert_eq!(line.ask(1, READ, 4000).await, Ok(good()));
        assert_eq!(line.is_backing_off(0, at), rests, "{is_round} {at}");
    }
}

#[test]
fn a_gateway_is_taken_for_there_if_two_units_share_a_connection() {
    for (gateway, alone, shared) in
        [(Gateway::ByUnits, false, true), (Gateway::Present, true, true), (Gateway::Absent, false, false)]
    {
        let is_present = |units: &[u8]| gateway.is_present(Transport::Tcp, units.iter().copied());
        assert_eq!((is_present(&[3, 3]), is_present(&[3, 3, 4])), (alone, shared), "{gateway:?}");
        assert!(!gateway.is_present(Transport::RtuOverTcp, [3, 4].into_iter()), "RTU waits by itself");
    }
}
