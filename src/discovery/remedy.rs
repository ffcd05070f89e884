//! Advice on a fault, for the person at the machine.

use std::time::Duration;

use crate::discovery::bus::{LineAddress, ScanKind};
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::explain::explain;
use crate::fieldbus::seen::{Asked, Seen};
use isotherm_core::codec::{Register, Table};
use isotherm_profile::duration_text;

/// Failed request, with the details on which the advice depends.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// Bus line of the request.
    pub line: &'a LineAddress,
    /// Modbus unit that the request addresses.
    pub unit: u8,
    /// First register or bit that was requested.
    pub from: Register,
    /// Number of registers or bits.
    pub count: u16,
    /// Number of values in these registers.
    pub values: u16,
    /// Time within which the answer had to arrive.
    pub timeout: Duration,
}

/// Describes a fault and its remedy: the text of [`explain`], with the details of this request.
pub fn remedy(fault: Fault, question: Question<'_>) -> String {
    let Question { line, unit, from, count, values, timeout } = question;
    let said = explain(Seen::of(fault, Asked::Read { values, gap: 0 }));
    let other = match from.table {
        Table::Holding => Table::Input,
        Table::Input => Table::Holding,
        Table::Coil => Table::Discrete,
        Table::Discrete => Table::Coil,
    };
    match (fault, fault.exception_code()) {
        (Fault::Timeout, _) => {
            format!("unit {unit} within {}: {said}{}", duration_text(timeout), fewer(values))
        }
        (_, Some(1)) => format!("unit {unit}: {said} Try {}:{}", other.name(), from.offset),
        (_, Some(2)) => {
            let last = u32::from(from.offset) + u32::from(count).saturating_sub(1);
            let span = if count > 1 { format!("{from}..{last}") } else { from.to_string() };
            let modicon = from.modicon();
            let below = match from.offset.checked_sub(1) {
                Some(below) if values == 1 => format!(
                    ": try {}:{below}. If {modicon} is the Modicon number in the manual, write {modicon}",
                    from.table.name()
                ),
                _ => fewer(values).to_owned(),
            };
            format!("unit {unit}, {span} ({modicon}): {said}{below}")
        }
        (_, Some(3)) => {
            format!("unit {unit}, read of {count} registers or bits: {said}. Try a smaller --count")
        }
        (Fault::Peer(PeerFault::Length), _) => {
            format!("unit {unit}, read of {count} registers or bits: {said}{}", fewer(values))
        }
        (Fault::Peer(PeerFault::Malformed), _) => match line.kind().scan {
            ScanKind::Units { malformed, .. } => format!("{line}: {said}{malformed}"),
            _ => format!("{line}: {said}"),
        },
        (Fault::Link(_) | Fault::Peer(PeerFault::Text(_) | PeerFault::Echoed), _) => {
            format!("{line}: {said}")
        }
        _ => format!("unit {unit}: {said}"),
    }
}

/// Returns the advice to read fewer values, if the request has several.
fn fewer(values: u16) -> &'static str {
    if values > 1 { ". Try a smaller --count" } else { "" }
}

#[cfg(test)]
mod tests;
