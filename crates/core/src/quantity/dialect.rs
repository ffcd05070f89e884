//! Format of a log from another program: separator of columns, decimal mark, and time zone. For example, a spreadsheet
//! set to German has semicolons between columns, commas in numbers, and local times.

use std::borrow::Cow;

use jiff::civil::{Date, DateTime, Time};
use jiff::tz::{AmbiguousOffset, TimeZone};

use super::{Moment, time};

/// Format of one log file: separator of columns, decimal mark, and time zone.
#[derive(Clone, Debug)]
pub struct Dialect {
    separator: u8,
    /// Time zone of times without an offset from UTC. If `None`, such times are rejected.
    zone: Option<TimeZone>,
    /// Decimal mark of the first number that has one, and this number as text. All later numbers must have the same
    /// mark.
    first: Option<(char, String)>,
}

impl Dialect {
    /// Detects the format from the header line. Comma, semicolon or tab separates the columns: the one that occurs most
    /// often outside quotes.
    #[must_use]
    pub fn of(header: &str, zone: Option<TimeZone>) -> Dialect {
        // Every other part is inside quotes.
        let open = || header.split('"').step_by(2).flat_map(str::bytes);
        let count = |separator: u8| open().filter(|byte| *byte == separator).count();
        // `max_by_key` returns the last maximum: a comma if there is no separator.
        let separator = [b'\t', b';', b','].into_iter().max_by_key(|separator| count(*separator));
        Dialect { separator: separator.unwrap_or(b','), zone, first: None }
    }

    /// Returns the separator of columns.
    #[must_use]
    pub fn separator(&self) -> u8 {
        self.separator
    }

    /// Replaces the decimal comma of a number by a point, unless commas separate columns. Any other text is returned
    /// unchanged.
    ///
    /// # Errors
    /// Returns a message if the number has separators of thousands, or another decimal mark than an earlier number of
    /// the file.
    pub fn number<'a>(&mut self, text: &'a str) -> Result<Cow<'a, str>, String> {
        let is_number = |text: &str| text.parse::<f64>().is_ok();
        let (mark, pointed) = match (text.contains(','), text.contains('.')) {
            _ if self.separator == b',' => return Ok(Cow::Borrowed(text)),
            (true, true) => {
                let (thousands, decimal) =
                    if text.rfind(',') > text.rfind('.') { ('.', ',') } else { (',', '.') };
                let plain = text.replace(thousands, "");
                return match is_number(&plain.replace(decimal, ".")) {
                    true => Err(format!("`{text}` has separators of thousands; write {plain}")),
                    false => Ok(Cow::Borrowed(text)),
                };
            }
            (true, false) => (',', Cow::Owned(text.replace(',', "."))),
            (false, true) => ('.', Cow::Borrowed(text)),
            (false, false) => return Ok(Cow::Borrowed(text)),
        };
        if !is_number(&pointed) {
            return Ok(Cow::Borrowed(text));
        }
        let (known, first) = self.first.get_or_insert_with(|| (mark, text.to_owned()));
        if *known != mark {
            return Err(format!(
                "`{text}` and `{first}`: decimal commas and points in one file; use only one of them"
            ));
        }
        Ok(pointed)
    }

    /// Parses a time: seconds, RFC 3339, or a local time such as `2026-01-05 06:00:10` or `05.01.2026 06:00:10`. `last`
    /// is the time of the previous row. It decides which hour is meant if the hour occurs twice, at the end of summer
    /// time.
    ///
    /// # Errors
    /// Returns a message that says how to write the time.
    pub fn moment(&mut self, text: &str, last: Option<Moment>) -> Result<Moment, String> {
        let text = text.trim();
        if !text.contains(':') {
            return time::parse(&self.number(text)?);
        }
        let read = time::parse(text);
        match (&self.zone, read.is_ok(), by_the_wall(text)) {
            (Some(zone), false, Some(wall)) => in_zone(wall?, zone, last),
            _ => read,
        }
    }
}

