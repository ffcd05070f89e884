//! Reports of measured errors from other programs, and how a repeated report is recognised.
//!
//! A broker delivers a message at least once, and a sender repeats a message without an answer. Two reports that agree
//! count as two measurements. Therefore each measurement may count only once:
//!
//! | the report has | it repeats a report that was taken if |
//! |---|---|
//! | `id` | the id is the same |
//! | `time` | time and error are the same |
//! | neither | the broker marks it as delivered again, or the same error arrived less than 10 s ago |
//!
//! A measurement from before the datum (last zero point of Cz) of the axis is rejected, because Cz is counted from that
//! datum. A measurement from the future is rejected, too.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted, shifted, time};

/// Number of reports that are remembered for each axis: two and a half days with one in each hour.
const KEPT: usize = 64;
/// Time within which an equal error is the same measurement, if neither report has an `id` or a `time`.
const REPEATED_WITHIN: Duration = Duration::from_secs(10);
/// Accepted lead of a sender's clock.
const AHEAD: Duration = Duration::from_secs(10);
/// Difference below which errors are equal, µm. One of them may have passed through a number of 32 bits.
const EQUAL_WITHIN: f64 = 1e-4;
/// Maximum length of an `id`.
const LONGEST_ID: usize = 64;

/// Measured error of an axis as a sender reports it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredReport {
    /// Actual minus commanded position, µm, while the compensation acts.
    pub error_um: f64,
    /// Time of the measurement by the wall clock; `None` if the report has none.
    pub time: Option<Moment>,
    /// Name that the sender has given to this measurement; `None` if the report has none.
    pub id: Option<String>,
    /// The broker has delivered this message before.
    pub redelivered: bool,
}

impl MeasuredReport {
    /// Creates a report with the `time` and the `id` of the measurement as text.
    ///
    /// # Errors
    /// Returns a message that says how to write the wrong text. It contains nothing of the report.
    pub fn new(error_um: f64, time: Option<&str>, id: Option<&str>) -> Result<MeasuredReport, String> {
        let time = time.map(MeasuredReport::time).transpose()?;
        let id = id.map(MeasuredReport::id).transpose()?;
        Ok(MeasuredReport { error_um, time, id, redelivered: false })
    }

    /// Parses a `time`.
    ///
    /// # Errors
    /// Returns a message that says how to write it.
    pub fn time(text: &str) -> Result<Moment, String> {
        let hint = "write `time` as 2026-01-31T12:00:00Z, with Z or the offset from UTC at its end";
        time::parse(text).map_err(|_| hint.to_owned())
    }

    /// Parses an `id`.
    ///
    /// # Errors
    /// Returns a message that says how to write it.
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

/// Report of an error without `time` and `id`.
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

/// Reason why a report is rejected before its error is judged. All times are by the wall clock.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rejected {
    /// A report with this `id` was taken.
    SameId(String),
    /// A report with this `time` and the same error was taken.
    SameTime(Moment),
    /// The broker has delivered the report again, and it has neither `time` nor `id`.
    Redelivered,
    /// An equal error arrived this long ago, and the report has neither `time` nor `id`.
    SameError(Duration),
    /// The report is older than all remembered ones, so it may have been taken already.
    Forgotten(Moment),
    /// The report was measured before the datum (last zero point of Cz) of the axis.
    BeforeDatum {
        /// `time` of the report.
        time: Moment,
        /// Time at which the datum was taken.
        datum: Moment,
    },
    /// The `time` of the report is in the future.
    Ahead {
        /// `time` of the report.
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
                    "the measurement with the id {id} was accepted before; give each measurement an id of \
                     its own"
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
                "the same error arrived {:.1} s ago and counts once; send a `time` or an `id` with each measurement, or \
                 wait {} s",
                ago.as_secs_f64(),
                REPEATED_WITHIN.as_secs()
            ),
            Rejected::Forgotten(time) => write!(
                f,
                "the measurement of {time} may have been accepted before: {KEPT} others were accepted after \
                 it; measure again"
            ),
            Rejected::BeforeDatum { time, datum } => write!(
                f,
                "the measurement of {time} is older than the datum (zero point) of {datum}; measure again"
            ),
            Rejected::Ahead { time, now } => write!(
                f,
                "its `time` {time} is in the future: the clock of this computer shows {now}; set the clock \
                 that is wrong, or leave `time` out"
            ),
        }
    }
}

/// Report that was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TakenReport {
    /// Counted time of its last arrival.
    at: Moment,
    error_um: f64,
    /// Time of the sender. A correction of this computer's clock does not change it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time: Option<Moment>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    id: Option<String>,
}

shifted!(TakenReport: at);

/// Reports that were taken last, by their last arrival, oldest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct TakenReports(Vec<TakenReport>);

impl Shifted for TakenReports {
    fn shift(&mut self, by: Shift) {
        self.0.shift(by);
    }
}

impl TakenReports {
    /// Keeps only the newest reports, as many as are remembered.
    pub(super) fn newest(mut self) -> TakenReports {
        let forgotten = self.0.len().saturating_sub(KEPT);
        self.0.drain(..forgotten);
        self
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Checks whether a report that arrives at `now` is a new measurement since the zero point `datum`. `shift`
    /// converts counted time to wall-clock time. A repeated report is remembered from `now` on, so that no number of
    /// repetitions counts.
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
        // Every forgotten report arrived before the oldest one that is left.
        let oldest = self.0.first().filter(|_| self.0.len() >= KEPT);
        match oldest.filter(|oldest| time <= oldest.at.shifted(shift).after(AHEAD)) {
            Some(_) => Err(Rejected::Forgotten(time)),
            None => Ok(()),
        }
    }

    /// Remembers a report that was taken.
    pub(in crate::compensation) fn take(&mut self, report: MeasuredReport, now: Moment) {
        if self.0.len() >= KEPT {
            self.0.remove(0);
        }
        let MeasuredReport { error_um, time, id, .. } = report;
        self.0.push(TakenReport { at: now, error_um, time, id });
    }
}

impl TakenReport {
    /// Returns whether a report that arrives at `now` is of the same measurement.
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
