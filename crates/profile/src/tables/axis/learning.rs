//! Learning of an axis's model from measured errors: keys of the table `probe`, and the resolved settings.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::tables::KeyContext;
use isotherm_core::candidate::Policy;
use isotherm_core::reading::SignalId;

/// Name of the learned model, on the web page and in the log.
pub const LEARNED: &str = "learned";

/// Schedule on which the gateway learns a model.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum LearnWord {
    Daily,
}

/// Whether an operator or the gateway adopts a learned model that is better than the model in use.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum AdoptWord {
    Propose,
    Auto,
}

/// Learning of an axis's model from its measured errors, once a day.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Learning {
    /// Signals that the learned model must not use.
    pub without: Vec<SignalId>,
    /// Whether an operator or the gateway adopts a learned model that is better than the model in use.
    pub adopt: Policy,
}

/// Keys of the table `probe` that concern learning, as the profile states them.
pub(super) struct LearningKeys<'a> {
    pub(super) learn: Option<LearnWord>,
    pub(super) learn_without: Option<&'a [String]>,
    pub(super) adopt: Option<AdoptWord>,
    /// Whether the table `probe` also adjusts the gains of the models (key `gains`), which excludes learning.
    pub(super) adjusts_gains: bool,
}

impl LearningKeys<'_> {
    /// Resolves the keys for learning. Returns `Some(None)` if the axis does not learn, and `None` if a key has an
    /// error.
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<Option<Learning>> {
        let without = self.learn_without.unwrap_or_default();
        let list = at.key("learn_without");
        let resolved: Vec<Option<SignalId>> =
            without.iter().enumerate().map(|(index, name)| list.item(index).signal(Some(name))).collect();
        let Some(LearnWord::Daily) = self.learn else {
            let own = [("adopt", self.adopt.is_some()), ("learn_without", self.learn_without.is_some())];
            for (key, _) in own.iter().filter(|(_, is_written)| *is_written) {
                let help = format!("write learn = \"daily\", or remove `{key}`");
                at.key(key).wrong_key(format!("`{key}` has no effect without `learn`"), help);
            }
            return Some(None);
        };
        if !cfg!(feature = "learn") {
            let help = "use a packaged program, or build one that learns: `cargo build --release --features identify`";
            at.key("learn").invalid("this program was built without learning", help);
        }
        if self.adjusts_gains {
            let help = "remove `gains`: learning changes all gains together, and tests the result before it \
                        is adopted";
            at.key("learn").invalid("`gains` and `learn` would both change the gains of the models", help);
        }
        let adopt = match self.adopt {
            None | Some(AdoptWord::Propose) => Policy::Propose,
            Some(AdoptWord::Auto) => Policy::Auto,
        };
        Some(Some(Learning { without: resolved.into_iter().collect::<Option<_>>()?, adopt }))
    }
}
