//! Time column of a log: its name, its unit, and the column with the date if the log has one.

use std::borrow::Cow;
use std::fmt;

use super::cell::name_and_unit;
use super::{Moment, time};

/// Unit of times that a log gives as numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TimeUnit {
    /// Milliseconds since the start of the log or since 1970.
    Milliseconds,
    /// Seconds since the start of the log or since 1970.
    #[default]
    Seconds,
    /// Minutes since the start of the log.
    Minutes,
    /// Hours since the start of the log.
    Hours,
    /// Days since the start of the log.
    Days,
    /// Days as spreadsheets store dates: 46090.25 is 2026-03-09 06:00.
    ExcelDays,
}

impl TimeUnit {
    /// Returns the unit with this name in a header or in a cell.
    pub(super) fn of(name: &str) -> Option<TimeUnit> {
        Some(match name.to_ascii_lowercase().as_str() {
            "ms" | "msec" | "millisecond" | "milliseconds" | "millisekunden" | "мс" => {
                TimeUnit::Milliseconds
            }
            "s" | "sec" | "secs" | "second" | "seconds" | "sek" | "sekunden" | "с" | "сек" | "秒" => {
                TimeUnit::Seconds
            }
            "min" | "mins" | "minute" | "minutes" | "minuten" | "мин" | "分" => TimeUnit::Minutes,
            "h" | "hr" | "hrs" | "hour" | "hours" | "std" | "stunden" | "ч" => TimeUnit::Hours,
            "d" | "day" | "days" | "tage" => TimeUnit::Days,
            _ => return None,
        })
    }

    /// Returns the name of the unit if a column with this unit cannot contain dates; else `None`.
    pub(super) fn of_a_count(self) -> Option<&'static str> {
        match self {
            TimeUnit::Milliseconds | TimeUnit::Minutes | TimeUnit::Hours | TimeUnit::Days => {
                Some(self.name())
            }
            TimeUnit::Seconds | TimeUnit::ExcelDays => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            TimeUnit::Milliseconds => "milliseconds",
            TimeUnit::Seconds => "seconds",
            TimeUnit::Minutes => "minutes",
            TimeUnit::Hours => "hours",
            TimeUnit::Days => "days",
            TimeUnit::ExcelDays => "days of a spreadsheet",
        }
    }

    /// Parses a number in this unit, exact to the nanosecond. A number of seconds that is too large for any date is read
    /// as milliseconds, microseconds or nanoseconds since 1970.
    pub(super) fn moment(self, number: &str) -> Result<Moment, String> {
        let factor = match self {
            TimeUnit::Seconds => return seconds(number),
            TimeUnit::Milliseconds => return time::parse_scaled(number, -3),
            TimeUnit::Minutes => 60,
            TimeUnit::Hours => 3600,
            TimeUnit::Days | TimeUnit::ExcelDays => 86_400,
        };
        let nanos = time::parse(number)?.as_nanos().checked_mul(factor);
        nanos.map(Moment::from_nanos).ok_or_else(|| format!("`{number}` {self} is too large"))
    }
}

impl fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Smallest number that is not read as seconds since 1970, because the date would be after the year 5000.
const NO_SECONDS: f64 = 1e11;

fn seconds(number: &str) -> Result<Moment, String> {
    let power = match number.parse::<f64>() {
        Ok(value) if value >= NO_SECONDS * 1e6 => -9,
        Ok(value) if value >= NO_SECONDS * 1e3 => -6,
        Ok(value) if value >= NO_SECONDS => -3,
        _ => return time::parse(number),
    };
    time::parse_scaled(number, power)
}

/// Columns of a log that contain the time of each row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeColumns {
    /// Index of the column with the time.
    pub time: usize,
    /// Index of the column with the dates, if the times have no date; else `None`.
    pub date: Option<usize>,
    /// Unit of the times, if they are numbers.
    pub unit: TimeUnit,
    /// Whether the name of the column or the operator states the unit of the times. Otherwise, the unit is assumed.
    pub is_stated: bool,
    /// Whether the name of the column states that its times are in UTC.
    pub is_in_utc: bool,
}

