//! Search for the registers of a unit. The search reads in steps of limited size. If the unit refuses a range, the
//! search divides this range into halves.

use serde::Serialize;

use crate::discovery::unit_reader::UnitReader;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::Answer;
use isotherm_core::codec::Register;

/// Number of consecutive timeouts after which the search ends, because the unit seems to be off.
const SILENCES: u32 = 3;
/// Number of registers or bits that are read in one step.
pub const STEP: u16 = 16;

/// Range of registers of a unit, and the result of reading it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegisterRange {
    /// Address of the first register, zero-based, with its table.
    pub register: String,
    /// Number of the first register in the one-based Modicon notation.
    pub modicon: String,
    /// Number of registers or bits.
    pub count: u16,
    /// Values of the registers; `None` if the range cannot be read.
    pub values: Option<Vec<u16>>,
    /// Reason why the range cannot be read; empty if it can.
    pub why: String,
}

impl RegisterRange {
    fn new(first: Register, count: u16, read: Result<Vec<u16>, Fault>) -> RegisterRange {
        let why = read.as_ref().err().map_or(String::new(), Fault::to_string);
        RegisterRange { register: first.to_string(), modicon: first.modicon(), count, values: read.ok(), why }
    }
}

/// Reads `count` registers from `from`. Divides this range into readable and unreadable parts, and calls `take` with
/// each part, in ascending order.
///
/// # Errors
/// The fault because of which the search ended early.
pub async fn walk(
    asker: &mut UnitReader,
    unit: u8,
    from: Register,
    count: u16,
    mut take: impl FnMut(RegisterRange),
) -> Result<(), Fault> {
    let mut silences = 0;
    let end = (u32::from(from.offset) + u32::from(count)).min(65_536);
    // Ranges still to read, the nearest last: start and length.
    let starts = (u32::from(from.offset)..end).step_by(usize::from(STEP)).rev();
    let mut left: Vec<(u32, u32)> = starts.map(|start| (start, u32::from(STEP).min(end - start))).collect();
    let mut missing: Option<RegisterRange> = None;
    while let Some((start, count)) = left.pop() {
        let (Ok(offset), Ok(length)) = (u16::try_from(start), u16::try_from(count)) else { continue };
        let first = Register { offset, ..from };
        let answer = asker.read(unit, first, length).await;
        let refused = answer.as_ref().err().and_then(|fault| fault.exception_code());
        if count > 1 && matches!(refused, Some(2 | 3)) {
            let half = count / 2;
            left.push((start + half, count - half));
            left.push((start, half));
            continue;
        }
        silences = if answer == Err(Fault::Timeout) { silences + 1 } else { 0 };
        match answer {
            Ok(answer) => {
                missing.take().into_iter().for_each(&mut take);
                take(RegisterRange::new(first, length, Ok(registers(answer))));
            }
            Err(fault) if silences >= SILENCES || (fault != Fault::Timeout && refused.is_none()) => {
                return Err(fault);
            }
            Err(fault) => match &mut missing {
                Some(before) if before.why == fault.to_string() => before.count += length,
                _ => {
                    let next = RegisterRange::new(first, length, Err(fault));
                    missing.replace(next).into_iter().for_each(&mut take);
                }
            },
        }
    }
    missing.into_iter().for_each(take);
    Ok(())
}

fn registers(answer: Answer) -> Vec<u16> {
    match answer {
        Answer::Registers(registers) => registers,
        Answer::Bits(bits) => bits.into_iter().map(u16::from).collect(),
        Answer::Done | Answer::Nodes(_) => Vec::new(),
    }
}
