//! Collinearity of the terms of a model: how similar the values of the terms are. The gains of similar terms are
//! uncertain.

use nalgebra::SymmetricEigen;

use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::gram::Gram;

/// Collinearity of some terms of a model (Belsley, Kuh, Welsch 1980). The values of each term are scaled to root mean
/// square 1. The mean is not subtracted, because the model has no constant term.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Collinearity {
    /// Condition number: ratio of the largest singular value to the smallest.
    pub(crate) condition: f64,
    /// Variance inflation factor of each term: variance of the gain, divided by the variance that the gain
    /// would have without the similar terms.
    pub(crate) inflation: Vec<f64>,
}

/// Returns the collinearity of these terms over all runs; `None` without terms, or if terms are linearly dependent.
pub(crate) fn collinearity(
    campaign: &Campaign<'_>,
    bank: &Bank,
    terms: &[(Candidate, f64)],
) -> Option<Collinearity> {
    if terms.is_empty() {
        return None;
    }
    let columns: Option<Vec<usize>> = terms.iter().map(|(term, _)| bank.column(term)).collect();
    // The bank does not contain time constants that the method has fitted.
    let own = || Bank::new(campaign, terms.iter().map(|(term, _)| *term).collect());
    of_gram(&match columns {
        Some(columns) => Gram::total(&bank.grams()).of_columns(&columns),
        None => Gram::total(&own().grams()),
    })
}

fn of_gram(gram: &Gram) -> Option<Collinearity> {
    let (scaled, _) = gram.scaled();
    let inverse = scaled.square.clone().cholesky()?.inverse();
    let values = SymmetricEigen::new(scaled.square).eigenvalues;
    let (least, most) = (values.min(), values.max());
    (least > 0.0)
        .then(|| Collinearity { condition: (most / least).sqrt(), inflation: inverse.diagonal().data.into() })
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    fn gram(alike: f64) -> Gram {
        // Two columns with root mean squares 2 and 3, over ten rows.
        let square = DMatrix::from_row_slice(2, 2, &[40.0, 60.0 * alike, 60.0 * alike, 90.0]);
        Gram { square, cross: DVector::zeros(2), power: 0.0, rows: 10.0 }
    }

    #[test]
    fn two_terms_are_as_hard_to_tell_apart_as_their_correlation_says() {
        let found = of_gram(&gram(0.8)).unwrap();
        // The eigenvalues are 1 ± r, the inflation is 1 / (1 − r²).
        assert!((found.condition - 3.0).abs() < 1e-9, "{found:?}");
        assert!((found.inflation[0] - 1.0 / 0.36).abs() < 1e-9, "{found:?}");
        let apart = of_gram(&gram(0.0)).unwrap();
        assert!((apart.condition - 1.0).abs() < 1e-9 && (apart.inflation[1] - 1.0).abs() < 1e-9, "{apart:?}");
    }

    #[test]
    fn the_same_term_twice_has_no_figures() {
        assert_eq!(of_gram(&gram(1.0)), None);
    }
}
