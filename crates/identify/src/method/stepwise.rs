//! `stepwise`: terms are added and removed by partial F tests. A partial F test requires the number of
//! independent samples.
//!
//! Successive minute rows of a slow machine depend on each other. If each row counted as an independent sample, nearly
//! every sensor would seem significant.

use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use crate::gram::{Gains, Gram};
use crate::solve::ridge;
use crate::statistics::count;

/// Significance level (p-value) below which a term is added.
const ENTERS: f64 = 0.01;
/// Significance level (p-value) above which a term is removed.
const LEAVES: f64 = 0.05;

/// Step of the search, in which a candidate term is added or removed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Move {
    pub(crate) column: usize,
    pub(crate) comes_in: bool,
    /// Partial F: reduction of the squared residual by the term, divided by the residual variance.
    pub(crate) f: f64,
    /// Probability of such an F if the term has no effect (p-value).
    pub(crate) chance: f64,
}

/// Fits a model with at most `most` terms. `rows_per_sample` is the number of rows that count as one independent
/// sample.
pub(super) fn fit(gram: &Gram, rows_per_sample: f64, columns: &[usize], most: usize) -> Gains {
    let (moves, _) = search(gram, gram.rows / rows_per_sample, columns, most);
    let mut chosen: Vec<usize> = Vec::new();
    for taken in moves {
        match taken.comes_in {
            true => chosen.push(taken.column),
            false => chosen.retain(|column| *column != taken.column),
        }
    }
    let gains = ridge(gram, &chosen, 0.0);
    chosen.into_iter().zip(gains.iter().copied()).collect()
}

/// Returns the steps in order. Also returns the best candidate term that is not added because it is not significant;
/// `None` if the search ends for another reason.
pub(crate) fn search(gram: &Gram, samples: f64, columns: &[usize], most: usize) -> (Vec<Move>, Option<Move>) {
    let left = |chosen: &[usize]| match chosen {
        [] => gram.power,
        _ => gram.of_columns(chosen).left(&ridge(gram, chosen, 0.0)),
    };
    let tested = |column: usize, comes_in: bool, without: f64, with: f64, terms: usize| {
        let free = samples - count(terms);
        let f = (without - with) / (with / free);
        let is_more = !f.is_nan() && f > 0.0;
        let chance = FisherSnedecor::new(1.0, free).ok().filter(|_| is_more).map_or(1.0, |law| law.sf(f));
        Move { column, comes_in, f, chance }
    };
    let (mut chosen, mut now, mut moves) = (Vec::new(), gram.power, Vec::new());
    // Each round reduces the residual or ends the search. The bound is a safeguard.
    for _ in 0..10 * columns.len() {
        let outside = columns.iter().filter(|column| !chosen.contains(*column));
        let tried = outside.map(|column| (left(&[chosen.as_slice(), &[*column]].concat()), *column));
        let best = tried.min_by(|one, other| one.0.total_cmp(&other.0));
        let terms = chosen.len() + 1;
        let may = chosen.len() < most && samples - count(terms) >= 1.0;
        let Some((less, column)) = best.filter(|_| may) else { break };
        let taken = tested(column, true, now, less, terms);
        if taken.chance >= ENTERS {
            return (moves, Some(taken));
        }
        moves.push(taken);
        chosen.push(column);
        now = less;
        // The column that was just added is not removed; otherwise two columns could alternate.
        while chosen.len() > 1 {
            let tried = (0..chosen.len() - 1).map(|place| {
                let mut without = chosen.clone();
                without.remove(place);
                (left(&without), place)
            });
            let weakest = tried.min_by(|one, other| one.0.total_cmp(&other.0));
            let Some((more, place)) = weakest else { break };
            let gone = tested(chosen[place], false, more, now, chosen.len());
            if gone.chance <= LEAVES {
                break;
            }
            moves.push(gone);
            chosen.remove(place);
            now = more;
        }
    }
    (moves, None)
}
