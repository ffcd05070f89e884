//! Read requests of a Modbus device.
//!
//! Registers that are close to each other in one table share a request, even if a few registers in between are not
//! needed. A request costs a round trip, a register only two bytes. A device that refuses registers that it does not
//! have needs `max_gap = 0`. A device that serves a register wrongly together with others has signals with `merge =
//! false`.

use super::quirks::Quirks;
use crate::plan::{Field, ReadRequest, ReadTarget};
use crate::tables::bus_kind::SignalsOf;
use crate::tables::device::Device;

/// Largest number of coils or discrete inputs in one request of the protocol.
pub(crate) const MAX_BITS: u16 = 2000;

pub(super) fn of(device: &Device, signals: &SignalsOf<'_>) -> Vec<ReadRequest> {
    let quirks = &device.quirks;
    let mut requests: Vec<ReadRequest> = Vec::new();
    let mut together: Vec<ReadRequest> = Vec::new();
    for (id, signal) in signals {
        let Some(from) = signal.address.register() else { continue };
        let count = signal.encoding.data_type.registers();
        let fields = vec![Field { signal: *id, at: 0, len: count }];
        let request = ReadRequest { asks: ReadTarget::Registers { from, count }, fields };
        let shares = signal.merge && !quirks.one_request_per_field;
        if shares { &mut together } else { &mut requests }.push(request);
    }
    together.sort_by_key(ReadRequest::rank);
    let mut merged: Vec<ReadRequest> = Vec::new();
    for next in together {
        let is_taken = merged.last_mut().is_some_and(|last| takes(last, &next, quirks));
        if !is_taken {
            merged.push(next);
        }
    }
    requests.extend(merged);
    requests
}

/// Merges the next request by address into a request. Returns `false` if it is too far away, or if the merged request
/// would be too long.
fn takes(request: &mut ReadRequest, next: &ReadRequest, quirks: &Quirks) -> bool {
    let (ReadTarget::Registers { from, count }, Some((start, len))) = (&mut request.asks, next.span()) else {
        return false;
    };
    let limit = if from.table.is_bits() { MAX_BITS } else { quirks.max_registers_per_request };
    let at = start.offset.saturating_sub(from.offset);
    let is_near = u32::from(at) <= u32::from(*count) + u32::from(quirks.max_gap);
    let whole = (*count).max(at.saturating_add(len));
    let fits = from.table == start.table && is_near && whole <= limit;
    if fits {
        *count = whole;
        request.fields.extend(next.fields.iter().map(|field| Field { at, ..*field }));
    }
    fits
}
