//! Reports of measured errors from other programs, and the detection of repeated reports.
//!
//! A broker may deliver a message more than once, and a sender repeats a message if it gets no answer. Two reports that
//! agree count as two measurements. Therefore a repetition must be recognised:
//!
//! | the report has | it repeats an earlier report if |
//! |---|---|
//! | `id` | the id is the same |
//! | `time` | time and error are the same |
//! | neither | the broker marks it as delivered again, or the same error arrived less than 10 s ago |
//!
//! A measurement from before the datum (last zero point of Cz) of the axis is rejected, because Cz is measured from
//! that datum. A measurement with a time in the future is rejected too.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted, shifted, time};

/// Number of reports that are stored for each axis: two and a half days with one report in each hour.
const KEPT: usize = 64;
/// Time within which an equal error counts as the same measurement, if the new report has neither `id` nor `time`.
const REPEATED_WITHIN: Duration = Duration::from_secs(10);
/// Largest accepted time by which the clock of a sender is ahead of this computer's clock.
const AHEAD: Duration = Duration::from_secs(10);
/// Difference below which two errors count as equal, µm. One of the errors may have been rounded to a float of 32 bits.
const EQUAL_WITHIN: f64 = 1e-4;
/// Maximum length of an `id`, in ASCII characters.
const LONGEST_ID: usize = 64;

/// Measured error of an axis as a sender reports it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredReport {
    /// Measured error: actual minus commanded position while the compensation acts, µm.
    pub error_um: f64,
    /// Wall-clock time of the measurement; `None` if the report states no time.
    pub time: Option<Moment>,
    /// Name that the sender has given to this measurement; `None` if the report states no name.
    pub id: Option<String>,
    /// Whether the MQTT broker has marked this report as delivered a second time.
    pub redelivered: bool,
}

impl MeasuredReport {
    /// Creates a report with the `time` and the `id` of the measurement as text.
    ///
    /// # Errors
    /// Returns a message that says how to write `time` or `id`. The message contains no text from the report.
    pub fn new(error_um: f64, time: Option<&str>, id: Option<&str>) -> Result<MeasuredReport, String> {
        let time = time.map(MeasuredReport::time).transpose()?;
        let id = id.map(MeasuredReport::id).transpose()?;
        Ok(MeasuredReport { error_um, time, id, redelivered: false })
    }

    /// Parses the `time` of a report.
    ///
    /// # Errors
    /// Returns a message that says how to write a `time`.
    pub fn time(text: &str) -> Result<Moment, String> {
        let hint = "write `time` as 2026-01-31T12:00:00Z, with Z or the offset from UTC at its end";
        time::parse(text).map_err(|_| hint.to_owned())
    }

    /// Parses the `id` of a report.
    ///
    /// # Errors
    /// Returns a message that says how to write an `id`.
    pub fn id(text: &str) -> Result<String, String> {
        let is_fit =
            (1..=LONGEST_ID).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic());
        let hint =
            || format!("write `id` as 1 to {LONGEST_ID} letters, digits and signs of ASCII, without a space");
        if is_fit { Ok(text.to_owned()) } else { Err(hint()) }
    }

    /// Returns whether the report has a `time` or an `id`.
    pub fn is_identified(&self) -> bool {
        self.time.is_some() || self.id.is_some()
    }
}

/// Creates a report of an error in µm, without `time` and `id`.
impl From<f64> for MeasuredReport {
    fn from(error_um: f64) -> MeasuredReport {
        MeasuredReport { error_um, ..MeasuredReport::default() }
    }
}

impl fmt::Display for MeasuredReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} µm", self.error_um)?;
        self.time.iter().try_for_each(|time| write!(f, ", time {time}"))?;
        self.id.iter().try_for_each(|id| write!(f, ", id {id}"))
    }
}

/// Reason why a report is rejected before its error is judged. All times are wall-clock times.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rejected {
    /// A report with this `id` was used before.
    SameId(String),
    /// A report with this `time` and the same error was used before.
    SameTime(Moment),
    /// The broker has delivered the report again, and it has neither `time` nor `id`.
    Redelivered,
    /// An equal error arrived this short time ago, and the report has neither `time` nor `id`.
    SameError(Duration),
    /// The report is older than all stored reports, so it may have been used before.
    Forgotten(Moment),
    /// The report was measured before the datum (last zero point of Cz) of the axis.
    BeforeDatum {
        /// Wall-clock time of the measurement, from the field `time` of the report.
        time: Moment,
        /// Time at which the datum was captured.
        datum: Moment,
    },
    /// The `time` of the report is in the future.
    Ahead {
        /// Wall-clock time of the measurement, from the field `time` of the report.
        time: Moment,
        /// Wall-clock time at which the report arrived.
        now: Moment,
    },
}

