//! Counters of linear scales: the position after a rollover, and the detection of a new reference (zero position of the
//! scale).
//!
//! A counter, for example of 16, 24 or 32 bits, starts again after its last count. The difference of two
//! counts, modulo the number of counts, is the motion in between. A difference larger than the axis can
//! travel is not a motion. Either the value is corrupted, and the next value contradicts it. Or the counter
//! was referenced, preset or restarted, and the next value confirms it. The functions are pure: the time of
//! each reading is an argument.

use std::time::Duration;

use super::{DataType, Encoded, Encoding};
use crate::quantity::{Counts, Moment};

/// Settings of a signal whose value is a counter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counter {
    /// Largest speed of the axis, in the signal's unit per second.
    pub max_speed: f64,
    /// Largest error of the interval between two consecutive readings. The true interval may be this much longer than
    /// the difference of their times.
    pub slack: Duration,
}

/// State of a signal whose value is a counter: last count, position, and a value that waits for confirmation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tracked {
    last: Option<CounterSample>,
    /// Value that the axis cannot have reached. The value is accepted if the next value agrees with it.
    leapt: Option<CounterSample>,
}

#[derive(Clone, Copy, Debug)]
struct CounterSample {
    /// Count in the register, mapped to a range with zero in its middle.
    count: i64,
    /// Count plus all rollovers since the first reading.
    position: i64,
    at: Moment,
}

/// Result for a new value of a counter, in the signal's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// The axis is at this position.
    To(f64),
    /// The axis cannot have reached this value. The next value shows whether it is valid.
    Doubtful,
    /// The counter has a new reference: its value changed from `from` to `to`, and the axis did not move.
    Rereferenced {
        /// Last position under the old reference.
        from: f64,
        /// Position under the new reference.
        to: f64,
    },
}

impl Counter {
    /// Returns the number of counts of a counter of this type before it starts again at its first count. `None` if the
    /// type cannot be a counter.
    pub fn modulus(data_type: DataType) -> Option<i64> {
        match data_type {
            DataType::U16 | DataType::I16 => Some(1 << 16),
            DataType::U32 | DataType::I32 => Some(1 << 32),
            DataType::Unsigned(bits @ 8..=32) | DataType::Signed(bits @ 8..=32) => Some(1 << bits),
            DataType::Bcd(digits) => Some(10i64.pow(u32::from(digits))),
            DataType::Part(part) if part.length() >= 8 => Some(1 << part.length()),
            _ => None,
        }
    }

    /// Encodes a value as the registers of a counter, which starts again at its first count after its last count. If
    /// the type cannot be a counter, encodes the value as [`Encoding::encode`] does.
    pub fn registers(encoding: &Encoding, value: f64) -> Encoded {
        let (Some(modulus), Some((low, _))) =
            (Counter::modulus(encoding.data_type), encoding.range_of_counts())
        else {
            return encoding.encode(value);
        };
        let counts = encoding.nearest_counts(value).0.saturating_sub(low.0).rem_euclid(modulus);
        encoding.encode_counts(Counts(counts + low.0))
    }

    /// Returns the time in which the axis, at its largest speed, moves over half the range of the counter. After a
    /// longer time without a reading, the number of rollovers is unknown. `None` if the type cannot be a counter.
    pub fn half_way(&self, encoding: &Encoding) -> Option<Duration> {
        let half = Counter::modulus(encoding.data_type)? / 2;
        #[allow(clippy::cast_precision_loss, reason = "at most 2^31")]
        Duration::try_from_secs_f64(half as f64 * encoding.scale.get().abs() / self.max_speed).ok()
    }
}

impl Tracked {
    /// Processes the scaled register value of a new reading. Returns the new position of the axis, or that the value is
    /// doubtful or has a new reference.
    pub fn take(&mut self, counter: &Counter, encoding: &Encoding, value: f64, at: Moment) -> Motion {
        let Some(modulus) = Counter::modulus(encoding.data_type) else { return Motion::To(value) };
        #[allow(clippy::cast_possible_truncation, reason = "a count has at most 32 bits")]
        let raw = ((value - encoding.offset) / encoding.scale.get()).round() as i64;
        let count = nearest_to_zero(raw, modulus);
        let fresh = CounterSample { count, position: count, at };
        let Some(last) = self.last else {
            self.last = Some(fresh);
            return Motion::To(scaled(encoding, count));
        };
        let travelled = |seen: CounterSample| {
            let seconds = (at.since(seen.at) + counter.slack).as_secs_f64();
            let reach = counter.max_speed * seconds / encoding.scale.get().abs() + 1.0;
            let moved = nearest_to_zero(count - seen.count, modulus);
            #[allow(clippy::cast_precision_loss, reason = "at most 2^31")]
            let (can, half) = (moved.abs() as f64 <= reach, (modulus / 2) as f64);
            (can, reach >= half && seen.position != seen.count, moved)
        };
        let (can, lost_count, moved) = travelled(last);
        let rereferenced = if can {
            // The last reading is so old that more than one rollover is possible. Only the present count is known.
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
        self.last = Some(CounterSample { count, position, at });
        Motion::To(scaled(encoding, position))
    }
}

/// Maps a count to the range from −modulus/2 to modulus/2 − 1.
fn nearest_to_zero(count: i64, modulus: i64) -> i64 {
    (count + modulus / 2).rem_euclid(modulus) - modulus / 2
}

fn scaled(encoding: &Encoding, count: i64) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "some rollovers of 32 bits")]
    let count = count as f64;
    // Same arithmetic as the codec: a counter that never rolled over gives exactly the decoded value.
    encoding.scale.scaled(count) + encoding.offset
}

#[cfg(test)]
mod tests;
