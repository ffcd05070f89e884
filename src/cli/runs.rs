//! Logs for the verbs `identify`, `select` and `report`, and their division into runs.

use std::path::PathBuf;
use std::time::Duration;

use super::logs::LogFormat;
use super::progress::Progress;
use isotherm_identify::dataset::{BadLog, Dataset, Split, Units, Uses};

/// Options that divide logs into runs.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct Runs {
    /// A new run begins at each row where this column changes
    #[arg(long, value_name = "COLUMN")]
    run_column: Option<String>,
    /// A new run begins after a time gap of at least this length between two rows
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    gap: Option<Duration>,
    #[command(flatten)]
    format: LogFormat,
    /// Readings of a dial gauge, as a file with the columns time and error in µm (or error_mm). Each reading is added
    /// to the log row that is nearest in time
    #[arg(long, value_name = "FILE")]
    gauge: Option<PathBuf>,
    /// Largest time difference between a reading of the gauge and its log row
    #[arg(long, value_name = "TIME", default_value = "30s", value_parser = humantime::parse_duration, requires = "gauge")]
    within: Duration,
}

impl Runs {
    /// Reads from the logs the columns that the verb uses. Readings of a dial gauge become the column `error`.
    /// `displacements` are further columns in µm.
    pub(super) fn read(
        &self,
        logs: &[PathBuf],
        (error, displacements): (&str, &[String]),
        units: Units<'_>,
        uses: Uses<'_>,
    ) -> Result<Dataset, BadLog> {
        let _reading = Progress::begin("reading the logs");
        let LogFormat { decimal, dates, time_unit, .. } = self.format;
        let split = Split {
            column: self.run_column.clone(),
            gap: self.gap,
            zone: Some(self.format.zone()),
            decimal,
            dates,
            time_unit,
            displacements: displacements.iter().cloned().chain([error.to_owned()]).collect(),
        };
        let mut dataset = Dataset::read(logs, &split, units, uses)?;
        if let Some(gauge) = &self.gauge {
            dataset.add_gauge(gauge, (error, self.within), &split)?;
        }
        Ok(dataset)
    }
}
