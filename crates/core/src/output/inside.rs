//! The Cz inside a corrected position, which is written again and again with a new position each time.

use std::ops::Sub;

use crate::quantity::Micron;

/// The Cz of the next position, if `last` went into the one before: towards the target by one step at most, and never away from it
/// or beyond it. `decided` is what the guard of the axis has, which may be ahead of what was sent; µm.
pub fn next_inside(last: Micron, decided: Micron, target: Micron, step: Micron) -> Micron {
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

/// Verified value that is farthest from the last decision. An axis with several outputs stays within one step of it. `values` are those of
/// the outputs that answer and do not hold the decision. `None` if there is none.
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
