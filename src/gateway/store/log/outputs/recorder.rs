//! Formatter for the rows of the output log. It reuses one buffer, and does not access files.

use std::fmt::Display;
use std::io::Write;

use super::cells::{
    BEGIN, CLOCK, Detail, FAILURES, FAULT, ResumeState, WRITES, cells_of_action, cells_of_input,
};
use super::controllers::{ControllerSnapshot, Turn};
use crate::clock::Correction;
use crate::gateway::store::log::recorder::{cell, has_to_be_quoted};
use isotherm_core::output::{Action, Input};
use isotherm_core::quantity::{Moment, Shift, Shifted, time};

/// Formatter for the rows of the output log; each row ends with a line break.
#[derive(Clone, Debug, Default)]
pub struct OutputRecorder {
    line: Vec<u8>,
    /// Difference between the time stamps in the file and the monotonic time of this run.
    pub(in crate::gateway) shift: Shift,
}

impl OutputRecorder {
    /// Formats the log row with the state from which an output continues.
    pub fn begin(&mut self, now: Moment, output: &str, beginning: &ResumeState) -> &[u8] {
        // Numbers, names and lists of them always have a JSON form.
        let (state, policy) = (beginning.state.shifted(self.shift), beginning.policy.shifted(self.shift));
        let detail = serde_json::to_string(&ResumeState { state, policy, ..*beginning }).unwrap_or_default();
        self.begins(now, output, BEGIN);
        self.ends(",,,,,,", &cell(&detail))
    }

    /// Formats the log row with an input of an output controller, and with the action that the controller returned.
    pub fn step(&mut self, now: Moment, output: &str, input: Input, action: Action) -> &[u8] {
        // Numbers and names always have a JSON form.
        let detail = Detail::of(input, self.shift).map(|one| serde_json::to_string(&one).unwrap_or_default());
        let (fact, action) = (cells_of_input(input), cells_of_action(action));
        self.begins(now, output, fact.0);
        self.value_and_moment(fact.1, fact.2);
        // Writing to a vector never fails.
        let _ = write!(self.line, ",{}", action.0);
        self.value_and_moment(action.1, action.2);
        self.ends(",", &detail.map_or(String::new(), |detail| cell(&detail)))
    }

    /// Formats the log row with the state from which a controller continues.
    pub fn resume(&mut self, now: Moment, name: &str, snapshot: &ControllerSnapshot) -> &[u8] {
        // Numbers, names and lists of them always have a JSON form.
        let detail = serde_json::to_string(&snapshot.clone().shifted(self.shift)).unwrap_or_default();
        self.begins(now, name, snapshot.name());
        self.ends(",,,,,,", &cell(&detail))
    }

    /// Formats the log row of a turn, which is one call of a controller by the line task. `repetitions`: how often
    /// the previous turn was repeated before this turn.
    pub fn turn(&mut self, now: Moment, name: &str, turn: &Turn, repetitions: u64) -> &[u8] {
        // Numbers, names and lists of them always have a JSON form.
        let detail = serde_json::to_string(&turn.clone().shifted(self.shift)).unwrap_or_default();
        self.begins(now, name, turn.row());
        self.value_and_moment((repetitions > 0).then_some(repetitions), Moment::END);
        // Writing to a vector never fails.
        let _ = write!(self.line, ",{}", turn.action());
        self.ends(",,,", &cell(&detail))
    }

    /// Formats the log row with the fault of an output that is written repeatedly.
    pub fn fault(&mut self, now: Moment, output: &str, why: &str) -> &[u8] {
        self.begins(now, output, FAULT);
        self.ends(",,,,,,", &cell(why))
    }

    /// Formats the log row with the number of writes that were answered since `since`.
    pub fn writes(&mut self, now: Moment, output: &str, count: u64, since: Moment) -> &[u8] {
        self.count(now, output, WRITES, count, since)
    }

    /// Formats the log row with the number of writes that failed since `since`.
    pub fn failures(&mut self, now: Moment, output: &str, count: u64, since: Moment) -> &[u8] {
        self.count(now, output, FAILURES, count, since)
    }

    /// Formats the log row with a correction of the computer's clock. Such a row begins a new file.
    pub(in crate::gateway) fn clock(&mut self, now: Moment, correction: Correction) -> &[u8] {
        self.begins(now, "", CLOCK);
        self.ends(",,,,,,", &correction.to_string())
    }

    fn count(&mut self, now: Moment, output: &str, what: &str, count: u64, since: Moment) -> &[u8] {
        self.begins(now, output, what);
        self.value_and_moment(Some(count), since);
        self.ends(",,,,", "")
    }

    fn begins(&mut self, now: Moment, output: &str, fact: &str) {
        self.line.clear();
        time::write(&mut self.line, now.shifted(self.shift));
        let _ = match has_to_be_quoted(output) {
            true => write!(self.line, ",{},{fact}", cell(output)),
            false => write!(self.line, ",{output},{fact}"),
        };
    }

    fn value_and_moment(&mut self, value: Option<impl Display>, moment: Moment) {
        self.line.push(b',');
        if let Some(value) = value {
            let _ = write!(self.line, "{value}");
        }
        self.line.push(b',');
        if moment != Moment::END {
            time::write(&mut self.line, moment.shifted(self.shift));
        }
    }

    fn ends(&mut self, empty: &str, detail: &str) -> &[u8] {
        let _ = writeln!(self.line, "{empty}{detail}");
        &self.line
    }
}
