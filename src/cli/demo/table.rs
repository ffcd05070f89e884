//! Table of the demo: on a terminal it is redrawn, otherwise it gets one row for each half hour of machine time.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::time::Duration;

use crate::cli::print::{Out, Screen};
use crate::observe::status::{AxisStatus, Status, TruthStatus};
use crate::virtual_machine::Summary;

/// Interval between the rows of the printed table in seconds of machine time, if stdout is not a terminal.
const ROW_EVERY: f64 = 1800.0;

/// Table that shows a demo while it runs.
pub(super) struct Table {
    mode: Mode,
    page: String,
    span: Duration,
    next_row: f64,
    drawn: usize,
}

enum Mode {
    /// Table that is redrawn, because stdout is a terminal.
    Live,
    /// Table whose rows are printed one below the other, because stdout is not a terminal.
    Rows,
    /// Progress line on stderr, which is a terminal. Stdout is reserved for the JSON document.
    Progress,
    Nothing,
}

impl Table {
    pub(super) fn new(json: bool, page: &str, span: Duration) -> Table {
        let mode = match (json, std::io::stdout().is_terminal(), std::io::stderr().is_terminal()) {
            (false, true, _) => Mode::Live,
            (false, false, _) => Mode::Rows,
            (true, _, true) => Mode::Progress,
            (true, _, false) => Mode::Nothing,
        };
        Table { mode, page: page.to_owned(), span, next_row: 0.0, drawn: 0 }
    }

    pub(super) fn draw(&mut self, status: &Status, summary: &Summary) -> std::io::Result<()> {
        // After the span come the fault actions of the stop, which are not part of the day.
        if status.uptime_s > self.span.as_secs_f64() {
            return Ok(());
        }
        match self.mode {
            Mode::Live => self.live(status, summary),
            Mode::Rows => self.row(status),
            Mode::Progress => {
                let share = 100.0 * status.uptime_s / self.span.as_secs_f64();
                write!(
                    std::io::stderr(),
                    "\r{:.1} h of machine time ({share:.0} %) ",
                    status.uptime_s / 3600.0
                )
            }
            Mode::Nothing => Ok(()),
        }
    }

    fn live(&mut self, status: &Status, summary: &Summary) -> std::io::Result<()> {
        let mut text = String::new();
        let share = (status.uptime_s / self.span.as_secs_f64()).clamp(0.0, 1.0);
        let lines = self.lines(status, summary, share);
        if self.drawn > 0 {
            let _ = write!(text, "\x1b[{}A", self.drawn);
        }
        for line in &lines {
            let _ = writeln!(text, "\x1b[2K{line}");
        }
        self.drawn = lines.len();
        let mut out = Screen;
        out.write_all(text.as_bytes())?;
        out.flush()
    }

    fn lines(&self, status: &Status, summary: &Summary, share: f64) -> Vec<String> {
        let mut lines = vec![
            format!("{} — {}", status.machine, status.description),
            format!("page  {}", self.page),
            format!(
                "time  {}   {} {:>4.1} h of {:.1} h",
                clock(&status.now),
                bar(share),
                status.uptime_s / 3600.0,
                self.span.as_secs_f64() / 3600.0
            ),
            String::new(),
            format!(
                "{:<6}{:>11}{:>11}{:>16}   {:<18}{}",
                "axis", "error", "+ Cz", "= residual", "state", "guard"
            ),
        ];
        for axis in &status.axes {
            let micron = |value: f64| format!("{value:+.1} µm");
            let [error, cz, left] = figures(axis.truth).map(|value| value.map_or("—".to_owned(), micron));
            lines.push(format!(
                "{:<6}{error:>11}{cz:>11}{left:>16}   {:<18}{}",
                axis.name,
                axis.display(),
                axis.acted.join(" ")
            ));
        }
        for axis in &summary.axes {
            lines.push(format!(
                "      range so far: {:.1} µm uncompensated, {:.1} µm compensated",
                axis.uncompensated.range_um(),
                axis.compensated.range_um()
            ));
        }
        lines.push(String::new());
        lines.extend(status.signals.iter().map(|signal| {
            let value = signal.value.map_or("—".to_owned(), |value| format!("{value:.3}"));
            format!("{:<14}{:>12} {:<5} {}", signal.name, value, signal.unit, signal.quality)
        }));
        lines.push(String::new());
        let newest = status.events.iter().rev().take(4);
        lines.extend(newest.map(|event| format!("{}  {}", clock(&event.at), event.text)));
        lines.resize(lines.len() + 4usize.saturating_sub(status.events.len()), String::new());
        lines.iter().map(|line| line.chars().take(100).collect()).collect()
    }

    fn row(&mut self, status: &Status) -> std::io::Result<()> {
        if status.uptime_s < self.next_row {
            return Ok(());
        }
        let mut out = Out;
        if self.next_row < ROW_EVERY {
            writeln!(out, "{} — {}\npage  {}\n", status.machine, status.description, self.page)?;
            writeln!(
                out,
                "{:>6}  {:<5}{:>12}{:>12}{:>20}   state",
                "hours", "axis", "error, µm", "+ Cz, µm", "= residual, µm"
            )?;
        }
        self.next_row = (status.uptime_s / ROW_EVERY).floor() * ROW_EVERY + ROW_EVERY;
        for axis in &status.axes {
            let micron = |value: f64| format!("{value:.1}");
            let [error, cz, left] = figures(axis.truth).map(|value| value.map_or("—".to_owned(), micron));
            let AxisStatus { name, state, .. } = axis;
            let hours = status.uptime_s / 3600.0;
            writeln!(out, "{hours:>6.1}  {name:<5}{error:>12}{cz:>12}{left:>20}   {state}")?;
        }
        out.flush()
    }
}

/// Returns the error of an axis without Cz, the acting Cz, and the residual error, in µm. The values are
/// rounded to tenths of a micrometre, so that the printed numbers add up exactly. All are `None` if the true
/// error is not known.
fn figures(truth: Option<TruthStatus>) -> [Option<f64>; 3] {
    let Some(truth) = truth else { return [None; 3] };
    let tenths = |value: f64| (value * 10.0).round();
    let (error, left) = (tenths(truth.error_um), tenths(truth.left_um));
    // Adding 0.0 converts a negative zero to zero.
    [error, left - error, left].map(|tenths| Some(tenths / 10.0 + 0.0))
}

/// Returns the time of day in an RFC 3339 time, for example `14:05:00`.
fn clock(time: &str) -> &str {
    time.get(11..19).unwrap_or(time)
}

fn bar(share: f64) -> String {
    let tenths = (0..30u8).filter(|tenth| f64::from(*tenth) < share * 30.0).count();
    format!("{}{}", "█".repeat(tenths), "░".repeat(30 - tenths))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_columns_add_up_as_they_are_printed() {
        for (error_um, cz_um) in
            [(-3.24, 1.26), (0.05, 0.05), (12.349, -12.351), (0.04, -0.04), (-0.049, 0.0)]
        {
            let [error, cz, left] = figures(Some(TruthStatus { error_um, left_um: error_um + cz_um }));
            let printed = [error, cz, left].map(|value| format!("{:.1}", value.unwrap()));
            let [error, cz, left] = printed.each_ref().map(|text| text.parse::<f64>().unwrap());
            assert!((error + cz - left).abs() < 1e-9, "{printed:?}");
            assert!(
                (cz - cz_um).abs() <= 0.1 + 1e-9 && (error - error_um).abs() <= 0.05 + 1e-9,
                "{printed:?}"
            );
            assert!(printed.iter().all(|text| text != "-0.0"), "{printed:?}");
        }
    }
}
