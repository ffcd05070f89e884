//! Which registers a unit has: read in bounded steps, and where a step is refused, in halves of it.

use serde::Serialize;

use crate::discovery::ask::Asker;
use crate::fieldbus::error::Fault;
use crate::fieldbus::trace::Exchange;
use crate::fieldbus::wire::Answer;
use isotherm_core::codec::Register;

/// Steps without any answer after which a walk gives up: the unit is gone.
const SILENCES: u32 = 3;
/// Registers and bits of one step.
pub const STEP: u16 = 16;

/// Some registers of a unit, and what came of reading them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stretch {
    /// The first register.
    pub register: String,
    /// Its one-based number.
    pub modicon: String,
    /// How many.
    pub count: u16,
    /// Their values; `None` where they cannot be read.
    pub values: Option<Vec<u16>>,
    /// Why not, in words; empty where they can.
    pub why: String,
}

/// What a walk tells.
#[derive(Clone, Debug, PartialEq)]
pub enum Walked {
    /// The next registers.
    Stretch(Stretch),
    /// What passed on the wire.
    Exchange(Exchange),
}

/// Reads `count` registers from `from` on, and tells each stretch that can or cannot be read, in their order.
///
/// # Errors
/// The fault that made it give up.
pub async fn walk(
    asker: &mut Asker,
    unit: u8,
    from: Register,
    count: u16,
    mut tell: impl FnMut(Walked),
) -> Result<(), Fault> {
    let mut silences = 0;
    // What is still to be read, the nearest last.
    let mut left = Vec::new();
    let end = (u32::from(from.offset) + u32::from(count)).min(65_536);
    let mut start = u32::from(from.offset);
    while start < end {
        let step = u32::from(STEP).min(end - start);
        left.push((start, step));
        start += step;
    }
    left.reverse();
    let mut missing: Option<Stretch> = None;
    while let Some((start, count)) = left.pop() {
        let (Ok(offset), Ok(length)) = (u16::try_from(start), u16::try_from(count)) else { continue };
        let first = Register { offset, ..from };
        let answer = asker.read(unit, first, length).await;
        while let Some(exchange) = asker.heard() {
            tell(Walked::Exchange(exchange));
        }
        let refused = matches!(answer, Err(Fault::Exception(2 | 3)));
        if refused && count > 1 {
            let half = count / 2;
            left.push((start + half, count - half));
            left.push((start, half));
            continue;
        }
        silences = if answer == Err(Fault::Timeout) { silences + 1 } else { 0 };
        match answer {
            Ok(answer) => {
                if let Some(stretch) = missing.take() {
                    tell(Walked::Stretch(stretch));
                }
                tell(Walked::Stretch(stretch(first, length, Ok(words(answer)))));
            }
            Err(fault) if silences >= SILENCES || !matches!(fault, Fault::Timeout | Fault::Exception(_)) => {
                return Err(fault);
            }
            Err(fault) => match &mut missing {
                Some(before) if before.why == fault.to_string() => before.count += length,
                _ => {
                    if let Some(stretch) = missing.take() {
                        tell(Walked::Stretch(stretch));
                    }
                    missing = Some(stretch(first, length, Err(fault)));
                }
            },
        }
    }
    if let Some(stretch) = missing {
        tell(Walked::Stretch(stretch));
    }
    Ok(())
}

fn words(answer: Answer) -> Vec<u16> {
    match answer {
        Answer::Words(words) => words,
        Answer::Bits(bits) => bits.into_iter().map(u16::from).collect(),
        Answer::Done => Vec::new(),
    }
}

fn stretch(first: Register, count: u16, read: Result<Vec<u16>, Fault>) -> Stretch {
    let why = read.as_ref().err().map_or(String::new(), Fault::to_string);
    Stretch { register: first.to_string(), modicon: first.modicon(), count, values: read.ok(), why }
}
