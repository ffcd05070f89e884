//! How far a gain may be from the truth.
//!
//! Minute rows are not independent: what is left over from one minute is nearly that of the next. The count of samples
//! is divided by the time over which residuals resemble each other, (1 + ρ)/(1 − ρ) for a first-order process with the
//! correlation ρ of neighbours. Where three runs or more were left out in turn, the spread of the gains among those
//! fits (jackknife) is the second opinion; the larger one is stated.

use nalgebra::DMatrix;

use super::bank::{Bank, Candidate};
use super::gram::{Gram, count};
use super::learn::Learned;

/// One standard error per gain, in its unit.
pub(super) fn standard_errors(
    bank: &Bank,
    gains: &[(Candidate, f64)],
    left_out: &[&Learned],
    by_spread_alone: bool,
) -> Vec<f64> {
    let spread = jackknife(gains, left_out);
    let classic = if by_spread_alone && spread.is_some() { None } else { by_residuals(bank, gains) };
    (0..gains.len())
        .map(|place| {
            let of = |errors: &Option<Vec<f64>>| errors.as_ref().map_or(0.0, |errors| errors[place]);
            of(&spread).max(of(&classic))
        })
        .collect()
}

fn jackknife(gains: &[(Candidate, f64)], left_out: &[&Learned]) -> Option<Vec<f64>> {
    let sums: Vec<&Vec<(Candidate, f64)>> = left_out
        .iter()
        .filter_map(|learned| match learned {
            Learned::Sum(gains) => Some(gains),
            Learned::Net { .. } => None,
        })
        .collect();
    if sums.len() < 3 {
        return None;
    }
    let runs = count(sums.len());
    let error = |(candidate, _): &(Candidate, f64)| {
        let of = |sum: &&Vec<(Candidate, f64)>| {
            let same = sum.iter().find(|(other, _)| other == candidate);
            same.map_or(0.0, |(_, gain)| *gain)
        };
        let values: Vec<f64> = sums.iter().map(of).collect();
        let mean = values.iter().sum::<f64>() / runs;
        let spread: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (spread * (runs - 1.0) / runs).sqrt()
    };
    Some(gains.iter().map(error).collect())
}

fn by_residuals(bank: &Bank, gains: &[(Candidate, f64)]) -> Option<Vec<f64>> {
    let place = |candidate: &Candidate| bank.candidates.iter().position(|known| known == candidate);
    let columns: Vec<usize> = gains.iter().map(|(candidate, _)| place(candidate)).collect::<Option<_>>()?;
    if columns.is_empty() {
        return None;
    }
    let (mut power, mut neighbours, mut rows) = (0.0, 0.0, 0.0);
    for run in &bank.runs {
        let left: Vec<f64> = (0..run.wanted.len())
            .map(|row| {
                let terms = columns.iter().zip(gains);
                run.wanted[row] - terms.map(|(column, (_, gain))| gain * run.rises[(row, *column)]).sum::<f64>()
            })
            .collect();
        power += left.iter().map(|value| value * value).sum::<f64>();
        neighbours += left.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
        rows += count(left.len());
    }
    let alike = if power > 0.0 { (neighbours / power).clamp(0.0, 0.999) } else { 0.0 };
    let each = (1.0 + alike) / (1.0 - alike);
    let grams: Vec<Gram> = bank.runs.iter().map(Gram::of).collect();
    let all: Vec<usize> = (0..grams.len()).collect();
    let (scaled, scales) = Gram::sum(&grams, &all).of_columns(&columns).scaled();
    let inverse: DMatrix<f64> = scaled.square.cholesky()?.inverse();
    let free = (rows / each - count(columns.len())).max(1.0);
    let variance = power / rows * (rows / each) / free;
    let error = |place: usize| (variance * each * inverse[(place, place)] / rows).sqrt() / scales[place];
    Some((0..columns.len()).map(error).collect())
}