/// Names of a time column, besides `time`, `time_s` and `time_min`. The most certain names come first.
const NAMES: [&[&str]; 4] = [
    &[
        "time",
        "_time",
        "zeit",
        "heure",
        "hora",
        "tijd",
        "czas",
        "čas",
        "tid",
        "время",
        "час",
        "时间",
        "時間",
        "日時",
        "時刻",
        "시간",
    ],
    &[
        "timestamp",
        "time stamp",
        "time_stamp",
        "zeitstempel",
        "zeitpunkt",
        "datetime",
        "date time",
        "date_time",
        "date-time",
        "date/time",
        "date & time",
        "date&time",
        "date and time",
        "fecha y hora",
        "fecha/hora",
        "date et heure",
        "date/heure",
        "data e ora",
        "data/ora",
        "data e hora",
        "data/hora",
        "дата и время",
        "дата/время",
        "дата время",
        "метка времени",
        "datum en tijd",
        "datum/tijd",
        "日期时间",
        "日期 时间",
        "采集时间",
        "记录时间",
        "日付 時間",
        "日付 時刻",
        "日付時刻",
        "messzeit",
        "messzeitpunkt",
        "local time",
        "log time",
        "created_at",
        "horodatage",
        "datum & uhrzeit",
        "datum&uhrzeit",
        "datum/uhrzeit",
        "datum / uhrzeit",
        "datum uhrzeit",
        "datum und uhrzeit",
        "datum/zeit",
        "datum zeit",
        "uhrzeit",
        "elapsed",
        "elapsed time",
        "elapsed_time",
        "time elapsed",
        "tmstamp",
        "x_value",
        "__index_level_0__",
    ],
    &["t"],
    &DATES,
];
/// Names of a date column. If a log has no other time column, this column also contains the times.
const DATES: [&str; 7] = ["date", "datum", "fecha", "дата", "日期", "日付", "날짜"];

/// Parts of the names of time columns. In such a column, numbers that are dates of this century in the form
/// of a spreadsheet are read as dates.
const NAMED_FOR_DATES: [&str; 2] = ["dat", "stamp"];

impl TimeColumns {
    /// Finds the time column by its name; `None` if no column has the name of a time column. `stated` is the unit that
    /// the operator has stated.
    #[must_use]
    pub fn find(names: &[String], stated: Option<TimeUnit>) -> Option<TimeColumns> {
        let exact = |name: &String| match name.as_str() {
            "time" | "time_s" => Some(TimeUnit::Seconds),
            "time_ms" => Some(TimeUnit::Milliseconds),
            "time_min" => Some(TimeUnit::Minutes),
            "time_h" => Some(TimeUnit::Hours),
            _ => None,
        };
        let exact = names.iter().enumerate().find_map(|(place, name)| Some((place, exact(name)?)));
        let exact = exact.map(|(place, unit)| (place, Stated::Unit(unit)));
        let (time, stated_by_name) =
            exact.or_else(|| NAMES.iter().find_map(|known| by_name(names, known)))?;
        let dates = |(place, name): (usize, &String)| {
            let name = name.trim().to_lowercase();
            let is_date = time_name(&name).is_some_and(|(name, _)| DATES.contains(&name));
            (is_date && place != time).then_some(place)
        };
        let date = names.iter().enumerate().find_map(dates);
        let unit = match stated_by_name {
            Stated::Unit(unit) => unit,
            Stated::Nothing | Stated::Utc => TimeUnit::Seconds,
        };
        let is_in_utc = stated_by_name == Stated::Utc;
        let is_stated =
            stated.is_some() || (names[time] != "time" && matches!(stated_by_name, Stated::Unit(_)));
        Some(TimeColumns { time, date, unit: stated.unwrap_or(unit), is_stated, is_in_utc })
    }

    /// Returns the unit of the numbers in the time column. `first` is the first of these numbers. Under a
    /// name such as `Datum` or `timestamp`, numbers are days of a spreadsheet if these days are in this
    /// century.
    #[must_use]
    pub fn unit_of(&self, name: &str, first: &str) -> TimeUnit {
        let is_dated = NAMED_FOR_DATES.iter().any(|word| name.to_lowercase().contains(word));
        let is_day = || {
            first.trim().replace(',', ".").parse().is_ok_and(|day: f64| (36_526.0..73_051.0).contains(&day))
        };
        if self.unit == TimeUnit::Seconds && is_dated && is_day() { TimeUnit::ExcelDays } else { self.unit }
    }
}

