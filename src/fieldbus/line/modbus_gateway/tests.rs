use super::*;

const TIMEOUT: Duration = Duration::from_millis(500);

/// Returns the moment this many milliseconds after an hour, because times are subtracted from it.
fn at(ms: u64) -> Moment {
    Moment::default().after(Duration::from_secs(3600) + Duration::from_millis(ms))
}

fn late(unit: u8, asked: u64, received: Option<u64>, is_of_a_gateway: bool) -> LateReply {
    LateReply { unit, asked: at(asked), received: received.map(at), is_of_a_gateway }
}

/// Returns a gateway whose unit 1 was asked at 0 and has missed its timeout.
fn silent() -> ModbusGateway {
    let mut gateway = ModbusGateway::default();
    gateway.missed(1, at(0), at(500));
    gateway
}

/// Returns a gateway that has sent the exception of unit 1 after this time.
fn with_exception(ms: u64) -> ModbusGateway {
    let mut gateway = silent();
    gateway.received_late(&late(1, 0, Some(ms), true));
    gateway
}

#[test]
fn the_own_timeout_is_the_time_until_the_late_exception_if_the_line_has_seen_it_arrive() {
    for (reply, own) in [
        (late(1, 0, Some(1000), true), Some(1000)),
        (late(1, 0, None, true), None),
        (late(1, 0, Some(1000), false), None),
        (late(1, 0, Some(11_000), true), None),
    ] {
        let mut gateway = silent();
        gateway.received_late(&reply);
        assert_eq!(gateway.occupied(), None, "{reply:?}");
        assert_eq!(gateway.news(TIMEOUT), own.map(Duration::from_millis), "{reply:?}");
    }
    let mut gateway = silent();
    gateway.received_late(&late(1, 7, Some(1000), false));
    assert!(gateway.occupied().is_some(), "the answer to another request");
}

#[test]
fn a_longer_timeout_is_news_once_and_again_when_it_changes() {
    let mut gateway = with_exception(1000);
    assert_eq!(gateway.news(TIMEOUT), Some(Duration::from_secs(1)));
    assert_eq!(gateway.news(TIMEOUT), None);
    for (asked, received, is_news) in [(2000, 3100, false), (4000, 7000, true), (8000, 8400, false)] {
        gateway.missed(1, at(asked), at(asked + 500));
        gateway.received_late(&late(1, asked, Some(received), true));
        assert_eq!(gateway.news(TIMEOUT).is_some(), is_news, "{asked}");
    }
}

/// Modbus gateway with an unknown timeout: action of the line before a request, for each unit and connection.
#[test]
fn the_line_waits_for_a_late_answer_and_opens_another_connection_where_none_comes() {
    let latest = at(4000);
    for (unit, expects_late, now, wait) in [
        (2, true, 600, Wait::Until(latest)),
        (2, true, 4000, Wait::Renew),
        (2, false, 600, Wait::None),
        (1, true, 2500, Wait::Renew),
        (1, false, 2500, Wait::None),
    ] {
        assert_eq!(silent().wait(unit, expects_late, latest, at(now)), wait, "{unit} {expects_late} {now}");
    }
    assert_eq!(ModbusGateway::default().wait(2, true, latest, at(600)), Wait::None, "nothing is missing");
    let mut gateway = silent();
    assert!(gateway.has_waited(2, true), "no answer");
    assert!(!gateway.has_waited(2, false), "it is another connection");
    gateway.missed(2, at(5000), at(5500));
    assert_eq!(gateway.wait(3, true, latest, at(5500)), Wait::Renew, "at once");
}

#[test]
fn the_line_waits_for_a_known_timeout_and_a_little_longer_and_asks_another_unit_on_another_connection() {
    let mut gateway = with_exception(1000);
    gateway.missed(2, at(2000), at(2500));
    let until = at(2000 + 1000 + 125 + 100);
    assert_eq!(gateway.occupied_until(), Some(until));
    // The Modbus gateway may keep the answer of unit 2, and send it as the answer to the next request.
    for (unit, expects_late, afterwards) in
        [(2, true, Wait::None), (3, true, Wait::Renew), (3, false, Wait::None)]
    {
        let case = format!("unit {unit}, {expects_late}");
        assert_eq!(gateway.wait(unit, expects_late, at(9000), at(2500)), Wait::Until(until), "{case}");
        assert_eq!(gateway.wait(unit, expects_late, at(9000), until), afterwards, "{case}");
        assert_eq!(gateway.has_waited(unit, expects_late), afterwards == Wait::Renew, "{case}");
    }
    // The Modbus gateway waits longer this time.
    assert_eq!(gateway.patience(3, until), Duration::from_millis(1000 + 500 + 100 - 1225));
    assert_eq!(gateway.patience(2, until), Duration::ZERO, "the unit itself");
    gateway.answered(3, false, at(3500));
    assert_eq!((gateway.wait(2, true, at(9000), at(3500)), gateway.occupied()), (Wait::None, None));
}

