//! Wall-clock dates and times, as loggers and spreadsheets write them, and their moments in a time zone.

use jiff::SignedDuration;
use jiff::civil::{Date, DateTime, Time};
use jiff::tz::{AmbiguousOffset, Offset, TimeZone};

use super::Moment;
use super::time_column::TimeUnit;

const DAY: u64 = 24 * HOUR;
const HOUR: u64 = 3_600_000_000_000;
/// Maximum wall-clock time between two rows of a logger that runs without a pause. The limit is used when
/// summer time ends and one hour occurs twice: after a longer time, the logger was off in that hour.
const NEXT_ROW: SignedDuration = SignedDuration::from_secs(30 * 60);
/// Day zero of spreadsheets. It is one day before 31 December 1899, because spreadsheets also count 29 February 1900,
/// which did not exist.
const FIRST_OF_EXCEL: Date = Date::constant(1899, 12, 30);

/// Order of day and month in dates such as `01/05/2026`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DateOrder {
    /// The day comes first: `01/05/2026` is 1 May 2026.
    DayFirst,
    /// The month comes first: `01/05/2026` is 5 January 2026.
    MonthFirst,
}

/// Result of reading a time from a cell of a log: a date with a time, or a time without a date.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Read {
    /// Date and time in an unknown time zone.
    Date(DateTime),
    /// Date and time with AM or PM. The month is assumed to come first, as in the United States.
    Assumed(DateTime),
    /// Time of day, or time since the start of the log, in nanoseconds.
    OfDay(u64),
}

/// Parses a time without a time zone. `None` if the text has another format; a message if it can be read in two ways.
pub(super) fn read(text: &str, order: Option<DateOrder>) -> Option<Result<Read, String>> {
    if let Some(clock) = Clock::of(text) {
        return Some(match clock.seconds {
            Some(_) => Ok(Read::OfDay(clock.nanos())),
            None => Err(format!(
                "`{text}` can be hours and minutes or minutes and seconds; state --time-unit h or --time-unit min, or write \
                 hours, minutes and seconds: 00:05:10"
            )),
        });
    }
    if let Some(nanos) = since_days(text) {
        return Some(Ok(Read::OfDay(nanos)));
    }
    let one_word = one_word(text);
    let spaced = one_word.as_deref().unwrap_or(text);
    // A blank is tried before `T`, because the name of a month may contain a T, for example `OCT`.
    let (date, time) = (spaced.split_once(' ').filter(|(date, _)| !date.contains(':')))
        .or_else(|| spaced.split_once('T'))?;
    let clock = Clock::of(time)?;
    let is_assumed = order.is_none()
        && clock.is_of_half_days
        && date.find('/').is_some_and(|at| at < 4)
        && self::order(text).is_none();
    // `31/01/2026 6:00 PM` can be read in only one way.
    let order =
        order.or_else(|| self::order(text)).or(clock.is_of_half_days.then_some(DateOrder::MonthFirst));
    Some(match parse_date(date.trim_end_matches(','), order, text)? {
        Ok(date) if is_assumed => Ok(Read::Assumed(date.to_datetime(clock.of_day()?))),
        Ok(date) => Ok(Read::Date(date.to_datetime(clock.of_day()?))),
        Err(why) => Err(why),
    })
}

/// Parses hours and minutes, or minutes and seconds, in a column of `unit`. Returns nanoseconds; `None` if
/// the text has another format or the column another unit.
pub(super) fn two_parts(text: &str, unit: TimeUnit) -> Option<u64> {
    let clock = Clock::of(text).filter(|clock| clock.seconds.is_none() && !clock.is_of_half_days)?;
    match unit {
        TimeUnit::Hours if clock.nanos == 0 => Some(clock.nanos()),
        TimeUnit::Minutes => Some((clock.hours * 60 + clock.minutes) * 1_000_000_000 + clock.nanos),
        _ => None,
    }
}

/// Parses a date without a time, as some programs write midnight. `None` if the text has another format.
pub(super) fn midnight(text: &str, order: Option<DateOrder>) -> Option<Result<DateTime, String>> {
    Some(parse_date(text, order, text)?.map(|date| date.to_datetime(Time::midnight())))
}

