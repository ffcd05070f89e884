//! Objects of a virtual CANopen node, and its SDO server, by which a client reads and writes these objects. The server
//! supports expedited transfers (at most four bytes in one frame) and segmented transfers.

use std::collections::BTreeMap;

use crate::fieldbus::kinds::can::canopen::abort::AbortCode;
use isotherm_core::codec::Entry;

/// Value of an object, as bytes with the lowest first, and whether the object is writable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredObject {
    /// Value of the object, lowest byte first.
    bytes: Vec<u8>,
    /// Whether an SDO request may write the object.
    is_writable: bool,
}

/// Objects of a CANopen node by index and sub-index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Dictionary {
    objects: BTreeMap<Entry, StoredObject>,
}

/// Result of an SDO request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct SdoReply {
    /// Data of the answer to the client; `None` if the request gets no answer.
    pub(crate) answer: Option<[u8; 8]>,
    /// Object that the request has written; `None` for a read, a rejected write, or a write that is not complete yet.
    pub(crate) written: Option<Entry>,
}

/// State of the SDO server of a node: the segmented transfer in progress, if any.
#[derive(Clone, Debug, Default)]
pub(crate) struct Server(Option<Transfer>);

#[derive(Clone, Debug)]
struct Transfer {
    at: Entry,
    way: TransferState,
    /// Upload: all bytes to send. Download: bytes received so far.
    bytes: Vec<u8>,
    toggle: bool,
}

#[derive(Clone, Debug)]
enum TransferState {
    /// Upload (the client reads): number of bytes sent so far.
    Out(usize),
    /// Download (the client writes): total number of bytes.
    In(usize),
}

/// Object with index and sub-index 0, which the abort message names if a segment belongs to no transfer.
pub(crate) const NONE: Entry = Entry::new(0, 0);

impl Dictionary {
    /// Adds an object, or replaces it.
    pub(crate) fn put(&mut self, at: Entry, bytes: &[u8], is_writable: bool) {
        self.objects.insert(at, StoredObject { bytes: bytes.to_vec(), is_writable });
    }

    /// Changes the value of an existing object; does nothing if the object does not exist.
    pub(crate) fn set(&mut self, at: Entry, bytes: &[u8]) {
        if let Some(object) = self.objects.get_mut(&at) {
            object.bytes.clear();
            object.bytes.extend_from_slice(bytes);
        }
    }

    /// Returns the value of an object; `None` if it does not exist.
    pub(crate) fn get(&self, at: Entry) -> Option<&[u8]> {
        self.objects.get(&at).map(|object| object.bytes.as_slice())
    }

    /// Returns the value of an object as an unsigned number; `None` if it has more than eight bytes or does not exist.
    pub(crate) fn number(&self, at: Entry) -> Option<u64> {
        let bytes = self.get(at)?;
        let mut eight = [0; 8];
        eight.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(u64::from_le_bytes(eight))
    }

    /// Sets the objects with these indices to their values in the dictionary `from`.
    pub(crate) fn restore(&mut self, from: &Dictionary, indices: std::ops::Range<u16>) {
        for (at, object) in from.objects.range(Entry::new(indices.start, 0)..Entry::new(indices.end, 0)) {
            self.objects.insert(*at, object.clone());
        }
    }

    /// Makes an existing object writable by SDO requests.
    pub(crate) fn unlock(&mut self, at: Entry) {
        if let Some(object) = self.objects.get_mut(&at) {
            object.is_writable = true;
        }
    }

    fn missing(&self, at: Entry) -> AbortCode {
        let is_known =
            self.objects.range(Entry::new(at.index, 0)..=Entry::new(at.index, u8::MAX)).next().is_some();
        if is_known { AbortCode::NO_SUB_INDEX } else { AbortCode::NO_OBJECT }
    }

    fn writable(&self, at: Entry) -> Result<&StoredObject, AbortCode> {
        let object = self.objects.get(&at).ok_or_else(|| self.missing(at))?;
        if object.is_writable { Ok(object) } else { Err(AbortCode::READ_ONLY) }
    }

    fn write(&mut self, at: Entry, bytes: &[u8]) -> Result<(), AbortCode> {
        if self.writable(at)?.bytes.len() != bytes.len() {
            return Err(AbortCode::LENGTH);
        }
        self.set(at, bytes);
        Ok(())
    }
}

impl Server {
    /// Returns whether an SDO request is part of a download, that is, of a write.
    pub(crate) fn is_write(request: &[u8]) -> bool {
        request.first().is_some_and(|command| matches!(command >> 5, 0 | 1))
    }

    /// Returns the object that an SDO request names; `None` for a segment, which names none.
    pub(crate) fn names(request: &[u8]) -> Option<Entry> {
        match request {
            [command, low, high, sub, ..] if matches!(command >> 5, 1 | 2) => {
                Some(Entry::new(u16::from_le_bytes([*low, *high]), *sub))
            }
            _ => None,
        }
    }

