//! Format of the times in a log file.

/// Format of the times in a log file: numbers, texts or time stamps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(not(feature = "parquet"), allow(dead_code, reason = "only Parquet declares its times"))]
pub(super) enum TimeForm {
    /// Times as numbers, for example seconds.
    #[default]
    Numbers,
    /// Texts with a date or a time of day.
    Texts,
    /// Time stamps in UTC.
    StampsInUtc,
    /// Time stamps in local wall-clock time.
    WallStamps,
    /// Times of day without a date.
    TimesOfDay,
}

impl TimeForm {
    /// Returns the format of this time: number or text.
    pub(super) fn of(time: &str) -> TimeForm {
        match time.trim().replace(',', ".").parse::<f64>() {
            Ok(_) => TimeForm::Numbers,
            Err(_) => TimeForm::Texts,
        }
    }
}
