//! Time spans of a log in which sensors of an axis were replaced or suspected, or in which the axis was on hold.

use std::fmt;

use serde::Serialize;

use super::findings::{Findings, Hold, HoldChange, StandIn, Suspicion, whole_seconds};
use crate::gateway::log::LogRow;
use isotherm_core::quantity::Moment;
use isotherm_profile::counted;

/// Maximum number of time spans of one kind that are stored for an axis, because a log may be very long. Further ones
/// are only counted.
const MOST: usize = 1000;
/// Maximum number of time spans of one kind that are printed for an axis.
const MOST_PRINTED: usize = 20;

/// Time span of a log, and the finding that was true during it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Span<T> {
    /// `time` of the first row of the time span, as in the log.
    pub from: String,
    /// `time` of the first row after the time span; or of the last row of the log.
    pub to: String,
    /// Time between the log rows `from` and `to`, s.
    pub span_s: f64,
    /// Whether the finding was still true in the last row of the log.
    pub lasts: bool,
    /// Finding that was true during the time span.
    #[serde(flatten)]
    pub what: T,
}

/// Time spans of one axis. Each list is in the order in which the time spans began.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AxisSpans {
    /// Time spans in which the value of a sensor was calculated from other sensors.
    pub stand_ins: Vec<Span<StandIn>>,
    /// Time spans in which a sensor was suspected of being frozen, and its reading was still used.
    pub suspicions: Vec<Span<Suspicion>>,
    /// Time spans in which the axis kept its Cz, or its Cz went to zero or was zero.
    pub holds: Vec<Span<Hold>>,
    /// Number of time spans that are missing in each list.
    pub left_out: OmittedSpans,
}

/// Number of time spans of each kind that are not in the lists, because there were too many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct OmittedSpans {
    /// Number of time spans missing in `stand_ins`.
    pub stand_ins: u64,
    /// Number of time spans missing in `suspicions`.
    pub suspicions: u64,
    /// Number of time spans missing in `holds`.
    pub holds: u64,
}

/// Collector of the time spans of one axis. It receives the log row by row.
#[derive(Debug)]
pub(super) struct SpanTally {
    stand_ins: SpanList<StandIn>,
    suspicions: SpanList<Suspicion>,
    holds: SpanList<Hold>,
}

impl SpanTally {
    pub(super) fn new() -> SpanTally {
        SpanTally { stand_ins: SpanList::new(), suspicions: SpanList::new(), holds: SpanList::new() }
    }

    /// Adds the findings at a log row.
    pub(super) fn row(&mut self, row: &LogRow, found: Findings) {
        // `for_s` grows with each row. `why` of a suspicion is that of its first row.
        self.stand_ins.row(row, found.stand_ins, |one, other| {
            (&one.signal, one.kind, &one.by) == (&other.signal, other.kind, &other.by)
        });
        self.suspicions.row(row, found.suspicions, |one, other| one.signal == other.signal);
        let holds = match found.held {
            HoldChange::AsBefore => return,
            HoldChange::No => Vec::new(),
            HoldChange::Yes(hold) => vec![hold],
        };
        self.holds.row(row, holds, |one, other| one == other);
    }

    /// Returns the time spans up to the last log row. `last` is the time of that row, as text and as a moment.
    pub(super) fn spans(self, last: (&str, Moment)) -> AxisSpans {
        let (stand_ins, stand_ins_left_out) = self.stand_ins.spans(last);
        let (suspicions, suspicions_left_out) = self.suspicions.spans(last);
        let (holds, holds_left_out) = self.holds.spans(last);
        let left_out = OmittedSpans {
            stand_ins: stand_ins_left_out,
            suspicions: suspicions_left_out,
            holds: holds_left_out,
        };
        AxisSpans { stand_ins, suspicions, holds, left_out }
    }
}

/// Time spans of one kind, for example holds: those that are stored, and those that have not ended yet.
#[derive(Debug)]
struct SpanList<T> {
    kept: Vec<Span<T>>,
    left_out: u64,
    open: Vec<Open<T>>,
}

/// Time span that has not ended yet.
#[derive(Debug)]
struct Open<T> {
    what: T,
    begun: Moment,
    /// Index in the list of stored time spans; `None` if this time span is not stored, only counted.
    place: Option<usize>,
    /// Whether the finding is also true in the present log row.
    lasts: bool,
}

impl<T: Clone> SpanList<T> {
    fn new() -> SpanList<T> {
        SpanList { kept: Vec::new(), left_out: 0, open: Vec::new() }
    }

    /// Adds the findings at a log row. `is_same` returns whether two findings belong to one time span.
    fn row(&mut self, row: &LogRow, found: Vec<T>, is_same: impl Fn(&T, &T) -> bool) {
        self.open.iter_mut().for_each(|open| open.lasts = false);
        for what in found {
            match self.open.iter().position(|open| is_same(&open.what, &what)) {
                Some(place) => self.open[place].lasts = true,
                None => self.begin(row, what),
            }
        }
        let kept = &mut self.kept;
        self.open.retain(|open| {
            if !open.lasts {
                open.end(kept, (row.time.as_str(), row.now), false);
            }
            open.lasts
        });
    }

