//! `ols`: ordinary least squares on all candidate terms. Every candidate term remains in the model.

use crate::gram::{Gains, Gram};
use crate::solve::ridge;
use crate::statistics::count;

pub(super) fn fit(gram: &Gram, columns: &[usize]) -> Result<Gains, String> {
    if gram.rows < count(columns.len()) {
        return Err(format!(
            "{} log rows are not enough to identify {} terms: record longer runs, or name fewer sensors with \
             --inputs",
            gram.rows,
            columns.len()
        ));
    }
    Ok(columns.iter().copied().zip(ridge(gram, columns, 0.0).iter().copied()).collect())
}
