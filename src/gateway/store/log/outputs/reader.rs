//! Reader of the output log. The output log has one row for each input of an output controller, with the
//! resulting action.

use std::fmt::Display;
use std::io::Read;

use csv::StringRecord;

use super::cells::{
    BEGIN, CLOCK, DemandDetail, FAILURES, FAULT, HEADER, ResumeState, Towards, WRITES, action, input,
};
use super::controllers::{ControllerSnapshot, Turn};
use crate::gateway::store::log::LogError;
use crate::gateway::store::log::reader::unreadable;
use isotherm_core::output::{Action, Fact, Input};
use isotherm_core::quantity::{Counts, Moment, time};
use isotherm_profile::safe_file::{self, Lines};

/// Names of log rows that only earlier versions wrote. `cz` contains the Cz in a corrected position, and `sealed` the
/// save numbers of state and register ledger.
const EARLIER: [&str; 2] = ["cz", "sealed"];

/// Row of the output log. The log contains one row for each input of an output controller.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputRow {
    /// Line number in the file of the output log.
    pub line: u64,
    /// Time at which the controller received the input.
    pub now: Moment,
    /// Name of the output.
    pub output: String,
    /// Parsed content of the log row.
    pub entry: Entry,
}

/// Content of a row of the output log.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// Settings and state from which an output continues, at the beginning of its rows.
    Begins(Box<ResumeState>),
    /// Input of the controller of the output, and the action.
    Step {
        /// Input of the controller.
        input: Input,
        /// Action that the controller returned.
        action: Action,
    },
    /// Settings and state from which the controller of an output set, of a corrected position (position plus Cz), or of
    /// a heartbeat continues.
    Resumes(Box<ControllerSnapshot>),
    /// Turn (one call by the line task) of the controller of an output set, of a corrected position, or of a
    /// heartbeat.
    Turn {
        /// Number of times that the previous turn (call of the controller) was repeated.
        repetitions: u64,
        /// Turn (call of the controller), with its input and action.
        turn: Turn,
    },
    /// Information for people who read the log. A replay ignores it.
    Noted,
}

/// Reader of the rows of an output log.
#[derive(Debug)]
pub struct OutputLogReader<R> {
    csv: csv::Reader<Lines<R>>,
    file: String,
    record: StringRecord,
    warnings: Vec<String>,
}

const COLUMNS: usize = 9;
const TIME: usize = 0;
const OUTPUT: usize = 1;
const FACT: usize = 2;
const VALUE: usize = 3;
const MOMENT: usize = 4;
const ACTION: usize = 5;
const ACTION_VALUE: usize = 6;
const ACTION_UNTIL: usize = 7;
const DETAIL: usize = 8;

impl<R: Read> OutputLogReader<R> {
    /// Reads the header. `file` is the name of the log in messages.
    ///
    /// # Errors
    /// The first line is not the header of an output log.
    pub fn open(input: R, file: &str) -> Result<OutputLogReader<R>, LogError> {
        let (_, input) =
            safe_file::first_line(input).map_err(|cause| unreadable(file, 1, &csv::Error::from(cause)))?;
        let mut csv = csv::ReaderBuilder::new().flexible(true).from_reader(input);
        let header = csv.headers().map_err(|cause| unreadable(file, 1, &cause))?;
        if !header.iter().eq(names()) {
            let message =
                format!("this is not a log of outputs: the first line must be {}", HEADER.trim_end());
            return Err(LogError { file: file.to_owned(), line: 1, column: None, message });
        }
        Ok(OutputLogReader { csv, file: file.to_owned(), record: StringRecord::new(), warnings: Vec::new() })
    }

    /// Returns sentences about defects of the log that did not prevent the reading.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Reads the next row. Returns `None` at the end of the log.
    ///
    /// # Errors
    /// The row cannot be read. The error contains its line and column.
    pub fn next_row(&mut self) -> Result<Option<OutputRow>, LogError> {
        if !self.read_record()? {
            return Ok(None);
        }
        let line = self.record.position().map_or(0, csv::Position::line);
        let error = match self.row(line) {
            Ok(row) => return Ok(Some(row)),
            Err(error) => error,
        };
        // A power cut can leave a part of the last row: too few cells, or a part of its last cell.
        let may_be_cut = self.record.len() < COLUMNS || error.column.as_deref() == name(DETAIL);
        if may_be_cut && !self.read_record()? {
            self.warnings
                .push(format!("{}, line {line}: the last row is incomplete and is left out", self.file));
            return Ok(None);
        }
        Err(error)
    }

    fn read_record(&mut self) -> Result<bool, LogError> {
        self.csv.get_mut().row_is_over();
        let read = self.csv.read_record(&mut self.record);
        read.map_err(|cause| unreadable(&self.file, self.csv.position().line(), &cause))
    }

