//! Context of a key of the profile while the value of the key is checked: the path of the key, and functions that
//! report errors and warnings.
//!
//! A key context knows which keys the profile has, but not the values in other tables. A check that needs another table
//! gets this table as an argument.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::ops::Deref;
use std::time::Duration;

use crate::duration::{Timespan, shown};
use crate::error::{Findings, ProfileError, allowed};
use crate::files::Files;
use crate::source_map::{SourceMap, child, element};
use crate::tables::signal::unit::Unit;
use crate::wording::counted;
use isotherm_core::reading::SignalId;

/// Shortest allowed period of reads, writes and updates. A period of a microsecond would cause 66,000
/// requests per second, and occupy the computer.
const SHORTEST_PERIOD: Duration = Duration::from_millis(1);

/// Names of all tables of one kind, for example of all signals, in the order of the file.
pub(crate) struct Names {
    pub(crate) kind: &'static str,
    names: Vec<String>,
    places: HashMap<String, usize>,
}

/// Errors and warnings of a check in progress, the files that the check reads, and a record of the signals that the
/// profile uses.
pub(crate) struct Report<'a> {
    pub(crate) spans: &'a SourceMap,
    pub(crate) files: &'a Files<'a>,
    pub(crate) signals: Names,
    errors: RefCell<Findings>,
    warnings: RefCell<Findings>,
    /// For each signal, by index: whether any table uses the signal.
    used: RefCell<Vec<bool>>,
    /// For each signal, by index: its unit. Empty before the signals are resolved.
    units: RefCell<Vec<Option<Unit>>>,
    /// Missing tables to which keys refer, by path of the table. The first number is the index of the error about the
    /// table. The second number counts the further keys that refer to the table.
    absent: RefCell<BTreeMap<String, (usize, usize)>>,
}

/// Key of the profile that is being checked, with functions for its errors and warnings.
#[derive(Clone)]
pub(crate) struct KeyContext<'c> {
    pub(crate) report: &'c Report<'c>,
    pub(crate) path: String,
}

/// Resolves an optional part of the profile with the function `resolve`. Returns `Some(None)` if the profile
/// does not contain the part, and `None` if the part has errors.
pub(crate) fn optional<R, T>(raw: Option<R>, resolve: impl FnOnce(R) -> Option<T>) -> Option<Option<T>> {
    raw.map_or(Some(None), |raw| resolve(raw).map(Some))
}

impl Names {
    pub(crate) fn of<R>(kind: &'static str, raw: &BTreeMap<String, R>, spans: &SourceMap) -> Names {
        let mut names: Vec<String> = raw.keys().cloned().collect();
        names.sort_by_cached_key(|name| spans.rank(&child(kind, name)));
        let places = names.iter().cloned().enumerate().map(|(place, name)| (name, place)).collect();
        Names { kind, names, places }
    }

    pub(crate) fn place(&self, name: &str) -> Option<usize> {
        self.places.get(name).copied()
    }
}

impl Deref for Names {
    type Target = [String];

    fn deref(&self) -> &[String] {
        &self.names
    }
}

impl<'a> Report<'a> {
    pub(crate) fn new(spans: &'a SourceMap, files: &'a Files<'a>, signals: Names) -> Report<'a> {
        let used = RefCell::new(vec![false; signals.len()]);
        let (errors, warnings, units) = (RefCell::default(), RefCell::default(), RefCell::default());
        Report { spans, files, signals, errors, warnings, used, units, absent: RefCell::default() }
    }

    /// Stores the units of the resolved signals. `None` for a signal with errors.
    pub(crate) fn set_units(&self, units: Vec<Option<Unit>>) {
        *self.units.borrow_mut() = units;
    }

    /// Returns for each signal, by index, whether any table uses the signal.
    pub(crate) fn used(&self) -> Vec<bool> {
        self.used.borrow().clone()
    }

    /// Returns the errors and the warnings.
    pub(crate) fn into_findings(self) -> (Findings, Findings) {
        let mut errors = self.errors.into_inner();
        for (index, others) in self.absent.into_inner().into_values().filter(|(_, others)| *others > 0) {
            errors.append_to_message(index, &format!(" ({} name it)", counted(others + 1, "key")));
        }
        (errors, self.warnings.into_inner())
    }

    /// Returns the context of a key at the top level of the profile.
    pub(crate) fn at(&self, key: &str) -> KeyContext<'_> {
        KeyContext { report: self, path: String::new() }.key(key)
    }
}

