//! Registers of an output set on a Modbus line, read and written with as few requests as possible.

use std::collections::BTreeMap;

use super::set_io::{SetReadings, Written};
use super::turn::LineTurn;
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use isotherm_core::codec::{Address, Encoded, Register, Table};
use isotherm_core::output::OwnWords;
use isotherm_core::quantity::Moment;
use isotherm_profile::{DeviceId, Output, OutputSet, Profile, Stretch};

/// Register values of an output set. The key is the address offset of the register.
type Cells = BTreeMap<u16, u16>;

/// Returns the values of all registers of the output set. `values` contains the value of each output, and `own`
/// contains the sequence number, the heartbeat and the control word of the set.
fn cells(profile: &Profile, set: &OutputSet, values: &[Encoded], own: OwnWords) -> Cells {
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
        (set.sequence, own.number),
        (register(set.heartbeat.as_ref()), Some(own.beat)),
        (register(set.control.as_ref()), Some(own.control)),
        (register(set.version.as_ref().map(|(at, _)| at)), set.version.as_ref().map(|(_, number)| *number)),
    ];
    cells.extend(own.into_iter().filter_map(|(at, word)| Some((at?.offset, word?))));
    if let Some(at) = set.complement {
        cells.remove(&at.offset);
        let sum = cells.values().fold(0u16, |sum, word| sum.wrapping_add(*word));
        cells.insert(at.offset, !sum);
    }
    cells
}

fn register(at: Option<&Address>) -> Option<Register> {
    at.and_then(Address::register)
}

/// Returns the ranges of consecutive registers of the output set. Each range needs one request, in this order.
pub(super) fn stretches(profile: &Profile, set: &OutputSet) -> Vec<Stretch> {
    set.stretches(set.members(profile), profile.device(set.device).longest_request())
}

/// Returns the registers of one output. `cells` contains all registers of the output set.
fn held(output: &Output, cells: &Cells) -> Encoded {
    let count = output.encoding.data_type.registers();
    let first = output.address.register();
    first.map_or(Encoded::of(&[]), |first| {
        Encoded::of(&registers(cells, &Stretch { from: first.offset, count }))
    })
}

/// Returns the values of consecutive registers. The value of a register that is not in `cells` is 0.
fn registers(cells: &Cells, stretch: &Stretch) -> Vec<u16> {
    let registers = (0..stretch.count).map(|place| stretch.from.saturating_add(place));
    registers.map(|register| cells.get(&register).copied().unwrap_or_default()).collect()
}

/// Reads every register of the output set.
pub(super) async fn read(turn: &mut LineTurn<'_>, set: &OutputSet) -> Result<SetReadings, Fault> {
    let profile = &turn.shared.profile;
    let (mut cells, mut asked) = (Cells::new(), Moment::END);
    for stretch in stretches(profile, set) {
        let from = Register { table: Table::Holding, offset: stretch.from };
        let request = Request::read_registers(from, stretch.count);
        let answered = turn.line.read_confirmed(set.device, request).await?;
        asked = asked.min(answered.asked);
        cells.extend((stretch.from..).zip(answered.answer.registers().iter().copied()));
    }
    let cell = |at: Option<Register>| at.and_then(|at| cells.get(&at.offset)).copied();
    Ok(SetReadings {
        values: set.members(profile).map(|output| held(output, &cells)).collect(),
        sequence: cell(set.sequence),
        heartbeat: cell(register(set.heartbeat.as_ref())),
        asked,
    })
}

/// Writes every register of the output set.
pub(super) async fn write_all(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    values: &[Encoded],
    own: OwnWords,
    leave: SendDeadline,
) -> Written {
    let profile = &turn.shared.profile;
    let (cells, stretches) = (cells(profile, set, values, own), stretches(profile, set));
    write_stretches(turn, set.device, &stretches, &cells, leave).await
}

/// Writes only the heartbeat and the control word of the output set, without its values.
pub(super) async fn write_own(turn: &mut LineTurn<'_>, set: &OutputSet, own: OwnWords) -> Written {
    let words = [(&set.heartbeat, own.beat), (&set.control, own.control)];
    let words = words.into_iter().filter_map(|(at, word)| Some((register(at.as_ref())?.offset, word)));
    write(turn, set.device, &words.collect(), SendDeadline::None).await
}

/// Writes the register values in `cells`. Adjacent registers share a request. In an error, the outcome applies to all
/// values.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    cells: &Cells,
    leave: SendDeadline,
) -> Written {
    let longest = turn.shared.profile.device(device).longest_request();
    let stretches = Stretch::joined(cells.keys().map(|offset| (*offset, 1)).collect(), longest);
    write_stretches(turn, device, &stretches, cells, leave).await
}

/// Writes the register values in `cells`, with one request for each range of consecutive registers. The deadline
/// `leave` applies only to the first request, because the other requests complete the write. In an error, the outcome
/// applies to all values: after the first request, some values have arrived.
async fn write_stretches(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    stretches: &[Stretch],
    cells: &Cells,
    leave: SendDeadline,
) -> Written {
    let functions = turn.shared.profile.device(device).functions;
    for (place, stretch) in stretches.iter().enumerate() {
        let registers = registers(cells, stretch);
        let request = Request::write_holding(stretch.from, &registers, functions);
        let leave = if place == 0 { leave } else { SendDeadline::None };
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
    fn a_stretch_is_cut_out_of_the_registers_of_a_set() {
        let cells = Cells::from([(10, 1), (11, 2), (12, 3)]);
        assert_eq!(registers(&cells, &Stretch { from: 11, count: 2 }), [2, 3]);
    }
}
