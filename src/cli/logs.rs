//! Time zone for times in a log that have none.

use jiff::tz::TimeZone;

/// Time zone for times that have none.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct LogZone {
    /// Time zone for times without one, such as 05.01.2026 06:00:10. Write Europe/Berlin, UTC, or +01:00 for a clock
    /// without daylight saving time [default: this computer's]
    #[arg(long, value_name = "ZONE", value_parser = zone)]
    zone: Option<TimeZone>,
}

impl LogZone {
    pub(super) fn of_the_log(&self) -> TimeZone {
        self.zone.clone().unwrap_or_else(TimeZone::system)
    }
}

fn zone(text: &str) -> Result<TimeZone, String> {
    let parser = jiff::fmt::temporal::DateTimeParser::new();
    parser.parse_time_zone(text).map_err(|_| {
        let known: Vec<String> = jiff::tz::db().available().map(|name| name.as_str().to_owned()).collect();
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        let meant = isotherm_profile::nearest(text, &known);
        let meant = meant.map(|name| format!("did you mean {name}? ")).unwrap_or_default();
        format!("{meant}write a zone as Europe/Berlin, UTC or +01:00")
    })
}
