//! `envelope` and `outside` of a model: the range of input values on which the model was identified, and the gateway's
//! action outside of this range.
//!
//! ```json
//! { "format": "isotherm-envelope", "version": 1, "reach": 3.4, "covariance": [[4.0, 1.2], [1.2, 2.5]],
//!   "inputs": [{ "signal": "bed", "mean": 24.1, "min": 20.0, "max": 30.5 }, …] }
//! ```
//! Values are in the unit of each signal, minus its `reference` (a number, default 0, "start" or "zero"). `reach` is
//! the largest Mahalanobis distance inside the envelope. Its default covers 99 % of a normal distribution.

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::effect::{figure, rise};
use super::file::{bytes, read, taken};
use super::half_models;
use super::inputs::ReferenceValue;
use super::raw::{OutsideWord, RawModel};
use crate::error::allowed;
use crate::tables::signal::Signal;
use crate::tables::{KeyContext, optional};
use isotherm_core::compensation::model::envelope::{BadEnvelope, Identified, MOST};
use isotherm_core::compensation::model::{Envelope, Input, Model, Outside, Reference};
use isotherm_core::quantity::Celsius;

/// Content of an envelope file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvelopeFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    reach: Option<f64>,
    inputs: Vec<KnownInput>,
    covariance: Vec<Vec<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownInput {
    signal: String,
    reference: Option<ReferenceValue>,
    mean: f64,
    min: f64,
    max: f64,
}

impl EnvelopeFile {
    /// Describes an error of the envelope file in a sentence that names the inputs.
    fn why(&self, wrong: BadEnvelope) -> String {
        let name = |place: usize| self.inputs.get(place).map_or("", |input| input.signal.as_str());
        match wrong {
            BadEnvelope::Count => {
                format!("the envelope has {} inputs; 1 to {MOST} are allowed", self.inputs.len())
            }
            BadEnvelope::Size => format!(
                "the covariance has {} rows of {} columns; {} inputs need as many rows and columns",
                self.covariance.len(),
                self.covariance.first().map_or(0, Vec::len),
                self.inputs.len()
            ),
            BadEnvelope::Range(place) => {
                format!(
                    "{}: `mean` must be between `min` and `max`, and `min` and `max` must differ",
                    name(place)
                )
            }
            BadEnvelope::NotSymmetric(first, second) => format!(
                "the covariance is not symmetric: the number for ({}, {}) differs from the number for ({}, \
                 {})",
                name(first),
                name(second),
                name(second),
                name(first)
            ),
            BadEnvelope::NotPositiveDefinite(place) => format!(
                "the covariance is not positive definite: input {} does not vary, or depends on inputs that \
                 are listed before it",
                name(place)
            ),
            BadEnvelope::Reach => "`reach` must be above zero".to_owned(),
        }
    }
}

/// Resolves the envelope of a model. Returns `Some(None)` if the model has no envelope. `model` is the model without
/// its envelope, or `None` if the model has errors.
pub(super) fn resolve(
    raw: &RawModel,
    at: &KeyContext<'_>,
    model: Option<&Model>,
) -> Option<Option<Envelope>> {
    let place = at.key("envelope");
    let Some(name) = raw.envelope.as_deref() else {
        let of_it = [("outside", raw.outside.is_some()), ("halves", raw.halves.is_some())];
        for (key, _) in of_it.into_iter().filter(|(_, named)| *named && !place.is_written()) {
            let help = format!("write the path of the envelope file in `envelope`, or remove `{key}`");
            at.key(key).wrong_key("this key needs `envelope`, which is missing", help);
        }
        return Some(None);
    };
    let (seals, halves) = (raw.sha256.as_ref(), at.key("halves"));
    let apart = optional(raw.halves.as_deref(), |name| half_models::resolve(seals, &halves, name, model?));
    let bytes = bytes(seals, "envelope", &place, name)?;
    let file: EnvelopeFile = taken(&place, name, read(&bytes, "isotherm-envelope"))?;
    let signals = model?.signals();
    let names = &at.report.signals;
    let mut known = Vec::new();
    for input in &file.inputs {
        let Some(signal) = signals.iter().copied().find(|id| names[id.0] == input.signal) else {
            let help = allowed(&input.signal, signals.iter().map(|id| names[id.0].as_str()));
            let message =
                format!("{name}: input `{}` of this file is not a signal of the model", input.signal);
            return place.reject(message, help);
        };
        let reference = input.reference.map_or(Reference::Fixed(Celsius::ZERO), Reference::from);
        let input_of = Input::of(signal, reference, None);
        known.push(Identified { input: input_of, mean: input.mean, range: (input.min, input.max) });
    }
    if raw.outside == Some(OutsideWord::Agree) && raw.halves.is_none() {
        let message = "outside = \"agree\" needs `halves`: without `halves`, the gateway follows the model \
                       outside the envelope, as with \"warn\"";
        at.key("outside").warn(
            message,
            "write the path of the half models in `halves`, or write outside = \"warn\", \"hold\" or \
             \"shrink\"",
        );
    }
    let outside = match (raw.outside, &apart) {
        // Without halves nothing can agree.
        (Some(OutsideWord::Warn), _) | (Some(OutsideWord::Agree) | None, Some(None)) => Outside::Warn,
        (Some(OutsideWord::Agree) | None, _) => Outside::Agree,
        (Some(OutsideWord::Hold), _) => Outside::Hold,
        (Some(OutsideWord::Shrink), _) => Outside::Shrink,
    };
    let envelope = Envelope::new(known, &file.covariance, file.reach, outside);
    let envelope = taken(&place, name, envelope.map_err(|wrong| file.why(wrong)));
    Some(Some(envelope?.of_halves(apart?.unwrap_or_default())))
}

/// Describes the envelope of a model, and the gateway's action outside of the envelope.
pub(super) fn preview(signals: &[Signal], envelope: &Envelope) -> String {
    let range = |known: &Identified| {
        let signal = &signals[known.input.signal.0];
        let (min, max) = known.range;
        format!("{} {} … {} {}", rise(signals, &known.input), figure(min), figure(max), signal.unit)
    };
    let ranges: Vec<String> = envelope.inputs().iter().map(range).collect();
    let outside = match envelope.outside() {
        Outside::Warn => "outside, the gateway warns and follows the model",
        Outside::Hold => "outside, Cz is kept",
        Outside::Shrink => "outside, the gateway reduces Cz more as the distance from the envelope increases",
        Outside::Agree => "outside, Cz follows the model as far as its two halves agree",
    };
    format!(
        "identified on {}, up to a Mahalanobis distance of {:.2} from their mean; {outside}",
        ranges.join(", "),
        envelope.reach()
    )
}
