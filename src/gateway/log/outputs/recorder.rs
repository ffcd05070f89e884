//! Formats rows into one buffer that is used again; knows nothing of files.

use std::fmt::Display;
use std::io::Write;

use super::{BEGIN, Beginning, CZ, FAILURES, FAULT, Told, WRITES, told_action, told_fact};
use crate::gateway::log::recorder::{cell, has_to_be_quoted, number};
use isotherm_core::output::{Action, Fact};
use isotherm_core::quantity::{Micron, Moment, time};

/// Turns what happens to outputs into rows, each with its line break.
#[derive(Clone, Debug, Default)]
pub struct OutputRecorder {
    line: Vec<u8>,
}

impl OutputRecorder {
    /// An output goes on from this.
    pub fn begin(&mut self, now: Moment, output: &str, beginning: &Beginning) -> &[u8] {
        self.start(now, output, BEGIN);
        // Numbers, names and lists of them can always be told.
        let detail = serde_json::to_string(beginning).unwrap_or_default();
        self.line.extend_from_slice(b",,,,,,");
        self.end(&cell(&detail))
    }

    /// An output took a fact, and asked for something.
    pub fn step(&mut self, now: Moment, output: &str, fact: Fact, action: Action) -> &[u8] {
        let (fact, action) = (told_fact(fact), told_action(action));
        self.start(now, output, fact.name);
        self.rest(fact);
        self.line.push(b',');
        self.line.extend_from_slice(action.name.as_bytes());
        self.rest(action);
        self.line.push(b',');
        self.end("")
    }

    /// The Cz that went into a position is another one.
    pub fn cz(&mut self, now: Moment, output: &str, cz: Micron) -> &[u8] {
        self.start(now, output, CZ);
        self.line.push(b',');
        number(&mut self.line, cz.get());
        self.line.extend_from_slice(b",,,,,");
        self.end("")
    }

    /// What is written again and again was not.
    pub fn fault(&mut self, now: Moment, output: &str, why: &str) -> &[u8] {
        self.start(now, output, FAULT);
        self.line.extend_from_slice(b",,,,,,");
        self.end(&cell(why))
    }

    /// So many writes were answered as done since that moment.
    pub fn writes(&mut self, now: Moment, output: &str, count: u64, since: Moment) -> &[u8] {
        self.count(now, output, WRITES, count, since)
    }

    /// So many failed.
    pub fn failures(&mut self, now: Moment, output: &str, count: u64, since: Moment) -> &[u8] {
        self.count(now, output, FAILURES, count, since)
    }

    fn count(&mut self, now: Moment, output: &str, what: &str, count: u64, since: Moment) -> &[u8] {
        self.start(now, output, what);
        self.optional(Some(count));
        self.moment(since);
        self.line.extend_from_slice(b",,,,");
        self.end("")
    }

    fn start(&mut self, now: Moment, output: &str, fact: &str) {
        self.line.clear();
        time::write(&mut self.line, now);
        self.line.push(b',');
        if has_to_be_quoted(output) {
            self.line.extend_from_slice(cell(output).as_bytes());
        } else {
            self.line.extend_from_slice(output.as_bytes());
        }
        self.line.push(b',');
        self.line.extend_from_slice(fact.as_bytes());
    }

    fn rest(&mut self, told: Told) {
        self.optional(told.value);
        self.moment(told.moment);
    }

    fn optional(&mut self, value: Option<impl Display>) {
        self.line.push(b',');
        if let Some(value) = value {
            // Writing to a vector never fails.
            let _ = write!(self.line, "{value}");
        }
    }

    fn moment(&mut self, moment: Moment) {
        self.line.push(b',');
        if moment != Moment::END {
            time::write(&mut self.line, moment);
        }
    }

    fn end(&mut self, detail: &str) -> &[u8] {
        self.line.extend_from_slice(detail.as_bytes());
        self.line.push(b'\n');
        &self.line
    }
}
