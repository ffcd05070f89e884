//! Form of the times in a file.

/// Form of the times in a file.
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
    /// Time stamps by the wall clock of the time zone.
    WallStamps,
    /// Times of day without a date.
    TimesOfDay,
}

impl TimeForm {
    /// Returns whether this time is a number or a text.
    pub(super) fn of(time: &str) -> TimeForm {
        match time.trim().replace(',', ".").parse::<f64>() {
            Ok(_) => TimeForm::Numbers,
            Err(_) => TimeForm::Texts,
        }
    }
}
