//! Decides whether a candidate replaces the model in use. A candidate is a model that was learned from touches. A touch
//! is the result of one probing.
//!
//! The touches of a day are first used to judge both models. The judgement consists of two mean squares of
//! the residual error: one with the model in use, one with the candidate learned before that day. Then a new
//! candidate is learned from the touches:
//!
//! ```text
//! day ── judge (both models) ── learn (new candidate) ── next day
//! ```
//!
//! | sums over the last five judged days | policy | at a datum | step |
//! |---|---|---|---|
//! | no day, or the candidate's sum is not smaller | any | any | [`Step::Keep`] |
//! | the candidate's sum is smaller | propose, without a confirmation | any | [`Step::Propose`] |
//! | the candidate's sum is smaller | propose, confirmed | any | [`Step::Adopt`] |
//! | the candidate's sum is smaller | auto | no | [`Step::WaitForDatum`] |
//! | the candidate's sum is smaller | auto | yes | [`Step::Adopt`] |
//!
//! A run lasts from one datum (zero point of the touches) to the next. The runs of one day (UTC) are one judged day, in
//! which each touch has the same weight.
//!
//! An adopted candidate becomes the model in use. Its mean squares of the judged days become the mean squares
//! of the model in use, so a later candidate is also compared over five days. The functions are pure: they
//! read no clock and no file.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::quantity::{Micron, Moment, shifted};

/// Time constants of the inputs of a learned model, in minutes. 0 means no lag.
pub const LAG_MINUTES: [u64; 4] = [0, 6, 25, 100];
/// Number of judged days over which the mean squares of both models are summed and compared.
const DAYS: usize = 5;
/// Relative difference below which two sums count as equal. Rounding causes such a difference if the candidate and the
/// model in use are the same model.
const ROUNDING: f64 = 1e-9;
const NANOS_OF_A_DAY: u64 = 24 * 3600 * 1_000_000_000;

/// Mean squares of the residual error at the touches of one day. Both models were learned without these touches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JudgedDay {
    /// Time of the day's datum, the zero point from which its touches are measured. If the day has several zero points,
    /// the time of the last zero point.
    pub begins: Moment,
    /// Number of touches (probings) of the day.
    pub touches: u32,
    /// Mean square of the residual error with the model in use, µm².
    pub in_use: f64,
    /// Mean square of the residual error with the candidate, µm².
    pub candidate: f64,
}

shifted!(JudgedDay: begins);

/// Comparison of the candidate with the model in use, over the last judged days.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    days: VecDeque<JudgedDay>,
}

shifted!(Judgement: days);

/// Residual errors of both models over the judged days, each as a root mean square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gain {
    /// Time of the datum (zero point) of the first judged day.
    pub since: Moment,
    /// Number of judged days.
    pub days: usize,
    /// Number of touches (probings) on these days.
    pub touches: u32,
    /// Residual error with the model in use.
    pub in_use: Micron,
    /// Residual error that the candidate would have left.
    pub candidate: Micron,
}

/// Candidate for an axis, with the comparison between the candidate and the model in use. `isotherm learn`
/// writes the offer, and a gateway may adopt the candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Offer {
    /// Name of the axis in the profile.
    pub axis: String,
    /// Name of the candidate, formed from the day of the last run that it was learned from, and from its terms.
    pub name: String,
    /// Number of runs from which the candidate was learned.
    pub runs: usize,
    /// Terms of the candidate, whose sum is Cz. Terms with a gain of zero are left out.
    pub terms: Vec<OfferedTerm>,
    /// Comparison of the candidate with the model in use, over the last judged days.
    pub judgement: Judgement,
    /// Name of the learned model with which the candidate was compared; `None` if that was the model of the profile.
    pub compared_with: Option<String>,
    /// Fingerprint (hash) of the models in the profile at the time of the comparison. Empty if the axis did not learn a
    /// model at that time.
    pub own: String,
}

/// One term of a candidate: an input and its gain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OfferedTerm {
    /// Name of the signal in the profile.
    pub signal: String,
    /// Time constant of the input's lag behind its signal, s; 0 means no lag.
    pub lag_s: f64,
    /// Whether the input is the square of the signal.
    pub squared: bool,
    /// Gain in µm per unit of the input.
    pub gain: f64,
}

/// Whether the operator or the gateway decides that a better candidate is adopted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Policy {
    /// A better candidate is proposed. An operator adopts it.
    #[default]
    Propose,
    /// A better candidate is adopted at the next datum.
    Auto,
}

