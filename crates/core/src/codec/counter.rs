//! Counters of linear scales: what the position is when the count rolls over, and when somebody has set it anew.
//!
//! A counter of 16 or 32 bits begins again after its last count; the difference of two counts, taken modulo that
//! length, is the motion in between. A difference that the axis cannot have travelled is no motion: either a garbled
//! value, which the next one contradicts, or a counter that was referenced, preset or restarted, which the next one
//! confirms. Pure: the moment of each reading is an argument.

use std::time::Duration;

use super::{DataType, Encoding};
use crate::quantity::Moment;

/// How the counts of a signal are understood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counter {
    /// The fastest motion of the axis, in the signal's unit per second.
    pub max_speed: f64,
    /// Two readings that follow each other may be this much further apart in time than their moments say.
    pub slack: Duration,
}

/// What a signal that counts has been through.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tracked {
    last: Option<Seen>,
    /// A value that the axis cannot have travelled to; believed when the next one agrees with it.
    leapt: Option<Seen>,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    /// As the counter shows it, nearest to zero.
    count: i64,
    /// With the rollovers since the first reading.
    position: i64,
    at: Moment,
}

/// What a new value means, in the signal's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// The axis is here.
    To(f64),
    /// The axis cannot have travelled there; the next value decides.
    Doubtful,
    /// The counter was set anew: what was `from` is `to` now, and nothing moved.
    Rereferenced {
        /// The last position under the old reference.
        from: f64,
        /// The position under the new one.
        to: f64,
    },
}

impl Counter {
    /// The counts after which a counter of this type begins again; `None` where it is no counter's type.
    pub fn modulus(data_type: DataType) -> Option<i64> {
        match data_type {
            DataType::U16 | DataType::I16 => Some(1 << 16),
            DataType::U32 | DataType::I32 => Some(1 << 32),
            DataType::Unsigned(bits @ 8..=32) | DataType::Signed(bits @ 8..=32) => Some(1 << bits),
            _ => None,
        }
    }

    /// How long the axis needs at least for half the counter's length: a longer gap hides how often it rolled over.
    pub fn half_way(&self, encoding: &Encoding) -> Option<Duration> {
        let half = Counter::modulus(encoding.data_type)? / 2;
        #[allow(clippy::cast_precision_loss, reason = "at most 2^31")]
        Duration::try_from_secs_f64(half as f64 * encoding.scale.get().abs() / self.max_speed).ok()
    }
}

impl Tracked {
    /// Takes the value that stands in the register, scaled.
    pub fn take(&mut self, counter: &Counter, encoding: &Encoding, value: f64, at: Moment) -> Motion {
        let Some(modulus) = Counter::modulus(encoding.data_type) else { return Motion::To(value) };
        #[allow(clippy::cast_possible_truncation, reason = "a count of at most 32 bits")]
        let raw = ((value - encoding.offset) / encoding.scale.get()).round() as i64;
        let count = nearest_to_zero(raw, modulus);
        let fresh = Seen { count, position: count, at };
        let Some(last) = self.last else {
            self.last = Some(fresh);
            return Motion::To(scaled(encoding, count));
        };
        let travelled = |seen: Seen| {
            let seconds = (at.since(seen.at) + counter.slack).as_secs_f64();
            let reach = counter.max_speed * seconds / encoding.scale.get().abs() + 1.0;
            let moved = nearest_to_zero(count - seen.count, modulus);
            #[allow(clippy::cast_precision_loss, reason = "at most 2^31")]
            let (can, half) = (moved.abs() as f64 <= reach, (modulus / 2) as f64);
            (can, reach >= half && seen.position != seen.count, moved)
        };
        let (can, lost_count, moved) = travelled(last);
        let rereferenced = if can {
            // Out of sight for so long that it may have gone round: what it shows is all that is known.
            lost_count
        } else {
            let confirmed = self.leapt.is_some_and(|leapt| travelled(leapt).0);
            if !confirmed {
                self.leapt = Some(fresh);
                return Motion::Doubtful;
            }
            true
        };
        self.leapt = None;
        if rereferenced {
            self.last = Some(fresh);
            let (from, to) = (scaled(encoding, last.position), scaled(encoding, count));
            return Motion::Rereferenced { from, to };
        }
        let position = last.position + moved;
        self.last = Some(Seen { count, position, at });
        Motion::To(scaled(encoding, position))
    }
}

/// The same count, between −modulus/2 and modulus/2 − 1.
fn nearest_to_zero(count: i64, modulus: i64) -> i64 {
    (count + modulus / 2).rem_euclid(modulus) - modulus / 2
}

fn scaled(encoding: &Encoding, count: i64) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "some rollovers of 32 bits")]
    let count = count as f64;
    // As the codec does it: a counter that never rolled over shows the very same number.
    encoding.scale.scaled(count) + encoding.offset
}

#[cfg(test)]
mod tests;
