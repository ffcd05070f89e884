//! Logs for the verbs `identify`, `select` and `report`, and their division into runs.

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::TypedValueParser;

use super::identify::one_of;
use super::logs::LogZone;
use super::progress::Progress;
use isotherm_core::quantity::{DateOrder, DecimalMark, TimeUnit};
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
    zone: LogZone,
    /// Decimal mark of the numbers in CSV logs [default: the one that the numbers show]
    #[arg(long, value_name = "MARK", value_parser = marks())]
    decimal: Option<DecimalMark>,
    /// Order of day and month in dates such as 01/05/2026 [default: the one that the dates show]
    #[arg(long, value_name = "ORDER", value_parser = orders())]
    dates: Option<DateOrder>,
    /// Unit of times that are numbers [default: the one in the name of the column, else seconds]
    #[arg(long, value_name = "UNIT", value_parser = time_units())]
    time_unit: Option<TimeUnit>,
    /// Readings of a dial gauge, as a file with the columns time and error in µm (or error_mm). Each reading is added
    /// to the log row that is nearest in time
    #[arg(long, value_name = "FILE")]
    gauge: Option<PathBuf>,
    /// Largest time difference between a reading of the gauge and its log row
    #[arg(long, value_name = "TIME", default_value = "30s", value_parser = humantime::parse_duration, requires = "gauge")]
    within: Duration,
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

impl Runs {
    /// Reads the columns of the logs that are used. Readings of a dial gauge become the column `error`.
    pub(super) fn read(
        &self,
        logs: &[PathBuf],
        error: &str,
        units: Units<'_>,
        uses: Uses<'_>,
    ) -> Result<Dataset, BadLog> {
        let _reading = Progress::begin("reading the logs");
        let zone = Some(self.zone.of_the_log());
        let split = Split {
            column: self.run_column.clone(),
            gap: self.gap,
            zone,
            decimal: self.decimal,
            dates: self.dates,
            time_unit: self.time_unit,
        };
        let mut dataset = Dataset::read(logs, &split, units, uses)?;
        if let Some(gauge) = &self.gauge {
            dataset.add_gauge(gauge, (error, self.within), &split)?;
        }
        Ok(dataset)
    }
}
