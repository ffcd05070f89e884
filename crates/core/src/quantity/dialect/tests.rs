use super::*;

fn german() -> Dialect {
    Dialect::of("Zeit;bed;column", TimeZone::get("Europe/Berlin").ok())
}

fn english() -> Dialect {
    Dialect::of("time,a", None)
}

fn utc(text: &str) -> Result<Moment, String> {
    Ok(time::parse(text).unwrap())
}

#[test]
fn columns_are_separated_by_what_the_first_line_has_most_of() {
    for (header, separator) in [
        ("time,a,b", b','),
        ("time;a;b", b';'),
        ("time\ta\tb", b'\t'),
        ("time", b','),
        ("time;\"a,b,c,d\";e", b';'),
        ("time,\"a;b;c;d\",e", b','),
        ("", b','),
        ("time;T1, front", b';'),
        ("time|a|b", b'|'),
        ("time,a|b", b','),
    ] {
        assert_eq!(Dialect::of(header, None).separator(), separator, "{header}");
    }
}

#[test]
fn a_decimal_comma_is_a_point_where_commas_separate_nothing() {
    let mut german = german();
    for (text, read) in
        [("12,5", "12.5"), ("-0,25", "-0.25"), ("1,5e-3", "1.5e-3"), ("12", "12"), ("A,B", "A,B")]
    {
        assert_eq!(german.number(text).as_deref(), Ok(read), "{text}");
    }
    let mixed = german.number("1.234").unwrap_err();
    assert!(mixed.starts_with("`1.234` and `12,5`: decimal commas and points in one file"), "{mixed}");
    assert_eq!(german.number("1.234,5").as_deref(), Ok("1234.5"));
    assert_eq!(german.number("1.234").as_deref(), Ok("1234"), "the file separates thousands by points");
    assert_eq!(german.number("12.345.678").as_deref(), Ok("12345678"));
}

#[test]
fn no_number_with_two_readings_is_read() {
    let said = english().number("1,020").unwrap_err();
    assert!(said.contains("can be 1020 or 1.020") && said.contains("--decimal"), "{said}");
    let said = english().number("12,5").unwrap_err();
    assert_eq!(said, "`12,5` has a decimal comma; state --decimal comma, or write 12.5");
    let mut counted = english();
    assert_eq!(counted.number("1,234,567").as_deref(), Ok("1234567"));
    assert_eq!(counted.number("1,020").as_deref(), Ok("1020"), "the file separates thousands by commas");
    for (stated, text, read) in [
        (DecimalMark::Point, "1,020", Ok("1020")),
        (DecimalMark::Comma, "1,020", Ok("1.020")),
        (DecimalMark::Comma, "1.020", Ok("1020")),
        (DecimalMark::Point, "1.020", Ok("1.020")),
        (DecimalMark::Comma, "20.5", Err("if the point is the decimal mark, state --decimal point")),
        (DecimalMark::Point, "20,00", Err("if the comma is the decimal mark, state --decimal comma")),
        (DecimalMark::Point, "A,B", Ok("A,B")),
    ] {
        let mut dialect = english().with(Some(stated), None);
        match (dialect.number(text), read) {
            (Ok(found), Ok(read)) => assert_eq!(found, read, "{text}"),
            (Err(found), Err(says)) => assert!(found.contains(says), "{found}"),
            (found, _) => panic!("{text}: {found:?}"),
        }
    }
    let mut pointed = Dialect::of("time;a", None);
    assert_eq!(pointed.number("20.5").as_deref(), Ok("20.5"));
    assert!(pointed.number("1,020").unwrap_err().contains("can be 1020 or 1.020"));
}

