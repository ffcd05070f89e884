//! Read requests of a Modbus device.
//!
//! Registers that are close to each other in one table share a request, even if a few registers in between are not
//! needed. A request costs a round trip, but a register only two bytes. A device needs `max_gap = 0` if it rejects
//! requests for registers that it does not have. A signal needs `merge = false` if its device returns wrong values in a
//! shared request.
//!
//! A value and its scale, which may be in another register, share a request even if their registers are far apart. The
//! scale certainly applies to the value only if one answer contains both.

use super::quirks::Quirks;
use crate::plan::{Field, ReadRequest, ReadTarget};
use crate::tables::bus_kind::SignalsOf;
use crate::tables::device::Device;

/// Largest number of coils or discrete inputs that the Modbus protocol allows in one request.
pub(crate) const MAX_BITS: u16 = 2000;

pub(super) fn of(device: &Device, signals: &SignalsOf<'_>) -> Vec<ReadRequest> {
    let quirks = &device.quirks;
    let mut requests: Vec<ReadRequest> = Vec::new();
    let mut together: Vec<ReadRequest> = Vec::new();
    for (id, signal) in signals {
        let Some(from) = signal.address.register() else { continue };
        let value = Field::value(*id, signal.encoding.data_type.registers());
        let scale = signal
            .scale_from
            .as_ref()
            .map(|scale| (scale.address, Field::scale(*id, scale.encoding.data_type.registers())));
        let shares = signal.merge && !quirks.one_request_per_field;
        for (from, field) in std::iter::once((from, value)).chain(scale) {
            let asks = ReadTarget::Registers { from, count: field.len };
            let request = ReadRequest { asks, fields: vec![field] };
            if shares { &mut together } else { &mut requests }.push(request);
        }
    }
    together.sort_by_key(ReadRequest::rank);
    let mut merged: Vec<ReadRequest> = Vec::new();
    for next in together {
        let is_taken = merged.last_mut().is_some_and(|last| takes(last, &next, quirks));
        if !is_taken {
            merged.push(next);
        }
    }
    if quirks.max_gap > 0 {
        join_scales(&mut merged, quirks.max_registers_per_request);
    }
    requests.extend(merged);
    requests
}

/// Merges the request for a value with the request for its scale, even if their registers are far apart. Requests
/// between the two are merged too. Requests are not merged if the result would be longer than `limit`, in registers.
fn join_scales(requests: &mut Vec<ReadRequest>, limit: u16) {
    let mut place = 0;
    while place < requests.len() {
        match farthest_partner(requests, place, limit) {
            Some(last) => {
                let joined: Vec<ReadRequest> = requests.drain(place + 1..=last).collect();
                joined.iter().for_each(|next| join(&mut requests[place], next));
            }
            None => place += 1,
        }
    }
}

/// Returns the index of the last partner that can be merged with the request at index `place`. `None` if no
/// partner can be merged. A partner is a later request for the other half of a signal: it reads the scale if
/// the request at `place` reads the value, or the value if that request reads the scale.
fn farthest_partner(requests: &[ReadRequest], place: usize, limit: u16) -> Option<usize> {
    let (from, _) = requests[place].span()?;
    let belongs = |next: &ReadRequest| {
        let is_other =
            |field: &Field, own: &Field| field.signal == own.signal && field.content != own.content;
        next.fields.iter().any(|field| requests[place].fields.iter().any(|own| is_other(field, own)))
    };
    let fits = |next: &ReadRequest| {
        let Some((start, len)) = next.span() else { return false };
        start.table == from.table
            && u32::from(start.offset - from.offset) + u32::from(len) <= u32::from(limit)
    };
    let is_partner = |next: &usize| belongs(&requests[*next]) && requests[place + 1..=*next].iter().all(fits);
    (place + 1..requests.len()).rev().find(is_partner)
}

/// Appends the registers and fields of `next` to a request. `next` must be at a higher address of the same table.
fn join(request: &mut ReadRequest, next: &ReadRequest) {
    let (ReadTarget::Registers { from, count }, Some((start, len))) = (&mut request.asks, next.span()) else {
        return;
    };
    let at = start.offset.saturating_sub(from.offset);
    *count = (*count).max(at.saturating_add(len));
    request.fields.extend(next.fields.iter().map(|field| Field { at: at + field.at, ..*field }));
}

/// Merges `next`, the request at the next higher address, into a request if possible. Returns `false` if `next` is too
/// far away, or if the merged request would be too long.
fn takes(request: &mut ReadRequest, next: &ReadRequest, quirks: &Quirks) -> bool {
    let (ReadTarget::Registers { from, count }, Some((start, len))) = (&request.asks, next.span()) else {
        return false;
    };
    let limit = if from.table.is_bits() { MAX_BITS } else { quirks.max_registers_per_request };
    let at = start.offset.saturating_sub(from.offset);
    let is_near = u32::from(at) <= u32::from(*count) + u32::from(quirks.max_gap);
    let whole = (*count).max(at.saturating_add(len));
    let fits = from.table == start.table && is_near && whole <= limit;
    if fits {
        join(request, next);
    }
    fits
}
