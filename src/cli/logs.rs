//! Options that say how a log is read: time zone, decimal mark, order of dates, and unit of times.

use clap::builder::TypedValueParser;
use jiff::tz::TimeZone;

use super::values::one_of;
use isotherm_core::quantity::{DateOrder, DecimalMark, TimeUnit};

/// Properties of logs that the log files possibly do not state.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct LogFormat {
    /// Time zone for times without one, such as 05.01.2026 06:00:10. Write Europe/Berlin, UTC, or +01:00 for a clock
    /// without daylight saving time [default: this computer's]
    #[arg(long, value_name = "ZONE", value_parser = zone)]
    zone: Option<TimeZone>,
    /// Decimal mark of the numbers in CSV logs [default: detected from the numbers]
    #[arg(long, value_name = "MARK", value_parser = marks())]
    pub(super) decimal: Option<DecimalMark>,
    /// Order of day and month in dates such as 01/05/2026 [default: detected from the dates]
    #[arg(long, value_name = "ORDER", value_parser = orders())]
    pub(super) dates: Option<DateOrder>,
    /// Unit of times that are numbers [default: the unit in the name of the column, else seconds]
    #[arg(long, value_name = "UNIT", value_parser = time_units())]
    pub(super) time_unit: Option<TimeUnit>,
}

impl LogFormat {
    pub(super) fn zone(&self) -> TimeZone {
        self.zone.clone().unwrap_or_else(TimeZone::system)
    }
}

fn marks() -> impl TypedValueParser<Value = DecimalMark> {
    one_of([
        (DecimalMark::Point, "point", "12.5; commas separate thousands"),
        (DecimalMark::Comma, "comma", "12,5; points separate thousands"),
    ])
}

fn orders() -> impl TypedValueParser<Value = DateOrder> {
    one_of([
        (DateOrder::DayFirst, "day-first", "31/01/2026"),
        (DateOrder::MonthFirst, "month-first", "01/31/2026"),
    ])
}

fn time_units() -> impl TypedValueParser<Value = TimeUnit> {
    one_of([
        (TimeUnit::Milliseconds, "ms", "Milliseconds"),
        (TimeUnit::Seconds, "s", "Seconds"),
        (TimeUnit::Minutes, "min", "Minutes"),
        (TimeUnit::Hours, "h", "Hours"),
        (TimeUnit::Days, "d", "Days since the start of the log"),
        (TimeUnit::ExcelDays, "excel", "Days as spreadsheets store dates: 46090.25 is 2026-03-09 06:00"),
    ])
}

/// Returns whether a time zone is ambiguous: a name and a number, such as `UTC+1`. In POSIX, `UTC+1` is one hour west
/// of UTC, but most people mean one hour east.
fn has_two_readings(text: &str) -> bool {
    text.find(['+', '-']).is_some_and(|at| {
        let (name, offset) = (&text[..at], &text[at + 1..]);
        let is_word = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphabetic());
        is_word && offset.starts_with(|first: char| first.is_ascii_digit())
    })
}

fn zone(text: &str) -> Result<TimeZone, String> {
    if has_two_readings(text) {
        let meaning = "can mean a zone ahead of UTC or behind UTC";
        return Err(format!("`{text}` {meaning}; write a zone as Europe/Berlin, UTC or +01:00"));
    }
    let parser = jiff::fmt::temporal::DateTimeParser::new();
    parser.parse_time_zone(text).map_err(|_| {
        let known: Vec<String> = jiff::tz::db().available().map(|name| name.as_str().to_owned()).collect();
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        let meant = isotherm_profile::nearest(text, &known);
        let meant = meant.map(|name| format!("did you mean {name}? ")).unwrap_or_default();
        format!("{meant}write a zone as Europe/Berlin, UTC or +01:00")
    })
}