/// Returns the order of day and month in this date and time, if the text can be read in only one way; else `None`.
pub(super) fn order(text: &str) -> Option<DateOrder> {
    let date = text.trim().split([' ', ',']).next()?;
    let parts: Vec<&str> = date.split(['/', '-']).collect();
    let [first, second, year] = parts.as_slice() else { return None };
    let (first, second): (u8, u8) = (first.parse().ok()?, second.parse().ok()?);
    only_order(first, second).filter(|_| year.len() == 4)
}

/// Returns the order of day and month if one of these numbers cannot be a month; else `None`.
fn only_order(first: u8, second: u8) -> Option<DateOrder> {
    match (first > 12, second > 12) {
        (true, false) => Some(DateOrder::DayFirst),
        (false, true) => Some(DateOrder::MonthFirst),
        _ => None,
    }
}

/// Parses a date and time without separators: `20260105T060010`, `20260105060010`.
pub(super) fn compact(text: &str) -> Option<DateTime> {
    if !matches!(text.len(), 14 | 15) {
        return None;
    }
    let (date, time) = text.split_once('T').or_else(|| text.split_at_checked(8))?;
    let date = eight_digits(date)?;
    if time.len() != 6 || !is_digits(time) {
        return None;
    }
    let two = |at: usize| time[at..at + 2].parse::<i8>().ok();
    Some(date.to_datetime(Time::new(two(0)?, two(2)?, two(4)?, 0).ok()?))
}

/// Parses a date without separators: `20260105`.
fn eight_digits(date: &str) -> Option<Date> {
    if date.len() != 8 || !is_digits(date) {
        return None;
    }
    Date::new(date[..4].parse().ok()?, date[4..6].parse().ok()?, date[6..].parse().ok()?).ok()
}

fn is_digits(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// Joins the parts of a date that contains the name of a month into one word, and keeps the time after the date.
/// `05 Jan 2026 06:00` and `Jan 05, 2026 06:00` become `05-Jan-2026 06:00`. `None` for any other text.
fn one_word(text: &str) -> Option<String> {
    let mut parts = text.split(' ').map(|part| part.trim_end_matches(',')).filter(|part| !part.is_empty());
    let (first, second, year) = (parts.next()?, parts.next()?, parts.next()?);
    let (day, month) = if is_digits(first) { (first, second) } else { (second, first) };
    if !is_digits(day) || !is_digits(year) || year.len() != 4 {
        return None;
    }
    month_of_name(month)?;
    let rest: Vec<&str> = parts.collect();
    Some(format!("{day}-{month}-{year} {}", rest.join(" ")))
}

/// Returns the nanoseconds of an elapsed time with days, as pandas and Python write it: `1 days 06:00:10`,
/// `1 day, 6:00:10`.
fn since_days(text: &str) -> Option<u64> {
    let (days, clock) = text.split_once(" day")?;
    let clock = Clock::of(clock.trim_start_matches(['s', ',']))?;
    let is_whole = clock.seconds.is_some() && !clock.is_of_half_days;
    days.parse::<u64>().ok().filter(|_| is_whole)?.checked_mul(DAY)?.checked_add(clock.nanos())
}

fn parse_date(date: &str, order: Option<DateOrder>, text: &str) -> Option<Result<Date, String>> {
    if let Some(date) = eight_digits(date) {
        return Some(Ok(date));
    }
    // `2026年1月5日`
    let dashed;
    let date = match date.contains('年') {
        true => {
            dashed = date.replace(['年', '月'], "-").replace('日', "");
            dashed.as_str()
        }
        false => date,
    };
    let parts: Vec<&str> = date.split(['.', '/', '-']).collect();
    let [first, second, third] = parts.as_slice() else { return None };
    if let Some(month) = month_of_name(second) {
        let (year, day) = if first.len() == 4 { (first, third) } else { (third, first) };
        let year = match (year.len(), order) {
            // `05-Jan-26` may be a day of 2005 or of 2026.
            (2, None) => return Some(Err(two_digits(text))),
            (2, Some(_)) => 2000 + year.parse::<i16>().ok()?,
            _ => year.parse::<i16>().ok().filter(|year| *year > 999)?,
        };
        return Some(Ok(Date::new(year, month, day.parse().ok()?).ok()?));
    }
    if first.len() == 4 {
        return Some(Ok(Date::new(first.parse().ok()?, second.parse().ok()?, third.parse().ok()?).ok()?));
    }
    let are_numbers = parts.iter().all(|part| is_digits(part));
    let year = match (third.len(), order) {
        (4, _) => third.parse::<i16>().ok()?,
        (2, Some(_)) if are_numbers => 2000 + third.parse::<i16>().ok()?,
        _ => return are_numbers.then(|| Err(two_digits(text))),
    };
    let (one, other): (i8, i8) = (first.parse().ok()?, second.parse().ok()?);
    let known = match date.contains('.') {
        true => Some(DateOrder::DayFirst),
        false => order.or_else(|| only_order(one.unsigned_abs(), other.unsigned_abs())),
    };
    let (day, month) = match known {
        Some(DateOrder::DayFirst) => (one, other),
        Some(DateOrder::MonthFirst) => (other, one),
        None => {
            return Some(Err(two_orders(text)));
        }
    };
    if month > 12 && (1..=12).contains(&day) && !date.contains('.') {
        let option = if known == Some(DateOrder::DayFirst) { "month-first" } else { "day-first" };
        return Some(Err(format!("`{text}`: there is no month {month}; try --dates {option}")));
    }
    Some(Ok(Date::new(year, month, day).ok()?))
}

/// Returns the month with this name, in English or German: `Jan`, `January`, `Mär`, `Dez`.
fn month_of_name(name: &str) -> Option<i8> {
    const MONTHS: [(&str, i8); 16] = [
        ("jan", 1),
        ("feb", 2),
        ("mar", 3),
        ("mär", 3),
        ("mrz", 3),
        ("apr", 4),
        ("may", 5),
        ("mai", 5),
        ("jun", 6),
        ("jul", 7),
        ("aug", 8),
        ("sep", 9),
        ("oct", 10),
        ("okt", 10),
        ("nov", 11),
        ("de", 12),
    ];
    let name = name.to_lowercase();
    MONTHS.iter().find(|(begin, _)| name.starts_with(begin)).map(|(_, month)| *month)
}

fn two_digits(text: &str) -> String {
    format!(
        "`{text}`: the year has two digits; write four digits. If the year is the last number, --dates day-first or \
         --dates month-first states the order"
    )
}

fn two_orders(text: &str) -> String {
    format!(
        "`{text}`: day and month are ambiguous; write 2026-01-31 12:00:00, or state the order with --dates day-first or \
         --dates month-first"
    )
}

/// Time of day, or time since the start of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Clock {
    hours: u64,
    minutes: u64,
    seconds: Option<u64>,
    nanos: u64,
    /// Whether AM or PM followed the time.
    is_of_half_days: bool,
}

