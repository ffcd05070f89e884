//! `position`: Δz(z) = Δz(z0) + k·(z − z0), both linear in the rises, Li, Yang, Zhang, Zhang 1998. The terms of both are
//! chosen together by partial F tests.

use crate::identify::bank::{Bank, Candidate};
use crate::identify::campaign::Campaign;

/// Every input, and every input times the distance from the reference position.
pub(super) fn bank(campaign: &Campaign<'_>) -> Result<Bank, String> {
    let Some(position) = &campaign.position else {
        return Err("position wants the signal that says where the axis was: --position scale_z".to_owned());
    };
    let values = || campaign.dataset.runs.iter().flat_map(|run| &run.values[position.column]);
    let (low, high) = values()
        .filter(|v| v.is_finite())
        .fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    if high - low < 1.0 || low > high {
        return Err(format!(
            "{} stays at one place: a slope wants errors measured at several positions of the axis",
            position.name
        ));
    }
    let each = |along| (0..campaign.inputs.len()).map(move |input| Candidate { input, lag: None, along });
    Ok(Bank::new(campaign, each(false).chain(each(true)).collect()))
}
