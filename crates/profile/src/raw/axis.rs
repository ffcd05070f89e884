//! `[axis.*]`, `[[axis.*.model]]` and `[output.*]` as written.

use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::{
    ChannelValue, RawFrame, RawHandshake, RawPdo, RawProbe, RawRestart, Span, TypeWord, WordOrderWord,
};

/// One compensated axis.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Axis")]
pub(crate) struct RawAxis {
    /// Largest |Cz|, µm.
    #[schemars(required)]
    pub(crate) limit: Option<f64>,
    /// Largest change of one update, µm.
    #[schemars(required)]
    pub(crate) step: Option<f64>,
    /// Largest speed, µm/s.
    #[schemars(required)]
    pub(crate) rate: Option<f64>,
    /// A smaller change is not made, µm. Default 0.
    pub(crate) deadband: Option<f64>,
    /// Update period.
    #[schemars(required)]
    pub(crate) every: Option<Span>,
    /// What happens when no model or no output can be used.
    #[schemars(required)]
    pub(crate) on_fault: Option<FaultAction>,
    /// Told once when |Cz| passes it, µm; at most `limit`.
    pub(crate) warn: Option<f64>,
    /// A model that asks for more than this is not believed, µm; at least `limit`. The axis takes its fault action and
    /// stays off until it is armed.
    pub(crate) error: Option<f64>,
    /// zero: Cz is measured from what the model asked for at the last zero. Default: from the model's own zero.
    pub(crate) datum: Option<DatumWord>,
    /// A lathe's X: the offset acts on the diameter, Cz is doubled when written. Default false.
    pub(crate) diameter: Option<bool>,
    /// Measured errors correct the models.
    pub(crate) probe: Option<RawProbe>,
    /// Models in order of preference: the first whose signals are all good is used. None yet: `record` and `identify`
    /// find one, `run` refuses the axis.
    pub(crate) model: Option<Vec<RawModel>>,
}

/// What happens on a fault.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct FaultAction {
    /// hold: keep the last value; ramp: keep it for `after`, then to zero at `rate`; zero: to zero at once, `step` by `step`.
    #[schemars(required)]
    pub(crate) action: Option<FaultActionWord>,
    /// How long the last value is kept before the ramp; required for it.
    pub(crate) after: Option<Span>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum FaultActionWord {
    Hold,
    Ramp,
    Zero,
}

/// What Cz is measured from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum DatumWord {
    Zero,
}

/// One way to compute Cz.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Model")]
pub(crate) struct RawModel {
    /// For people: the page and the log say which model is used.
    #[schemars(required)]
    pub(crate) name: Option<String>,
    /// How it computes.
    #[schemars(required)]
    pub(crate) kind: Option<ModelKind>,
    /// linear: Cz where every rise is zero, µm. Default 0.
    pub(crate) offset: Option<f64>,
    /// linear: gains times temperature rises, added up.
    pub(crate) terms: Option<Vec<RawTerm>>,
    /// formula: Cz in µm, as "Kz * (A - (b*t + c))".
    pub(crate) formula: Option<String>,
    /// formula: names and the signals they stand for; matrix: one signal per block; network: the signals in its order.
    pub(crate) inputs: Option<Inputs>,
    /// formula: names and their numbers.
    pub(crate) constants: Option<BTreeMap<String, f64>>,
    /// linear: a second sum of terms that grows with the distance from a reference position, µm/mm.
    pub(crate) slope: Option<RawSlope>,
    /// matrix, network: the file with the coefficients.
    pub(crate) file: Option<String>,
    /// A file with the temperatures the model was identified on.
    pub(crate) envelope: Option<String>,
    /// What the axis does outside its envelope: warn: follow the model; hold: keep Cz; shrink: follow it less and less.
    pub(crate) outside: Option<OutsideWord>,
    /// matrix: the signal that tells where the axis is, mm.
    pub(crate) position: Option<String>,
    /// matrix, network: what rises are measured from: a number, "start" or "zero". A network's default is 0.
    pub(crate) reference: Option<ReferenceValue>,
    /// matrix: the component of the guideway's displacement along the axis, as it moves the axis to plus.
    pub(crate) component: Option<Component>,
    /// matrix: what the guideway carries: displaced to plus, a tool is too far in plus, the work too far in minus.
    pub(crate) carries: Option<Carries>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ModelKind {
    Linear,
    Formula,
    Matrix,
    Network,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum OutsideWord {
    Warn,
    Hold,
    Shrink,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
pub(crate) enum Component {
    #[serde(rename = "x")]
    X,
    #[serde(rename = "y")]
    Y,
    #[serde(rename = "z")]
    Z,
    #[serde(rename = "-x")]
    MinusX,
    #[serde(rename = "-y")]
    MinusY,
    #[serde(rename = "-z")]
    MinusZ,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Carries {
    Tool,
    Work,
}

/// Signals of a model: by name, or in order.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum Inputs {
    ByName(BTreeMap<String, String>),
    InOrder(Vec<InputValue>),
}

/// One input: a signal's name, or a table where it has a reference of its own.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum InputValue {
    Name(String),
    Table(RawInput),
}

/// One input of a matrix or a network.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "InputTable")]
pub(crate) struct RawInput {
    /// The signal.
    #[schemars(required)]
    pub(crate) signal: Option<String>,
    /// What its rise is measured from: a number, "start" or "zero". Default: the model's `reference`.
    pub(crate) reference: Option<ReferenceValue>,
    /// It lags behind the signal: time constant C of a first-order lag, 1 − e^(−t/C); needs a `reference`.
    pub(crate) lag: Option<Span>,
}

impl JsonSchema for InputValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Input".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        // The alternative itself, not a `$ref` to it: the walk chooses by the type it sees.
        let table = RawInput::json_schema(generator);
        schemars::json_schema!({ "anyOf": [{ "type": "string" }, table] })
    }
}

