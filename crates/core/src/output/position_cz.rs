//! Cz (the compensation value) in a corrected position. A corrected position (a position that was read, plus
//! Cz) is written repeatedly, for each new position.

use std::ops::Sub;

use serde::{Deserialize, Serialize};

use crate::quantity::{Micron, Moment, Shift, Shifted};

/// Cz in a corrected position (a position that was read, plus Cz). The latest position is sent at once, even if earlier
/// writes may still arrive. Only Cz moves in steps, one for each decision. After a write with an unknown result, Cz
/// stays as it was sent. Only that value is near enough to both possible register values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PositionCz {
    /// Nothing has been written since the axis was armed.
    #[default]
    Nothing,
    /// The previous run last wrote a position with this Cz.
    Left(Micron),
    /// This Cz was written, after the decision at this time.
    Written(Micron, Moment),
    /// This Cz was sent, with an unknown result.
    Sent(Micron),
}

impl PositionCz {
    /// Returns the Cz of the next position, µm. The first argument is the decision of the axis: Cz and its
    /// target, µm, and the time of the decision. `step` is the largest change of Cz, µm.
    pub fn next(self, (decided, target, at): (Micron, Micron, Moment), step: Micron) -> Micron {
        match self {
            PositionCz::Nothing => decided,
            PositionCz::Written(last, before) if before == at => last,
            PositionCz::Written(last, _) => next_inside(last, decided, target, step),
            PositionCz::Left(same) | PositionCz::Sent(same) => same,
        }
    }
}

impl Shifted for PositionCz {
    fn shift(&mut self, by: Shift) {
        if let PositionCz::Written(_, at) = self {
            at.shift(by);
        }
    }
}

/// Returns the Cz of the next position, µm. `last` is the Cz of the previous position. The result approaches the target
/// by one step at most, never moves away from it, and never passes it. `decided` is the Cz that the axis has decided,
/// which may be ahead of the Cz that was sent last.
fn next_inside(last: Micron, decided: Micron, target: Micron, step: Micron) -> Micron {
    let next = last + (decided - last).clamp_to(step);
    let (low, high) = if last < target { (last, target) } else { (target, last) };
    if next < low {
        low
    } else if next > high {
        high
    } else {
        next
    }
}

/// Returns the verified value that is farthest from the last decision. An axis with several outputs stays within one
/// step of this value. `values`: verified values of the outputs that answer and do not hold the decision. `None` if
/// there are no such values.
pub fn farthest_behind<T>(decided: T, values: impl Iterator<Item = T>) -> Option<T>
where
    T: Copy + PartialOrd + Sub<Output = T>,
{
    let distance = |value: T| if value > decided { value - decided } else { decided - value };
    values.fold(None, |farthest, value| match farthest {
        Some(known) if distance(known) >= distance(value) => Some(known),
        _ => Some(value),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn micron(value: f64) -> Micron {
        Micron::new(value).unwrap()
    }

    #[test]
    fn it_moves_once_for_each_decision_and_stays_after_a_write_of_unknown_result() {
        let [one, two] = [1, 2].map(Moment::from_nanos);
        let step = micron(1.0);
        let next = |inside: PositionCz, at| inside.next((micron(5.0), micron(9.0), at), step);
        assert_eq!(next(PositionCz::Nothing, one), micron(5.0));
        assert_eq!(next(PositionCz::Written(micron(2.0), one), one), micron(2.0));
        assert_eq!(next(PositionCz::Written(micron(2.0), one), two), micron(3.0));
        assert_eq!(next(PositionCz::Sent(micron(2.0)), two), micron(2.0));
        assert_eq!(next(PositionCz::Left(micron(-20.0)), two), micron(-20.0));
    }

    #[test]
    fn it_follows_the_decision_by_a_step_and_waits_where_that_is_on_the_wrong_side() {
        for (last, decided, target, next) in [
            (0.0, 5.0, 9.0, 1.0),
            (0.0, 0.5, 9.0, 0.5),
            (1.0, 28.0, -36.0, 1.0),
            (1.0, -3.0, -36.0, 0.0),
            (1.0, 5.0, 1.5, 1.5),
            (2.0, 2.0, 2.0, 2.0),
        ] {
            let [last, decided, target, next] = [last, decided, target, next].map(micron);
            assert_eq!(next_inside(last, decided, target, micron(1.0)), next, "{last} {decided} {target}");
        }
    }

    proptest! {
        #[test]
        fn it_moves_by_a_step_at_most_and_only_towards_the_target(
            last in -50.0..50.0_f64, decided in -50.0..50.0_f64, target in -50.0..50.0_f64, step in 0.1..5.0_f64,
        ) {
            let next = next_inside(micron(last), micron(decided), micron(target), micron(step)).get();
            prop_assert!((next - last).abs() <= step * (1.0 + 1e-12));
            prop_assert!(next >= last.min(target) && next <= last.max(target));
        }
    }
}
