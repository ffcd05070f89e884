//! Outputs that land together, and how a control is told that they are there.
//!
//! A control that is given several values must never see half of them. So the values of a set are written side by side
//! in one request where the registers allow it; a sequence word that changes last says "a new set is whole"; and a
//! handshake (strobe up, acknowledge up, strobe down, acknowledge down) asks the control to take it.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use crate::{Device, DeviceId, Output, OutputId, Profile};
use isotherm_core::codec::{Register, Table};

/// One set: its place in the profile's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SetId(pub usize);

/// Outputs of one device that are written as one. An output with a handshake of its own is a set of one.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSet {
    /// Its name in the profile; that of its only output where it is no `[set.*]`.
    pub name: String,
    /// It stands in the profile as `[set.*]`.
    pub is_named: bool,
    /// Where all of it goes.
    pub device: DeviceId,
    /// What belongs to it, in the order of the file. Never empty.
    pub outputs: Vec<OutputId>,
    /// Counts up with every whole set, written last: one register, 1 to 65535, then 1 again.
    pub sequence: Option<Register>,
    /// All other words of the set, the sequence with them, summed to 16 bits and inverted: one register.
    pub complement: Option<Register>,
    /// Counts up with every write: one register, 0 to 32767.
    pub heartbeat: Option<Register>,
    /// What the gateway does, in bits: one register. See [`Control`].
    pub control: Option<Register>,
    /// A number that control and profile agree on.
    pub version: Option<(Register, u16)>,
    /// Registers between its words are written as 0.
    pub zeros: bool,
    /// How the control is asked to take it.
    pub handshake: Option<Handshake>,
}

/// The bits of a set's control word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Control;

impl Control {
    /// Every axis of the set is armed.
    pub const ENABLE: u16 = 1;
    /// One of them keeps its value.
    pub const HOLD: u16 = 2;
    /// One of them takes its fault action.
    pub const FAULT: u16 = 4;
    /// One of them follows a lesser model.
    pub const DEGRADED: u16 = 8;
}

/// A strobe and its acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handshake {
    /// Ours: "take it".
    pub strobe: Flag,
    /// The control's: "taken".
    pub acknowledge: Flag,
    /// Longest wait for the acknowledge to rise, and again for it to drop.
    pub timeout: Duration,
}

/// One bit: a coil, a discrete input, a register as a whole (0 or not), or one bit of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flag {
    /// Where.
    pub address: Register,
    /// Which bit of the register, 0 to 15; `None` for a coil, a discrete input, or a whole register.
    pub bit: Option<u8>,
}

/// Registers side by side: one request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// The first one.
    pub from: u16,
    /// How many.
    pub count: u16,
}

impl OutputSet {
    /// As events and errors call it: `set plc`, `output cnc_z`.
    pub fn label(&self) -> String {
        format!("{} {}", if self.is_named { "set" } else { "output" }, self.name)
    }

    /// How its registers are written, in this order: one stretch where all lie side by side; else the values (and the
    /// complement) first and the sequence, alone, last. None is longer than `most` registers.
    pub fn stretches<'a>(&self, outputs: impl Iterator<Item = &'a Output>, most: u16) -> Vec<Stretch> {
        let values = outputs.filter_map(|output| {
            Some((output.address.register()?.offset, output.encoding.data_type.registers()))
        });
        let words = [self.complement, self.heartbeat, self.control, self.version.map(|(at, _)| at)];
        let words = words.into_iter().flatten().map(|at| (at.offset, 1));
        let mut cells: Vec<(u16, u16)> = values.chain(words).collect();
        let last = self.sequence.map(|at| (at.offset, 1));
        if self.zeros {
            let ends = cells.iter().chain(&last).map(|(from, count)| (*from, from.saturating_add(*count)));
            let (from, to) = ends.fold((u16::MAX, 0), |(from, to), (a, b)| (from.min(a), to.max(b)));
            return joined((from..to).map(|register| (register, 1)).collect(), most);
        }
        let whole = joined(cells.iter().copied().chain(last).collect(), most);
        if whole.len() == 1 || last.is_none() {
            return whole;
        }
        cells = joined(cells, most).into_iter().map(|stretch| (stretch.from, stretch.count)).collect();
        cells.into_iter().chain(last).map(|(from, count)| Stretch { from, count }).collect()
    }

    /// Its outputs.
    pub fn members<'a>(&'a self, profile: &'a Profile) -> impl Iterator<Item = &'a Output> {
        self.outputs.iter().map(|id| profile.output(*id))
    }
}