    /// Executes one SDO request. A request that is not eight bytes long is ignored.
    pub(crate) fn serve(&mut self, request: &[u8], objects: &mut Dictionary) -> SdoReply {
        let Ok([command, low, high, sub, rest @ ..]) = <[u8; 8]>::try_from(request) else {
            return SdoReply::default();
        };
        let at = Entry::new(u16::from_le_bytes([low, high]), sub);
        let answered = match command >> 5 {
            // The client aborts the transfer.
            4 => {
                self.0 = None;
                return SdoReply::default();
            }
            2 => self.read(at, objects),
            1 => self.write(at, command, rest, objects),
            0 | 3 => self.segment(command, &request[1..], objects),
            _ => Err((at, AbortCode::COMMAND)),
        };
        match answered {
            Ok((answer, written)) => SdoReply { answer: Some(answer), written },
            Err((at, code)) => {
                self.0 = None;
                SdoReply { answer: Some(refusal(at, code)), written: None }
            }
        }
    }

    fn read(&mut self, at: Entry, objects: &Dictionary) -> Answered {
        let bytes = objects.get(at).ok_or_else(|| (at, objects.missing(at)))?;
        self.0 = None;
        if (1..=4).contains(&bytes.len()) {
            let mut rest = [0; 4];
            rest[..bytes.len()].copy_from_slice(bytes);
            return Ok((message(0x43 | spare(4, bytes.len()) << 2, at, rest), None));
        }
        let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        self.0 = Some(Transfer { at, way: TransferState::Out(0), bytes: bytes.to_vec(), toggle: false });
        Ok((message(0x41, at, length.to_le_bytes()), None))
    }

    fn write(&mut self, at: Entry, command: u8, rest: [u8; 4], objects: &mut Dictionary) -> Answered {
        let width = objects.writable(at).map_err(|code| (at, code))?.bytes.len();
        self.0 = None;
        let done = message(0x60, at, [0; 4]);
        if command & 2 == 2 {
            let length = if command & 1 == 1 { 4 - usize::from(command >> 2 & 3) } else { width.min(4) };
            objects.write(at, &rest[..length]).map_err(|code| (at, code))?;
            return Ok((done, Some(at)));
        }
        if command & 1 == 1 && usize::try_from(u32::from_le_bytes(rest)) != Ok(width) {
            return Err((at, AbortCode::LENGTH));
        }
        self.0 = Some(Transfer { at, way: TransferState::In(width), bytes: Vec::new(), toggle: false });
        Ok((done, None))
    }

    /// Transfers the next segment of an upload or a download. Returns the answer, or the object and the abort
    /// code.
    fn segment(&mut self, command: u8, data: &[u8], objects: &mut Dictionary) -> Answered {
        let is_out = command >> 5 == 3;
        let going =
            self.0.as_mut().filter(|transfer| matches!(transfer.way, TransferState::Out(_)) == is_out);
        let Some(Transfer { at, way, bytes, toggle }) = going else { return Err((NONE, AbortCode::COMMAND)) };
        let at = *at;
        if (command & 0x10 != 0) != *toggle {
            return Err((at, AbortCode::TOGGLE));
        }
        let toggled = u8::from(*toggle) << 4;
        *toggle = !*toggle;
        match way {
            TransferState::Out(sent) => {
                let until = bytes.len().min(*sent + 7);
                let part = &bytes[*sent..until];
                let is_last = until == bytes.len();
                let mut answer = [0; 8];
                answer[0] = toggled | spare(7, part.len()) << 1 | u8::from(is_last);
                answer[1..=part.len()].copy_from_slice(part);
                *sent = until;
                if is_last {
                    self.0 = None;
                }
                Ok((answer, None))
            }
            TransferState::In(width) => {
                bytes.extend_from_slice(&data[..7 - usize::from(command >> 1 & 7)]);
                if bytes.len() > *width {
                    return Err((at, AbortCode::LENGTH));
                }
                let answer = message(0x20 | toggled, NONE, [0; 4]);
                if command & 1 == 0 {
                    return Ok((answer, None));
                }
                let bytes = std::mem::take(bytes);
                self.0 = None;
                objects.write(at, &bytes).map_err(|code| (at, code))?;
                Ok((answer, Some(at)))
            }
        }
    }
}

/// Answer and written object; or, for a rejected request, the object and the abort code.
type Answered = Result<([u8; 8], Option<Entry>), (Entry, AbortCode)>;

/// Returns the SDO abort message that rejects a request for this object.
pub(crate) fn refusal(at: Entry, code: AbortCode) -> [u8; 8] {
    message(0x80, at, code.0.to_le_bytes())
}

fn message(command: u8, at: Entry, rest: [u8; 4]) -> [u8; 8] {
    let [low, high] = at.index.to_le_bytes();
    let [a, b, c, d] = rest;
    [command, low, high, at.sub, a, b, c, d]
}

/// Returns the number of unused bytes, if `taken` of `places` bytes are used.
fn spare(places: usize, taken: usize) -> u8 {
    u8::try_from(places - taken).unwrap_or_default()
}
