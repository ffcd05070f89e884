//! Terms that do nothing go: as long as what goes never comes to more than half a count of the register, on any row of any
//! run, nobody can tell.

use crate::bank::{Bank, Candidate};
use crate::learn::Learned;

/// Without the smallest terms, which together never exceed so many µm.
pub(crate) fn lean(learned: Learned, bank: &Bank, most: f64) -> Learned {
    let Some(gains) = learned.sum() else { return learned };
    let Some(keeps) = kept(gains, bank, most) else { return learned };
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

/// By term, whether it stays; `None` where a column is not in the bank.
fn kept(gains: &[(Candidate, f64)], bank: &Bank, most: f64) -> Option<Vec<bool>> {
    let columns: Vec<usize> =
        gains.iter().map(|(candidate, _)| bank.column(candidate)).collect::<Option<_>>()?;
    let parts: Vec<Vec<f64>> = (columns.iter().zip(gains))
        .map(|(column, (_, gain))| bank.rises(*column).iter().map(|rise| gain * rise).collect())
        .collect();
    let largest = |part: &Vec<f64>| part.iter().fold(0.0_f64, |largest, part| largest.max(part.abs()));
    let mut order: Vec<(f64, usize)> = parts.iter().map(largest).zip(0..).collect();
    order.sort_by(|one, other| one.0.total_cmp(&other.0));
    let mut gone: Vec<f64> = vec![0.0; bank.runs.iter().map(|run| run.target.len()).sum()];
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

    #[test]
    fn what_goes_never_comes_to_more_than_was_allowed_on_any_row_and_takes_its_halves_along() {
        let candidates: Vec<Candidate> = (0..4).map(|input| Candidate::new(input, None)).collect();
        let rises = DMatrix::from_row_slice(2, 4, &[1.0, 1.0, 1.0, 1.0, 10.0, -1.0, 1.0, 0.5]);
        let run = Traced {
            name: "day".to_owned(),
            windows: vec![0, 1],
            seconds: vec![0.0, 60.0],
            target: DVector::zeros(2),
            rises,
        };
        let bank = Bank { candidates: candidates.clone(), is_speed: vec![false; 4], runs: vec![run] };
        let gains: Vec<(Candidate, f64)> = candidates.into_iter().zip([1.0, 0.03, 0.04, 0.02]).collect();
        let halves = gains.iter().map(|(_, gain)| [gain - 1.0, gain + 1.0]).collect();
        let left = |most: f64| match lean(
            Learned::Mean { gains: gains.clone(), halves: Vec::clone(&halves) },
            &bank,
            most,
        ) {
            Learned::Mean { gains, halves } => {
                assert!(
                    gains.iter().zip(&halves).all(|(own, [ridge, _])| (own.1 - ridge - 1.0).abs() < 1e-12)
                );
                gains.iter().map(|(candidate, _)| candidate.input).collect::<Vec<usize>>()
            }
            _ => Vec::new(),
        };
        assert_eq!(left(0.0), [0, 1, 2, 3]);
        assert_eq!(left(0.02), [0, 1, 2]);
        // 0.02 + 0.03 on the first row, and 0.04 more would be too much.
        assert_eq!(left(0.05), [0, 2]);
        assert_eq!(left(0.09), [0]);
    }
}