impl Clock {
    /// Parses `6:00`, `06:00:10`, `06:00:10,25`, `06:00:10:250` or `6:00:10 PM`. `None` for any other text.
    fn of(text: &str) -> Option<Clock> {
        let text = text.trim();
        let half =
            [("am", 0), ("a.m.", 0), ("pm", 12), ("p.m.", 12)].into_iter().find_map(|(word, hours)| {
                let split = text.len().checked_sub(word.len())?;
                let is_there = text.get(split..)?.eq_ignore_ascii_case(word);
                is_there.then(|| (text[..split].trim_end(), hours))
            });
        let plain = half.map_or(text, |(plain, _)| plain);
        let (plain, fraction) = plain.split_once(['.', ',']).unwrap_or((plain, ""));
        let number = |part: &str| {
            let is_number = (1..=6).contains(&part.len()) && part.bytes().all(|byte| byte.is_ascii_digit());
            if is_number { part.parse::<u64>().ok() } else { None }
        };
        let parts: Vec<&str> = plain.split(':').collect();
        let (hours, minutes, seconds, millis) = match parts.as_slice() {
            [hours, minutes] => (hours, minutes, None, None),
            [hours, minutes, seconds] => (hours, minutes, Some(number(seconds)?), None),
            [hours, minutes, seconds, millis] if millis.len() == 3 && fraction.is_empty() => {
                (hours, minutes, Some(number(seconds)?), Some(number(millis)?))
            }
            _ => return None,
        };
        let (hours, minutes) = (number(hours)?, number(minutes)?);
        let hours = match half {
            Some(_) if !(1..=12).contains(&hours) => return None,
            Some((_, more)) => hours % 12 + more,
            None => hours,
        };
        let is_fraction = fraction.len() <= 9 && fraction.bytes().all(|byte| byte.is_ascii_digit());
        if minutes > 59 || seconds.is_some_and(|seconds| seconds > 59) || !is_fraction {
            return None;
        }
        let nanos = match millis {
            Some(millis) => millis * 1_000_000,
            None => format!("{fraction:0<9}").parse().ok()?,
        };
        Some(Clock { hours, minutes, seconds, nanos, is_of_half_days: half.is_some() })
    }