/// One gain times one temperature rise.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Term")]
pub(crate) struct RawTerm {
    /// The temperature.
    #[schemars(required)]
    pub(crate) signal: Option<String>,
    /// µm per unit of the signal; in a slope µm/mm per unit. Either this, or `expansion` and `length` (not in a slope).
    pub(crate) gain: Option<f64>,
    /// What the rise is measured from: a number (default 0: the temperature itself), "start" or "zero".
    pub(crate) reference: Option<ReferenceValue>,
    /// Time constant C of a first-order lag, 1 − e^(−t/C); needs a `reference`.
    pub(crate) lag: Option<Span>,
    /// Coefficient of linear expansion, 1/K.
    pub(crate) expansion: Option<f64>,
    /// Length that expands, mm.
    pub(crate) length: Option<f64>,
}

/// What a rise is measured from.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum ReferenceValue {
    Number(f64),
    Word(ReferenceWord),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ReferenceWord {
    Start,
    Zero,
}

impl JsonSchema for ReferenceValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Reference".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schemars::json_schema!({ "anyOf": [{ "type": "number" }, { "type": "string", "enum": ["start", "zero"] }] })
    }
}

/// Terms that grow with the position.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Slope")]
pub(crate) struct RawSlope {
    /// The signal that tells where the axis is, in mm.
    #[schemars(required)]
    pub(crate) position: Option<String>,
    /// Where the slope adds nothing, mm.
    #[schemars(required)]
    pub(crate) reference: Option<f64>,
    /// The ends of the axis's travel, mm; required where the control is given the slope: they bound its effect.
    pub(crate) travel: Option<[f64; 2]>,
    /// Gains in µm/mm per unit of the signal.
    #[schemars(required)]
    pub(crate) terms: Option<Vec<RawTerm>>,
}

