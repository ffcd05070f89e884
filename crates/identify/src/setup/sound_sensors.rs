//! Selects the sensors that are used for the identification. Faulty readings are repaired or masked. If that is not
//! possible, the sensor is left out, and the effect on the error is calculated.

use super::Choice;
use crate::campaign::{Campaign, Input, temperatures_of, without};
use crate::checks::stays;
use crate::dataset::{BadLog, Dataset};
use crate::faults::mend::{Mended, mend};
use crate::faults::{self, Fault, Finding, Frozen, Omission, Repaired};
use crate::omission;
use crate::resolution;
use crate::stand_in::freeze::{freezes, untested};
use isotherm_profile::Profile;

/// Campaign with only the sensors that are used, and the findings about the sensors that are left out.
pub(super) struct SoundSensors<'a> {
    pub(super) campaign: Campaign<'a>,
    pub(super) excluded: Vec<Finding>,
    pub(super) omissions: Vec<Omission>,
    pub(super) repaired: Vec<Repaired>,
    /// Remarks about faulty sensors that are used because the operator requested them, and about constant readings that
    /// could not be tested.
    pub(super) remarks: Vec<String>,
}

/// Searches the temperatures among these inputs for faults, and selects the sensors that are used for the
/// identification.
///
/// # Errors
/// Returns a message if no sensor is left.
pub(super) fn examine<'a>(
    profile: &Profile,
    dataset: &'a Dataset,
    choice: &Choice,
    error: usize,
    inputs: &[Input],
) -> Result<SoundSensors<'a>, BadLog> {
    let temperatures = temperatures_of(dataset, inputs);
    let is_kept = |column: &usize| choice.keep.contains(&dataset.columns[*column].name);
    let assessed: Vec<usize> = temperatures.iter().copied().filter(|column| !is_kept(column)).collect();
    let (found, remark) = find_freezes(profile, dataset, choice, error, (inputs, &assessed));
    let mut remarks: Vec<String> = remark.into_iter().collect();
    let (kept, frozen): (Vec<Frozen>, Vec<Frozen>) =
        found.into_iter().partition(|frozen| is_kept(&frozen.column));
    if assessed.len() < temperatures.len() {
        let mut staying = faults::find(dataset, &temperatures, &kept);
        staying.retain(|found| choice.keep.contains(&found.signal));
        staying.extend(kept.iter().map(|frozen| Fault::frozen(dataset, frozen).finding(dataset, "")));
        remarks.extend(staying.iter().map(stays));
    }
    let campaign_of = |excluded: &[Finding], mending| {
        let good = without(inputs, excluded);
        Campaign::new(profile, dataset, error, good, choice.resample).with_mending(mending)
    };
    let Mended { mending, mut excluded, mut repaired } = mend(dataset, &assessed, &frozen);
    let mut campaign = campaign_of(&excluded, mending);
    if campaign.inputs.is_empty() {
        let reasons = excluded.iter().map(|faulty| format!("{}: {}", faulty.signal, faulty.reason));
        let reasons: Vec<String> = reasons.collect();
        return Err(BadLog(vec![format!(
            "no sensor remains for the model: {}. To use a faulty sensor nevertheless, add --keep NAME",
            reasons.join("; ")
        )]));
    }
    let mut omissions = Vec::new();
    // With a moving axis, the error must first be separated by place before a sensor can be judged by it.
    if choice.position.is_none() {
        let is_masked = |input: &usize| {
            let column = campaign.inputs[*input].column;
            frozen.iter().any(|frozen| frozen.column == column)
        };
        let masked: Vec<usize> = (0..campaign.inputs.len()).filter(is_masked).collect();
        let harmful = omission::harmful(&campaign, &masked);
        let gone: Vec<usize> = harmful.iter().map(|(input, _)| campaign.inputs[*input].column).collect();
        omissions.extend(harmful.into_iter().map(|(_, omission)| omission));
        if !gone.is_empty() {
            let stay: Vec<usize> = assessed.iter().copied().filter(|column| !gone.contains(column)).collect();
            let mended = mend(dataset, &stay, &frozen);
            (excluded, repaired) = (mended.excluded, mended.repaired);
            let own = frozen.iter().filter(|frozen| gone.contains(&frozen.column));
            let more = " (without this sensor, the error of held-out runs is smaller)";
            excluded.extend(own.map(|frozen| Fault::frozen(dataset, frozen).finding(dataset, more)));
            campaign = campaign_of(&excluded, mended.mending);
        }
        let others = costs(&campaign, inputs, &excluded, &omissions);
        omissions.extend(others);
    }
    Ok(SoundSensors { campaign, excluded, omissions, repaired, remarks })
}

/// Returns every freeze of these inputs. Also returns a remark if some constant readings could not be tested.
/// `assessed` contains the log columns that are also searched for other faults.
fn find_freezes(
    profile: &Profile,
    dataset: &Dataset,
    choice: &Choice,
    error: usize,
    (inputs, assessed): (&[Input], &[usize]),
) -> (Vec<Frozen>, Option<String>) {
    let levelled = faults::levelled(dataset, assessed);
    let Mended { mending, excluded, .. } = mend(&levelled, assessed, &[]);
    let good = without(inputs, &excluded);
    let campaign = Campaign::new(profile, &levelled, error, good, choice.resample).with_mending(mending);
    let count_of = |column: usize| {
        let name = &dataset.columns[column].name;
        let signal = profile.signals.iter().find(|signal| signal.name == *name);
        signal.and_then(resolution::scale).unwrap_or_else(|| resolution::estimated(dataset, column))
    };
    (freezes(&campaign, dataset, &count_of), untested(&campaign))
}

/// Returns the effect of leaving out each excluded sensor on the residual error. Sensors in `known` are
/// skipped.
fn costs(
    campaign: &Campaign<'_>,
    inputs: &[Input],
    excluded: &[Finding],
    known: &[Omission],
) -> Vec<Omission> {
    let is_unknown = |input: &&Input| {
        let is_excluded = excluded.iter().any(|faulty| faulty.signal == input.name);
        is_excluded && known.iter().all(|known| known.signal != input.name)
    };
    inputs.iter().filter(is_unknown).filter_map(|input| omission::cost(campaign, input)).collect()
}
