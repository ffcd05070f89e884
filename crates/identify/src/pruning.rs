//! Removal of terms that have almost no effect on Cz, the compensation value. In each row of each run, the removed
//! terms together contribute at most half a count (smallest step) of the register. If the model is a mean of two
//! models, their difference shows how reliable the mean is. This difference also changes by at most half a count.

use crate::bank::{Bank, Candidate};
use crate::learn::Learned;

/// Removes the terms with the smallest effects. In every log row, the removed terms together contribute at most `most`
/// µm to Cz.
pub(crate) fn prune(learned: Learned, bank: &Bank, most: f64) -> Learned {
    let Some(gains) = learned.sum() else { return learned };
    let apart = match &learned {
        Learned::Mean { halves, .. } => halves.iter().map(|[ridge, net]| ridge - net).collect(),
        _ => Vec::new(),
    };
    let Some(keeps) = kept(gains, &apart, bank, most) else { return learned };
    let keep = |place: &usize| keeps[*place];
    let places = || (0..keeps.len()).filter(keep);
    match learned {
        Learned::Mean { gains, halves } => Learned::Mean {
            gains: places().map(|place| gains[place]).collect(),
            halves: places().map(|place| halves[place]).collect(),
        },
        Learned::Sum(gains) => Learned::Sum(places().map(|place| gains[place]).collect()),
        net @ Learned::Net { .. } => net,
    }
}

/// Returns for each term whether it remains in the model; `None` if the matrix of candidate terms does not contain some
/// term. If the model is a mean of two models, `apart` contains the difference of their gains for each term; otherwise
/// it is empty.
fn kept(gains: &[(Candidate, f64)], apart: &[f64], bank: &Bank, most: f64) -> Option<Vec<bool>> {
    let columns: Vec<usize> =
        gains.iter().map(|(candidate, _)| bank.column(candidate)).collect::<Option<_>>()?;
    // Contribution of a term to Cz on each row, then to the difference of the two models of a mean.
    let part = |(place, column): (usize, &usize)| -> Vec<f64> {
        let rises = bank.rises(*column);
        let gains = [Some(&gains[place].1), apart.get(place)];
        gains.into_iter().flatten().flat_map(|gain| rises.iter().map(move |rise| gain * rise)).collect()
    };
    let parts: Vec<Vec<f64>> = columns.iter().enumerate().map(part).collect();
    let largest = |part: &Vec<f64>| part.iter().fold(0.0_f64, |largest, part| largest.max(part.abs()));
    let mut order: Vec<(f64, usize)> = parts.iter().map(largest).zip(0..).collect();
    order.sort_by(|one, other| one.0.total_cmp(&other.0));
    let mut gone: Vec<f64> = vec![0.0; parts.first().map_or(0, Vec::len)];
    let mut keeps = vec![true; gains.len()];
    for (_, place) in order.into_iter().take_while(|(largest, _)| *largest <= 2.0 * most) {
        let with: Vec<f64> = gone.iter().zip(&parts[place]).map(|(gone, part)| gone + part).collect();
        if with.iter().all(|gone| gone.abs() <= most) {
            (gone, keeps[place]) = (with, false);
        }
    }
    Some(keeps)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::bank::Traced;

    fn bank(rises: DMatrix<f64>) -> Bank {
        let (rows, inputs) = rises.shape();
        let candidates = (0..inputs).map(|input| Candidate::new(input, None)).collect();
        let run = Traced {
            name: "day".to_owned(),
            windows: (0..).take(rows).collect(),
            seconds: vec![0.0; rows],
            target: DVector::zeros(rows),
            rises,
        };
        Bank { candidates, is_speed: vec![false; inputs], runs: vec![run] }
    }

    #[test]
    fn a_term_about_which_the_halves_disagree_stays_though_their_mean_is_nothing() {
        let bank = bank(DMatrix::from_row_slice(1, 2, &[1.0, 1.0]));
        let gains = bank.candidates.iter().map(|candidate| (*candidate, 0.0)).collect();
        let lean = prune(Learned::Mean { gains, halves: vec![[0.5, -0.5], [0.01, -0.01]] }, &bank, 0.05);
        let Learned::Mean { gains, halves } = lean else { panic!("it has halves") };
        assert_eq!((gains.len(), halves), (1, vec![[0.5, -0.5]]));
    }

    #[test]
    fn what_goes_never_comes_to_more_than_was_allowed_on_any_row_and_takes_its_halves_along() {
        let bank = bank(DMatrix::from_row_slice(2, 4, &[1.0, 1.0, 1.0, 1.0, 10.0, -1.0, 1.0, 0.5]));
        let gains: Vec<(Candidate, f64)> =
            bank.candidates.iter().copied().zip([1.0, 0.03, 0.04, 0.02]).collect();
        let halves = gains.iter().map(|(_, gain)| [0.9 * gain, 1.1 * gain]).collect();
        let left = |most: f64| match prune(
            Learned::Mean { gains: gains.clone(), halves: Vec::clone(&halves) },
            &bank,
            most,
        ) {
            Learned::Mean { gains, halves } => {
                assert!(
                    gains.iter().zip(&halves).all(|(own, [ridge, _])| (0.9 * own.1 - ridge).abs() < 1e-12)
                );
                gains.iter().map(|(candidate, _)| candidate.input).collect::<Vec<usize>>()
            }
            _ => Vec::new(),
        };
        assert_eq!(left(0.0), [0, 1, 2, 3]);
        assert_eq!(left(0.02), [0, 1, 2]);
        // 0.02 + 0.03 on the first row is allowed; another 0.04 is too much.
        assert_eq!(left(0.05), [0, 2]);
        assert_eq!(left(0.09), [0]);
    }
}