/// One value that is written.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Output")]
pub(crate) struct RawOutput {
    /// Whose Cz.
    #[schemars(required)]
    pub(crate) axis: Option<String>,
    /// Where it goes.
    #[schemars(required)]
    pub(crate) device: Option<String>,
    /// What of the device's template is written: its register, type and scale.
    #[allow(dead_code, reason = "resolved before the profile is checked")]
    pub(crate) channel: Option<ChannelValue>,
    /// corrected: position + Cz; offset: Cz; intercept, slope, reference: K0 (µm), tanβ (µm/mm) and P0 (mm), for a
    /// control that applies K0 + tanβ·(P − P0) itself.
    #[schemars(required)]
    pub(crate) writes: Option<WritesWord>,
    /// corrected: the scale's signal, in mm.
    pub(crate) position: Option<String>,
    /// A holding register: "holding:104" or "40105".
    pub(crate) register: Option<String>,
    /// How the value lies in its registers or in its CANopen object; required for both.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// CANopen process data that is written: { cob_id = 0x20C, start = 0, length = 32, signed = true }.
    pub(crate) pdo: Option<RawPdo>,
    /// CANopen object that is written: "2000:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// CAN frame that is written: { id = 0x300, start = 0, length = 32, order = "little", signed = true }.
    pub(crate) frame: Option<RawFrame>,
    /// register: another register, in which the control says what it applies. pdo, frame: the CANopen object that reads what
    /// was written, of the same length: "6004:00"; required but for a display.
    pub(crate) read_back: Option<ReadBackValue>,
    /// Which register comes first; required for 32 bits and more.
    pub(crate) word_order: Option<WordOrderWord>,
    /// The two bytes inside every register are exchanged. Default false.
    pub(crate) byte_swap: Option<bool>,
    /// offset, intercept: µm per count; slope: µm/mm per count; corrected, reference: mm per count. Required for whole counts; default 1 for f32 and f64.
    pub(crate) scale: Option<f64>,
    /// Added to the raw count. Default 0.
    pub(crate) bias: Option<i64>,
    /// How a write is believed. Default "read-back".
    pub(crate) verify: Option<VerifyWord>,
    /// Written again after this long though unchanged.
    pub(crate) refresh: Option<Span>,
    /// Interlock, a condition on signals: otherwise held.
    pub(crate) when: Option<String>,
    /// whole: the register is ours; ledger: an operator's register, of which we own a share, kept in a ledger on disk. Default "whole".
    pub(crate) share: Option<ShareWord>,
    /// The set it belongs to: outputs of one device that the control sees together or not at all.
    pub(crate) set: Option<String>,
    /// A strobe and its acknowledgement around each write.
    pub(crate) handshake: Option<RawHandshake>,
    /// How a restart of the CNC is seen, besides the register going to zero.
    pub(crate) restart: Option<RawRestart>,
    /// The largest step that the control follows within `shortest_every`, µm; the axis's `step` must not be larger.
    pub(crate) largest_step: Option<f64>,
    /// The shortest time between two updates that the control follows; the axis's `every` must not be shorter.
    pub(crate) shortest_every: Option<Span>,
    /// corrected: words of a display that go beside the value, as its decimal point and its colour.
    pub(crate) beside: Option<Vec<RawBeside>>,
    /// corrected: what a display shows where there is no position to correct, or the axis is off.
    pub(crate) stale: Option<RawStale>,
}

/// What reads back an output: an object on CAN, a register on Modbus.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum ReadBackValue {
    Object(String),
    Register(RawReadBack),
}

/// The register in which a control says what it applies of an offset.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ReadBack")]
pub(crate) struct RawReadBack {
    /// An input or holding register: "input:12" or "30013".
    #[schemars(required)]
    pub(crate) register: Option<String>,
    /// How the value lies in its registers. Default: as the output's.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// Which register comes first. Default: as the output's.
    pub(crate) word_order: Option<WordOrderWord>,
    /// The two bytes inside every register are exchanged. Default: as the output's.
    pub(crate) byte_swap: Option<bool>,
    /// µm per count. Default: the output's.
    pub(crate) scale: Option<f64>,
    /// What it may be away from what was written, µm. Default: one count, the output's or its own, whichever is more.
    pub(crate) tolerance: Option<f64>,
    /// How long the control may take to apply a change. Default 1s.
    pub(crate) settle: Option<Span>,
}

impl JsonSchema for ReadBackValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "ReadBackPlace".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        // The alternative itself, not a `$ref` to it: the walk chooses by the type it sees.
        let table = RawReadBack::json_schema(generator);
        let object = serde_json::json!({ "type": "string", "pattern": "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$" });
        schemars::json_schema!({ "anyOf": [object, table] })
    }
}

/// One word of a display beside its value.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Beside")]
pub(crate) struct RawBeside {
    /// A holding register.
    #[schemars(required)]
    pub(crate) register: Option<String>,
    /// Always this word.
    pub(crate) value: Option<u16>,
    /// The number of decimals that `scale` has, times this.
    pub(crate) decimals: Option<u16>,
    /// The word while the axis follows its first model.
    pub(crate) good: Option<u16>,
    /// The word while it follows another one. Default: as `good`.
    pub(crate) degraded: Option<u16>,
    /// The word while it holds, ramps, is zeroed or off.
    pub(crate) fault: Option<u16>,
}

/// The text that stands for no value.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Stale")]
pub(crate) struct RawStale {
    /// The first holding register of the display's text.
    #[schemars(required)]
    pub(crate) register: Option<String>,
    /// The text, as "----".
    #[schemars(required)]
    pub(crate) text: Option<String>,
    /// Characters in one register: 1, or 2 with the first in the high byte. Default 2.
    #[schemars(range(min = 1, max = 2))]
    pub(crate) characters: Option<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum WritesWord {
    Corrected,
    Offset,
    Intercept,
    Slope,
    Reference,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum VerifyWord {
    ReadBack,
    Echo,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ShareWord {
    Whole,
    Ledger,
}
