//! Advice for users about faults that only Modbus has.
//!
//! Table of observations ([`Sight`]): for each observation, the key of the profile that helps, and the chapter of the
//! manual that describes it.

use super::text::TextProtocol;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::seen::{Advice, Asked, Others, Seen};
use crate::tls::TlsFault;

/// Advice on a request without an answer in time. This is a macro, because the table of advice appends to this text at
/// compile time.
macro_rules! silent {
    () => {
        "is the unit number right (`isotherm scan` finds it), is the device powered? On a serial line also check baud \
         rate, parity, termination, and whether A and B are exchanged. Some devices do not answer at all if they do \
         not have the register"
    };
}

/// Advice on a request without an answer in time.
pub(in crate::fieldbus) const SILENT: &str = silent!();

/// Observation about a failed request, for which there is specific advice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fieldbus) enum Sight {
    /// Exception 2 to a read of several values with unused registers between them.
    GapRefused,
    /// Exception 2 to a read of several values without a gap.
    ValuesRefused,
    /// Exception 3 to a read of several values.
    CountRefused,
    /// Read of several values without an answer. Other requests to the device were not sent or not answered.
    SeveralUnanswered,
    /// Read of several values without an answer, although the device answers other requests.
    OnlySeveralUnanswered,
    /// Exception 1 to a write with function 06.
    SingleWriteRefused,
    /// Exception 1 to a write with function 16. The gateway writes a single register with function 16 only if
    /// `functions` of the device lack function 06.
    MultipleWriteRefused,
    /// Reply with another unit number.
    OtherUnit,
    /// Reply to a read of several values, with another number of registers.
    OtherCount,
    /// Reply to a read of one value, with another number of registers.
    OtherLength,
    /// Reply to a read, with another function code.
    OtherFunction,
    /// Text of the protocol Modbus ASCII on the line.
    ModbusAscii,
    /// Text of the protocol DCON on the line.
    Dcon,
    /// Text of an unknown protocol on the line.
    OtherText,
    /// Request that the gateway receives back instead of a reply (an echo).
    Echoed,
}

impl Sight {
    /// Returns the observation about this request; `None` if there is no specific advice on it.
    const fn of(seen: Seen) -> Option<Sight> {
        let is_of_several = matches!(seen.asked, Asked::Read { values: 2.., .. });
        Some(match (seen.fault, seen.fault.exception_code(), seen.asked) {
            (_, Some(2), Asked::Read { values: 2.., gap: 1.. }) => Sight::GapRefused,
            (_, Some(2), _) if is_of_several => Sight::ValuesRefused,
            (_, Some(3), _) if is_of_several => Sight::CountRefused,
            (_, Some(1), Asked::Write(6)) => Sight::SingleWriteRefused,
            (_, Some(1), Asked::Write(16)) => Sight::MultipleWriteRefused,
            (Fault::Timeout, ..) if is_of_several => match seen.others {
                Others::Unknown => Sight::SeveralUnanswered,
                Others::Answered => Sight::OnlySeveralUnanswered,
            },
            (Fault::Peer(PeerFault::Unit(_)), ..) => Sight::OtherUnit,
            (Fault::Peer(PeerFault::Length), ..) if is_of_several => Sight::OtherCount,
            (Fault::Peer(PeerFault::Length), _, Asked::Read { .. }) => Sight::OtherLength,
            (Fault::Peer(PeerFault::Function), _, Asked::Read { .. }) => Sight::OtherFunction,
            (Fault::Peer(PeerFault::Text(TextProtocol::ModbusAscii)), ..) => Sight::ModbusAscii,
            (Fault::Peer(PeerFault::Text(TextProtocol::Dcon)), ..) => Sight::Dcon,
            (Fault::Peer(PeerFault::Text(TextProtocol::Other)), ..) => Sight::OtherText,
            (Fault::Peer(PeerFault::Echoed), ..) => Sight::Echoed,
            _ => return None,
        })
    }

