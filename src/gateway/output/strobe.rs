//! Requests for the strobe of a set and its acknowledge.

use super::turn::LineTurn;
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::{Address, DataType, Encoded};
use isotherm_profile::{Bit, DeviceId};

/// Raises or drops the strobe.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    strobe: &Bit,
    up: bool,
) -> Result<(), Fault> {
    let functions = turn.shared.profile.device(device).functions;
    let (content, address) = match strobe {
        Bit::Flag(flag) => (Encoded::of(&[if up { flag.raised() } else { 0 }]), flag.address.into()),
        Bit::Node(node) => (node.word(u16::from(up)), Address::Node(node.clone())),
    };
    let request = match address.register() {
        Some(register) if register.table.is_bits() => Request::WriteCoil { at: register.offset, value: up },
        _ => Request::write(&address, content.registers(), functions),
    };
    turn.line.request(device, request, SendDeadline::None).await.map(|_| ())
}

/// Reads the acknowledge of the control. Returns true if it is up.
pub(super) async fn read(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    acknowledge: &Bit,
) -> Result<bool, Fault> {
    let (address, data_type) = match acknowledge {
        Bit::Flag(flag) => (flag.address.into(), DataType::U16),
        Bit::Node(node) => (Address::Node(node.clone()), node.taken_as()),
    };
    let Some(request) = Request::read(&address, data_type) else {
        return Err(Fault::Caller(CallerFault::Function));
    };
    let answered = turn.line.read_confirmed(device, request).await?;
    Ok(match (answered.answer.accepted()?, acknowledge) {
        (Answer::Bits(bits), _) => bits.first().copied().unwrap_or_default(),
        (answer, Bit::Flag(flag)) => answer.registers().first().is_some_and(|register| flag.is_up(*register)),
        (answer, Bit::Node(_)) => answer.registers().iter().any(|word| *word != 0),
    })
}
