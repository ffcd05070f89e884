//! Effect of leaving a sensor out: the residual errors of a model with the sensor and of a model without it. Both
//! models are identified by the method `whitened`, and are tested on the same rows of held-out runs.
//!
//! The method `whitened` is used here even if the operator chose another method. Masked rows are not used.

use std::iter::once;

use crate::campaign::{Campaign, Input};
use crate::faults::Omission;
use crate::method::Settings;
use crate::statistics::{count, smallest};
use crate::validate::{HeldOut, leave_one_run_out};

/// Limit of the ratio of two residual errors: the error without the sensor, divided by the error with it. Below this
/// limit, the sensor is harmful. A smaller improvement is not significant.
const CLEARLY: f64 = 0.98;

/// Returns the harmful inputs among `suspects`, worst first. An input is harmful if the residual error is clearly
/// smaller without the input. At least one sensor of the campaign is never returned.
pub(crate) fn harmful(campaign: &Campaign<'_>, suspects: &[usize]) -> Vec<(usize, Omission)> {
    let (mut rest, mut found) = (suspects.to_vec(), Vec::<(usize, Omission)>::new());
    while !rest.is_empty() && found.len() + 1 < campaign.sensors().len() {
        let gone: Vec<usize> = found.iter().map(|(input, _)| *input).collect();
        let each = rest.iter().map(|input| [gone.as_slice(), &[*input]].concat());
        let without: Vec<Vec<usize>> = once(gone.clone()).chain(each).collect();
        let Some(left) = left_without(campaign, &without) else { break };
        let (with_um, without) = (left[0], &left[1..]);
        let best = smallest(without);
        if without[best] >= CLEARLY * with_um {
            break;
        }
        let (input, without_um) = (rest.remove(best), without[best]);
        let signal = campaign.inputs[input].name.clone();
        found.push((input, Omission { signal, with_um, without_um }));
    }
    found
}

/// Returns the residual errors of models with and without this input. `None` if a model with the input cannot be
/// tested, because there is only one run, or because the input is missing in all rows of a run.
pub(crate) fn cost(campaign: &Campaign<'_>, input: &Input) -> Option<Omission> {
    let (with, place) = (campaign.with_input(input.clone()), campaign.inputs.len());
    let left = left_without(&with, &[Vec::new(), vec![place]])?;
    Some(Omission { signal: input.name.clone(), with_um: left[0], without_um: left[1] })
}

/// Returns the root mean square of the residual error on these runs, µm. Each run is held out in turn. `None` if a
/// model with all inputs cannot be tested.
pub(crate) fn left_in(campaign: &Campaign<'_>, runs: &[usize]) -> Option<f64> {
    let held = held_out(campaign, &[Vec::new()])?.pop()?;
    Some(root_mean_square(runs.iter().filter_map(|run| held.get(*run))))
}

/// Returns for each list of inputs in `without` the residual error of a model without these inputs: root mean square on
/// held-out rows, µm. `None` if the models cannot be tested.
fn left_without(campaign: &Campaign<'_>, without: &[Vec<usize>]) -> Option<Vec<f64>> {
    Some(held_out(campaign, without)?.iter().map(root_mean_square).collect())
}

/// Returns for each list of inputs in `without` the results on all held-out runs of a model without these inputs.
/// `None` if the models cannot be tested.
fn held_out(campaign: &Campaign<'_>, without: &[Vec<usize>]) -> Option<Vec<Vec<HeldOut>>> {
    if campaign.dataset.runs.len() < 2 {
        return None;
    }
    let settings = Settings::default();
    let learner = settings.method.prepare(campaign, &settings).ok()?;
    learner.bank().check_rows("every sensor", "the sensor").ok()?;
    let each = leave_one_run_out(campaign, learner.as_ref(), &settings, without, None, &|_, _| {});
    each.into_iter().map(Result::ok).collect()
}

/// Returns the root mean square of the residual error over the rows of all these runs, µm.
fn root_mean_square<'a>(held_out: impl IntoIterator<Item = &'a HeldOut>) -> f64 {
    let (mut sum, mut rows) = (0.0, 0);
    for held in held_out {
        let left = held.residual(None);
        sum += left.iter().map(|left| left * left).sum::<f64>();
        rows += left.len();
    }
    (sum / count(rows).max(1.0)).sqrt()
}
