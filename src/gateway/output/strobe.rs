//! Requests for the strobe signal of an output set and its acknowledge signal.

use std::slice::from_ref;

use super::turn::LineTurn;
use crate::fieldbus::error::Fault;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::Encoded;
use isotherm_profile::{Bit, DeviceId};

/// Raises or drops the strobe signal.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    strobe: &Bit,
    up: bool,
) -> Result<(), Fault> {
    let functions = turn.shared.profile.device(device).functions;
    let content = match strobe {
        Bit::Flag(flag) => Encoded::of(&[if up { flag.raised() } else { 0 }]),
        Bit::Node(node) => node.word(u16::from(up)),
    };
    let request = match strobe {
        Bit::Flag(flag) if flag.address.table.is_bits() => Request::write_coil(flag.address.offset, up),
        Bit::Flag(flag) => Request::write_holding(flag.address.offset, content.registers(), functions),
        Bit::Node(node) => Request::write_nodes(from_ref(node), content.registers()),
    };
    turn.line.request(device, request, SendDeadline::None).await.map(|_| ())
}

/// Reads the acknowledge signal of the control. Returns true if it is up.
pub(super) async fn read(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    acknowledge: &Bit,
) -> Result<bool, Fault> {
    let request = match acknowledge {
        Bit::Flag(flag) => Request::read_registers(flag.address, 1),
        Bit::Node(node) => Request::read_nodes(from_ref(node)),
    };
    let answered = turn.line.read_confirmed(device, request).await?;
    Ok(match (answered.answer.accepted()?, acknowledge) {
        (Answer::Bits(bits), _) => bits.first().copied().unwrap_or_default(),
        (answer, Bit::Flag(flag)) => answer.registers().first().is_some_and(|register| flag.is_up(*register)),
        (answer, Bit::Node(_)) => answer.registers().iter().any(|word| *word != 0),
    })
}
