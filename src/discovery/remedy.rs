//! What to do about a fault, for the person in front of the machine.

use std::time::Duration;

use crate::discovery::bus::{LineAddress, Transport};
use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use isotherm_core::codec::{Register, Table};

/// What was asked when the fault came.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// On which line.
    pub line: &'a LineAddress,
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
pub fn remedy(fault: Fault, question: Question<'_>) -> String {
    let Question { line, unit, from, count, timeout } = question;
    let is_serial = line.transport != Transport::Tcp;
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
            "nothing listens on {line}. Is the port right (Modbus TCP has 502), is Modbus switched on in the device, is another \
             master holding its only connection?"
        ),
        Fault::Link(LinkFault::Unreachable) => format!(
            "{line} cannot be reached within {}. Are name and address right, is it powered and on this network, is a \
             firewall between?",
            humantime::format_duration(timeout)
        ),
        Fault::Link(LinkFault::Broken) => format!(
            "{line} closed the connection instead of answering. Many devices take one client at a time: is another master \
             connected? Some close it for a unit number that is not theirs"
        ),
        Fault::Link(LinkFault::Absent) => {
            format!(
                "there is no {}. Is the adapter plugged in? Its lasting name is below /dev/serial/by-id",
                line.address
            )
        }
        Fault::Link(LinkFault::Forbidden) => format!(
            "{} may not be opened by this user: add him to the group that owns it (often dialout)",
            line.address
        ),
        Fault::Link(LinkFault::Busy) => {
            format!("another program has {}: end it, the gateway itself included", line.address)
        }
        Fault::Link(LinkFault::Unsuited) => format!("{line}: {fault}. Does the adapter know this speed?"),
        Fault::Peer(PeerFault::Malformed) => format!(
            "what {line} answers is not Modbus{}",
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
mod tests;
