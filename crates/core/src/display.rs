//! Displayed state of an axis, from its decision and the value last verified in the control.
//!
//! | axis | outputs | displayed as |
//! |---|---|---|
//! | has no model | | no model yet |
//! | is off, or waits to be armed | | off, waiting to arm |
//! | is armed | a device does not answer | unreachable: the control may hold another value than the verified one |
//! | moves for a sign check | answer | sign check |
//! | follows a model, or is frozen | answer | compensating, fallback model, frozen |
//! | has decided zero | hold another Cz, or nothing was verified | returning to zero |
//! | has decided zero | hold zero, verified | at zero |

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::compensation::AxisState;

mod control_word;

pub use control_word::control_word;

/// Cz in the control, as far as the gateway knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KnownCz {
    /// Nothing is written, or nothing has been verified yet.
    Unknown,
    /// Zero was verified in every output.
    Zero,
    /// Another Cz was verified in an output.
    Other,
    /// A device of an output does not answer: the control may hold another value than the last verified one.
    Unreachable,
}

/// Displayed state of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Display {
    /// Off because the profile has no model for the axis.
    Unmodelled,
    /// Not armed: nothing is decided or written.
    Off,
    /// Not armed yet. The axis arms when the missing condition is met.
    Waiting,
    /// The axis follows its preferred model.
    Active,
    /// The axis follows a fallback model.
    Degraded,
    /// The axis keeps its last value.
    Holding,
    /// Returning to zero at the axis's rate.
    Ramping,
    /// Zero was verified in the control.
    Zeroed,
    /// Moved for a sign check with a dial gauge.
    SignCheck,
    /// The control does not answer.
    Unreachable,
}

/// Severity of a displayed state. The web page has a colour and a sign for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// The axis is compensated.
    Good,
    /// The operator should notice it.
    Warning,
    /// The operator should act.
    Bad,
    /// Nothing is written, which is no fault.
    Off,
}

impl Tone {
    /// Returns the name in JSON and metrics.
    pub const fn name(self) -> &'static str {
        match self {
            Tone::Good => "good",
            Tone::Warning => "warn",
            Tone::Bad => "bad",
            Tone::Off => "off",
        }
    }
}

/// Requested mode of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intent {
    /// None: the profile has no model for the axis.
    Unmodelled,
    /// Arm the axis as soon as the missing condition is met.
    Arm,
    /// Follow the model while it is armed.
    Follow,
    /// Move the axis for a dial gauge while it is armed.
    CheckSign,
}

impl Display {
    /// All displayed states, each with its name for programs, its English text and its tone.
    pub const ALL: [(Display, &'static str, &'static str, Tone); 10] = [
        (Display::Unmodelled, "unmodelled", "no model yet", Tone::Off),
        (Display::Off, "off", "off", Tone::Off),
        (Display::Waiting, "waiting", "waiting to arm", Tone::Warning),
        (Display::Active, "active", "compensating", Tone::Good),
        (Display::Degraded, "degraded", "fallback model", Tone::Warning),
        (Display::Holding, "holding", "frozen", Tone::Warning),
        (Display::Ramping, "ramping", "returning to zero", Tone::Bad),
        (Display::Zeroed, "zeroed", "at zero", Tone::Bad),
        (Display::SignCheck, "sign-check", "sign check", Tone::Warning),
        (Display::Unreachable, "unreachable", "unreachable", Tone::Bad),
    ];

    /// Chooses the displayed state from the decided state, the requested mode and Cz in the control.
    pub fn of(state: AxisState, intent: Intent, held: KnownCz) -> Display {
        match (state, intent) {
            (_, Intent::Arm) => Display::Waiting,
            (AxisState::Off, Intent::Unmodelled) => Display::Unmodelled,
            (AxisState::Off, _) => Display::Off,
            _ if held == KnownCz::Unreachable => Display::Unreachable,
            (AxisState::Active | AxisState::Degraded, Intent::CheckSign) => Display::SignCheck,
            (AxisState::Active, _) => Display::Active,
            (AxisState::Degraded, _) => Display::Degraded,
            (AxisState::Holding(_), _) => Display::Holding,
            (AxisState::Zeroed, _) if held == KnownCz::Zero => Display::Zeroed,
            (AxisState::Ramping | AxisState::Zeroed, _) => Display::Ramping,
        }
    }

    /// Returns the name in JSON and metrics.
    pub fn name(self) -> &'static str {
        self.entry().1
    }

    /// English text for the operator.
    pub fn words(self) -> &'static str {
        self.entry().2
    }

    /// Severity of the state.
    pub fn tone(self) -> Tone {
        self.entry().3
    }

    fn entry(self) -> (Display, &'static str, &'static str, Tone) {
        Display::ALL.into_iter().find(|(display, ..)| *display == self).unwrap_or(Display::ALL[0])
    }
}

/// Serializes the fields `shown` and `tone` for programs.
impl Serialize for Display {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_map(Some(2))?;
        fields.serialize_entry("shown", self.name())?;
        fields.serialize_entry("tone", self.tone().name())?;
        fields.end()
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

    /// Checks each state of an armed axis with each possible knowledge about its outputs.
    #[test]
    fn every_state_and_every_value_in_the_control_have_what_is_shown() {
        use Display::{Active, Degraded, Holding, Off, Ramping, Unreachable, Zeroed};
        let table = [
            (KnownCz::Unknown, [Off, Active, Degraded, Holding, Ramping, Ramping]),
            (KnownCz::Zero, [Off, Active, Degraded, Holding, Ramping, Zeroed]),
            (KnownCz::Other, [Off, Active, Degraded, Holding, Ramping, Ramping]),
            (KnownCz::Unreachable, [Off, Unreachable, Unreachable, Unreachable, Unreachable, Unreachable]),
        ];
        for (held, expected) in table {
            for (state, display) in STATES.into_iter().zip(expected) {
                let of = |intent| Display::of(state, intent, held);
                assert_eq!(of(Intent::Follow), display, "{state:?} {held:?}");
                assert_eq!(of(Intent::Arm), Display::Waiting, "{state:?} {held:?}");
                let moves = matches!(display, Active | Degraded);
                let checked = if moves { Display::SignCheck } else { display };
                assert_eq!(of(Intent::CheckSign), checked, "{state:?} {held:?}");
                let unmodelled = if display == Off { Display::Unmodelled } else { display };
                assert_eq!(of(Intent::Unmodelled), unmodelled, "{state:?} {held:?}");
            }
        }
    }

    #[test]
    fn each_has_a_name_and_words_of_its_own() {
        for (display, name, words, tone) in Display::ALL {
            assert_eq!((display.name(), display.words(), display.tone()), (name, words, tone));
            let same = Display::ALL.iter().filter(|(_, other, said, _)| *other == name || *said == words);
            assert_eq!(same.count(), 1, "{name}");
        }
        for state in STATES.into_iter().filter(|state| *state != AxisState::Zeroed) {
            let shown = Display::of(state, Intent::Follow, KnownCz::Zero);
            assert_eq!(shown.words(), AxisState::display_of(state.name()), "the words of events");
        }
    }
}
