//! What goes over the wire for a set: its registers, and the requests that carry them, as few as there can be.

use std::collections::BTreeMap;

use super::LineTurn;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::wire::Request;
use isotherm_core::codec::{Encoded, Register, Table};
use isotherm_core::quantity::Moment;
use isotherm_profile::{DeviceId, Output, OutputSet, Profile, Stretch};

/// What registers hold, by their offsets.
pub(super) type Cells = BTreeMap<u16, u16>;

/// The registers of a set that are nobody's value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Own {
    pub(super) sequence: Option<u16>,
    pub(super) heartbeat: u16,
    /// What the gateway does.
    pub(super) control: u16,
}

pub(super) fn next_beat(beat: u16) -> u16 {
    if beat >= 32767 { 0 } else { beat + 1 }
}

/// Every register of the set for these values, one for each member.
pub(super) fn cells(profile: &Profile, set: &OutputSet, values: &[Encoded], own: Own) -> Cells {
    let mut cells = Cells::new();
    if set.zeros {
        for stretch in stretches(profile, set) {
            cells.extend((0..stretch.count).map(|place| (stretch.from.saturating_add(place), 0)));
        }
    }
    for (output, value) in set.members(profile).zip(values) {
        cells.extend(output.cells(value.registers()));
    }
    let own = [
        (set.sequence, own.sequence),
        (set.heartbeat, Some(own.heartbeat)),
        (set.control, Some(own.control)),
        (set.version.map(|(at, _)| at), set.version.map(|(_, number)| number)),
    ];
    cells.extend(own.into_iter().filter_map(|(at, word)| Some((at?.offset, word?))));
    if let Some(at) = set.complement {
        cells.remove(&at.offset);
        let sum = cells.values().fold(0u16, |sum, word| sum.wrapping_add(*word));
        cells.insert(at.offset, !sum);
    }
    cells
}

/// The requests that write or read the set, in their order.
pub(super) fn stretches(profile: &Profile, set: &OutputSet) -> Vec<Stretch> {
    set.stretches(set.members(profile), profile.device(set.device).longest_request())
}

/// The registers of one member among what was read.
pub(super) fn held(output: &Output, cells: &Cells) -> Encoded {
    let count = output.encoding.data_type.registers();
    let first = output.address.register();
    first.map_or(Encoded::of(&[]), |first| {
        Encoded::of(&registers(cells, &Stretch { from: first.offset, count }))
    })
}

/// The registers of one stretch.
fn registers(cells: &Cells, stretch: &Stretch) -> Vec<u16> {
    let registers = (0..stretch.count).map(|place| stretch.from.saturating_add(place));
    registers.map(|register| cells.get(&register).copied().unwrap_or_default()).collect()
}

/// Reads every register of the set into these cells. When the first question left.
pub(super) async fn read(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    cells: &mut Cells,
) -> Result<Moment, Fault> {
    let mut asked = Moment::END;
    for stretch in stretches(&turn.shared.profile, set) {
        let from = Register { table: Table::Holding, offset: stretch.from };
        let request = Request::Read { from, count: stretch.count };
        let answered = turn.line.request(set.device, request, Leave::Whenever).await?;
        asked = asked.min(answered.asked);
        cells.extend((stretch.from..).zip(answered.answer.registers().iter().copied()));
    }
    Ok(asked)
}

/// Writes these cells, those of one stretch in one request. The first leaves as `leave` says; what belongs to it follows,
/// however late. What failed, and what that says of all of them: after the first, some have arrived.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    stretches: &[Stretch],
    cells: &Cells,
    leave: Leave,
) -> Result<(), (Fault, Outcome)> {
    let functions = turn.shared.profile.device(device).functions;
    for (place, stretch) in stretches.iter().enumerate() {
        let registers = registers(cells, stretch);
        let request = Request::write_holding(stretch.from, &registers, functions);
        let leave = if place == 0 { leave } else { Leave::Whenever };
        if let Err(fault) = turn.line.request(device, request, leave).await {
            let outcome = if place == 0 { fault.outcome() } else { Outcome::Unknown };
            return Err((fault, outcome));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_heartbeat_of_a_set_goes_round_below_the_sign() {
        assert_eq!((next_beat(0), next_beat(32766), next_beat(32767)), (1, 32767, 0));
    }

    #[test]
    fn a_stretch_is_cut_out_of_the_registers_of_a_set() {
        let cells = Cells::from([(10, 1), (11, 2), (12, 3)]);
        assert_eq!(registers(&cells, &Stretch { from: 11, count: 2 }), [2, 3]);
    }
}
