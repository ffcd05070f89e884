//! The requests that carry a set: as few as its registers allow, in their order.

use super::cells::{Cells, stretches, words};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::{Register as Place, Table};
use isotherm_core::quantity::Moment;
use isotherm_profile::{OutputSet, Profile};

/// Reads every register of the set into these cells. When the first question left.
pub(super) async fn read(
    line: &mut DeviceLine,
    profile: &Profile,
    set: &OutputSet,
    cells: &mut Cells,
) -> Result<Moment, Fault> {
    let mut asked = Moment::END;
    for stretch in stretches(profile, set) {
        let from = Place { table: Table::Holding, offset: stretch.from };
        let request = Request::Read { from, count: stretch.count };
        let answered = line.request(set.device, request, Leave::Whenever).await?;
        asked = asked.min(answered.asked);
        if let Answer::Words(words) = answered.answer {
            cells.extend((stretch.from..).zip(words));
        }
    }
    Ok(asked)
}

/// Writes these cells, beginning no later than `not_after` on the connection that there is. What failed, and what that says
/// of the whole set.
pub(super) async fn write(
    line: &mut DeviceLine,
    profile: &Profile,
    set: &OutputSet,
    cells: &Cells,
    not_after: Moment,
) -> Result<(), (Fault, Outcome)> {
    let functions = profile.device(set.device).functions;
    for (place, stretch) in stretches(profile, set).iter().enumerate() {
        let words = words(cells, stretch);
        let request = Request::write_holding(stretch.from, &words, functions);
        // The first request decides; what belongs to it follows, however late, and some of it has arrived then.
        let leave = if place == 0 { Leave::Here(not_after) } else { Leave::Whenever };
        if let Err(fault) = line.request(set.device, request, leave).await {
            let outcome = if place == 0 { fault.outcome() } else { Outcome::Unknown };
            return Err((fault, outcome));
        }
    }
    Ok(())
}
