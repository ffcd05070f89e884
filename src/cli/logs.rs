//! The logs of verbs that learn from them: which ones, how they become runs, and whose clock their times are of.

use std::path::PathBuf;
use std::time::Duration;

use jiff::tz::TimeZone;

#[cfg(feature = "identify")]
use isotherm_identify::dataset::{BadLog, Dataset, Split, Units};

/// The zone of times without one.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct LogZone {
    /// The zone of times that have none, as 05.01.2026 06:00:10: a name as Europe/Berlin, UTC, or +01:00 for a clock that is
    /// never put forward [default: this computer's]
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

/// How logs become runs.
#[cfg(feature = "identify")]
#[derive(clap::Args, Clone, Debug)]
pub(super) struct Runs {
    /// A new run begins where this column changes
    #[arg(long, value_name = "COLUMN")]
    run_column: Option<String>,
    /// A new run begins after so long without a row
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    gap: Option<Duration>,
    #[command(flatten)]
    zone: LogZone,
    /// What a dial gauge showed, as a small file with the columns time and error in µm (or error_mm): each reading is put into
    /// the row of the logs that is nearest in time
    #[arg(long, value_name = "FILE")]
    gauge: Option<PathBuf>,
    /// How far that row may be away
    #[arg(long, value_name = "TIME", default_value = "30s", value_parser = humantime::parse_duration, requires = "gauge")]
    within: Duration,
}

#[cfg(feature = "identify")]
impl Runs {
    /// Reads the logs. What a gauge showed becomes the column `error`.
    pub(super) fn read(&self, logs: &[PathBuf], error: &str, units: Units<'_>) -> Result<Dataset, BadLog> {
        let zone = Some(self.zone.of_the_log());
        let split = Split { column: self.run_column.clone(), gap: self.gap, zone };
        let mut dataset = Dataset::read(logs, &split, units)?;
        if let Some(gauge) = &self.gauge {
            dataset.add_gauge(gauge, (error, self.within), split.zone)?;
        }
        Ok(dataset)
    }
}