    fn nanos(self) -> u64 {
        let seconds = self.minutes * 60 + self.seconds.unwrap_or(0);
        self.hours * HOUR + seconds * 1_000_000_000 + self.nanos
    }

    /// Returns the time as a time of day; `None` if it is 24:00 or later.
    fn of_day(self) -> Option<Time> {
        let small = |number: u64| i8::try_from(number).ok();
        let nanos = i32::try_from(self.nanos).ok()?;
        Time::new(small(self.hours)?, small(self.minutes)?, small(self.seconds.unwrap_or(0))?, nanos).ok()
    }
}

/// Returns the date and time of a count of days, as spreadsheets store them. Returns a message about the cell
/// `text` if `number` is not a count of days from 1970 to 2200.
pub(super) fn excel(number: &str, text: &str) -> Result<DateTime, String> {
    let wrong = || format!("`{text}` is not a date of a spreadsheet; write 2026-01-31 12:00:00");
    let days: f64 = number.parse().map_err(|_| wrong())?;
    // From 1970 to 2200. A spreadsheet keeps fractions of a day to about a hundredth of a millisecond.
    if !(25_569.0..110_000.0).contains(&days) {
        return Err(wrong());
    }
    #[allow(clippy::cast_possible_truncation, reason = "the range was checked")]
    let millis = (days * 86_400_000.0).round() as i64;
    let first = FIRST_OF_EXCEL.to_datetime(Time::midnight());
    first.checked_add(SignedDuration::from_millis(millis)).map_err(|_| wrong())
}

/// State of the reader of a log with wall-clock times.
#[derive(Clone, Debug, Default)]
pub(super) struct Wall {
    /// Number of midnights since the start of the log, for times without dates.
    days: u64,
    /// Last time in the hour that occurs twice at the end of summer time. Set only if the time was taken to be in the
    /// first of the two hours.
    first_pass: Option<DateTime>,
    /// Last date whose month was assumed to come first.
    assumed: Option<Date>,
}

impl Wall {
    /// Returns the moment of a time without a date. A new day begins if the time is more than twelve hours before the
    /// last time.
    pub(super) fn of_day(&mut self, nanos: u64, last: Option<Moment>) -> Result<Moment, String> {
        let at = |days: u64| days.saturating_mul(DAY).saturating_add(nanos);
        if last.is_some_and(|last| last.as_nanos() > at(self.days).saturating_add(DAY / 2)) {
            self.days += 1;
        }
        Ok(Moment::from_nanos(at(self.days)))
    }

    /// Checks a date whose month was assumed to come first. Returns a message if the date is the same day of
    /// another month than the last such date, as in `01/05/2026` and `02/05/2026`. The day then probably
    /// comes first.
    pub(super) fn follows(&mut self, wall: DateTime, text: &str) -> Result<(), String> {
        let date = wall.date();
        let before = *self.assumed.get_or_insert(date);
        let is_next_month = date.day() == before.day() && date != before;
        if is_next_month {
            return Err(two_orders(text));
        }
        self.assumed = Some(date);
        Ok(())
    }

