//! What goes over the wire for a set: its words and the requests that carry them. Pure.

use std::collections::BTreeMap;

use crate::codec::Encoded;
use crate::profile::{OutputSet, Profile, Stretch};

/// The words of a set by their registers.
pub(super) type Cells = BTreeMap<u16, u16>;

/// What was sent and is not known to have been taken as a whole.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sent {
    /// By member; `None` where it was only kept.
    pub(super) values: Vec<Option<Encoded>>,
    pub(super) cells: Cells,
    pub(super) sequence: Option<u16>,
    /// The control has acknowledged it, and dropped that again.
    pub(super) is_taken: bool,
}

/// The number of the next set. Zero is left to a control that has just been started.
pub(super) fn next(sequence: u16) -> u16 {
    sequence.checked_add(1).unwrap_or(1)
}

/// Every word of the set for these values, one for each member.
pub(super) fn cells(profile: &Profile, set: &OutputSet, values: &[Encoded], sequence: Option<u16>) -> Cells {
    let mut cells = Cells::new();
    for (output, value) in set.members(profile).zip(values) {
        cells.extend((output.address.offset..).zip(value.words().iter().copied()));
    }
    if let (Some(at), Some(sequence)) = (set.sequence, sequence) {
        cells.insert(at.offset, sequence);
    }
    if let Some(at) = set.complement {
        let sum = cells.values().fold(0u16, |sum, word| sum.wrapping_add(*word));
        cells.insert(at.offset, !sum);
    }
    cells
}

/// The requests that write or read the set, in their order.
pub(super) fn stretches(profile: &Profile, set: &OutputSet) -> Vec<Stretch> {
    set.stretches(set.members(profile), profile.device(set.device).longest_request())
}

/// The words of one stretch.
pub(super) fn words(cells: &Cells, stretch: &Stretch) -> Vec<u16> {
    let registers = (0..stretch.count).map(|place| stretch.from.saturating_add(place));
    registers.map(|register| cells.get(&register).copied().unwrap_or_default()).collect()
}

/// The value of one member among words that were read.
pub(super) fn value(cells: &Cells, from: u16, count: u16) -> Encoded {
    Encoded::of(&words(cells, &Stretch { from, count }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_counts_from_one_and_never_comes_back_to_zero() {
        assert_eq!((next(0), next(7), next(65535)), (1, 8, 1));
    }

    #[test]
    fn a_stretch_is_cut_out_of_the_words_of_a_set() {
        let cells = Cells::from([(10, 1), (11, 2), (12, 3)]);
        assert_eq!(words(&cells, &Stretch { from: 11, count: 2 }), [2, 3]);
        assert_eq!(value(&cells, 10, 2).words(), [1, 2]);
    }
}
