//! `position`: Δz(z) = Δz(z0) + k·(z − z0), Li, Yang, Zhang, Zhang 1998. Δz(z) is the error at the position z; it has a
//! constant part and a slope k over the position. Both are sums of terms; each term is a sensor with a lag. The forward
//! search of the method `sparse-lag` selects the terms of both sums together, on held-out runs.
//!
//! A term of the slope is a rise times the distance from z0. Such a term always differs from the rise itself. Therefore
//! a small ridge penalty is enough.

use std::time::Duration;

use super::sparse::{by_forward, in_columns, most_terms};
use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::folds::Inner;
use crate::gram::{Gains, Gram};
use crate::statistics::range;

/// Ridge penalty of the forward search. The candidate terms are scaled to a root mean square of 1.
const HELD: [f64; 1] = [1e-3];

/// Fits a model with at most `terms` terms; `None` for the default limit. `runs` are the training runs.
pub(super) fn fit(grams: &[Gram], runs: &[usize], columns: &[usize], terms: Option<usize>) -> Gains {
    let inner = Inner::of(grams, runs).of_columns(columns).or_itself();
    let most = most_terms(runs, terms);
    in_columns(&by_forward(&inner.all, &inner.scaled(), most, &HELD, false), columns)
}

/// Creates the matrix of candidate terms: every input through every lag. Each of these terms occurs twice: as it is,
/// and multiplied by the distance from the reference position.
pub(super) fn bank(campaign: &Campaign<'_>, lags: &[Option<Duration>]) -> Result<Bank, String> {
    let Some(position) = &campaign.position else {
        return Err("the method position needs the signal with the position of the axis, for example \
                    --position scale_z"
            .to_owned());
    };
    let places = campaign.dataset.runs.iter().flat_map(|run| &run.values[position.input.column]);
    if range(places) < 1.0 {
        return Err(format!(
            "{} is constant: a slope needs errors measured at several positions of the axis",
            position.input.name
        ));
    }
    returns(campaign, &position.input.name)?;
    let each = |along| {
        let of = move |input| lags.iter().map(move |lag| Candidate { along, ..Candidate::new(input, *lag) });
        (0..campaign.inputs.len()).flat_map(of)
    };
    Ok(Bank::new(campaign, each(false).chain(each(true)).collect()))
}

/// Checks that the machine visits most positions more than once. A position that is visited once gives no information,
/// because its error is counted from that visit.
fn returns(campaign: &Campaign<'_>, name: &str) -> Result<(), String> {
    let (mut once, mut rows) = (0_usize, 0_usize);
    for run in &campaign.dataset.runs {
        for (row, target) in campaign.targets(run).into_iter().enumerate().filter(|(_, at)| at.cz.is_finite())
        {
            once += usize::from(target.since == Some(row));
            rows += 1;
        }
    }
    if 2 * once <= rows {
        return Ok(());
    }
    Err(format!(
        "{name} rarely returns to an earlier position ({once} of {rows} rows are the first row at their \
         position). The error at a position is counted from the first row at this position; positions are \
         rounded to 1 mm. Measure repeatedly at the same few positions, beginning with the cold machine"
    ))
}
