//! Parsing of conditions and formulas in a profile. Errors state the position in the text.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};

use super::KeyContext;
use crate::error::allowed;
use crate::source_map::child;
use isotherm_core::compensation::model::{Condition, Expression, ExpressionError, Formula, Symbol};
use isotherm_core::reading::SignalId;

/// Words of the expression language. They cannot be names of inputs or constants.
const WORDS: [&str; 9] = ["and", "or", "not", "abs", "exp", "ln", "sqrt", "min", "max"];

/// Parses the condition at this key. `of` is the signal that the condition marks as bad. `None` if the condition marks
/// no signal, for example at an output.
pub(super) fn condition(at: &KeyContext<'_>, text: Option<&String>, of: Option<&str>) -> Option<Condition> {
    let (text, signals) = (text?, &at.report.signals);
    let is_misspelt = Cell::new(false);
    let find = |name: &str| {
        let found = signals.place(name).map(SignalId);
        if found.is_none() && at.report.spans.is_meant(&child("signal", name)) {
            is_misspelt.set(true);
        }
        found
    };
    match Condition::parse(text, &find) {
        Ok(condition) => {
            for id in condition.signals() {
                at.uses(id);
                if of.is_some_and(|of| signals[id.0] == of) {
                    let help = "use a signal with a status bit of the device; to reject values of this \
                                signal, write `range` or `bad`";
                    at.invalid("the signal must not be in its own condition", help);
                }
            }
            Some(condition)
        }
        // The table of a signal has a misspelt name, which has been reported.
        Err(_) if is_misspelt.get() => None,
        Err(why) => {
            in_text(at, text, &why, signals.iter().map(String::as_str));
            None
        }
    }
}

/// Parses the formula of a model over its inputs, its constants and the time since machine start.
pub(super) fn formula(
    at: &KeyContext<'_>,
    text: &str,
    inputs: &BTreeMap<String, String>,
    constants: &BTreeMap<String, f64>,
) -> Option<Formula> {
    let mut symbols = BTreeMap::new();
    for (name, signal) in inputs {
        let at = at.key("inputs").key(name);
        check_symbol(&at, name);
        // An unknown signal has been reported. The formula is parsed nevertheless.
        let id = at.signal(Some(signal)).unwrap_or(SignalId(0));
        symbols.insert(name.as_str(), Symbol::Signal(id));
    }
    for (name, number) in constants {
        let at = at.key("constants").key(name);
        check_symbol(&at, name);
        if symbols.insert(name.as_str(), Symbol::Constant(*number)).is_some() {
            at.wrong_key(format!("`{name}` is also an input"), "give the input or the constant another name");
        }
    }
    symbols.entry("t").or_insert(Symbol::Time);
    let seen = RefCell::new(BTreeSet::new());
    let find = |name: &str| {
        seen.borrow_mut().insert(name.to_owned());
        // A name with a wrong value has been reported. The rest of the formula is parsed nevertheless.
        let is_wrong = || ["inputs", "constants"].iter().any(|table| at.key(table).key(name).is_written());
        symbols.get(name).copied().or_else(|| is_wrong().then_some(Symbol::Constant(0.0)))
    };
    match Expression::parse(text, &find) {
        Ok(expression) => {
            let seen = seen.into_inner();
            let given = inputs.keys().map(|name| ("inputs", name));
            for (table, name) in given.chain(constants.keys().map(|name| ("constants", name))) {
                if !seen.contains(name) {
                    let help = format!("use `{name}` in the formula `{text}`, or remove `{name}`");
                    at.key(table).key(name).wrong_key(format!("the formula does not use `{name}`"), help);
                }
            }
            Some(Formula { expression })
        }
        Err(why) => {
            in_text(&at.key("formula"), text, &why, symbols.keys().copied());
            None
        }
    }
}

fn check_symbol(at: &KeyContext<'_>, name: &str) {
    if name == "t" {
        let help = "`t` is always the time since machine start in seconds: choose another name";
        at.wrong_key("`t` is a reserved name", help);
    }
    let begins = name.chars().next().is_some_and(|first| first.is_alphabetic() || first == '_');
    let is_plain = name.chars().all(|c| c.is_alphanumeric() || c == '_');
    if !begins || !is_plain || WORDS.contains(&name) {
        let help = "a name begins with a letter and contains letters, digits and `_`; words such as `min` \
                    and `or` are reserved";
        at.wrong_key(format!("`{name}` cannot be a name in a formula"), help);
    }
}

fn in_text<'n>(at: &KeyContext<'_>, text: &str, why: &ExpressionError, known: impl Iterator<Item = &'n str>) {
    let rest = text.get(why.at..).unwrap_or_default();
    let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let is_unknown = why.message.contains("is not known");
    let help = is_unknown.then(|| allowed(&rest[..end], known));
    at.error(at.report.spans.inside(&at.path, text, why.at, why.message.clone(), help));
}
