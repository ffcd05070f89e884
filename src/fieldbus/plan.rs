//! Which requests read a device: pure, from its signals to the fewest read requests.
//!
//! Neighbours in one table share a request, also across a few registers that nobody asked for: a request costs a
//! round trip, a register two bytes. A device that refuses registers it does not have wants `max_gap = 0`; one that
//! serves a register wrongly among others has signals with `merge = false`. A CANopen object is a request of its own, and
//! what comes in CAN frames is not asked for.

use std::fmt;

use super::wire::{Answer, Request};
use crate::codec::{Address, Encoding, Table};
use crate::profile::{Device, Signal};
use crate::reading::{Reason, SignalId};

/// Most coils or discrete inputs that one request may ask for, by the protocol.
const MAX_BITS: u16 = 2000;

/// One read request, and which of its registers belong to whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadRequest {
    /// The table, and by it the function code.
    pub table: Table,
    /// The first register or bit.
    pub start: u16,
    /// How many.
    pub count: u16,
    /// What the answer holds. Never empty.
    pub fields: Vec<Field>,
}

/// The part of an answer that is one signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Whose.
    pub signal: SignalId,
    /// Its first register or bit, counted from the beginning of the answer.
    pub at: u16,
    /// How many registers or bits.
    pub len: u16,
}

/// What a signal needs, before it is put into a request.
struct Wanted {
    signal: SignalId,
    address: Address,
    len: u16,
    alone: bool,
}

/// The fewest requests that read these signals of one device, by table and address.
///
/// A value of several registers is never torn apart, even where it is longer than the device's limit.
pub fn plan<'a>(
    device: &Device,
    signals: impl IntoIterator<Item = (SignalId, &'a Signal)>,
) -> Vec<ReadRequest> {
    let quirks = &device.quirks;
    let mut wanted: Vec<Wanted> = signals
        .into_iter()
        .filter(|(_, signal)| signal.address.table != Table::Process)
        .map(|(id, signal)| Wanted {
            signal: id,
            address: signal.address,
            len: signal.encoding.data_type.registers(),
            alone: quirks.one_request_per_field || !signal.merge || signal.address.table.is_can(),
        })
        .collect();
    wanted.sort_by_key(|want| (want.address, want.len, want.signal));
    let (alone, together): (Vec<_>, Vec<_>) = wanted.into_iter().partition(|want| want.alone);
    let mut requests: Vec<ReadRequest> = Vec::new();
    for want in &together {
        let limit = if want.address.table.is_bits() { MAX_BITS } else { quirks.max_registers_per_request };
        match requests.last_mut() {
            Some(request) if request.can_take(want, quirks.max_gap, limit) => request.take(want),
            _ => requests.push(ReadRequest::of(want)),
        }
    }
    requests.extend(alone.iter().map(ReadRequest::of));
    requests.sort_by_key(|request| (request.table, request.start, request.fields[0].signal));
    requests
}

impl ReadRequest {
    fn of(want: &Wanted) -> ReadRequest {
        ReadRequest {
            table: want.address.table,
            start: want.address.offset,
            count: want.len,
            fields: vec![Field { signal: want.signal, at: 0, len: want.len }],
        }
    }

    fn end(&self) -> u32 {
        u32::from(self.start) + u32::from(self.count)
    }

    /// Wanted come in the order of their addresses, so only the end can move.
    fn can_take(&self, want: &Wanted, max_gap: u16, limit: u16) -> bool {
        let end = (u32::from(want.address.offset) + u32::from(want.len)).max(self.end());
        self.table == want.address.table
            && u32::from(want.address.offset) <= self.end() + u32::from(max_gap)
            && end - u32::from(self.start) <= u32::from(limit)
    }

    fn take(&mut self, want: &Wanted) {
        let at = want.address.offset - self.start;
        self.count = self.count.max(at + want.len);
        self.fields.push(Field { signal: want.signal, at, len: want.len });
    }

    /// As it goes over the wire.
    pub fn request(&self) -> Request<'static> {
        Request::Read { from: self.first(), count: self.count }
    }

    /// The address of the first register or bit.
    pub fn first(&self) -> Address {
        Address { table: self.table, offset: self.start }
    }

    /// The address of the last register or bit.
    pub fn last(&self) -> Address {
        Address { table: self.table, offset: self.start.saturating_add(self.count - 1) }
    }
}

impl Field {
    /// The signal's value in the answer to its request.
    ///
    /// # Errors
    /// Why there is none.
    pub fn decode(&self, encoding: &Encoding, answer: &Answer) -> Result<f64, Reason> {
        let (from, to) = (usize::from(self.at), usize::from(self.at) + usize::from(self.len));
        match answer {
            Answer::Words(words) => encoding.decode(words.get(from..to).ok_or(Reason::BadReply)?),
            Answer::Bits(bits) => encoding.decode_bit(*bits.get(from).ok_or(Reason::BadReply)?),
            Answer::Done => Err(Reason::BadReply),
        }
    }
}

/// `read input:0..7 (30001..30008), 8 registers`.
impl fmt::Display for ReadRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = (self.first(), self.last());
        let plural = if self.count == 1 { "" } else { "s" };
        let cells = if self.table.is_bits() { "bit" } else { "register" };
        if first == last {
            write!(f, "read {first} ({})", first.modicon())?;
        } else {
            write!(f, "read {first}..{} ({}..{})", last.offset, first.modicon(), last.modicon())?;
        }
        write!(f, ", {} {cells}{plural}", self.count)
    }
}

/// `3 requests touching 17 registers for 9 signals`.
pub fn summary(requests: &[ReadRequest]) -> String {
    if requests.is_empty() {
        return "nothing is read".to_owned();
    }
    let counted = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let touched = |bits: bool| {
        requests
            .iter()
            .filter(|request| request.table.is_bits() == bits)
            .map(|request| usize::from(request.count))
            .sum()
    };
    let (registers, bits): (usize, usize) = (touched(false), touched(true));
    let cells: Vec<String> = [(registers, "register"), (bits, "bit")]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| counted(count, what))
        .collect();
    let signals = requests.iter().map(|request| request.fields.len()).sum();
    format!(
        "{} touching {} for {}",
        counted(requests.len(), "request"),
        cells.join(" and "),
        counted(signals, "signal")
    )
}

#[cfg(test)]
mod tests;