impl fmt::Display for Rejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Rejected::SameId(id) => {
                write!(
                    f,
                    "the measurement with the id {id} was accepted before; give each measurement a \
                     different id"
                )
            }
            Rejected::SameTime(time) => {
                write!(f, "the measurement of {time} was accepted before with the same error; measure again")
            }
            Rejected::Redelivered => f.write_str(
                "the broker has delivered this message again, and the message does not identify its \
                 measurement; send a `time` or an `id` with each measurement",
            ),
            Rejected::SameError(ago) => write!(
                f,
                "the same error arrived {:.1} s ago, so this report is ignored; send a `time` or an `id` \
                 with each measurement, or wait {} s",
                ago.as_secs_f64(),
                REPEATED_WITHIN.as_secs()
            ),
            Rejected::Forgotten(time) => write!(
                f,
                "the measurement of {time} may have been accepted before: {KEPT} other measurements were accepted after \
                 it; measure again"
            ),
            Rejected::BeforeDatum { time, datum } => write!(
                f,
                "the measurement of {time} is older than the datum (zero point) of {datum}; measure again"
            ),
            Rejected::Ahead { time, now } => write!(
                f,
                "the `time` {time} of the measurement is in the future. The clock of this computer shows \
                 {now}. Set the clock that is wrong, or leave `time` out"
            ),
        }
    }
}

/// Report that was used, stored to recognise a repetition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TakenReport {
    /// Time of the report's last arrival, by the monotonic time of the gateway.
    at: Moment,
    error_um: f64,
    /// Time of the measurement by the sender's clock. A correction of this computer's clock does not change it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<Moment>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    id: Option<String>,
}

shifted!(TakenReport: at);

/// Reports that were used last, in the order of their last arrival, oldest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct TakenReports(Vec<TakenReport>);

impl Shifted for TakenReports {
    fn shift(&mut self, by: Shift) {
        self.0.shift(by);
    }
}

impl TakenReports {
    /// Removes the oldest reports if there are more than [`KEPT`].
    pub(super) fn newest(mut self) -> TakenReports {
        let forgotten = self.0.len().saturating_sub(KEPT);
        self.0.drain(..forgotten);
        self
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Checks whether a report that arrives at `now` is a new measurement since the zero point `datum`. `shift`
    /// converts a [`Moment`] to wall-clock time. The arrival of a repeated report is stored, so that any number of
    /// repetitions is rejected.
    ///
    /// # Errors
    /// Returns why the report is rejected.
    pub(in crate::compensation) fn check(
        &mut self,
        report: &MeasuredReport,
        (now, shift): (Moment, Shift),
        datum: Option<Moment>,
    ) -> Result<(), Rejected> {
        if let Some(place) = self.0.iter().rposition(|taken| taken.is_same(report, now)) {
            let mut taken = self.0.remove(place);
            let ago = now.since(taken.at);
            taken.at = now;
            self.0.push(taken);
            return Err(match (&report.id, report.time) {
                (Some(id), _) if self.0.last().is_some_and(|taken| taken.id.as_ref() == Some(id)) => {
                    Rejected::SameId(id.clone())
                }
                (_, Some(time)) => Rejected::SameTime(time),
                _ => Rejected::SameError(ago),
            });
        }
        let Some(time) = report.time else {
            let is_doubtful = report.redelivered && !report.is_identified();
            return if is_doubtful { Err(Rejected::Redelivered) } else { Ok(()) };
        };
        let (today, datum) = (now.shifted(shift), datum.map(|datum| datum.shifted(shift)));
        if time > today.after(AHEAD) {
            return Err(Rejected::Ahead { time, now: today });
        }
        if let Some(datum) = datum.filter(|datum| time < *datum) {
            return Err(Rejected::BeforeDatum { time, datum });
        }
        // Every forgotten report arrived before the oldest report that is still stored.
        let oldest = self.0.first().filter(|_| self.0.len() >= KEPT);
        match oldest.filter(|oldest| time <= oldest.at.shifted(shift).after(AHEAD)) {
            Some(_) => Err(Rejected::Forgotten(time)),
            None => Ok(()),
        }
    }

    /// Stores a report that was used. A repetition of it is then rejected.
    pub(in crate::compensation) fn take(&mut self, report: MeasuredReport, now: Moment) {
        if self.0.len() >= KEPT {
            self.0.remove(0);
        }
        let MeasuredReport { error_um, time, id, .. } = report;
        self.0.push(TakenReport { at: now, error_um, time, id });
    }
}

impl TakenReport {
    /// Returns whether a report that arrives at `now` is about the same measurement as this stored report.
    fn is_same(&self, report: &MeasuredReport, now: Moment) -> bool {
        let is_equal = (self.error_um - report.error_um).abs() < EQUAL_WITHIN;
        let has_same_id = report.id.is_some() && self.id == report.id;
        let has_same_time = report.time.is_some() && self.time == report.time;
        let is_repeated = !report.is_identified() && now.since(self.at) < REPEATED_WITHIN;
        has_same_id || (is_equal && (has_same_time || is_repeated))
    }
}

#[cfg(test)]
mod tests;
