//! Finds frozen sensors in logs: their readings are constant, while the predictions from the other sensors move. x̂(t)
//! is the predicted reading at the time t. A rise is a reading minus its reference value.
//!
//! ```text
//! D(t) = |x̂(t) − x̂(s)|   °C, s: time of the last change of the reading; D is 0 in the 3 minutes after s
//! θ    = max(0.05 °C, 2 × the largest D of the other runs)
//!        The run with the largest D is ignored if its D exceeds
//!        three times the largest D of the remaining runs.
//! ```
//!
//! For the test of a run, x̂ and θ are calculated from the other runs only. A period of constant readings is a freeze
//! in two cases:
//! - The sensor **thaws**: the step to the next reading is more than three counts (smallest steps), and D exceeded θ
//!   before.
//! - The period lasts to the end of the run and for at least half an hour, and D exceeds θ at the end.
//!
//! The reading of a good sensor in thermal equilibrium is constant, too, but its next change is only one or
//! two counts. A fast sensor may change by many counts within one row. Therefore the step of a sensor with
//! coarse counts must also be twice as large as the largest other step of this sensor. The air of a hall may
//! be constant for hours, and the other sensors predict it badly. Therefore D of a sensor with coarse counts
//! must also exceed the usual error of x̂ at the end of a run.
//!
//! Predictions are unreliable outside the range of the other runs. Therefore the rises from which x̂ is
//! calculated are clipped to this range. A sensor is not tested if the rise of its constant reading is far
//! outside the range of its rises in the other runs.
//!
//! A false alarm costs more than an undetected freeze. An earlier, less strict test wrongly left out eight of twelve
//! good sensors of two machines. The residual error of the models was then nearly twice as large.

use rayon::prelude::*;

use super::{ENOUGH_RUNS, FAR, Gains, LATELY, LEAST, Others, TIMES, apart};
use crate::campaign::Campaign;
use crate::dataset::Dataset;
use crate::faults::Frozen;
use crate::faults::standstill::{End, Standstill, largest_step, standstills};
use crate::folds::folds;
use crate::resolution::finest_step;
use crate::statistics::{least_and_most, median, rms};

/// Largest step of a good sensor between two readings, in counts (smallest steps of the reading).
const COUNTS: f64 = 3.0;
/// Tolerance for rounding errors, as a share of the limit. A step of exactly three counts must not exceed the limit of
/// three counts.
const ROUNDING: f64 = 1e-6;
/// Minimum number of runs. With fewer runs, sensors are not tested for freezes.
const FEWEST_RUNS: usize = 3;
/// Minimum duration of constant readings that are tested if there are only [`FEWEST_RUNS`] runs, s.
const LONG: f64 = 3600.0;
/// Minimum duration of constant readings that are tested at the end of a run, s. A shorter period may be thermal
/// equilibrium, and has little effect on the model.
const LONG_AT_THE_END: f64 = 1800.0;
/// Factor by which the step at the end of a freeze must exceed the largest other step of a sensor with coarse counts.
const LARGER: f64 = 2.0;
/// Maximum distance of a constant reading outside the range of the sensor's rises in the other runs, as a share of this
/// range. If the distance is larger, the sensor is not tested.
const BEYOND: f64 = 0.25;

/// Returns a message that some constant readings were not tested for freezes, because there are too few runs. `None` if
/// all were tested.
pub(crate) fn untested(campaign: &Campaign<'_>) -> Option<String> {
    if campaign.sensors().len() < 2 {
        return None;
    }
    match campaign.dataset.runs.len() {
        runs if runs >= ENOUGH_RUNS => None,
        runs if runs >= FEWEST_RUNS => Some(
            "there are fewer than four runs: only sensors that were constant for at least an hour were \
             tested for freezes"
                .to_owned(),
        ),
        _ => Some("there are fewer than three runs: sensors were not tested for freezes".to_owned()),
    }
}