    fn begin(&mut self, row: &LogRow, what: T) {
        let place = (self.kept.len() < MOST).then_some(self.kept.len());
        match place {
            Some(_) => self.kept.push(Span {
                from: row.time.clone(),
                to: row.time.clone(),
                span_s: 0.0,
                lasts: false,
                what: what.clone(),
            }),
            None => self.left_out += 1,
        }
        self.open.push(Open { what, begun: row.now, place, lasts: true });
    }

    /// Returns the stored time spans, and the number of those that were only counted.
    fn spans(mut self, last: (&str, Moment)) -> (Vec<Span<T>>, u64) {
        for open in &self.open {
            open.end(&mut self.kept, last, true);
        }
        (self.kept, self.left_out)
    }
}

impl<T> Open<T> {
    /// Ends the time span at this log row. `lasts`: the row is the last one of the log, and the finding is still true
    /// in it.
    fn end(&self, kept: &mut [Span<T>], (time, now): (&str, Moment), lasts: bool) {
        if let Some(span) = self.place.and_then(|place| kept.get_mut(place)) {
            time.clone_into(&mut span.to);
            (span.span_s, span.lasts) = (now.since(self.begun).as_secs_f64(), lasts);
        }
    }
}

/// Formats a time as the log states it, without conversion to UTC: to the second if the time has a date, else in
/// seconds.
fn shown(time: &str) -> String {
    let time = time.trim();
    if time.parse::<f64>().is_ok() {
        return format!("{time} s");
    }
    let marks: [(usize, &str); 3] = [(10, " Tt"), (13, ":"), (16, ":")];
    let has_both = marks
        .into_iter()
        .all(|(place, marks)| time.get(place..=place).is_some_and(|mark| marks.contains(mark)));
    let Some((date, of_day)) = time.get(..19).filter(|_| has_both).map(|time| time.split_at(10)) else {
        return time.to_owned();
    };
    format!("{date} {}", &of_day[1..])
}

impl<T: fmt::Display> fmt::Display for Span<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (from, to) = (shown(&self.from), shown(&self.to));
        let to = match (from.split_once(' '), to.split_once(' ')) {
            (Some((date, _)), Some((same, of_day))) if date == same && of_day.contains(':') => of_day,
            _ => to.as_str(),
        };
        let end = if self.lasts { ", the end of the log" } else { "" };
        write!(f, "{from} to {to}{end} ({}): {}", whole_seconds(self.span_s), self.what)
    }
}

impl fmt::Display for AxisSpans {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_spans(f, "stand-in", &self.stand_ins, self.left_out.stand_ins)?;
        write_spans(f, "suspicion", &self.suspicions, self.left_out.suspicions)?;
        write_spans(f, "hold", &self.holds, self.left_out.holds)
    }
}

/// Writes a line for each time span of one kind, for at most [`MOST_PRINTED`] of them.
fn write_spans<T: fmt::Display>(
    f: &mut fmt::Formatter<'_>,
    kind: &str,
    spans: &[Span<T>],
    left_out: u64,
) -> fmt::Result {
    for span in spans.iter().take(MOST_PRINTED) {
        writeln!(f, "  {span}")?;
    }
    let more = left_out.saturating_add(spans.len().saturating_sub(MOST_PRINTED) as u64);
    if more > 0 {
        writeln!(f, "  and {}; --json lists the first {MOST}", counted(more, &format!("more {kind}")))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_that_of_the_log_to_the_second() {
        for (time, text) in [
            ("7210", "7210 s"),
            (" 12.5 ", "12.5 s"),
            ("2026-01-05T12:03:10.123456789Z", "2026-01-05 12:03:10"),
            ("2026-01-05 12:03:10+03:00", "2026-01-05 12:03:10"),
            ("05.01.2026 06:00:10,25", "05.01.2026 06:00:10"),
            ("5.1.2026 6:00", "5.1.2026 6:00"),
        ] {
            assert_eq!(shown(time), text);
        }
    }

    #[test]
    fn the_date_of_the_end_is_written_if_it_is_another_one() {
        let span = |from: &str, to: &str| {
            let (from, to) = (from.to_owned(), to.to_owned());
            Span { from, to, span_s: 8209.6, lasts: false, what: "it held" }.to_string()
        };
        assert_eq!(
            span("2026-01-05T12:03:10Z", "2026-01-05T14:20:00Z"),
            "2026-01-05 12:03:10 to 14:20:00 (2h 16m 50s): it held"
        );
        assert_eq!(
            span("2026-01-05T23:00:00Z", "2026-01-06T01:16:50Z"),
            "2026-01-05 23:00:00 to 2026-01-06 01:16:50 (2h 16m 50s): it held"
        );
        assert_eq!(span("10", "10"), "10 s to 10 s (2h 16m 50s): it held");
    }
}
