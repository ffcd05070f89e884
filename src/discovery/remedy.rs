//! What to do about a fault, for the person in front of the machine.

use std::time::Duration;

use crate::discovery::bus::{Place, Transport};
use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use isotherm_core::codec::{Register, Table};

/// What was asked when the fault came.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'a> {
    /// On which line.
    pub place: &'a Place,
    /// Which unit.
    pub unit: u8,
    /// The first register or bit.
    pub from: Register,
    /// How many.
    pub count: u16,
    /// How long the answer was waited for.
    pub timeout: Duration,
}

/// What is wrong and what to do, in a sentence or two.
pub fn remedy(fault: Fault, asked: Asked<'_>) -> String {
    let Asked { place, unit, from, count, timeout } = asked;
    let is_serial = place.transport != Transport::Tcp;
    let wiring = if is_serial {
        "; on a serial line also baud rate and parity, A and B exchanged, termination"
    } else {
        "; behind a gateway to a serial line also its baud rate and wiring"
    };
    let other = match from.table {
        Table::Holding => Table::Input,
        Table::Input => Table::Holding,
        Table::Coil => Table::Discrete,
        Table::Discrete => Table::Coil,
    };
    match fault {
        Fault::Timeout => format!(
            "unit {unit} does not answer within {}. Is the unit number right (`isotherm scan` finds it), is it powered{wiring}? \
             Some devices answer nothing at all for a register they do not have",
            humantime::format_duration(timeout)
        ),
        Fault::Exception(1) => format!(
            "unit {unit} answers, but does not know function {:02}, which reads {} registers. Try {}:{}",
            from.table.read_function(),
            from.table.name(),
            other.name(),
            from.offset
        ),
        Fault::Exception(2) => {
            let last = u32::from(from.offset) + u32::from(count).saturating_sub(1);
            let span = if count > 1 { format!("{from}..{last}") } else { from.to_string() };
            let below = from.offset.checked_sub(1).map_or(String::new(), |below| {
                format!(
                    " Is the number in its manual one-based? Then try {}:{below}; a Modicon number such as {} can be \
                     written as it is",
                    from.table.name(),
                    from.modicon()
                )
            });
            format!("unit {unit} answers, but has no {span} ({}).{below}", from.modicon())
        }
        Fault::Exception(3) => {
            format!(
                "unit {unit} answers, but does not take a request for {count} at once. Try a smaller --count"
            )
        }
        Fault::Exception(5 | 6) => format!("unit {unit} is busy ({fault}). Try again"),
        Fault::Exception(10 | 11) => format!(
            "the gateway answers, but nobody behind it as unit {unit} ({fault}). Is the unit number right \
             (`isotherm scan` finds it), is it powered{wiring}?"
        ),
        Fault::Exception(_) => format!("unit {unit} answers, but says no: {fault}"),
        Fault::Link(LinkFault::Refused) => format!(
            "nothing listens on {place}. Is the port right (Modbus TCP has 502), is Modbus switched on in the device, is another \
             master holding its only connection?"
        ),
        Fault::Link(LinkFault::Unreachable) => format!(
            "{place} cannot be reached within {}. Are name and address right, is it powered and on this network, is a \
             firewall between?",
            humantime::format_duration(timeout)
        ),
        Fault::Link(LinkFault::Broken) => format!(
            "{place} closed the connection instead of answering. Many devices take one client at a time: is another master \
             connected? Some close it for a unit number that is not theirs"
        ),
        Fault::Link(LinkFault::Absent) => {
            format!(
                "there is no {}. Is the adapter plugged in? Its lasting name is below /dev/serial/by-id",
                place.address
            )
        }
        Fault::Link(LinkFault::Forbidden) => format!(
            "{} may not be opened by this user: add him to the group that owns it (often dialout)",
            place.address
        ),
        Fault::Link(LinkFault::Busy) => {
            format!("another program has {}: end it, the gateway itself included", place.address)
        }
        Fault::Link(LinkFault::Unsuited) => format!("{place}: {fault}. Does the adapter know this speed?"),
        Fault::Peer(PeerFault::Malformed) => format!(
            "what {place} answers is not Modbus{}",
            if is_serial {
                ": baud rate, parity, or two units with one number"
            } else {
                " TCP. Is it RTU over TCP? Write rtu+tcp://"
            }
        ),
        Fault::Peer(PeerFault::Foreign) => {
            format!("something else answers than unit {unit}: {fault}. Is another master on the line?")
        }
        fault => format!("unit {unit}: {fault}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_told_with_what_to_do() {
        let place: Place = "tcp://10.0.0.7".parse().unwrap();
        let asked = |register: &str| Asked {
            place: &place,
            unit: 3,
            from: register.parse().unwrap(),
            count: 1,
            timeout: Duration::from_millis(500),
        };
        for (fault, register, words) in [
            (Fault::Timeout, "input:0", &["unit 3 does not answer within 500ms", "isotherm scan"][..]),
            (Fault::Exception(1), "input:4", &["function 04", "Try holding:4"]),
            (Fault::Exception(2), "40101", &["has no holding:100 (40101)", "try holding:99"]),
            (Fault::Exception(2), "holding:0", &["has no holding:0 (40001)."]),
            (Fault::Exception(3), "holding:0", &["smaller --count"]),
            (Fault::Exception(6), "holding:0", &["busy", "Try again"]),
            (Fault::Exception(11), "holding:0", &["nobody behind it as unit 3"]),
            (Fault::Link(LinkFault::Refused), "holding:0", &["nothing listens on tcp://10.0.0.7:502"]),
            (Fault::Link(LinkFault::Broken), "holding:0", &["one client at a time"]),
            (Fault::Peer(PeerFault::Malformed), "holding:0", &["rtu+tcp://"]),
        ] {
            let said = remedy(fault, asked(register));
            assert!(words.iter().all(|word| said.contains(word)), "{fault:?}: {said}");
        }
    }
}