/// Returns the time of a row, with the date of another column if the time is a time of day without a date.
#[must_use]
pub fn with_date<'a>(time: &'a str, date: Option<&str>) -> Cow<'a, str> {
    let time = time.trim();
    let is_of_day = |time: &str| {
        let hours = time.split_once(':').map(|(hours, _)| hours);
        hours.is_some_and(|hours| !hours.is_empty() && hours.bytes().all(|byte| byte.is_ascii_digit()))
    };
    match date.and_then(|date| date.split_whitespace().next()).filter(|_| is_of_day(time)) {
        Some(date) => Cow::Owned(format!("{date} {time}")),
        None => Cow::Borrowed(time),
    }
}

/// Meaning of the text after the name of a time column: no statement, the unit of the times, or that the
/// times are in UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stated {
    Nothing,
    Unit(TimeUnit),
    Utc,
}

/// Returns the index of the first column with one of these names, and the meaning of the text after the name.
/// A unit may follow the name. The name `t` requires a unit in brackets.
fn by_name(names: &[String], known: &[&str]) -> Option<(usize, Stated)> {
    names.iter().enumerate().find_map(|(place, header)| {
        let header = header.trim().to_lowercase();
        let (name, stated) = time_name(&header)?;
        // `t_min` is the smallest temperature.
        let needs_unit = known == NAMES[2] && (stated == Stated::Nothing || header.contains('_'));
        (known.contains(&name) && !needs_unit).then_some((place, stated))
    })
}

/// Separates the name of a time column, in lower case, from the statement after it: `zeit [min]`, `time
/// (sec)`, `timestamp_ms`, `time (utc)`, `date (dd/mm/yyyy)`. `None` if the text after the name is another
/// unit.
fn time_name(header: &str) -> Option<(&str, Stated)> {
    if let (name, Some(unit)) = name_and_unit(header) {
        return Some((name, Stated::Unit(TimeUnit::of(unit)?)));
    }
    let mut brackets = [('[', ']'), ('(', ')')].into_iter();
    let enclosed = brackets.find_map(|(open, close)| header.strip_suffix(close)?.rsplit_once(open));
    if let Some((name, text)) = enclosed {
        return Some((name.trim(), statement(text.trim())?));
    }
    let mut open = [" in ", " ", "_"].into_iter().filter_map(|between| header.rsplit_once(between));
    let stated = open.find_map(|(name, text)| Some((name.trim(), statement(text)?)));
    Some(stated.unwrap_or((header, Stated::Nothing)))
}

