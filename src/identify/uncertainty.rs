//! How far a gain may be from the truth.
//!
//! Minute rows are not independent: what is left over from one minute is nearly that of the next. The count of samples
//! is divided by the time over which residuals resemble each other, 1 + 2·Σρ over their correlations at one row apart, two,
//! and so on, as long as these are above a twentieth (a run's whole offset counts with it). Where three runs or more were left out in turn, the spread of the gains among those
//! fits (jackknife) is the second opinion; the larger one is stated.

use nalgebra::DMatrix;
use statrs::distribution::{ContinuousCDF, StudentsT};

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
    let spread = jackknife(bank, gains, left_out);
    let classic = if by_spread_alone && spread.is_some() { None } else { by_residuals(bank, gains) };
    (0..gains.len())
        .map(|place| {
            let of = |errors: &Option<Vec<f64>>| errors.as_ref().map_or(0.0, |errors| errors[place]);
            of(&spread).max(of(&classic))
        })
        .collect()
}

/// A time constant that was fitted is another in each fit; such a term is known by its sensor.
fn jackknife(bank: &Bank, gains: &[(Candidate, f64)], left_out: &[&Learned]) -> Option<Vec<f64>> {
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
            let is_fitted = !bank.candidates.contains(candidate);
            let is_same = |other: &Candidate| {
                other == candidate
                    || is_fitted && (other.input, other.along) == (candidate.input, candidate.along)
            };
            let same = sum.iter().find(|(other, _)| is_same(other));
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
    let left: Vec<Vec<f64>> = bank
        .runs
        .iter()
        .map(|run| {
            let of = |row: usize| {
                let terms = columns.iter().zip(gains);
                run.wanted[row]
                    - terms.map(|(column, (_, gain))| gain * run.rises[(row, *column)]).sum::<f64>()
            };
            (0..run.wanted.len()).map(of).collect()
        })
        .collect();
    let power = products(&left, 0);
    let rows = count(left.iter().map(Vec::len).sum());
    let each = alike(&left);
    let grams: Vec<Gram> = bank.runs.iter().map(Gram::of).collect();
    let all: Vec<usize> = (0..grams.len()).collect();
    let (scaled, scales) = Gram::sum(&grams, &all).of_columns(&columns).scaled();
    let inverse: DMatrix<f64> = scaled.square.cholesky()?.inverse();
    let free = (rows / each - count(columns.len())).max(1.0);
    let variance = power / rows * (rows / each) / free;
    let few = for_few(free);
    let error =
        |place: usize| few * (variance * each * inverse[(place, place)] / rows).sqrt() / scales[place];
    Some((0..columns.len()).map(error).collect())
}

/// Two standard errors are to hold the truth in 95 cases of 100, however few the samples are: Student's factor.
fn for_few(free: f64) -> f64 {
    const NORMAL: f64 = 1.959_963_985;
    StudentsT::new(0.0, 1.0, free).map_or(1.0, |law| law.inverse_cdf(0.975) / NORMAL)
}

/// How many rows make one independent sample.
fn alike(left: &[Vec<f64>]) -> f64 {
    const MOST_APART: usize = 500;
    let power = products(left, 0);
    let longest = left.iter().map(Vec::len).max().unwrap_or(0).min(2 * MOST_APART) / 2;
    let correlations = (1..longest).map(|apart| products(left, apart) / power);
    1.0 + 2.0 * correlations.take_while(|correlation| *correlation > 0.05).sum::<f64>()
}

fn products(left: &[Vec<f64>], apart: usize) -> f64 {
    let of =
        |run: &Vec<f64>| run.iter().zip(run.iter().skip(apart)).map(|(one, other)| one * other).sum::<f64>();
    left.iter().map(of).sum()
}