/// Circumstances under which [`Judgement::decide`] decides whether a candidate is adopted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Occasion {
    /// Whether the operator has confirmed this candidate.
    pub confirmed: bool,
    /// Whether the datum of the axis is taken now. Then every lag and every correction starts at zero.
    pub at_datum: bool,
}

/// Next step with a candidate: keep the model in use, propose the candidate, or adopt it. For a better candidate, the
/// step contains the residual errors of both models.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// The axis keeps the model in use.
    Keep,
    /// The candidate is better. It is proposed to the operator, who decides.
    Propose(Gain),
    /// The candidate is better, and is adopted at the next datum.
    WaitForDatum(Gain),
    /// The candidate replaces the model in use now.
    Adopt(Gain),
}

impl JudgedDay {
    fn is_same_day(&self, other: &JudgedDay) -> bool {
        self.begins.as_nanos() / NANOS_OF_A_DAY == other.begins.as_nanos() / NANOS_OF_A_DAY
    }

    /// Returns the mean squares over this run and another run of the same day. Each touch of both runs has the same
    /// weight.
    fn with(&self, run: JudgedDay) -> JudgedDay {
        let (own, others) = (f64::from(self.touches), f64::from(run.touches));
        let mean = |own_square: f64, square: f64| (own * own_square + others * square) / (own + others);
        JudgedDay {
            begins: run.begins,
            touches: self.touches.saturating_add(run.touches),
            in_use: mean(self.in_use, run.in_use),
            candidate: mean(self.candidate, run.candidate),
        }
    }
}

impl Judgement {
    /// Adds a judged day. Another run of the last day is combined with that day. Returns `false` if the day is not
    /// used: it has no touch, a mean square is invalid, or its datum is not later than the datum of the last judged
    /// day.
    pub fn judge(&mut self, day: JudgedDay) -> bool {
        let is_error = |square: f64| square.is_finite() && square >= 0.0;
        let is_new = self.days.back().is_none_or(|last| day.begins > last.begins);
        if day.touches == 0 || !is_new || !is_error(day.in_use) || !is_error(day.candidate) {
            return false;
        }
        if let Some(last) = self.days.back_mut().filter(|last| last.is_same_day(&day)) {
            *last = last.with(day);
            return true;
        }
        if self.days.len() >= DAYS {
            self.days.pop_front();
        }
        self.days.push_back(day);
        true
    }

    /// Returns the judged days, oldest first.
    pub fn days(&self) -> impl ExactSizeIterator<Item = &JudgedDay> {
        self.days.iter()
    }

    /// Returns the residual errors over the judged days; `None` if no day has been judged.
    pub fn gain(&self) -> Option<Gain> {
        let since = self.days.front()?.begins;
        let rms = |of: fn(&JudgedDay) -> f64| {
            let days = u32::try_from(self.days.len()).unwrap_or(u32::MAX);
            Micron::new((self.days.iter().map(of).sum::<f64>() / f64::from(days)).sqrt())
        };
        Some(Gain {
            since,
            days: self.days.len(),
            touches: self.days.iter().map(|day| day.touches).fold(0, u32::saturating_add),
            in_use: rms(|day| day.in_use)?,
            candidate: rms(|day| day.candidate)?,
        })
    }

    /// Returns whether the candidate has the smaller sum of mean squares over the judged days. Differences by rounding
    /// do not count.
    pub fn is_better(&self) -> bool {
        let sum = |of: fn(&JudgedDay) -> f64| self.days.iter().map(of).sum::<f64>();
        sum(|day| day.candidate) < (1.0 - ROUNDING) * sum(|day| day.in_use)
    }

    /// Returns the next step with the candidate: [`Step::Keep`] unless the candidate is better than the model in use.
    pub fn decide(&self, policy: Policy, occasion: Occasion) -> Step {
        let Some(gain) = self.gain().filter(|_| self.is_better()) else { return Step::Keep };
        match (policy, occasion) {
            (Policy::Propose, Occasion { confirmed: false, .. }) => Step::Propose(gain),
            (Policy::Auto, Occasion { confirmed: false, at_datum: false }) => Step::WaitForDatum(gain),
            (Policy::Propose | Policy::Auto, _) => Step::Adopt(gain),
        }
    }

    /// Records that the candidate has become the model in use. On all judged days, its mean squares replace those of
    /// the former model.
    pub fn adopted(&mut self) {
        self.days.iter_mut().for_each(|day| day.in_use = day.candidate);
    }

    /// Discards all judged days, because another model is in use now.
    pub fn clear(&mut self) {
        self.days.clear();
    }
}

#[cfg(test)]
mod tests;