#[test]
fn a_mark_before_three_digits_is_asked_for_if_no_other_number_shows_the_decimal_mark() {
    let learnt = |rows: &[&[&'static str]]| {
        let mut dialect = Dialect::of("time;rpm", None);
        dialect.learn_marks(rows.iter().map(|row| row.to_vec()));
        dialect.number("1.200").map(std::borrow::Cow::into_owned)
    };
    assert!(learnt(&[&["09.03.2026", "900"], &["10.03.2026", "1.200"]]).is_err());
    let said = learnt(&[&["0", "900"], &["60", "1.200"]]).unwrap_err();
    assert!(said.contains("can be 1200 or 1.200") && said.contains("--decimal"), "{said}");
    let clear: [&[&[&str]]; 3] =
        [&[&["0", "900"], &["60", "1.200"], &["90.5", "1.200"]], &[&["0", "20.125"], &["60", "1.200"]], &[]];
    for rows in clear {
        assert_eq!(learnt(rows).as_deref(), Ok("1.200"), "{rows:?}");
    }
}

#[test]
fn a_month_that_seems_to_pass_in_a_night_is_asked_for() {
    let mut american = german();
    let first = american.moment("1/5/2026 11:59:00 PM", None);
    assert_eq!(first, utc("2026-01-05T22:59:00Z"));
    assert_eq!(american.moment("1/6/2026 12:00:00 AM", first.ok()), utc("2026-01-05T23:00:00Z"));
    let mut british = german();
    let first = british.moment("1/5/2026 11:59:00 PM", None);
    let said = british.moment("2/5/2026 12:00:00 AM", first.ok()).unwrap_err();
    assert!(said.contains("--dates day-first"), "{said}");
}

#[test]
fn a_date_without_a_time_is_midnight() {
    assert_eq!(german().moment("05.01.2026", None), utc("2026-01-04T23:00:00Z"));
    assert_eq!(german().moment("2026-01-05", None), utc("2026-01-04T23:00:00Z"));
    assert!(german().moment("1/5/2026", None).unwrap_err().contains("--dates"));
    assert_eq!(german().in_utc().moment("05.01.2026 06:00:00", None), utc("2026-01-05T06:00:00Z"));
}

#[test]
fn cells_are_numbers_with_units_missing_values_or_texts() {
    for (text, cell) in [
        ("+   20.01", Cell::Number(20.01, "")),
        ("20.01 °C", Cell::Number(20.01, "°C")),
        ("2.0D+01", Cell::Number(20.0, "")),
        ("+9.9E+37", Cell::Number(9.9e37, "")),
        ("9.9E+999", Cell::Failed),
        ("NaN", Cell::Absent),
        ("", Cell::Absent),
        ("OL", Cell::Failed),
        ("1.#QNAN", Cell::Failed),
        ("idle", Cell::Text),
    ] {
        assert_eq!(english().cell(text), Ok(cell), "{text}");
    }
    assert_eq!(german().cell("20,01 °C"), Ok(Cell::Number(20.01, "°C")));
    assert!(english().cell("1,020").is_err());
}

#[test]
fn times_by_the_clock_on_the_wall_are_those_of_the_zone() {
    for (text, read) in [
        ("05.01.2026 06:00:10", "2026-01-05T05:00:10Z"),
        ("5.1.2026 6:00", "2026-01-05T05:00:00Z"),
        ("2026-01-05 06:00:10", "2026-01-05T05:00:10Z"),
        ("2026/01/05 06:00:10", "2026-01-05T05:00:10Z"),
        ("1/5/2026 6:00:10 AM", "2026-01-05T05:00:10Z"),
        ("2026-07-05T06:00:10", "2026-07-05T04:00:10Z"),
        ("05.07.2026 06:00:10,250", "2026-07-05T04:00:10.25Z"),
        ("2026-01-05 06:00:10+03:00", "2026-01-05T03:00:10Z"),
        ("2026-01-05T06:00:10Z", "2026-01-05T06:00:10Z"),
        ("2026-01-05 06:00:10 UTC", "2026-01-05T06:00:10Z"),
        ("05.07.2026 06:00:10.5 GMT", "2026-07-05T06:00:10.5Z"),
        ("20260105T060010", "2026-01-05T05:00:10Z"),
        ("20260105060010", "2026-01-05T05:00:10Z"),
    ] {
        assert_eq!(german().moment(text, None), utc(read), "{text}");
    }
    assert_eq!(german().moment("12,5", None), utc("12.5"));
    assert_eq!(english().moment("00:01:30", None), utc("90"));
    assert_eq!(english().moment("00:01:30:250", None), utc("90.25"));
    assert_eq!(german().moment_in(TimeUnit::ExcelDays, "46090,25", None), utc("2026-03-09T05:00:00Z"));
    assert_eq!(german().moment_in(TimeUnit::Hours, "0,2", None), utc("720"));
    assert_eq!(german().moment("1,5 min", None), utc("90"));
    assert_eq!(german().moment_in(TimeUnit::Hours, "06:30", None), utc("23400"));
    assert_eq!(german().moment_in(TimeUnit::Minutes, "06:30", None), utc("390"));
    assert!(german().moment("1,5 mm", None).is_err());
}

#[test]
fn the_hour_that_comes_twice_goes_by_the_row_before() {
    let mut german = german();
    let first = german.moment("25.10.2026 02:30:00", utc("2026-10-25T00:29:00Z").ok());
    assert_eq!(first, utc("2026-10-25T00:30:00Z"));
    let again = german.moment("25.10.2026 02:00:00", utc("2026-10-25T00:59:00Z").ok());
    assert_eq!(again, utc("2026-10-25T01:00:00Z"));
}

#[test]
fn what_is_no_time_of_the_zone_says_what_to_write() {
    for (text, says) in [
        (
            "29.03.2026 02:30:00",
            "2026-03-29T02:30:00 does not exist in Europe/Berlin: the clocks of this zone were set forward",
        ),
        ("01/05/2026 06:00:00", "day and month are ambiguous"),
        ("05.01.26 06:00:10", "write four digits"),
        ("31.02.2026 06:00:10", "`31.02.2026 06:00:10` is not a time"),
        ("05.01.2026 25:00:10", "is not a time"),
        ("05.01.2026 6 Uhr: frueh", "is not a time"),
    ] {
        let said = german().moment(text, None).unwrap_err();
        assert!(said.contains(says), "{text}: {said}");
    }
    let without = Dialect::of("time;a", None).moment("2026-01-05 06:00:10", None).unwrap_err();
    assert!(without.contains("with Z or the offset"), "{without}");
    let counted = german().moment_in(TimeUnit::Minutes, "05.01.2026 06:00:10", None).unwrap_err();
    assert!(counted.contains("the unit of this column is minutes"), "{counted}");
    let mut learnt = german();
    learnt.learn_dates("31/01/2026 06:00:00");
    assert_eq!(learnt.moment("05/01/2026 06:00:00", None), utc("2026-01-05T05:00:00Z"));
}
