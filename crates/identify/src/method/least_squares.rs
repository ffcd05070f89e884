//! `ols`: least squares on every column.

use super::Rule;
use crate::gram::Gram;
use crate::solve;
use crate::statistics::count;

pub(super) struct LeastSquares;

impl Rule for LeastSquares {
    fn fit(&self, grams: &[Gram], runs: &[usize], columns: &[usize]) -> Result<Vec<(usize, f64)>, String> {
        let gram = Gram::sum(grams, runs);
        if gram.rows < count(columns.len()) {
            return Err(format!(
                "{} rows cannot carry {} terms: record longer runs, or name fewer sensors with --inputs",
                gram.rows,
                columns.len()
            ));
        }
        let gains = solve::ridge(&gram, columns, 0.0);
        Ok(columns.iter().copied().zip(gains.iter().copied()).collect())
    }
}