    /// Returns the advice on this observation.
    const fn advice(self) -> Advice {
        const QUIRKS: &str = "serial.md#quirks";
        const PROTOCOL: &str = "serial.md#another-protocol-on-the-line";
        let (hint, key, chapter) = match self {
            Sight::GapRefused => (
                "the device has no such register. The request also reads registers between the values: if each value \
                 can be read alone, write `quirks = { max_gap = 0 }`. Otherwise: is the register number \
                 in its manual one-based?",
                Some("max_gap"),
                QUIRKS,
            ),
            Sight::ValuesRefused => (
                "the device has no such register: is a register number in its manual one-based? If each value can be \
                 read alone, write `quirks = { one_request_per_field = true }` at the device",
                Some("one_request_per_field"),
                QUIRKS,
            ),
            Sight::CountRefused => (
                "the device does not accept so many registers in one request: write a smaller \
                 `max_registers_per_request` into the `quirks` of the device",
                Some("max_registers_per_request"),
                QUIRKS,
            ),
            Sight::SeveralUnanswered => (
                concat!(
                    silent!(),
                    ". Other devices do not answer a read of many registers, or a read that includes \
                     unused registers: write `max_registers_per_request` or `max_gap` into the `quirks`"
                ),
                Some("max_registers_per_request"),
                QUIRKS,
            ),
            Sight::OnlySeveralUnanswered => (
                "the device answers other requests, but not this read of several values: write a smaller \
                 `max_registers_per_request`, or `max_gap = 0`, into its `quirks`",
                Some("max_registers_per_request"),
                QUIRKS,
            ),
            Sight::SingleWriteRefused => (
                "the device does not know function 06, which writes one register: write `functions` at the device \
                 without \"write-single\". The gateway then writes with function 16",
                Some("functions"),
                "control.md#the-function-that-writes",
            ),
            Sight::MultipleWriteRefused => (
                "the device does not know function 16, which writes several registers. A value must then have one \
                 register: write a `type` of 16 bits, and `functions` at the device with \"write-single\" and without \
                 \"write-multiple\". The gateway then writes with function 06",
                Some("functions"),
                "control.md#the-function-that-writes",
            ),
            Sight::OtherUnit => (
                "if this is the right device, write the unit number of the reply into its `unit`. Some servers \
                 always reply with one unit number, often 0, 1 or 255",
                Some("unit"),
                "troubleshooting.md#find-the-units",
            ),
            Sight::OtherCount => (
                "the device sends another number of registers than requested: write a smaller \
                 `max_registers_per_request`, or `one_request_per_field = true`, into its `quirks`",
                Some("max_registers_per_request"),
                QUIRKS,
            ),
            Sight::OtherLength => (
                "does `type` have as many registers as the value in the device?",
                Some("type"),
                "troubleshooting.md#read-a-register",
            ),
            Sight::OtherFunction => (
                "is the table of `register` right (input, holding)? Some devices answer with the function of the other \
                 table",
                Some("register"),
                "troubleshooting.md#read-a-register",
            ),
            Sight::ModbusAscii => (
                "write type = \"modbus-ascii\" at the bus; or set the device, or the Modbus gateway in front of it, from \
                 Modbus ASCII to Modbus RTU",
                Some("type"),
                PROTOCOL,
            ),
            Sight::Dcon => (
                "set the protocol of the device from DCON to Modbus RTU, with its configuration program or its switch \
                 INIT",
                None,
                PROTOCOL,
            ),
            Sight::OtherText => (
                "is the port right? A console, a web server or another program sends text at this port",
                None,
                PROTOCOL,
            ),
            Sight::Echoed => (
                "an adapter or a serial server sends the request back, and no device answers. Check its mode (echo, \
                 loopback), the wires to the device, the unit number and the baud rate",
                None,
                PROTOCOL,
            ),
        };
        Advice { hint, key, chapter }
    }
}

/// Returns the advice on a failed request; `None` if the table has no advice on this request.
pub(in crate::fieldbus) fn advice(seen: Seen) -> Option<Advice> {
    Sight::of(seen).map(Sight::advice)
}

/// Returns what the user can do about a Modbus exception with this code.
pub(in crate::fieldbus) const fn exception(code: u8) -> &'static str {
    match code {
        1 => "the device does not know this function: is the register in another table (input, holding)?",
        2 => {
            "the device has no such register: is the register number in its manual one-based? Then subtract \
             1 from it"
        }
        3 => "the device does not accept this value, or not so many registers in one request",
        4 => "the device could not execute the request: the display or log of the device says why",
        5 => "the device has accepted the request and needs more time for it: try again later",
        6 => "the device is busy: try again later, or poll it less often",
        8 => "the device's memory is faulty: switch the device off and on. If that fails, have it repaired",
        10 | 11 => {
            "the Modbus gateway answers, but not the device behind it. Is the unit number right \
             (`isotherm scan` finds it)? Is the device powered? Are baud rate and wiring behind the Modbus \
             gateway right?"
        }
        _ => "the device's manual says what this exception code means",
    }
}

/// Returns what to do about a fault of Modbus inside TLS; `None` if the text of its cause is sufficient.
pub(in crate::fieldbus) const fn inside_tls(fault: TlsFault) -> Option<&'static str> {
    Some(match fault {
        TlsFault::OtherName => {
            "write the name in the device's certificate into `tls.name`, or put the certificate itself into \
             the file of `tls.ca`"
        }
        TlsFault::UnknownAuthority => {
            "put the certificate of the authority that signed the device's certificate into the file of `tls.ca`"
        }
        TlsFault::BadCertificate => {
            "if the device has signed its certificate itself, put this certificate into the file of `tls.ca`"
        }
        TlsFault::OursExpired => "renew the certificate in `tls.cert`",
        TlsFault::OursMissing | TlsFault::OursRefused => {
            "does the device know the authority that signed the certificate in `tls.cert`, and does it \
             accept the role in this certificate?"
        }
        TlsFault::NoTls => "the port of the device for Modbus inside TLS is usually 802",
        TlsFault::Silent => "does the device support TLS, and does it accept another client?",
        TlsFault::TurnedAway => {
            "does the device accept the certificate in `tls.cert`, and does it accept another client?"
        }
        TlsFault::OurFiles => "`isotherm check` says why",
        TlsFault::Expired | TlsFault::NotYetValid | TlsFault::NothingInCommon | TlsFault::Refused => {
            return None;
        }
    })
}

#[cfg(test)]
mod tests;