    fn row(&self, line: u64) -> Result<OutputRow, LogError> {
        if self.record.len() != COLUMNS {
            let message =
                format!("the row has {} cells, but the header has {COLUMNS} column names", self.record.len());
            return Err(LogError { file: self.file.clone(), line, column: None, message });
        }
        let now = time::parse(self.cell(TIME)).map_err(|why| self.error(line, TIME, why))?;
        let wrong = |why| {
            let why = format!(
                "{why}; another version of the program has written the log: replay the log with that version"
            );
            self.error(line, DETAIL, why)
        };
        let (fact, detail) = (self.cell(FACT), self.cell(DETAIL));
        let entry = if let Some(snapshot) = ControllerSnapshot::parse(fact, detail) {
            Entry::Resumes(Box::new(snapshot.map_err(wrong)?))
        } else if let Some(turn) = Turn::parse(fact, detail) {
            let turn = turn.map_err(wrong)?;
            Entry::Turn { repetitions: self.repetitions(line, turn.most_repetitions())?, turn }
        } else {
            match fact {
                BEGIN => Entry::Begins(serde_json::from_str(detail).map_err(wrong)?),
                FAULT | WRITES | FAILURES | CLOCK => Entry::Noted,
                earlier if EARLIER.contains(&earlier) => Entry::Noted,
                _ => Entry::Step {
                    input: self.with_detail(line, self.named(line, (FACT, VALUE, MOMENT), input)?)?,
                    action: self.named(line, (ACTION, ACTION_VALUE, ACTION_UNTIL), action)?,
                },
            }
        };
        Ok(OutputRow { line, now, output: self.cell(OUTPUT).to_owned(), entry })
    }

    fn repetitions(&self, line: u64, most: u64) -> Result<u64, LogError> {
        let text = self.cell(VALUE);
        let count = if text.is_empty() { Some(0) } else { text.parse().ok() };
        let wrong =
            || self.error(line, VALUE, format!("`{text}` is not a number of repetitions from 0 to {most}"));
        count.filter(|count| *count <= most).ok_or_else(wrong)
    }

    /// Parses an input or an action. The tuple contains the indices of three columns: name, value and moment. The
    /// function `of` creates the result from their cells.
    fn named<T>(
        &self,
        line: u64,
        (what, value, moment): (usize, usize, usize),
        of: fn(&str, Option<Counts>, Moment) -> Option<T>,
    ) -> Result<T, LogError> {
        let (count, at) = self.value_and_moment(line, value, moment)?;
        let wrong = || match of(self.cell(what), Some(Counts(0)), at) {
            Some(_) => self.error(line, value, format!("`{}` needs a value, but has none", self.cell(what))),
            None => self.error(line, what, format!("`{}` is unknown", self.cell(what))),
        };
        of(self.cell(what), count, at).ok_or_else(wrong)
    }

    /// Parses two columns: a value and a moment. An empty value is `None`; an empty moment is [`Moment::END`].
    fn value_and_moment(
        &self,
        line: u64,
        value: usize,
        moment: usize,
    ) -> Result<(Option<Counts>, Moment), LogError> {
        let count = match self.cell(value) {
            "" => None,
            text => {
                let count = text.parse().map(Counts);
                let wrong = |_| self.error(line, value, format!("`{text}` is not a register value"));
                Some(count.map_err(wrong)?)
            }
        };
        let at = match self.cell(moment) {
            "" => Moment::END,
            text => time::parse(text).map_err(|why| self.error(line, moment, why))?,
        };
        Ok((count, at))
    }

    /// Adds the column `detail` to an input. Decisions in logs of earlier versions have no detail.
    fn with_detail(&self, line: u64, input: Input) -> Result<Input, LogError> {
        let text = self.cell(DETAIL);
        let wrong = |why: &dyn Display| self.error(line, DETAIL, why);
        Ok(match input {
            Input::Fact(Fact::Decided { offset, not_after, .. }) if !text.is_empty() => {
                let Towards { target } = serde_json::from_str(text).map_err(|why| wrong(&why))?;
                Input::Fact(Fact::Decided { offset, target: Some(target), not_after })
            }
            Input::Demand(_) => {
                let detail: DemandDetail = serde_json::from_str(text).map_err(|why| wrong(&why))?;
                let (offset, not_after) = self.value_and_moment(line, VALUE, MOMENT)?;
                let demand = detail.demand(offset, not_after);
                Input::Demand(demand.ok_or_else(|| wrong(&"a decision needs an offset, but has none"))?)
            }
            input => input,
        })
    }

    fn cell(&self, place: usize) -> &str {
        self.record.get(place).unwrap_or_default()
    }

    fn error(&self, line: u64, place: usize, message: impl Display) -> LogError {
        let column = name(place).map(str::to_owned);
        LogError { file: self.file.clone(), line, column, message: message.to_string() }
    }
}

fn names() -> impl Iterator<Item = &'static str> {
    HEADER.trim_end().split(',')
}

fn name(place: usize) -> Option<&'static str> {
    names().nth(place)
}
