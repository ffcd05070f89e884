//! Control word of a set of outputs: a register in which the gateway shows the control the states of the set's axes.

use crate::compensation::AxisState;
use crate::output::ControlWord;

/// Returns the control word of a set of outputs. `axes`: for each axis, whether it is armed, and its last decided
/// state. `ends`: the gateway is shutting down with fault actions, so the bit [`ControlWord::ENABLE`] is not set.
pub fn control_word(axes: impl Iterator<Item = (bool, Option<AxisState>)>, ends: bool) -> u16 {
    let first = if ends { 0 } else { ControlWord::ENABLE };
    axes.fold(first, |word, (is_armed, state)| {
        let word = if is_armed { word } else { word & !ControlWord::ENABLE };
        word | match state {
            Some(AxisState::Holding(_)) => ControlWord::HOLD | ControlWord::FAULT,
            Some(AxisState::Ramping | AxisState::Zeroed) => ControlWord::FAULT,
            Some(AxisState::Degraded) => ControlWord::DEGRADED,
            _ => 0,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_control_word_says_what_each_axis_does_and_enables_only_if_all_are_armed() {
        let of = |axes: &[(bool, Option<AxisState>)]| control_word(axes.iter().copied(), false);
        assert_eq!(of(&[(true, Some(AxisState::Active)), (true, Some(AxisState::Active))]), 1);
        assert_eq!(of(&[(true, Some(AxisState::Active)), (false, Some(AxisState::Off))]), 0);
        assert_eq!(of(&[(true, Some(AxisState::Degraded)), (true, Some(AxisState::Ramping))]), 1 + 8 + 4);
        assert_eq!(control_word([(true, Some(AxisState::Active))].into_iter(), true), 0, "the gateway ends");
    }
}
