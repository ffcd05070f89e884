//! Events about learned models: a better candidate, adoption, and the end of a learned model. A candidate is a newly
//! learned model of an axis that is compared with the model in use. Cz is the compensation value of the axis.

use serde::Serialize;

use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_core::quantity::Micron;
use isotherm_profile::counted;

/// Event about the learned model of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Adoption {
    /// The candidate is better than the model in use.
    Better {
        /// Name of the axis for which the candidate was learned.
        axis: String,
        /// Name of the candidate.
        model: String,
        /// First day on which the candidate was compared with the model in use.
        since: String,
        /// Number of days on which the candidate was compared with the model in use.
        days: usize,
        /// Number of touches (measurements with a probe) on the days of the comparison.
        touches: u32,
        /// Residual error with the model in use on the days of the comparison, as a root mean square.
        #[serde(rename = "in_use_um")]
        in_use: Micron,
        /// Residual error that the candidate would have left on the days of the comparison, as a root mean square.
        #[serde(rename = "candidate_um")]
        candidate: Micron,
        /// Whether the gateway adopts the candidate automatically at the next datum (zero point of Cz).
        auto: bool,
    },
    /// The preferred model of an axis has changed. Cz keeps its present value.
    Adopted {
        /// Name of the axis whose preferred model has changed.
        axis: String,
        /// Name of the learned model; `None` for the model of the profile.
        model: Option<String>,
        /// Name of the learned model that was preferred before; `None` for the model of the profile.
        before: Option<String>,
    },
    /// The models of the profile have changed, so that the learned model is not used any more.
    Superseded {
        /// Name of the axis whose learned model is not used any more.
        axis: String,
        /// Name of the learned model.
        model: String,
    },
    /// No model could be learned from the touches (measurements with a probe) of the axes.
    Failed {
        /// Reason why no model could be learned, as a part of a sentence.
        why: String,
    },
}

/// Returns the name of a model as text. `None` stands for the model of the profile.
fn named(model: Option<&String>) -> String {
    model.map_or_else(|| "the model of the profile".to_owned(), |name| format!("model {name}"))
}

impl Adoption {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Adoption::Better { axis, model, since, days, touches, in_use, candidate, auto } => {
                let next = match auto {
                    true => "the gateway adopts it at the next datum (zero point of Cz)",
                    false => "an operator may adopt it; Cz does not move",
                };
                let basis = format!("{}, touches: {touches}", counted(*days, "day"));
                plain(format!(
                    "axis {axis}: since {since}, model {model} would have left a residual error of {candidate} instead \
                     of {in_use} ({basis}); {next}"
                ))
                .of(EventKind::CandidateBetter)
            }
            Adoption::Adopted { axis, model, before } => {
                let (model, before) = (named(model.as_ref()), named(before.as_ref()));
                plain(format!("axis {axis}: follows {model} instead of {before}; Cz has not moved"))
                    .of(EventKind::ModelAdopted)
            }
            Adoption::Superseded { axis, model } => {
                let why = format!(
                    "the models in the profile have changed, so the learned model {model} is not used any more"
                );
                caused(format!("axis {axis}"), why).of(EventKind::ModelSuperseded)
            }
            Adoption::Failed { why } => caused("no model was learned", why).of(EventKind::LearningFailed),
        }
    }
}