/// Returns every freeze of the sensors of a campaign. `logs` are the logs as recorded; they give the next reading after
/// each period of constant readings. Predictions use the campaign, in which other faults are repaired. `resolution`
/// returns the count (smallest step) of a log column in its unit; 0 if it is not known.
pub(crate) fn freezes(
    campaign: &Campaign<'_>,
    logs: &Dataset,
    resolution: &dyn Fn(usize) -> f64,
) -> Vec<Frozen> {
    let (sensors, runs) = (campaign.sensors(), logs.runs.len());
    if sensors.len() < 2 || runs < FEWEST_RUNS {
        return Vec::new();
    }
    let least = if runs < ENOUGH_RUNS { LONG } else { 0.0 };
    let mut suspects: Vec<Suspect> = Vec::new();
    for sensor in &sensors {
        let column = campaign.inputs[*sensor].column;
        let count = resolution(column);
        let own_steps = campaign.dataset.runs.iter().map(|run| largest_step(run, column));
        // A sensor with very fine counts is never constant without a fault.
        let is_coarse = count > 0.0;
        let own_step = if is_coarse { own_steps.fold(0.0, f64::max) } else { 0.0 };
        // The `scale` of a signal may be finer than the steps of its module.
        let count = f64::max(count, finest_step(logs, column));
        let thaw = f64::max(COUNTS * count * (1.0 + ROUNDING), LARGER * own_step);
        let is_suspect = |still: &Standstill| {
            let lasts = still.to - still.from;
            match still.end {
                End::Step { size, .. } => lasts >= least && size > thaw,
                End::OfRun => lasts >= f64::max(least, LONG_AT_THE_END),
                End::Gap => false,
            }
        };
        for (run, log) in logs.runs.iter().enumerate() {
            let mut stills = standstills(log, column);
            stills.retain(is_suspect);
            if !stills.is_empty() {
                suspects.push(Suspect { sensor: *sensor, run, is_coarse, stills });
            }
        }
    }
    if suspects.is_empty() {
        return Vec::new();
    }
    let others = Others::new(campaign, &sensors);
    let assess = Judge::new(&others, logs);
    suspects.par_iter().map(|suspect| assess.frozen(suspect)).collect::<Vec<_>>().concat()
}

/// Periods of constant readings of one sensor in one run, each of which may be a freeze.
struct Suspect {
    /// Index of the sensor among the inputs.
    sensor: usize,
    run: usize,
    /// Whether the reading may be constant without a fault, because the counts of the sensor are coarse.
    is_coarse: bool,
    stills: Vec<Standstill>,
}

/// Data for the test of a run: the predictions, and the ranges of the rises.
struct Judge<'a> {
    others: &'a Others<'a>,
    logs: &'a Dataset,
    /// For each run, the smallest and the largest rise of each candidate term.
    spans: Vec<Vec<(f64, f64)>>,
}

