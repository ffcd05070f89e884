//! How well the terms of a sum can be told apart.

use nalgebra::SymmetricEigen;

use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::gram::Gram;

/// Of the columns of some terms, each of root mean square 1 and, as there is no intercept, not centred (Belsley, Kuh,
/// Welsch 1980).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Collinearity {
    /// The largest singular value over the smallest.
    pub(crate) condition: f64,
    /// By term: how many times the variance of its gain is what it were if no other term resembled it.
    pub(crate) inflation: Vec<f64>,
}

/// Of these terms over every run; `None` where there are none, or two are the same.
pub(crate) fn collinearity(
    campaign: &Campaign<'_>,
    bank: &Bank,
    terms: &[(Candidate, f64)],
) -> Option<Collinearity> {
    if terms.is_empty() {
        return None;
    }
    let columns: Option<Vec<usize>> = terms.iter().map(|(term, _)| bank.column(term)).collect();
    // Fitted time constants are in no bank.
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
        // Of scales 2 and 3, ten rows.
        let square = DMatrix::from_row_slice(2, 2, &[40.0, 60.0 * alike, 60.0 * alike, 90.0]);
        Gram { square, cross: DVector::zeros(2), power: 0.0, rows: 10.0 }
    }

    #[test]
    fn two_terms_are_as_hard_to_tell_apart_as_their_correlation_says() {
        let found = of_gram(&gram(0.8)).unwrap();
        // Eigenvalues 1 ± r; inflation 1 / (1 − r²).
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
