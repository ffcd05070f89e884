//! Tendency patterns (θ3 of JP 6507619 B2): sets of blocks that are warmed together.
//!
//! The patent shows some patterns for a column of eight blocks: the whole, the foot, the back, the middle. Here the
//! patterns follow from the positions of the blocks of any structure. They are the whole, the low, middle and high
//! blocks along each direction, the corners of two directions, and each single block.

use crate::mesh::{AXES, range};
use crate::problem::Block;

/// Pattern: its name, and the blocks that are one kelvin warmer.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    /// Name of the pattern in the report.
    pub name: String,
    /// For each block: whether it is warmer in this pattern.
    pub warmed: Vec<bool>,
}

/// Returns all patterns of these blocks, without duplicates.
#[must_use]
pub fn patterns(blocks: &[Block]) -> Vec<Pattern> {
    let mut found: Vec<Pattern> = Vec::new();
    let mut add = |name: String, warmed: Vec<bool>| {
        let some = warmed.iter().any(|warm| *warm);
        if some && !found.iter().any(|pattern| pattern.warmed == warmed) {
            found.push(Pattern { name, warmed });
        }
    };
    add("whole".to_owned(), vec![true; blocks.len()]);
    let sides: Vec<(String, Vec<bool>, usize)> = (0..3).flat_map(|axis| along(blocks, axis)).collect();
    for (name, warmed, _) in &sides {
        add(name.clone(), warmed.clone());
    }
    for (place, (name, warmed, axis)) in sides.iter().enumerate() {
        for (other_name, other, _) in sides[place..].iter().filter(|(_, _, other)| other != axis) {
            let both = warmed.iter().zip(other).map(|(one, other)| *one && *other).collect();
            add(format!("{name}, {other_name}"), both);
        }
    }
    for (place, block) in blocks.iter().enumerate() {
        add(block.name.clone(), (0..blocks.len()).map(|other| other == place).collect());
    }
    found
}

/// Returns five patterns along a direction: the blocks of the low half, the high half, the low end, the high end, and
/// the middle. Each pattern has its name, its warmed blocks and the direction. The result is empty if all blocks have
/// nearly the same position in this direction.
fn along(blocks: &[Block], axis: usize) -> Vec<(String, Vec<bool>, usize)> {
    let extents = [0, 1, 2].map(|axis| range(blocks.iter().map(|block| block.centre[axis])));
    let length = extents.iter().map(|(low, high)| high - low).fold(0.0, f64::max);
    let (low, high) = extents[axis];
    if high - low < 0.1 * length {
        return Vec::new();
    }
    let share: Vec<f64> = blocks.iter().map(|block| (block.centre[axis] - low) / (high - low)).collect();
    let of = |word: &str, chosen: fn(f64) -> bool| {
        let warmed = share.iter().map(|share| chosen(*share)).collect();
        (format!("{word} {}", AXES[axis]), warmed, axis)
    };
    vec![
        of("low", |share| share < 0.5),
        of("high", |share| share >= 0.5),
        of("lowest", |share| share < 0.2),
        of("highest", |share| share > 0.8),
        of("middle", |share| (0.2..=0.8).contains(&share)),
    ]
}
