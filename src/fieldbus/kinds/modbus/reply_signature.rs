//! Features by which the answer to one Modbus request differs from the answer to another.

use super::request::ModbusRequest;
use crate::fieldbus::request::Request;

/// Form of an answer: its function, and its length or the echo of a write. Answers of different forms cannot be
/// confused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplySignature {
    function: u8,
    form: [u16; 2],
}

impl ReplySignature {
    /// Returns the form of the answer to a Modbus request. Requests of other protocols all get the same form.
    pub(in crate::fieldbus) fn of(request: Request<'_>) -> ReplySignature {
        let Request::Modbus(request) = request else { return ReplySignature { function: 0, form: [0, 0] } };
        let form = match request {
            ModbusRequest::Read { from, count } if from.table.is_bits() => [count.div_ceil(8), 0],
            ModbusRequest::Read { count, .. } => [2 * count, 0],
            ModbusRequest::WriteCoil { at, value } => [at, if value { 0xff00 } else { 0 }],
            ModbusRequest::WriteSingle { at, value } => [at, value],
            ModbusRequest::WriteMultiple { at, values } => {
                [at, u16::try_from(values.len()).unwrap_or(u16::MAX)]
            }
        };
        ReplySignature { function: request.function(), form }
    }

    /// Returns the form (function and length) of an answer to a read; `None` for any other message.
    pub(super) fn of_answer(pdu: &[u8]) -> Option<ReplySignature> {
        match *pdu {
            [function @ 1..=4, bytes, ..] => Some(ReplySignature { function, form: [u16::from(bytes), 0] }),
            _ => None,
        }
    }

    /// Returns the form of the answer to a read, from the bytes of the request; `None` for any other message.
    pub(super) fn of_question(pdu: &[u8]) -> Option<ReplySignature> {
        let [function @ 1..=4, _, _, high, low] = *pdu else { return None };
        let count = u16::from_be_bytes([high, low]);
        let (most, bytes) = match function {
            1 | 2 => (2000, count.div_ceil(8)),
            _ => (125, 2 * count.min(125)),
        };
        (1..=most).contains(&count).then_some(ReplySignature { function, form: [bytes, 0] })
    }

    /// Returns whether a message has this form (function, and length or echo).
    pub(super) fn is_on(self, pdu: &[u8]) -> bool {
        let word = |at: usize| Some(u16::from_be_bytes([*pdu.get(at)?, *pdu.get(at + 1)?]));
        let form = match self.function {
            1..=4 => pdu.get(1).map(|bytes| [u16::from(*bytes), 0]),
            _ => word(1).zip(word(3)).map(|(at, what)| [at, what]),
        };
        pdu.first() == Some(&self.function) && form == Some(self.form)
    }

    /// Returns whether a message is the exception that refuses a request whose answer has this form (function and
    /// length).
    pub(super) fn is_refused_by(self, pdu: &[u8]) -> bool {
        pdu.len() == 2 && pdu[0] == self.function | 0x80
    }
}
