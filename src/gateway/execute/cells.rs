//! What goes over the wire for a set: its words and the requests that carry them. Pure.

use std::collections::BTreeMap;

use isotherm_core::codec::Encoded;
use isotherm_profile::{OutputSet, Profile, Stretch};

/// The words of a set by their registers.
pub(super) type Cells = BTreeMap<u16, u16>;

/// The words of a set that are nobody's value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Own {
    /// The number of this set.
    pub(super) sequence: Option<u16>,
    /// Counts every write.
    pub(super) heartbeat: u16,
    /// What the gateway does.
    pub(super) control: u16,
}

/// The count after this one.
pub(super) fn next_beat(beat: u16) -> u16 {
    if beat >= 32767 { 0 } else { beat + 1 }
}

/// Every word of the set for these values, one for each member.
pub(super) fn cells(profile: &Profile, set: &OutputSet, values: &[Encoded], own: Own) -> Cells {
    let mut cells = Cells::new();
    if set.zeros {
        for stretch in stretches(profile, set) {
            cells.extend((0..stretch.count).map(|place| (stretch.from.saturating_add(place), 0)));
        }
    }
    for (output, value) in set.members(profile).zip(values) {
        cells.extend(output.cells(value.words()));
    }
    let words = [
        (set.sequence, own.sequence),
        (set.heartbeat, Some(own.heartbeat)),
        (set.control, Some(own.control)),
        (set.version.map(|(at, _)| at), set.version.map(|(_, number)| number)),
    ];
    for (at, word) in words {
        if let (Some(at), Some(word)) = (at, word) {
            cells.insert(at.offset, word);
        }
    }
    if let Some(at) = set.complement {
        cells.remove(&at.offset);
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
    fn the_heartbeat_of_a_set_goes_round_below_the_sign() {
        assert_eq!((next_beat(0), next_beat(32766), next_beat(32767)), (1, 32767, 0));
    }

    #[test]
    fn a_stretch_is_cut_out_of_the_words_of_a_set() {
        let cells = Cells::from([(10, 1), (11, 2), (12, 3)]);
        assert_eq!(words(&cells, &Stretch { from: 11, count: 2 }), [2, 3]);
        assert_eq!(value(&cells, 10, 2).words(), [1, 2]);
    }
}
