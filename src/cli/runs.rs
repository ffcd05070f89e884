//! The logs of verbs that learn from them, and how they become runs.

use std::path::PathBuf;
use std::time::Duration;

use super::logs::LogZone;
use super::progress::Progress;
use isotherm_identify::dataset::{BadLog, Dataset, Split, Units, Uses};

/// How logs become runs.
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

impl Runs {
    /// Reads of the logs what is used. What a gauge showed becomes the column `error`.
    pub(super) fn read(
        &self,
        logs: &[PathBuf],
        error: &str,
        units: Units<'_>,
        uses: Uses<'_>,
    ) -> Result<Dataset, BadLog> {
        let _reading = Progress::begin("reading the logs");
        let zone = Some(self.zone.of_the_log());
        let split = Split { column: self.run_column.clone(), gap: self.gap, zone };
        let mut dataset = Dataset::read(logs, &split, units, uses)?;
        if let Some(gauge) = &self.gauge {
            dataset.add_gauge(gauge, (error, self.within), split.zone)?;
        }
        Ok(dataset)
    }
}
