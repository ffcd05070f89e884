//! State of an axis as people see it, from its decision and from the value last verified in the control.
//!
//! | the axis | its outputs | is shown as |
//! |---|---|---|
//! | has no model | | no model yet |
//! | is off, or waits to be armed | | off, waiting to arm |
//! | is armed | a device of one does not answer | unreachable: the control may hold another value than the verified one |
//! | moves for a check of its sign | answer | sign check |
//! | follows a model, or keeps its value | answer | compensating, fallback model, frozen |
//! | has decided zero | hold another Cz | returning to zero |
//! | has decided zero | hold zero | at zero |

use crate::compensation::AxisState;

/// Cz in the control, as far as the gateway knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Nothing is written, or nothing was verified yet.
    Unknown,
    /// Zero was verified in every output.
    Zero,
    /// Another Cz was verified in an output.
    Other,
    /// A device of an output does not answer: the control may hold another value than the last verified one.
    Unreachable,
}

/// State of an axis as people see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Display {
    /// Off because the profile has no model for the axis.
    Unmodelled,
    /// Not armed.
    Off,
    /// Not armed yet; armed when the missing condition is met.
    Waiting,
    /// Following its preferred model.
    Active,
    /// Following a fallback model.
    Degraded,
    /// Keeping its last value.
    Holding,
    /// On the way to zero.
    Ramping,
    /// Zero was verified in the control.
    Zeroed,
    /// Moved on purpose, for a dial gauge.
    SignCheck,
    /// The control does not answer.
    Unreachable,
}

/// Inputs of [`Display::of`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Decided state.
    pub state: AxisState,
    /// The profile has a model for the axis.
    pub has_model: bool,
    /// The axis is not armed yet, and will be.
    pub is_waiting: bool,
    /// A sign check with a dial gauge is under way.
    pub is_checked: bool,
    /// Cz in the control.
    pub held: Held,
}

impl Display {
    /// Every display state with its name for programs and its English words for people.
    pub const ALL: [(Display, &'static str, &'static str); 10] = [
        (Display::Unmodelled, "unmodelled", "no model yet"),
        (Display::Off, "off", "off"),
        (Display::Waiting, "waiting", "waiting to arm"),
        (Display::Active, "active", "compensating"),
        (Display::Degraded, "degraded", "fallback model"),
        (Display::Holding, "holding", "frozen"),
        (Display::Ramping, "ramping", "returning to zero"),
        (Display::Zeroed, "zeroed", "at zero"),
        (Display::SignCheck, "sign-check", "sign check"),
        (Display::Unreachable, "unreachable", "unreachable"),
    ];

    /// Chooses the display state.
    pub fn of(shown: Shown) -> Display {
        let Shown { state, has_model, is_waiting, is_checked, held } = shown;
        match state {
            _ if is_waiting => Display::Waiting,
            AxisState::Off if !has_model => Display::Unmodelled,
            AxisState::Off => Display::Off,
            _ if held == Held::Unreachable => Display::Unreachable,
            AxisState::Active | AxisState::Degraded if is_checked => Display::SignCheck,
            AxisState::Active => Display::Active,
            AxisState::Degraded => Display::Degraded,
            AxisState::Holding(_) => Display::Holding,
            AxisState::Zeroed if held != Held::Other => Display::Zeroed,
            AxisState::Ramping | AxisState::Zeroed => Display::Ramping,
        }
    }

    /// Name for programs.
    pub fn name(self) -> &'static str {
        self.entry().1
    }

    /// English words for people.
    pub fn words(self) -> &'static str {
        self.entry().2
    }

    fn entry(self) -> (Display, &'static str, &'static str) {
        Display::ALL.into_iter().find(|(display, ..)| *display == self).unwrap_or(Display::ALL[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::Moment;

    const STATES: [AxisState; 6] = [
        AxisState::Off,
        AxisState::Active,
        AxisState::Degraded,
        AxisState::Holding(Moment::from_nanos(7)),
        AxisState::Ramping,
        AxisState::Zeroed,
    ];

    /// Each state of an armed axis beside each thing that may be known of its outputs.
    #[test]
    fn every_state_and_every_value_in_the_control_have_what_is_shown() {
        use Display::{Active, Degraded, Holding, Off, Ramping, Unreachable, Zeroed};
        let table = [
            (Held::Unknown, [Off, Active, Degraded, Holding, Ramping, Zeroed]),
            (Held::Zero, [Off, Active, Degraded, Holding, Ramping, Zeroed]),
            (Held::Other, [Off, Active, Degraded, Holding, Ramping, Ramping]),
            (Held::Unreachable, [Off, Unreachable, Unreachable, Unreachable, Unreachable, Unreachable]),
        ];
        for (held, expected) in table {
            for (state, display) in STATES.into_iter().zip(expected) {
                let shown = Shown { state, has_model: true, is_waiting: false, is_checked: false, held };
                assert_eq!(Display::of(shown), display, "{shown:?}");
                let waits = Display::of(Shown { is_waiting: true, ..shown });
                assert_eq!(waits, Display::Waiting, "{shown:?}");
                let checked = Display::of(Shown { is_checked: true, ..shown });
                let moves = matches!(display, Active | Degraded);
                assert_eq!(checked, if moves { Display::SignCheck } else { display }, "{shown:?}");
                let unmodelled = Display::of(Shown { has_model: false, ..shown });
                let is_off = display == Off;
                assert_eq!(unmodelled, if is_off { Display::Unmodelled } else { display }, "{shown:?}");
            }
        }
    }

    #[test]
    fn each_has_a_name_and_words_of_its_own() {
        for (display, name, words) in Display::ALL {
            assert_eq!((display.name(), display.words()), (name, words));
            let same = Display::ALL.iter().filter(|(_, other, said)| *other == name || *said == words);
            assert_eq!(same.count(), 1, "{name}");
        }
        for state in STATES {
            let shown =
                Shown { state, has_model: true, is_waiting: false, is_checked: false, held: Held::Zero };
            assert_eq!(
                Display::of(shown).words(),
                AxisState::display_of(state.name()),
                "the words of events"
            );
        }
    }
}
