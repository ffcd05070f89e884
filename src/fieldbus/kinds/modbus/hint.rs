//! Remedies for faults that occur only on Modbus lines.

use crate::tls::TlsFault;

/// Returns what to do about an exception.
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
        8 => "the device's memory is faulty: switch it off and on, then have it repaired",
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
            "put the certificate of the authority that signed it into the file of `tls.ca`"
        }
        TlsFault::BadCertificate => {
            "if the device has signed its certificate itself, put this certificate into the file of `tls.ca`"
        }
        TlsFault::OursExpired => "renew the certificate in `tls.cert`",
        TlsFault::OursMissing | TlsFault::OursRefused => {
            "does the device know the authority that signed the certificate in `tls.cert`, and the role in \
             it?"
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