impl<'a> Judge<'a> {
    fn new(others: &'a Others<'a>, logs: &'a Dataset) -> Judge<'a> {
        let mut spans = Vec::new();
        for run in &others.bank.runs {
            let columns = run.rises.column_iter();
            let span = columns.map(|column| least_and_most(column.iter()).unwrap_or_default());
            spans.push(span.collect::<Vec<(f64, f64)>>());
        }
        Judge { others, logs, spans }
    }

    /// Returns the freezes among the suspected periods of constant readings.
    fn frozen(&self, suspect: &Suspect) -> Vec<Frozen> {
        let Suspect { sensor, run, is_coarse, stills } = suspect;
        let (sensor, run) = (*sensor, *run);
        let training: Vec<usize> = (0..self.spans.len()).filter(|other| *other != run).collect();
        let penalty = self.others.penalty(sensor, &training);
        let gains = self.others.learn_with(sensor, &training, penalty);
        let predicted = self.predicted(&gains, run, &training);
        let missed = |still: &Standstill| {
            let missed = self.missed(sensor, run, still, &predicted, &training)?;
            Some((*still, missed))
        };
        let mut found: Vec<(Standstill, f64)> = stills.iter().filter_map(missed).collect();
        found.retain(|(_, missed)| *missed > LEAST);
        if found.is_empty() {
            return Vec::new();
        }
        let (threshold, error) = self.limits(sensor, &training, penalty);
        let least = |still: &Standstill| {
            if *is_coarse && still.end == End::OfRun { threshold.max(error) } else { threshold }
        };
        found.retain(|(still, missed)| *missed > least(still));
        let column = self.others.campaign.inputs[sensor].column;
        let frozen = |(still, missed): (Standstill, f64)| Frozen {
            column,
            run,
            first: still.first,
            last: still.last,
            lasts_to_the_end: still.end == End::OfRun,
            missed,
        };
        found.into_iter().map(frozen).collect()
    }

    /// Returns D (the predicted motion, °C) of a period of constant readings. If the period lasts to the end of the
    /// run, the result is the last D, otherwise the largest. `None` if no row can be used, or if the constant reading
    /// is far outside the range of the training runs.
    fn missed(
        &self,
        sensor: usize,
        run: usize,
        still: &Standstill,
        predicted: &[f64],
        training: &[usize],
    ) -> Option<f64> {
        let traced = &self.others.bank.runs[run];
        let anchor = traced.seconds.partition_point(|second| *second <= still.from).saturating_sub(1);
        let times = &self.logs.runs[run].times;
        let thaws = match still.end {
            End::Step { row, .. } => Some(times.get(row)?.since(*times.first()?).as_nanos()),
            End::Gap | End::OfRun => None,
        };
        let window = self.others.campaign.resample.as_nanos().max(1);
        // A window that contains readings from after the step cannot be used.
        let is_before = |row: &usize| {
            let ends = traced.windows[*row].saturating_add(1).saturating_mul(window);
            thaws.is_none_or(|thaws| ends <= thaws)
        };
        let from = traced.seconds.partition_point(|second| second - still.from < LATELY);
        let to = traced.seconds.partition_point(|second| *second <= still.to);
        let rows: Vec<usize> = (from..to).filter(is_before).collect();
        let (first, last) = (*rows.first()?, *rows.last()?);
        let own = self.others.bank.plain(sensor)?;
        let (low, high) = self.span(own, training);
        let beyond = BEYOND * (high - low);
        if !(low - beyond..=high + beyond).contains(&traced.rises[(first, own)]) {
            return None;
        }
        let apart = |row: usize| Some((predicted.get(row)? - predicted.get(anchor)?).abs());
        match still.end {
            End::OfRun => apart(last),
            End::Step { .. } | End::Gap => rows.into_iter().filter_map(apart).reduce(f64::max),
        }
    }

    /// Returns the threshold θ of a sensor and the usual error of its prediction x̂ on these runs, °C. The usual error
    /// is the median of the root mean squares of the runs.
    fn limits(&self, sensor: usize, runs: &[usize], penalty: f64) -> (f64, f64) {
        let (mut largest, mut errors) = (Vec::new(), Vec::new());
        for held in folds(runs) {
            let rest: Vec<usize> = runs.iter().copied().filter(|run| !held.contains(run)).collect();
            let gains = self.others.learn_with(sensor, &rest, penalty);
            for run in held {
                let changed = self.others.changed(sensor, run);
                let predicted = self.predicted(&gains, run, &rest);
                let apart = apart(&self.others.bank.runs[run].seconds, &predicted, &changed);
                largest.push(apart.into_iter().fold(0.0, f64::max));
                let left = predicted.iter().zip(self.others.rise(sensor, run)).map(|(own, rise)| own - rise);
                errors.push(rms(&left.collect::<Vec<f64>>()));
            }
        }
        (theta(largest), median(errors))
    }

    /// Returns the predicted rise of a sensor in each row of a run. The rises of the other sensors are clipped to their
    /// range in the training runs.
    fn predicted(&self, gains: &Gains, run: usize, training: &[usize]) -> Vec<f64> {
        let rises = &self.others.bank.runs[run].rises;
        let mut sum = vec![0.0; rises.nrows()];
        for (candidate, gain) in gains {
            let Some(column) = self.others.bank.column(candidate) else { continue };
            let (low, high) = self.span(column, training);
            for (row, sum) in sum.iter_mut().enumerate() {
                *sum += gain * rises[(row, column)].clamp(low, high);
            }
        }
        sum
    }

    /// Returns the smallest and the largest rise of a column over these runs. The range includes 0, at which every run
    /// starts.
    fn span(&self, column: usize, runs: &[usize]) -> (f64, f64) {
        let spans = runs.iter().map(|run| self.spans[*run][column]);
        spans.fold((0.0, 0.0), |(low, high), (least, most)| (f64::min(low, least), f64::max(high, most)))
    }
}

/// Returns the threshold θ, calculated from the largest D of each run. With only two runs, an outlier cannot be
/// recognized.
fn theta(mut largest: Vec<f64>) -> f64 {
    largest.sort_by(|one, other| other.total_cmp(one));
    let seen = match largest.as_slice() {
        [first, second, _, ..] if *first > FAR * *second => *second,
        [first, ..] => *first,
        [] => 0.0,
    };
    (TIMES * seen).max(LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_is_twice_the_largest_unless_that_is_a_fault_of_its_own() {
        let near = |largest: &[f64], wanted: f64| (theta(largest.to_vec()) - wanted).abs() < 1e-12;
        assert!(near(&[0.1, 0.3, 0.2], 0.6));
        assert!(near(&[0.1, 0.29, 0.1], 0.58), "not yet three times the second");
        assert!(near(&[0.1, 4.0, 0.2], 0.4));
        assert!(near(&[0.1, 4.0], 8.0), "of two runs nobody knows which is the odd one");
        assert!(near(&[0.001, 0.0, 0.0], 0.05));
        assert!(near(&[], 0.05));
    }
}