impl Profile {
    /// The set.
    pub fn set(&self, id: SetId) -> &OutputSet {
        &self.sets[id.0]
    }
}

impl Device {
    /// The most registers that one request carries, writing and reading.
    pub fn longest_request(&self) -> u16 {
        // Function 16 carries 123 registers, function 06 one.
        let most = if self.functions.write_multiple { 123 } else { 1 };
        self.quirks.max_registers_per_request.min(most)
    }
}

impl Stretch {
    /// Cells (the first register of each, and how many) as the fewest stretches, none longer than `most`.
    pub fn joined(cells: Vec<(u16, u16)>, most: u16) -> Vec<Stretch> {
        joined(cells, most)
    }
}

fn joined(mut cells: Vec<(u16, u16)>, most: u16) -> Vec<Stretch> {
    cells.sort_unstable();
    let mut stretches: Vec<Stretch> = Vec::new();
    for (from, count) in cells {
        match stretches.last_mut() {
            Some(last)
                if u32::from(last.from) + u32::from(last.count) == u32::from(from)
                    && last.count + count <= most =>
            {
                last.count += count;
            }
            _ => stretches.push(Stretch { from, count }),
        }
    }
    stretches
}

impl Flag {
    /// The word that raises a strobe in a register.
    pub const fn raised(self) -> u16 {
        match self.bit {
            Some(bit) => 1 << bit,
            None => 1,
        }
    }

    /// Whether it is up in this word of its register.
    pub const fn is_up(self, word: u16) -> bool {
        match self.bit {
            Some(bit) => word >> bit & 1 == 1,
            None => word != 0,
        }
    }

    /// In the notation of the other world, as `30017.0`.
    pub fn modicon(self) -> String {
        let number = self.address.modicon();
        self.bit.map_or_else(|| number.clone(), |bit| format!("{number}.{bit}"))
    }
}

impl FromStr for Flag {
    type Err = String;

    /// `coil:20`, `input:16`, `input:16.0`.
    ///
    /// # Errors
    /// A sentence that says what is allowed.
    fn from_str(text: &str) -> Result<Flag, String> {
        let (register, bit) = match text.split_once('.') {
            Some((register, bit)) => (register, Some(bit.trim())),
            None => (text, None),
        };
        let address: Register = register.parse()?;
        let Some(bit) = bit else { return Ok(Flag { address, bit: None }) };
        if matches!(address.table, Table::Coil | Table::Discrete) {
            return Err(format!("{address} is one bit already: write it without `.{bit}`"));
        }
        match bit.parse() {
            Ok(bit @ 0..=15) => Ok(Flag { address, bit: Some(bit) }),
            _ => Err(format!("`{bit}` is no bit of a register; allowed: 0 to 15")),
        }
    }
}

impl fmt::Display for Flag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.bit {
            Some(bit) => write!(f, "{}.{bit}", self.address),
            None => write!(f, "{}", self.address),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_is_a_bit_a_register_or_a_bit_of_a_register() {
        let flag = |text: &str| text.parse::<Flag>().unwrap();
        assert_eq!((flag("coil:20").raised(), flag("coil:20").to_string().as_str()), (1, "coil:20"));
        assert_eq!((flag("holding:7").raised(), flag("holding:7.3").raised()), (1, 8));
        assert!(flag("input:7").is_up(4) && !flag("input:7").is_up(0));
        assert!(flag("input:7.2").is_up(4) && !flag("input:7.2").is_up(11));
        assert_eq!((flag("30008.2"), flag("input:7.2").modicon().as_str()), (flag("input:7.2"), "30008.2"));
        for (text, word) in [("coil:2.0", "one bit"), ("input:2.16", "0 to 15"), ("input:2.", "0 to 15")] {
            assert!(text.parse::<Flag>().unwrap_err().contains(word), "{text}");
        }
    }

    #[test]
    fn cells_side_by_side_become_one_stretch_and_no_stretch_is_too_long() {
        let stretch = |from, count| Stretch { from, count };
        assert_eq!(joined(vec![(6, 2), (4, 2), (8, 1)], 123), [stretch(4, 5)]);
        assert_eq!(joined(vec![(4, 2), (7, 2)], 123), [stretch(4, 2), stretch(7, 2)]);
        assert_eq!(joined(vec![(4, 2), (6, 2), (8, 2)], 4), [stretch(4, 4), stretch(8, 2)]);
    }
}