impl<'c> KeyContext<'c> {
    /// Returns the context of another key, at the top level of the profile.
    pub(crate) fn top(&self, key: &str) -> KeyContext<'c> {
        self.report.at(key)
    }

    /// Returns the context of the key `key` in the table of this context.
    pub(crate) fn key(&self, key: &str) -> KeyContext<'c> {
        KeyContext { report: self.report, path: child(&self.path, key) }
    }

    /// Returns the context of an entry of the list at this key. The index counts from 0.
    pub(crate) fn item(&self, index: usize) -> KeyContext<'c> {
        KeyContext { report: self.report, path: element(&self.path, index) }
    }

    /// Returns whether the table of this context has the key `key` with a value of the correct type.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.report.spans.is_right(&child(&self.path, key))
    }

    /// Returns whether this key has been written, with a correct or a wrong value.
    pub(crate) fn is_written(&self) -> bool {
        self.report.spans.contains(&self.path)
    }

    /// Returns whether this key is missing and no error about this has been reported. In this case the profile and its
    /// templates do not set the key, and no unknown key looks like a misspelling of this key.
    pub(crate) fn is_left_out(&self) -> bool {
        let spans = self.report.spans;
        !self.is_written() && !spans.is_right(&self.path) && !spans.is_meant(&self.path)
    }

    /// Returns the position of the key for messages, for example `profiles/x.toml:41`.
    pub(crate) fn line(&self) -> String {
        self.report.spans.line_of(&self.path)
    }

    /// Reports an error at the value of this key.
    pub(crate) fn invalid(&self, message: impl Into<String>, help: impl Into<String>) {
        if self.is_enough() {
            return;
        }
        self.error(self.report.spans.at_value(&self.path, message, Some(help.into())));
    }

    /// Reports an error at the value of this key, and returns `None`.
    pub(crate) fn reject<T>(&self, message: impl Into<String>, help: impl Into<String>) -> Option<T> {
        self.invalid(message, help);
        None
    }

    /// Returns whether the list of errors is full. If so, counts one more error, and the caller need not describe it.
    pub(crate) fn is_enough(&self) -> bool {
        let mut errors = self.report.errors.borrow_mut();
        let is_full = errors.is_full();
        if is_full {
            errors.count();
        }
        is_full
    }

    /// Reports an error at the name of this key, which should not be present.
    pub(crate) fn wrong_key(&self, message: impl Into<String>, help: impl Into<String>) {
        if self.is_enough() {
            return;
        }
        self.error(self.report.spans.at_key(&self.path, message, Some(help.into())));
    }

    /// Reports an error if this required key is missing. Does nothing if the key has a wrong value, because that error
    /// has been reported already.
    pub(crate) fn missing(&self, message: impl Into<String>, help: impl Into<String>) {
        if self.is_left_out() {
            self.wrong_key(message, help);
        }
    }

    /// Reports an error for each of these keys that the table has. `owner` is the kind of table that may have them, for
    /// example "an OPC UA server".
    pub(crate) fn not_applicable(&self, keys: &[&str], owner: &str, help: &str) {
        for key in keys.iter().filter(|key| self.has(key)) {
            self.key(key).wrong_key(format!("`{key}` is only for {owner}"), help);
        }
    }

    pub(crate) fn error(&self, error: ProfileError) {
        self.report.errors.borrow_mut().push(error);
    }

    /// Reports a warning at the value of this key.
    pub(crate) fn warn(&self, message: impl Into<String>, help: impl Into<String>) {
        let warning = self.report.spans.at_value(&self.path, message, Some(help.into()));
        self.report.warnings.borrow_mut().push(warning);
    }

    /// Warns if the private key or password in this file can be read by any user.
    pub(crate) fn secret(&self, name: Option<&String>) {
        if let Some(name) = name.filter(|name| self.report.files.is_open_to_all(name)) {
            let file = self.report.files.path(name);
            let message =
                format!("every user of this computer can read {file}, and use it to act as the gateway");
            self.warn(message, format!("remove the permission of other users: `chmod o= {file}`"));
        }
    }

    /// Reports a warning at the name of this key.
    pub(crate) fn warn_key(&self, message: impl Into<String>, help: Option<&str>) {
        let warning = self.report.spans.at_key(&self.path, message, help.map(str::to_owned));
        self.report.warnings.borrow_mut().push(warning);
    }

    /// Returns the index of the table with this name. If the table does not exist, reports an error and returns `None`.
    pub(crate) fn named(&self, names: &Names, name: Option<&String>) -> Option<usize> {
        let name = name?;
        if let Some(found) = names.place(name) {
            return Some(found);
        }
        // If the table exists but has errors, or is below a misspelt name, this has been reported.
        let (spans, path) = (self.report.spans, child(names.kind, name));
        if spans.contains(&path) || spans.is_meant(&path) {
            return None;
        }
        let mut absent = self.report.absent.borrow_mut();
        if let Some((_, others)) = absent.get_mut(&path) {
            *others += 1;
            return None;
        }
        if self.is_enough() {
            return None;
        }
        absent.insert(path, (self.report.errors.borrow().next_index(), 0));
        let help = allowed(name, names.iter().map(String::as_str));
        self.reject(format!("there is no {} named `{name}`", names.kind), help)
    }

    /// Returns the signal with this name and marks it as used. If the signal does not exist, reports an error and
    /// returns `None`.
    pub(crate) fn signal(&self, name: Option<&String>) -> Option<SignalId> {
        let found = SignalId(self.named(&self.report.signals, name)?);
        self.uses(found);
        Some(found)
    }

    /// Marks a signal as used. `isotherm check` lists the signals that nothing uses.
    pub(crate) fn uses(&self, signal: SignalId) {
        self.report.used.borrow_mut()[signal.0] = true;
    }

    /// Returns the unit of a signal. `None` if the signal has errors.
    pub(crate) fn unit_of(&self, signal: SignalId) -> Option<Unit> {
        self.report.units.borrow().get(signal.0).copied().flatten()
    }

    /// Returns the signal with this name. Reports an error if the signal does not exist, or is not a position in mm.
    pub(crate) fn position(&self, name: Option<&String>) -> Option<SignalId> {
        let position = self.signal(name)?;
        let name = name?;
        // A wrong unit has been reported.
        if let Some(Unit(unit)) = self.unit_of(position).filter(|unit| unit.0 != "mm") {
            let help = format!("write unit = \"mm\" and the scale in mm per count at signal `{name}`");
            self.invalid(format!("`{name}` is in \"{unit}\"; a position must be in mm"), help);
        }
        Some(position)
    }

    /// Returns whether this signal is a temperature: its unit is °C or K. `false` without a signal, or if its unit is
    /// unknown.
    pub(crate) fn is_temperature(&self, signal: Option<SignalId>) -> bool {
        let unit = signal.and_then(|id| self.unit_of(id));
        unit.is_some_and(|unit| matches!(unit.0, "degC" | "K"))
    }

    /// Returns the duration if it is longer than zero. Otherwise reports an error and returns `None`.
    pub(crate) fn duration(&self, raw: Option<Timespan>) -> Option<Duration> {
        let Timespan(span) = raw?;
        if span.is_zero() {
            return self.reject("a duration of zero is not allowed here", "write a longer one, as \"1s\"");
        }
        Some(span)
    }

    /// Returns the period of a read or write. If the period is too short, reports an error and returns `None`. Such a
    /// period would overload the bus and the computer.
    pub(crate) fn period(&self, raw: Option<Timespan>) -> Option<Duration> {
        let span = self.duration(raw)?;
        if span < SHORTEST_PERIOD {
            let (short, shortest) = (shown(span), shown(SHORTEST_PERIOD));
            let message =
                format!("a period of {short} is too short: the shortest allowed period is {shortest}");
            return self.reject(message, "no device answers this fast; write \"10ms\" or longer");
        }
        Some(span)
    }

    /// Returns the number if it is above zero. Otherwise reports an error and returns `None`.
    pub(crate) fn positive(&self, number: Option<f64>) -> Option<f64> {
        let number = number?;
        if number <= 0.0 {
            return self.reject(format!("{number} is not above zero"), "write a number above zero");
        }
        Some(number)
    }

    /// Returns the content of the file with this name. If the file cannot be read, reports an error and returns `None`.
    pub(crate) fn file(&self, name: &str, help: &str) -> Option<Vec<u8>> {
        self.report.files.read(name).map_err(|why| self.invalid(why, help)).ok()
    }
}
