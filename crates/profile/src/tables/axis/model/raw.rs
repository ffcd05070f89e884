//! Keys of a model, as the profile contains them.

use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::expected::RawExpected;
use super::identified_with::RawIdentifiedWith;
use super::inputs::{Inputs, ReferenceValue};
use super::seals::RawSeals;
use crate::duration::Timespan;

// Words for the kinds in the key `kind`.
pub(super) const LINEAR: &str = "linear";
pub(super) const FORMULA: &str = "formula";
pub(super) const MATRIX: &str = "matrix";
pub(super) const NETWORK: &str = "network";

/// Calculation of Cz from signals.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Model")]
pub(crate) struct RawModel {
    /// Name of the model, shown on the web page and in the log.
    #[schemars(required)]
    pub(in crate::tables::axis) name: Option<String>,
    /// Kind of model: "linear" (sum of terms), "formula", "matrix" or "network".
    #[schemars(required, schema_with = "kinds")]
    pub(super) kind: Option<String>,
    /// Only for kind = "linear": Cz in µm if every rise is zero. Default 0.
    pub(super) offset: Option<f64>,
    /// Only for kind = "linear": list of terms, each a gain times a temperature rise. Cz is their sum.
    pub(super) terms: Option<Vec<RawTerm>>,
    /// Only for kind = "formula": Cz in µm, for example "Kz * (A - (b*t + c))".
    pub(super) formula: Option<String>,
    /// Signals of the model. For kind = "formula": by their names in the formula. For "matrix": one temperature signal
    /// for each block (part of the machine). For "network": in the order of the network's inputs.
    pub(super) inputs: Option<Inputs>,
    /// Only for kind = "formula": constants by their names in the formula.
    pub(super) constants: Option<BTreeMap<String, f64>>,
    /// Only for kind = "linear": second sum of terms, in µm/mm. It is multiplied by the distance of the axis from a
    /// reference position.
    pub(super) slope: Option<RawSlope>,
    /// Only for kind = "matrix" or "network": file with the coefficients. An ONNX file may have external data in its
    /// directory.
    pub(super) file: Option<String>,
    /// File with the range of temperatures on which the model was identified.
    pub(super) envelope: Option<String>,
    /// Settings of the identification; `isotherm identify` writes them.
    pub(super) identified_with: Option<RawIdentifiedWith>,
    /// Action outside of the envelope. "agree" follows the model as far as its two halves agree (default). "warn" warns
    /// and follows the model. "hold" keeps Cz. "shrink" follows the model less with increasing distance.
    pub(super) outside: Option<OutsideWord>,
    /// Only for kind = "linear": file with the two halves of the model, which are sums of terms whose mean is the
    /// model. `isotherm identify` writes the file. Without the file, "agree" acts as "warn".
    pub(super) halves: Option<String>,
    /// Expected error, from runs that the identification did not use. `isotherm identify` writes this key, and the web
    /// page shows the error next to Cz.
    pub(super) expected: Option<RawExpected>,
    /// File that relates the sensors to each other. With the file, the gateway detects a frozen sensor, and calculates
    /// the reading of a frozen or lost sensor.
    pub(super) stand_ins: Option<String>,
    /// SHA-256 of each file of the model, under the name of the key that names the file. A changed file is rejected.
    /// `isotherm identify` writes these keys.
    pub(super) sha256: Option<RawSeals>,
    /// Only for kind = "matrix": signal with the position of the axis, mm.
    pub(super) position: Option<String>,
    /// Only for kind = "matrix" or "network": reference from which rises are measured: a number, "start" or "zero".
    /// Default for a network: 0.
    pub(super) reference: Option<ReferenceValue>,
    /// Only for kind = "matrix": direction of the guideway's displacement that moves the axis in the positive
    /// direction.
    pub(super) component: Option<Component>,
    /// Only for kind = "matrix": part that the guideway carries. A positive displacement of the tool is a positive
    /// error. A positive displacement of the workpiece is a negative error.
    pub(super) carries: Option<Carries>,
}

fn kinds(_: &mut SchemaGenerator) -> Schema {
    schemars::json_schema!({ "type": "string", "enum": [LINEAR, FORMULA, MATRIX, NETWORK] })
}

impl RawModel {
    pub(in crate::tables::axis) fn may_be_linear(&self) -> bool {
        self.kind.as_deref().is_none_or(|kind| kind == LINEAR)
    }

    /// Returns whether a term has the reference "zero": its rise is measured from the temperature at the last zero
    /// command.
    pub(in crate::tables::axis) fn has_term_at_zero(&self) -> bool {
        let of_slope = self.slope.iter().flat_map(RawSlope::terms);
        self.terms.iter().flatten().chain(of_slope).any(RawTerm::is_at_zero)
    }

    /// Returns whether an input has the reference "zero": its rise is measured from the value at the last zero command.
    pub(in crate::tables::axis) fn has_input_at_zero(&self) -> bool {
        self.inputs.as_ref().is_some_and(|inputs| inputs.are_at_zero(self.reference))
    }
}

/// Gain times a temperature rise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Term")]
pub(super) struct RawTerm {
    /// Temperature signal.
    #[schemars(required)]
    pub(super) signal: Option<String>,
    /// Gain in µm per unit of the signal, or per unit² with power = 2. In a slope, µm/mm. The alternative is
    /// `expansion` with `length`, but not in a slope.
    pub(super) gain: Option<f64>,
    /// Reference from which the rise is measured. A number such as 20.0 is the signal's value at which the structure
    /// has its cold geometry. "start" is the value at machine start, "zero" the value at the last zero command. With
    /// 0.0, the rise is the value itself.
    #[schemars(required)]
    pub(super) reference: Option<ReferenceValue>,
    /// Time constant C of a first-order lag behind the signal. After the time t, the term has followed a step of the
    /// signal by the part 1 − e^(−t/C).
    pub(super) lag: Option<Timespan>,
    /// Power of the value, 1 or 2. With 2, the square of the reference is subtracted from the square of the value, for
    /// example for a spindle speed. Default 1.
    pub(super) power: Option<i64>,
    /// Coefficient of linear expansion, 1/K.
    pub(super) expansion: Option<f64>,
    /// Length that expands, mm.
    pub(super) length: Option<f64>,
}

/// Terms of Cz that are multiplied by the distance of the axis from a reference position.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Slope")]
pub(super) struct RawSlope {
    /// Signal with the position of the axis, mm.
    #[schemars(required)]
    pub(super) position: Option<String>,
    /// Position at which the slope adds nothing, mm.
    #[schemars(required, extend("x-layers" = "arrives"))]
    pub(super) reference: Option<f64>,
    /// Ends of the axis's travel, mm. They limit the effect of the slope. Required if the control receives the slope.
    #[schemars(extend("x-layers" = "arrives"))]
    pub(super) travel: Option<[f64; 2]>,
    /// Terms with gains in µm/mm per unit of the signal.
    #[schemars(required)]
    pub(super) terms: Option<Vec<RawTerm>>,
}

impl RawTerm {
    pub(super) fn is_at_zero(&self) -> bool {
        self.reference.is_some_and(ReferenceValue::is_zero)
    }
}

impl RawSlope {
    pub(super) fn terms(&self) -> impl Iterator<Item = &RawTerm> {
        self.terms.iter().flatten()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum OutsideWord {
    Agree,
    Warn,
    Hold,
    Shrink,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
pub(super) enum Component {
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
pub(super) enum Carries {
    Tool,
    Work,
}