    /// Returns the moment of a date and time in a zone. `last` is the time of the previous row. It decides
    /// which hour is meant if the hour occurs twice, at the end of summer time. Returns a message if there is
    /// no zone, or if the time is before 1970 or does not exist in the zone. Also returns a message if the
    /// clock of the log was perhaps not set back.
    pub(super) fn in_zone(
        &mut self,
        wall: DateTime,
        zone: Option<&TimeZone>,
        last: Option<Moment>,
    ) -> Result<Moment, String> {
        let zone =
            zone.ok_or_else(|| format!("{wall} needs a time zone, for example --zone Europe/Berlin"))?;
        let at = |offset: Offset| {
            let nanos =
                offset.to_timestamp(wall).ok().and_then(|stamp| u64::try_from(stamp.as_nanosecond()).ok());
            nanos.map(Moment::from_nanos).ok_or_else(|| format!("{wall} lies before 1970"))
        };
        match zone.to_ambiguous_timestamp(wall).offset() {
            AmbiguousOffset::Unambiguous { offset } => {
                let before = self.first_pass.take().map(|before| wall.duration_since(before));
                if before.is_some_and(|passed| passed > SignedDuration::ZERO && passed < NEXT_ROW) {
                    return Err(format!(
                        "{wall} is just after the end of summer time, but the log contains the repeated \
                         hour only once. The clock of this log was not set back, or the log begins in \
                         that hour. State the UTC offset of the clock: --zone {offset}:00 for winter time, \
                         or one hour more for summer time"
                    ));
                }
                at(offset)
            }
            AmbiguousOffset::Fold { before, after } => {
                let first = at(before)?;
                if last.is_some_and(|last| last > first) {
                    self.first_pass = None;
                    return at(after);
                }
                self.first_pass = Some(wall);
                Ok(first)
            }
            AmbiguousOffset::Gap { .. } => Err(format!(
                "{wall} does not exist in {}: the clocks of this zone were set forward at that time. Check \
                 the zone of the log. For a clock without summer time, write its offset, for example \
                 --zone +01:00",
                zone.iana_name().unwrap_or("the zone")
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> Option<Result<Read, String>> {
        Some(Ok(Read::Date(text.parse().unwrap())))
    }

    #[test]
    fn dates_and_times_are_read_in_the_formats_of_loggers() {
        let (day, month) = (Some(DateOrder::DayFirst), Some(DateOrder::MonthFirst));
        for (text, order, read_as) in [
            ("05.01.2026 06:00:10", None, "2026-01-05T06:00:10"),
            ("05.01.2026, 06:00:10", None, "2026-01-05T06:00:10"),
            ("2026/01/05 06:00:10", None, "2026-01-05T06:00:10"),
            ("2026-01-05 06:00:10:250", None, "2026-01-05T06:00:10.25"),
            ("2026-01-05 06:00:10,25", None, "2026-01-05T06:00:10.25"),
            ("1/15/2026 6:00:10 AM", None, "2026-01-15T06:00:10"),
            ("15/01/2026 12:00:10 AM", None, "2026-01-15T00:00:10"),
            ("01/05/2026 12:00 pm", month, "2026-01-05T12:00:00"),
            ("01/05/2026 11:59:59 p.m.", day, "2026-05-01T23:59:59"),
            ("31/01/2026 06:00", None, "2026-01-31T06:00:00"),
            ("01/31/2026 06:00", None, "2026-01-31T06:00:00"),
            ("05/01/2026 06:00", day, "2026-01-05T06:00:00"),
            ("05/01/2026 06:00", month, "2026-05-01T06:00:00"),
            ("05-01-2026 06:00", day, "2026-01-05T06:00:00"),
            ("05-Jan-2026 06:00:10", None, "2026-01-05T06:00:10"),
            ("2026-Dez-05 06:00:10", None, "2026-12-05T06:00:10"),
            ("05-OCT-2026 06:00:10", None, "2026-10-05T06:00:10"),
            ("05 Jan 2026 06:00:10,25", None, "2026-01-05T06:00:10.25"),
            ("Jan 5, 2026 6:00:10 PM", None, "2026-01-05T18:00:10"),
            ("2026年1月5日 06:00:10", None, "2026-01-05T06:00:10"),
            ("20260105 06:00:10", None, "2026-01-05T06:00:10"),
            ("05.01.26 06:00:10", day, "2026-01-05T06:00:10"),
            ("05/01/26 06:00", day, "2026-01-05T06:00:00"),
            ("05/01/26 06:00", month, "2026-05-01T06:00:00"),
            ("1/31/26 6:00 AM", month, "2026-01-31T06:00:00"),
            ("05-Jan-26 06:00:10", day, "2026-01-05T06:00:10"),
        ] {
            assert_eq!(read(text, order), at(read_as), "{text}");
        }
        for (text, nanos) in [
            ("00:00:10", 10_000_000_000),
            ("25:00:00.5", 25 * HOUR + 500_000_000),
            ("0 days 00:00:10", 10_000_000_000),
            ("1 days 06:00:00.5", 30 * HOUR + 500_000_000),
            ("1 day, 6:00:00", 30 * HOUR),
        ] {
            assert_eq!(read(text, None), Some(Ok(Read::OfDay(nanos))), "{text}");
        }
        for text in [
            "05.01.2026 25:00:10",
            "31.02.2026 06:00",
            "13/13/2026 06:00",
            "noon",
            "1:2:3:4",
            "2026-01-05",
            "05 Foo 2026 06:00",
            "99999999 06:00",
            "1 days",
            "x days 06:00:00",
        ] {
            assert!(!matches!(read(text, day), Some(Ok(_))), "{text}");
        }
    }

    #[test]
    fn a_time_with_two_readings_is_answered_with_what_to_state() {
        for (text, order, says) in [
            ("01/05/2026 06:00:00", None, "--dates"),
            ("00:30", None, "hours and minutes or minutes and seconds"),
            ("31/01/2026 06:00", Some(DateOrder::MonthFirst), "--dates day-first"),
            ("01/31/2026 06:00", Some(DateOrder::DayFirst), "--dates month-first"),
            ("05.01.26 06:00", None, "four digits"),
            ("05.01.26 06:00", None, "--dates day-first"),
            ("05-Jan-26 06:00", None, "--dates"),
        ] {
            let said = read(text, order).unwrap().unwrap_err();
            assert!(said.contains(says), "{text}: {said}");
        }
        assert_eq!(order("31/01/2026 06:00"), Some(DateOrder::DayFirst));
        assert_eq!(order("01/31/2026 06:00"), Some(DateOrder::MonthFirst));
        assert_eq!(order("01/05/2026 06:00"), None);
    }

    #[test]
    fn two_parts_of_a_time_are_read_in_the_unit_of_their_column() {
        assert_eq!(two_parts("06:30", TimeUnit::Hours), Some(HOUR * 13 / 2));
        assert_eq!(two_parts("06:30", TimeUnit::Minutes), Some(390_000_000_000));
        assert_eq!(two_parts("90:30.5", TimeUnit::Minutes), Some(5_430_500_000_000));
        assert_eq!(two_parts("06:30", TimeUnit::Seconds), None);
        assert_eq!(two_parts("6:30 PM", TimeUnit::Hours), None);
        assert_eq!(two_parts("05.01.2026 06:30", TimeUnit::Hours), None);
    }

    #[test]
    fn dates_and_times_without_separators_are_read() {
        for text in ["20260105T060010", "20260105060010"] {
            assert_eq!(compact(text), Some("2026-01-05T06:00:10".parse().unwrap()), "{text}");
        }
        for text in [
            "20261305T060010",
            "20260105T250010",
            "2026010T0600100",
            "1773036000000",
            "xxxxxxxx060010",
            "年年年年ab",
        ] {
            assert_eq!(compact(text), None, "{text}");
        }
    }

    #[test]
    fn days_of_a_spreadsheet_are_dates() {
        let read = |days: &str| excel(days, days).map(|date| date.to_string());
        assert_eq!(read("46090.25").as_deref(), Ok("2026-03-09T06:00:00"));
        assert_eq!(read("46090.2506944444").as_deref(), Ok("2026-03-09T06:01:00"));
        assert!(read("0.25").is_err() && read("1e9").is_err() && read("x").is_err());
    }

    #[test]
    fn a_clock_that_is_never_set_back_is_recognised_and_midnight_is_passed() {
        let berlin = TimeZone::get("Europe/Berlin").unwrap();
        let follow = |times: &[&str]| -> Result<Vec<Moment>, String> {
            let (mut wall, mut last, mut all) = (Wall::default(), None, Vec::new());
            for time in times {
                let moment = wall.in_zone(time.parse().unwrap(), Some(&berlin), last)?;
                last = Some(moment);
                all.push(moment);
            }
            Ok(all)
        };
        let said = follow(&["2026-10-25T02:50:00", "2026-10-25T03:00:00"]).unwrap_err();
        assert!(said.contains("was not set back") && said.contains("--zone"), "{said}");
        let back = follow(&[
            "2026-10-25T02:50:00",
            "2026-10-25T02:00:00",
            "2026-10-25T02:50:00",
            "2026-10-25T03:00:00",
        ]);
        let back = back.unwrap();
        assert!(back.is_sorted());
        assert_eq!(back[3].since(back[0]), std::time::Duration::from_secs(70 * 60));
        let mut wall = Wall::default();
        let late = wall.of_day(DAY - 1, None).unwrap();
        assert_eq!(wall.of_day(0, Some(late)), Ok(Moment::from_nanos(DAY)));
    }
}
