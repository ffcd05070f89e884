//! Detection of harmful models. With a harmful model, the error range is larger than without compensation on
//! too many held-out runs. Such a model is rejected if there are enough runs. Otherwise, a warning is added.

use super::{Fallback, Identified};
use crate::validate::Means;

/// Largest permitted share of held-out runs that are worse with the model than without compensation.
const MOST_WORSE: f64 = 1.0 / 3.0;
/// Minimum number of held-out runs with which a model may be rejected. With fewer runs, only a warning is added.
const ENOUGH_RUNS: usize = 6;

impl Identified {
    /// Returns a message with the reason why the model must not be written to the profile, and what to do. `None` if
    /// the model may be written, or if there is no model.
    pub fn refusal(&self) -> Option<String> {
        let means = self.unprobed();
        let is_refused = self.is_assessed() && is_harmful(&means) && !self.learned.inputs().is_empty();
        is_refused.then(|| {
            format!(
                "{}; at most a third is allowed. Find out what was different on these days, and record more \
                 days like these. Or leave inputs out with --without. With --force, the model is written \
                 nevertheless",
                self.leaves_worse("the model", &means)
            )
        })
    }

    /// Removes the fallback models for lost sensors that are worse than no compensation on too many runs. Also returns
    /// a message about each removed model.
    #[must_use]
    pub fn without_harmful_fallbacks(mut self) -> (Identified, Vec<String>) {
        if !self.is_assessed() {
            return (self, Vec::new());
        }
        let harmful = self.fallbacks.iter().filter(|fallback| is_harmful(&fallback.means));
        let sentence = |fallback: &Fallback| {
            let model = format!("the fallback model without {}", fallback.without);
            format!("{}: this model is not written", self.leaves_worse(&model, &fallback.means))
        };
        let sentences: Vec<String> = harmful.map(sentence).collect();
        self.fallbacks.retain(|fallback| !is_harmful(&fallback.means));
        (self, sentences)
    }

    /// Returns a warning about each harmful model if there are too few runs to reject it.
    pub(super) fn warnings(&self) -> Vec<String> {
        if self.is_assessed() {
            return Vec::new();
        }
        let means = self.unprobed();
        let own = [("the model".to_owned(), &means)];
        let fallbacks = self.fallbacks.iter();
        let fallbacks = fallbacks
            .map(|fallback| (format!("the fallback model without {}", fallback.without), &fallback.means));
        let harmful = own.into_iter().chain(fallbacks).filter(|(_, means)| is_harmful(means));
        let warning = |(model, means): (String, &Means)| {
            format!(
                "{}; if there were {ENOUGH_RUNS} or more held-out runs, this model would not be written",
                self.leaves_worse(&model, means)
            )
        };
        harmful.map(warning).collect()
    }

    /// Returns whether there are enough held-out runs to reject a model.
    fn is_assessed(&self) -> bool {
        self.runs.len() >= ENOUGH_RUNS
    }

    /// Returns the means of the held-out results without a simulated probe. The corrections of a probe would hide that
    /// a model is harmful, and an axis with this model may have no probe.
    fn unprobed(&self) -> Means {
        Means::unprobed(&self.held_out)
    }

    fn leaves_worse(&self, model: &str, means: &Means) -> String {
        let runs = self.runs.len();
        let probe = if self.probe_s.is_some() { " (without the probe)" } else { "" };
        format!(
            "with {model}, {:.0} % of {runs} held-out runs are worse than without compensation{probe}",
            100.0 * means.worse_share
        )
    }
}

/// Returns whether the error range with a model is larger than without compensation in more than
/// [`MOST_WORSE`] of the held-out runs. Without held-out runs, the share is NaN, and the result is `false`.
fn is_harmful(means: &Means) -> bool {
    means.worse_share > MOST_WORSE
}
