//! Description of a failed request: its fault, its extent, and whether the device answers other requests. The advice to
//! the user depends on it.

use std::borrow::Cow;

use super::error::Fault;
use isotherm_profile::plan::ReadRequest;

/// Failed request, as far as the advice to the user depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// Fault of the request.
    pub fault: Fault,
    /// Kind and size of the request.
    pub asked: Asked,
    /// Whether the device answers other requests while this request fails.
    pub others: Others,
}

/// Kind and size of a request to a Modbus unit, as far as they change the advice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Asked {
    /// Request whose details do not change the advice.
    #[default]
    Any,
    /// Read of registers or bits.
    Read {
        /// Number of values that the read contains.
        values: u16,
        /// Largest number of unused registers between two values.
        gap: u16,
    },
    /// Write with this function code.
    Write(u8),
}

/// Whether a device answers other requests while one request fails.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Others {
    /// No other request was sent meanwhile, or no other request was answered.
    #[default]
    Unknown,
    /// The device has answered another request meanwhile.
    Answered,
}

/// Advice to the user on a fault, with the matching chapter of the manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Advice {
    /// Instruction to the user.
    pub hint: &'static str,
    /// Key of the profile that helps; `None` if a setting of the device or of another program helps.
    pub key: Option<&'static str>,
    /// Chapter of the manual as a link below `docs`, for example `serial.md#quirks`.
    pub chapter: &'static str,
}

impl Advice {
    /// Returns the hint with a reference to the manual.
    pub fn text(self) -> Cow<'static, str> {
        let Advice { hint, chapter, .. } = self;
        let end = if hint.ends_with('?') { "" } else { "." };
        format!("{hint}{end} See docs/{chapter}").into()
    }
}

impl Seen {
    /// Creates the description of a request of the kind and size `asked` that failed with `fault`. Whether the device
    /// answers other requests is not known.
    pub const fn of(fault: Fault, asked: Asked) -> Seen {
        Seen { fault, asked, others: Others::Unknown }
    }
}

impl From<Fault> for Seen {
    fn from(fault: Fault) -> Seen {
        Seen::of(fault, Asked::Any)
    }
}

impl Asked {
    /// Returns the kind and size of a planned read. Returns [`Asked::Any`] for a read that is not of registers.
    pub fn of(request: &ReadRequest) -> Asked {
        if request.span().is_none() {
            return Asked::Any;
        }
        let mut parts: Vec<(u16, u16)> = request.fields.iter().map(|field| (field.at, field.len)).collect();
        parts.sort_unstable();
        // Registers before `end` are used. Two values may share registers.
        let (mut end, mut gap) = (0, 0);
        for (at, len) in parts {
            gap = at.saturating_sub(end).max(gap);
            end = at.saturating_add(len).max(end);
        }
        Asked::Read { values: u16::try_from(request.fields.len()).unwrap_or(u16::MAX), gap }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::{Register, Table};
    use isotherm_core::reading::SignalId;
    use isotherm_profile::plan::{Field, ReadTarget};

    fn read(fields: &[(u16, u16)]) -> ReadRequest {
        let count = fields.iter().map(|(at, len)| at + len).max().unwrap_or(0);
        let from = Register { table: Table::Input, offset: 100 };
        let fields = fields.iter().map(|(at, len)| Field { at: *at, ..Field::value(SignalId(0), *len) });
        ReadRequest { asks: ReadTarget::Registers { from, count }, fields: fields.collect() }
    }

    #[test]
    fn the_gap_of_a_read_is_the_longest_run_of_registers_that_no_value_uses() {
        for (fields, gap) in [
            (&[(0, 1)][..], 0),
            (&[(0, 2), (2, 2)], 0),
            (&[(0, 1), (3, 1)], 2),
            (&[(3, 1), (0, 1), (9, 2)], 5),
            (&[(0, 4), (1, 1), (5, 1)], 1),
        ] {
            let values = u16::try_from(fields.len()).unwrap();
            assert_eq!(Asked::of(&read(fields)), Asked::Read { values, gap }, "{fields:?}");
        }
        let sensors = ReadRequest { asks: ReadTarget::Sensors(Vec::new()), fields: Vec::new() };
        assert_eq!(Asked::of(&sensors), Asked::Any);
    }
}
