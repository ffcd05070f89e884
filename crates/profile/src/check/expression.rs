//! Conditions and formulas: errors point into the text.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::Check;
use crate::error::allowed;
use crate::place::child;
use isotherm_core::compensation::model::{Condition, Expression, ExpressionError, Formula, Symbol};
use isotherm_core::reading::SignalId;

/// What an expression understands by itself.
const WORDS: [&str; 9] = ["and", "or", "not", "abs", "exp", "ln", "sqrt", "min", "max"];

impl Check<'_> {
    /// A condition over signals; `of` is the signal that it condemns.
    pub(super) fn condition(&mut self, path: &str, text: &str, of: Option<&str>) -> Option<Condition> {
        let parsed = Condition::parse(text, &|name: &str| self.signals.position(name).map(SignalId));
        match parsed {
            Ok(condition) => {
                for id in condition.signals() {
                    self.used[id.0] = true;
                    if of.is_some_and(|of| self.signals.names[id.0] == of) {
                        let help = "name the status bit of the device; for the value itself there are `range` and `bad`";
                        self.wrong(path, "the signal would judge itself", help);
                    }
                }
                Some(condition)
            }
            Err(why) => {
                let names = self.signals.names.clone();
                self.in_text(path, text, &why, names.iter().map(String::as_str));
                None
            }
        }
    }

    /// A formula over its inputs, its constants and machine-on time.
    pub(super) fn formula(
        &mut self,
        path: &str,
        text: &str,
        inputs: &BTreeMap<String, String>,
        constants: &BTreeMap<String, f64>,
    ) -> Option<Formula> {
        let mut symbols = BTreeMap::new();
        for (name, signal) in inputs {
            let at = child(&child(path, "inputs"), name);
            self.symbol_name(&at, name);
            // An unknown signal is an error by now; the formula itself can still be read.
            let id = self.signal(&at, signal).unwrap_or(SignalId(0));
            symbols.insert(name.as_str(), Symbol::Signal(id));
        }
        for (name, number) in constants {
            let at = child(&child(path, "constants"), name);
            self.symbol_name(&at, name);
            if symbols.insert(name.as_str(), Symbol::Constant(*number)).is_some() {
                self.wrong_key(&at, format!("`{name}` is an input, too"), "give one of them another name");
            }
        }
        symbols.entry("t").or_insert(Symbol::Time);
        let places = self.places;
        let seen = RefCell::new(BTreeSet::new());
        let find = |name: &str| {
            seen.borrow_mut().insert(name.to_owned());
            // One that is there but wrong has been reported: the rest of the formula can still be read.
            let wrong = ["inputs", "constants"]
                .iter()
                .any(|table| places.contains(&child(&child(path, table), name)));
            symbols.get(name).copied().or(wrong.then_some(Symbol::Constant(0.0)))
        };
        let formula = child(path, "formula");
        match Expression::parse(text, &find) {
            Ok(expression) => {
                let seen = seen.into_inner();
                let given = inputs.keys().map(|name| ("inputs", name));
                for (table, name) in given.chain(constants.keys().map(|name| ("constants", name))) {
                    if !seen.contains(name) {
                        let at = child(&child(path, table), name);
                        let help = format!("the formula is `{text}`: use `{name}` in it, or remove it");
                        self.wrong_key(&at, format!("the formula does not use `{name}`"), help);
                    }
                }
                Some(Formula { expression })
            }
            Err(why) => {
                self.in_text(&formula, text, &why, symbols.keys().copied());
                None
            }
        }
    }

    fn symbol_name(&mut self, path: &str, name: &str) {
        if name == "t" {
            let help = "`t` is machine-on time in seconds, always there: choose another name";
            self.wrong_key(path, "`t` is taken", help);
        }
        let begins = name.chars().next().is_some_and(|first| first.is_alphabetic() || first == '_');
        let plain = name.chars().all(|c| c.is_alphanumeric() || c == '_');
        if !begins || !plain || WORDS.contains(&name) {
            let help = "a name begins with a letter and goes on with letters, digits and `_`";
            self.wrong_key(path, format!("`{name}` cannot stand in a formula"), help);
        }
    }

    fn in_text<'n>(
        &mut self,
        path: &str,
        text: &str,
        why: &ExpressionError,
        known: impl Iterator<Item = &'n str>,
    ) {
        let rest = text.get(why.at..).unwrap_or_default();
        let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let name = &rest[..end];
        let unknown = why.message.contains("is not known");
        let help = unknown.then(|| allowed(name, known));
        self.errors.push(self.places.inside(path, text, why.at, why.message.clone(), help));
    }
}