#[test]
fn the_timeout_of_a_gateway_that_gives_up_silently_shows_in_the_answer_of_the_next_unit() {
    // The first unit was asked at 0, and the answer of the other one was prompt or not.
    for (is_after_timeout, answered) in [(true, 3020), (false, 1600)] {
        let own = Duration::from_millis(answered);
        let mut gateway = silent();
        assert!(gateway.has_waited(2, true));
        gateway.answered(2, false, at(4020));
        assert_eq!(gateway.own_timeout(), None, "the line has waited for longer than it had to");
        gateway.missed(1, at(0), at(500));
        assert_eq!(gateway.patience(2, at(500)), LONGEST_WAIT - TIMEOUT);
        gateway.answered(2, is_after_timeout, at(answered));
        gateway.missed(1, at(0), at(500));
        let until = at(0).after(own + own / 8 + LATER);
        assert_eq!(gateway.wait(2, true, at(9000), at(500)), Wait::Until(until), "{answered}");
        assert_eq!(gateway.news(TIMEOUT), is_after_timeout.then_some(own), "{answered}");
    }
}

#[test]
fn what_was_learnt_is_forgotten_when_another_unit_misses_although_the_line_has_waited() {
    let mut gateway = with_exception(1000);
    gateway.missed(1, at(2000), at(2500));
    gateway.missed(2, at(3300), at(3800));
    assert_eq!(gateway.own_timeout(), None);
    let mut gateway = with_exception(1000);
    gateway.missed(1, at(2000), at(2500));
    gateway.missed(1, at(4000), at(4500));
    assert_eq!(gateway.own_timeout(), Some(Duration::from_secs(1)), "the same unit again");
}

#[test]
fn a_gateway_that_refuses_another_connection_keeps_the_present_one() {
    let mut gateway = ModbusGateway::default();
    gateway.refuses_connection();
    gateway.missed(1, at(0), at(500));
    assert_eq!(gateway.wait(1, true, at(4000), at(2500)), Wait::Renew, "no unit was silent");
    gateway.refuses_connection();
    for asked in [0, 20_000] {
        gateway.missed(1, at(asked), at(asked + 500));
        let latest = at(asked + 4000);
        assert_eq!(gateway.wait(1, true, latest, at(asked + 2500)), Wait::None, "the unit itself");
        assert_eq!(gateway.wait(2, true, latest, at(asked + 600)), Wait::Until(latest));
        assert!(!gateway.has_waited(2, true));
        assert_eq!(gateway.wait(2, true, latest, latest), Wait::None);
        // The answer of the unit itself shows nothing about the timeout.
        gateway.answered(1, false, at(asked + 4020));
    }
    gateway.missed(1, at(40_000), at(40_500));
    gateway.answered(2, false, at(44_020));
    assert_eq!(gateway.own_timeout(), Some(Duration::from_millis(4020)));
}

/// Time of the last answer in ms, and the age in s at which the readings are too old.
type Live = (u64, u64);

fn may_try(gateway: &ModbusGateway, tried: u64, live: &[Live], now: u64) -> bool {
    let live = live.iter().map(|(received, max_age)| (at(*received), Duration::from_secs(*max_age)));
    gateway.may_try_dead(at(tried), TIMEOUT, live, at(now))
}

#[test]
fn a_dead_unit_is_asked_if_no_reading_becomes_too_old() {
    let mut gateway = with_exception(3000);
    gateway.answered(2, false, at(3020));
    // The line waits for 3.475 s, and then up to a timeout for the next answer.
    for (live, may) in [
        (&[(3000, 5)][..], true),
        (&[(3000, 5), (3000, 3)], false),
        (&[(3075, 4)], true),
        (&[(3074, 4)], false),
        (&[], true),
    ] {
        assert_eq!(may_try(&gateway, 0, live, 3100), may, "{live:?}");
    }
    // If this is not possible, it is asked every five minutes.
    for (now, may) in [(299_000, false), (300_000, true)] {
        assert_eq!(may_try(&gateway, 0, &[(now, 1)], now), may, "{now}");
    }
}

#[test]
fn two_dead_units_are_never_asked_in_a_row_unless_no_other_one_answers() {
    let live = [(3000, 600)];
    for is_exception in [false, true] {
        let mut gateway = ModbusGateway::default();
        match is_exception {
            true => gateway.gave_up(at(3000)),
            false => gateway.missed(1, at(2500), at(3000)),
        }
        for (tried, now) in [(0, 3100), (0, 32_900)] {
            assert!(!may_try(&gateway, tried, &live, now), "{now}");
            assert!(may_try(&gateway, tried, &[], now), "{now}");
        }
        assert!(may_try(&gateway, 0, &live, 33_000), "the other unit does not answer any more");
        gateway.answered(2, false, at(3100));
        assert!(may_try(&gateway, 0, &live, 3100));
    }
    let mut gateway = ModbusGateway::default();
    gateway.missed(1, at(299_000), at(299_500));
    assert!(!may_try(&gateway, 0, &[(298_000, 600)], 300_100), "also after five minutes");
}

#[test]
fn dead_units_get_a_quarter_of_the_time() {
    let mut gateway = with_exception(1000);
    gateway.answered(2, false, at(1020));
    gateway.spent_on_dead(at(2000), TIMEOUT);
    for (now, may) in [(5999, false), (6000, true)] {
        assert_eq!(may_try(&gateway, 2000, &[(now, 60)], now), may, "{now}");
    }
}