/// Parses a date and a time without a time zone. `None` if the text has another format; a message if the date is
/// ambiguous.
fn by_the_wall(text: &str) -> Option<Result<DateTime, String>> {
    let (date, time) = text.split_once([' ', 'T'])?;
    let date = date.trim_end_matches(',');
    if date.contains('/') {
        return Some(Err(format!("`{text}`: day and month are ambiguous; write 2026-01-31 12:00:00")));
    }
    let date = match date.contains('.') {
        true => {
            let parts: Vec<&str> = date.split('.').collect();
            let [day, month, year] = parts.as_slice() else { return None };
            if year.len() != 4 {
                return Some(Err(format!("`{text}`: write the year with four digits")));
            }
            Date::new(year.parse().ok()?, month.parse().ok()?, day.parse().ok()?).ok()?
        }
        false => date.parse().ok()?,
    };
    Some(Ok(date.to_datetime(of_day(time.trim())?)))
}

/// Parses a time of day: `6:00`, `06:00:10` or `06:00:10,25`. `None` for any other text.
fn of_day(text: &str) -> Option<Time> {
    let (text, fraction) = text.split_once(['.', ',']).unwrap_or((text, ""));
    let mut parts = text.split(':').map(|part| part.parse::<i8>().ok());
    let (hour, minute) = (parts.next()??, parts.next()??);
    let second = parts.next().unwrap_or(Some(0))?;
    if parts.next().is_some() || fraction.len() > 9 || !fraction.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let nanos = format!("{fraction:0<9}").parse().ok()?;
    Time::new(hour, minute, second, nanos).ok()
}

fn in_zone(wall: DateTime, zone: &TimeZone, last: Option<Moment>) -> Result<Moment, String> {
    let at = |offset: jiff::tz::Offset| {
        let nanos =
            offset.to_timestamp(wall).ok().and_then(|stamp| u64::try_from(stamp.as_nanosecond()).ok());
        nanos.map(Moment::from_nanos).ok_or_else(|| format!("{wall} lies before 1970"))
    };
    match zone.to_ambiguous_timestamp(wall).offset() {
        AmbiguousOffset::Unambiguous { offset } => at(offset),
        AmbiguousOffset::Fold { before, after } => {
            let first = at(before)?;
            if last.is_some_and(|last| last > first) { at(after) } else { Ok(first) }
        }
        AmbiguousOffset::Gap { .. } => Err(format!(
            "{} has no {wall}: the clocks of this zone were set forward over this time. Is this the zone of \
             the log? For a clock without summer time, write --zone +01:00",
            zone.iana_name().unwrap_or("the zone")
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn german() -> Dialect {
        Dialect::of("Zeit;bed;column", TimeZone::get("Europe/Berlin").ok())
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
        assert_eq!(mixed, "`1.234` and `12,5`: decimal commas and points in one file; use only one of them");
        let thousands = german.number("1.234,5").unwrap_err();
        assert_eq!(thousands, "`1.234,5` has separators of thousands; write 1234,5");
        let mut english = Dialect::of("time,a", None);
        assert_eq!(english.number("12,5").as_deref(), Ok("12,5"), "what reads it says what to write");
    }

    #[test]
    fn times_by_the_clock_on_the_wall_are_those_of_the_zone() {
        for (text, read) in [
            ("05.01.2026 06:00:10", "2026-01-05T05:00:10Z"),
            ("5.1.2026 6:00", "2026-01-05T05:00:00Z"),
            ("2026-01-05 06:00:10", "2026-01-05T05:00:10Z"),
            ("2026-07-05T06:00:10", "2026-07-05T04:00:10Z"),
            ("05.07.2026 06:00:10,250", "2026-07-05T04:00:10.25Z"),
            ("2026-01-05 06:00:10+03:00", "2026-01-05T03:00:10Z"),
            ("2026-01-05T06:00:10Z", "2026-01-05T06:00:10Z"),
        ] {
            assert_eq!(german().moment(text, None), utc(read), "{text}");
        }
        assert_eq!(german().moment("12,5", None), utc("12.5"));
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
                "Europe/Berlin has no 2026-03-29T02:30:00: the clocks of this zone were set forward",
            ),
            ("01/05/2026 06:00:00", "day and month are ambiguous"),
            ("05.01.26 06:00:10", "write the year with four digits"),
            ("31.02.2026 06:00:10", "`31.02.2026 06:00:10` is no time"),
            ("05.01.2026 25:00:10", "is no time"),
            ("05.01.2026 6 Uhr: frueh", "is no time"),
        ] {
            let said = german().moment(text, None).unwrap_err();
            assert!(said.contains(says), "{text}: {said}");
        }
        let without = Dialect::of("time;a", None).moment("2026-01-05 06:00:10", None).unwrap_err();
        assert!(without.contains("with Z or the offset"), "{without}");
    }
}
