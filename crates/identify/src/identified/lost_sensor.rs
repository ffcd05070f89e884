//! Replacement of a lost sensor (failed or frozen). A virtual sensor predicts the reading of the lost sensor
//! from the other sensors. A fallback model does not use the lost sensor as an input.

use serde::Serialize;

use super::single_sensor::alone;
use super::{Alone, TermFound, terms_of};
use crate::campaign::Campaign;
use crate::expected::{Expected, expected};
use crate::learn::{Learned, Learner};
use crate::method::{Method, Settings};
use crate::region::Region;
use crate::stand_in::StandIn;
use crate::validate::{HeldOut, Means, leave_one_run_out};

/// Fallback model: used instead of the model if one sensor is lost.
#[derive(Clone, Debug, Serialize)]
pub struct Fallback {
    /// Name of the signal of the lost sensor.
    pub without: String,
    /// Name of the method that identified the model.
    pub method: &'static str,
    /// Terms of the model; empty if the model is a formula.
    pub terms: Vec<TermFound>,
    /// Range of the inputs in the logs. `None` if there are too many inputs, or if one input is constant.
    #[serde(rename = "envelope")]
    pub region: Option<Region>,
    /// Formula with the remaining sensor and the time since machine start; `None` if the model is a sum of terms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alone: Option<Alone>,
    /// Expected error of the model: a standard deviation that grows with the hours since the datum (zero point). `None`
    /// if it is not known.
    pub expected: Option<Expected>,
    /// Means of the held-out results of this fallback model.
    #[serde(flatten)]
    pub means: Means,
}

impl Fallback {
    /// Returns a description of the model: its method, or the name of the remaining sensor.
    pub fn kind(&self) -> String {
        match &self.alone {
            Some(alone) => format!("{} alone, with the time since machine start", alone.signal),
            None => self.method.to_owned(),
        }
    }
}

/// Returns a fallback model for the loss of each input of the model, the best first. Fallback models use only inputs in
/// `among`.
pub(super) fn fallbacks(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    (among, inputs): (&[usize], &[usize]),
    learned: &Learned,
    held_out: &[HeldOut],
) -> Result<Vec<Fallback>, String> {
    let own = Settings { method: settings.method.stand_in(), ..settings.clone() };
    // With one run nothing is judged. Then a fallback is made only for a speed, which the machine may not have.
    let is_wanted = |input: &usize| !held_out.is_empty() || campaign.inputs[*input].is_speed();
    let lost: Vec<usize> = inputs.iter().copied().filter(is_wanted).collect();
    let mut found = match own.method {
        method if method == settings.method => without_each(campaign, learner, &own, among, &lost),
        method => without_each(campaign, method.prepare(campaign, &own)?.as_ref(), &own, among, &lost),
    };
    if settings.method == Method::Difference {
        found.extend(alone(campaign, learner.bank(), learned, held_out));
    }
    found.sort_by(|one, other| one.means.mean_range_um.total_cmp(&other.means.mean_range_um));
    Ok(found)
}

/// Returns a fallback model for each lost input. An input has no fallback model if the method cannot identify a model
/// without this input.
fn without_each(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    among: &[usize],
    lost: &[usize],
) -> Vec<Fallback> {
    let runs: Vec<usize> = (0..learner.bank().runs.len()).collect();
    let without = |lost: &usize| -> Vec<usize> {
        (0..campaign.inputs.len()).filter(|input| input == lost || !among.contains(input)).collect()
    };
    let without: Vec<Vec<usize>> = lost.iter().map(without).collect();
    let held_out = match runs.len() {
        1 => lost.iter().map(|_| Ok(Vec::new())).collect(),
        _ => leave_one_run_out(campaign, learner, settings, &without, None, &|_, _| {}),
    };
    let each = lost.iter().zip(&without).zip(held_out);
    let fallbacks = each.filter_map(|((lost, without), held)| {
        let (learned, held) = (learner.learn(&runs, without).ok()?, held.ok()?);
        let gains = learned.sum().filter(|gains| !gains.is_empty())?;
        Some(Fallback {
            without: campaign.inputs[*lost].name.clone(),
            method: settings.method.name(),
            alone: None,
            terms: terms_of(campaign, learner.bank(), gains),
            region: Region::of(campaign, learner.bank(), &learned.inputs()),
            expected: expected(&held).ok(),
            means: Means::of(held.iter().map(|held| &held.score)),
        })
    });
    fallbacks.collect()
}

/// Chooses between virtual sensor and fallback model for each sensor. The virtual sensor is used if it depends on at
/// least two other sensors, and if no fallback model for that sensor has a smaller residual error.
pub(super) fn keep_the_better(stand_ins: &mut [StandIn], fallbacks: &mut Vec<Fallback>) {
    for stand_in in stand_ins {
        let is_for_it = |fallback: &Fallback| fallback.without == stand_in.signal;
        let other = fallbacks.iter().find(|fallback| is_for_it(fallback));
        let leaves_least =
            other.is_none_or(|other| stand_in.means.mean_range_um <= other.means.mean_range_um);
        stand_in.stands_in = leaves_least && stand_in.has_others_enough();
        if stand_in.stands_in {
            fallbacks.retain(|fallback| !is_for_it(fallback));
        }
    }
}

/// Returns the sensors whose loss cannot be compensated, either by a virtual sensor or by a fallback model.
pub(super) fn irreplaceable<'a>(
    sensors: impl Iterator<Item = &'a str>,
    stand_ins: &[StandIn],
    fallbacks: &[Fallback],
    whole: &Means,
) -> Vec<String> {
    const GROWS: f64 = 1.25;
    let is_lost = |sensor: &&str| {
        let virtually = stand_ins.iter().filter(|own| own.stands_in && own.signal == *sensor);
        let models = fallbacks.iter().filter(|own| own.without == *sensor);
        let mut left = virtually.map(|own| own.means).chain(models.map(|own| own.means));
        !left.any(|means| means.mean_range_um <= GROWS * whole.mean_range_um)
    };
    sensors.filter(is_lost).map(str::to_owned).collect()
}