/// Returns the meaning of a text after the name of a time column; `None` if the text is unknown.
fn statement(text: &str) -> Option<Stated> {
    let is_format = ["hh:mm", "h:mm", "yyyy", "jjjj", "mm:ss"].iter().any(|part| text.contains(part));
    match text {
        "utc" | "gmt" | "utc+0" | "utc+00:00" => Some(Stated::Utc),
        _ if is_format => Some(Stated::Nothing),
        _ => TimeUnit::of(text).map(Stated::Unit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(header: &str) -> Option<(usize, Option<usize>, TimeUnit)> {
        let names: Vec<String> = header.split(';').map(str::to_owned).collect();
        TimeColumns::find(&names, None).map(|found| (found.time, found.date, found.unit))
    }

    #[test]
    fn the_time_column_is_found_by_the_names_of_loggers() {
        use TimeUnit::{Hours, Milliseconds, Minutes, Seconds};
        for (header, columns) in [
            ("time;bed", (0, None, Seconds)),
            ("time_min;bed", (0, None, Minutes)),
            ("timestamp;time;bed", (1, None, Seconds)),
            ("No.;Time;bed", (1, None, Seconds)),
            ("Zeit;bed", (0, None, Seconds)),
            ("Zeit [min];bed", (0, None, Minutes)),
            ("Time (h);bed", (0, None, Hours)),
            ("t in ms;bed", (0, None, Milliseconds)),
            ("Date;Time;bed", (1, Some(0), Seconds)),
            ("bed;Datum;Uhrzeit", (2, Some(1), Seconds)),
            ("Datum & Uhrzeit;bed", (0, None, Seconds)),
            ("Дата;Время;Станина", (1, Some(0), Seconds)),
            ("Время [мин];Станина", (0, None, Minutes)),
            ("Zeitstempel;bed", (0, None, Seconds)),
            ("bed;Datum", (1, None, Seconds)),
            ("Elapsed Time (sec);bed", (0, None, Seconds)),
            ("timestamp_ms;bed", (0, None, Milliseconds)),
            ("Zeit in Minuten;bed", (0, None, Minutes)),
            ("Date (dd/mm/yyyy);Time (hh:mm:ss);bed", (1, Some(0), Seconds)),
            ("番号;日付 時間;ms;bed", (1, None, Seconds)),
            ("result;table;_start;_stop;_time;_value", (4, None, Seconds)),
        ] {
            assert_eq!(found(header), Some(columns), "{header}");
        }
        for header in
            ["when;bed", "t;bed", "t_min;bed", "air time [°C];bed", "Time [°C];bed", "Time (ticks);bed"]
        {
            assert_eq!(found(header), None, "{header}");
        }
        let stated = |name: &str, unit| {
            TimeColumns::find(&[name.to_owned()], unit).is_some_and(|found| found.is_stated)
        };
        for (name, is_stated) in
            [("time", false), ("Zeit", false), ("timestamp utc", false), ("time_s", true), ("t [s]", true)]
        {
            assert_eq!(stated(name, None), is_stated, "{name}");
            assert!(stated(name, Some(Seconds)), "{name}");
        }
        let zones = ["Time (UTC)", "time", "timestamp utc"]
            .map(|name| TimeColumns::find(&[name.to_owned()], None).is_some_and(|found| found.is_in_utc));
        assert_eq!(zones, [true, false, true]);
    }

    #[test]
    fn numbers_are_times_in_their_unit_and_stamps_since_1970_in_theirs() {
        let seconds = |moment: Result<Moment, String>| moment.unwrap().as_nanos();
        for (unit, text, nanos) in [
            (TimeUnit::Seconds, "1.5", 1_500_000_000),
            (TimeUnit::Milliseconds, "1500", 1_500_000_000),
            (TimeUnit::Minutes, "0.5", 30_000_000_000),
            (TimeUnit::Hours, "0.2", 720_000_000_000),
            (TimeUnit::Days, "1", 86_400_000_000_000),
            (TimeUnit::Seconds, "1773036000", 1_773_036_000_000_000_000),
            (TimeUnit::Seconds, "1773036000000", 1_773_036_000_000_000_000),
            (TimeUnit::Seconds, "1773036000000000", 1_773_036_000_000_000_000),
            (TimeUnit::Seconds, "1773036000000000000", 1_773_036_000_000_000_000),
        ] {
            assert_eq!(seconds(unit.moment(text)), nanos, "{text} {unit}");
        }
        assert!(TimeUnit::Minutes.moment("1e12").is_err());
    }

    #[test]
    fn a_time_of_day_takes_the_date_of_its_own_column() {
        for (time, date, whole) in [
            ("06:00:10", Some("05.01.2026"), "05.01.2026 06:00:10"),
            ("6:00 AM", Some("1/5/2026 00:00:00"), "1/5/2026 6:00 AM"),
            ("05.01.2026 06:00:10", Some("05.01.2026"), "05.01.2026 06:00:10"),
            ("12.5", Some("05.01.2026"), "12.5"),
            ("06:00:10", Some(" "), "06:00:10"),
            ("06:00:10", None, "06:00:10"),
        ] {
            assert_eq!(with_date(time, date), whole, "{time}");
        }
    }

    #[test]
    fn days_of_a_spreadsheet_are_recognised_only_under_a_name_of_dates() {
        let columns =
            TimeColumns { time: 0, date: None, unit: TimeUnit::Seconds, is_stated: false, is_in_utc: false };
        assert_eq!(columns.unit_of("Datum", "46090.25"), TimeUnit::ExcelDays);
        assert_eq!(columns.unit_of("timestamp", "46090,25"), TimeUnit::ExcelDays);
        assert_eq!(columns.unit_of("time", "46090.25"), TimeUnit::Seconds);
        assert_eq!(columns.unit_of("timestamp", "1773036000"), TimeUnit::Seconds);
    }
}
