//! Inputs of models: the signals, given by name or in the order of a file, the references of their rises, and their
//! lags.

use std::collections::BTreeMap;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::duration::{Timespan, shown};
use crate::schema_of::schema_of;
use crate::tables::KeyContext;
use isotherm_core::compensation::model::{Input, Reference};
use isotherm_core::quantity::Celsius;

/// Longest allowed time constant of a lag: one week. The effect of a longer lag would not be visible within a shift.
pub(super) const LONGEST_LAG: Duration = Duration::from_hours(7 * 24);

/// Signals of a model, by name or in order.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum Inputs {
    ByName(BTreeMap<String, String>),
    InOrder(Vec<InputValue>),
}

/// Input of a model: the name of a signal, or a table if the input has its own reference or lag.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Input", description = "")]
pub(super) enum InputValue {
    Name(String),
    Table(RawInput),
}

/// Input of a matrix or a network.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// Inlined, because the schema check selects an alternative by its type, which a `$ref` hides.
#[schemars(rename = "InputTable", inline)]
pub(super) struct RawInput {
    /// Signal of the input.
    #[schemars(required)]
    signal: Option<String>,
    /// Reference from which the rise of the input is measured: a number, "start" or "zero". Default: `reference` of the
    /// model.
    reference: Option<ReferenceValue>,
    /// Time constant C of a first-order lag behind the signal. After the time t, the input has followed a step of the
    /// signal by the part 1 − e^(−t/C). Needs a `reference`.
    lag: Option<Timespan>,
}

/// Reference from which a rise is measured.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum ReferenceValue {
    Number(Celsius),
    Word(ReferenceWord),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum ReferenceWord {
    Start,
    Zero,
}

schema_of!(ReferenceValue as "Reference": { "anyOf": [{ "type": "number" }, { "type": "string", "enum": ["start", "zero"] }] });

impl ReferenceValue {
    pub(super) fn is_zero(self) -> bool {
        matches!(self, ReferenceValue::Word(ReferenceWord::Zero))
    }
}

impl From<ReferenceValue> for Reference {
    fn from(value: ReferenceValue) -> Reference {
        match value {
            ReferenceValue::Number(number) => Reference::Fixed(number),
            ReferenceValue::Word(ReferenceWord::Start) => Reference::Start,
            ReferenceValue::Word(ReferenceWord::Zero) => Reference::Zero,
        }
    }
}

impl Inputs {
    /// Returns whether any input of the list has the reference "zero". `of_model` is the `reference` of the model,
    /// which applies to inputs without a reference of their own.
    pub(super) fn are_at_zero(&self, of_model: Option<ReferenceValue>) -> bool {
        let Inputs::InOrder(inputs) = self else { return false };
        let own = inputs.iter().filter_map(|input| match input {
            InputValue::Name(_) => None,
            InputValue::Table(input) => input.reference,
        });
        own.chain(of_model).any(ReferenceValue::is_zero)
    }
}

/// Returns the inputs in the order of the list, with the names of their signals. `default` is the reference of inputs
/// without a reference of their own. If `default` is `None`, an input without a reference is an error.
pub(super) fn in_order<'r>(
    (raw, reference): (Option<&'r Inputs>, Option<ReferenceValue>),
    at: &KeyContext<'_>,
    default: Option<Reference>,
) -> Option<(Vec<Input>, Vec<&'r str>)> {
    let list = at.key("inputs");
    let inputs = match raw? {
        Inputs::InOrder(inputs) => inputs,
        Inputs::ByName(_) => {
            let help = "write inputs = [ \"bed\", \"column\" ], in the order of the file";
            return list.reject("this model needs its signals in an order, but they are given by name", help);
        }
    };
    if inputs.is_empty() {
        return list.reject(
            "a model without inputs follows no temperature",
            "write at least one signal in `inputs`",
        );
    }
    let of_model = reference.map(Reference::from).or(default);
    let (mut found, mut names, mut lacks_reference) = (Vec::new(), Vec::new(), false);
    for (place, input) in inputs.iter().enumerate() {
        let item = list.item(place);
        let (name, own, own_lag) = match input {
            InputValue::Name(name) => (Some(name), None, None),
            InputValue::Table(table) => (table.signal.as_ref(), table.reference, table.lag),
        };
        // Without a default, a missing reference is reported once for all inputs.
        let has_reference =
            default.is_none() || own.or(reference).is_some() || at.key("reference").is_written();
        let lag = lag(&item, own_lag, has_reference);
        let Some(name) = name else { continue };
        names.push(name.as_str());
        let signal = item.signal(Some(name));
        let reference = own.map(Reference::from).or(of_model);
        lacks_reference |= reference.is_none();
        let input = signal.zip(reference).zip(lag);
        found.extend(input.map(|((signal, reference), lag)| Input::of(signal, reference, lag)));
    }
    if lacks_reference {
        let help = "write reference = \"start\", \"zero\", or the temperature in °C from which the rises are \
                    measured";
        at.key("reference")
            .missing("`reference` is missing: a matrix needs the reference of each rise", help);
    }
    (found.len() == inputs.len()).then_some((found, names))
}

/// Resolves the lag of a term or an input. An input with a lag must have a reference. Returns `Some(None)` if the
/// profile states no lag, and `None` if the lag is invalid.
pub(super) fn lag(
    at: &KeyContext<'_>,
    raw: Option<Timespan>,
    has_reference: bool,
) -> Option<Option<Duration>> {
    if raw.is_none() {
        return Some(None);
    }
    if !has_reference {
        let help = "write reference = \"start\", \"zero\", or the temperature in °C at which the structure \
                    has no thermal growth";
        let message = "`reference` is missing: a value with `lag` begins at its reference";
        at.key("reference").missing(message, help);
    }
    let lag = at.key("lag").duration(raw)?;
    if lag > LONGEST_LAG {
        let help = "a structure with this lag hardly changes within a shift: remove the term, or check the \
                    unit of `lag`";
        at.key("lag").invalid(format!("{} is longer than a week", shown(lag)), help);
    }
    Some(Some(lag))
}
