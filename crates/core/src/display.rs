//! Displayed state of an axis, from its decision and the Cz that was last verified in the control.
//!
//! | axis | outputs | displayed as |
//! |---|---|---|
//! | has no model | | no model yet |
//! | is off, or waits to be armed | | off, waiting to arm |
//! | is armed | a device does not answer | unreachable: the control may hold an unverified value |
//! | moves for a sign check, or returns to zero after a sign check without a model | answer | sign check |
//! | follows a model, or is frozen | answer | compensating, fallback model, frozen |
//! | has decided zero | hold another Cz, or nothing was verified | returning to zero |
//! | has decided zero | hold zero, verified | at zero |

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::compensation::AxisState;

mod control_word;

pub use control_word::control_word;

/// Cz that acts in the control for an axis, as far as the gateway knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KnownCz {
    /// The gateway writes no Cz for the axis, or has not verified any Cz yet.
    Unknown,
    /// A Cz of zero was verified in every output of the axis whose Cz is known.
    Zero,
    /// A Cz other than zero was verified in at least one output.
    Other,
    /// A device with an output of the axis does not answer: the control may hold another Cz than the last verified Cz.
    Unreachable,
}

/// Displayed state of an axis, for the web page, JSON and metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Display {
    /// The axis is off, because the profile has no model for it.
    Unmodelled,
    /// The axis is not armed: the gateway decides and writes nothing for it.
    Off,
    /// The axis is not armed yet. The gateway arms the axis when the missing condition is met.
    Waiting,
    /// The axis follows its preferred model.
    Active,
    /// The axis follows a fallback model, or its preferred model with a stand-in (estimate) for a frozen or
    /// lost sensor.
    Degraded,
    /// The axis keeps its last Cz.
    Holding,
    /// Cz of the axis returns to zero at the axis's rate.
    Ramping,
    /// A Cz of zero was decided for the axis, and verified in the control.
    Zeroed,
    /// The gateway moves the axis by a requested Cz, so that the operator can check the sign with a dial gauge.
    SignCheck,
    /// A device with an output of the axis does not answer.
    Unreachable,
}

/// Severity of a displayed state. The web page shows each severity with a separate colour and icon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// The axis is compensated.
    Good,
    /// The operator should notice the state, for example that a fallback model is used.
    Warning,
    /// The operator should act on the state, for example because a device does not answer.
    Bad,
    /// The gateway writes nothing for the axis. This is not a fault.
    Off,
}

impl Tone {
    /// Returns the name of the severity in JSON and metrics.
    pub const fn name(self) -> &'static str {
        match self {
            Tone::Good => "good",
            Tone::Warning => "warn",
            Tone::Bad => "bad",
            Tone::Off => "off",
        }
    }
}

/// Requested mode of an axis: wait for arming, follow the model, or check the sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intent {
    /// No mode: the profile has no model for the axis. If the axis is armed, its Cz returns to zero after a sign check.
    Unmodelled,
    /// Arm the axis as soon as the missing condition for arming is met.
    Arm,
    /// Follow the model while the axis is armed.
    Follow,
    /// Move the axis by a requested Cz while the axis is armed, for a sign check with a dial gauge.
    CheckSign,
}

impl Display {
    /// All displayed states, each with its name for programs, its English text, and its severity.
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

    /// Returns the displayed state for the decided state, the requested mode, and the known Cz in the control (`held`).
    pub fn of(state: AxisState, intent: Intent, held: KnownCz) -> Display {
        match (state, intent) {
            (_, Intent::Arm) => Display::Waiting,
            (AxisState::Off, Intent::Unmodelled) => Display::Unmodelled,
            (AxisState::Off, _) => Display::Off,
            _ if held == KnownCz::Unreachable => Display::Unreachable,
            // Without a model, the axis returns to zero after a sign check, and does not compensate.
            (AxisState::Active | AxisState::Degraded, Intent::CheckSign | Intent::Unmodelled) => {
                Display::SignCheck
            }
            (AxisState::Active, _) => Display::Active,
            (AxisState::Degraded, _) => Display::Degraded,
            (AxisState::Holding(_), _) => Display::Holding,
            (AxisState::Zeroed, _) if held == KnownCz::Zero => Display::Zeroed,
            (AxisState::Ramping | AxisState::Zeroed, _) => Display::Ramping,
        }
    }

    /// Returns the name of the state in JSON and metrics.
    pub fn name(self) -> &'static str {
        self.entry().1
    }

    /// Returns the English text for the operator, for example `fallback model`.
    pub fn words(self) -> &'static str {
        self.entry().2
    }

    /// Returns the severity of the state, which determines its colour on the web page.
    pub fn tone(self) -> Tone {
        self.entry().3
    }

    fn entry(self) -> (Display, &'static str, &'static str, Tone) {
        Display::ALL.into_iter().find(|(display, ..)| *display == self).unwrap_or(Display::ALL[0])
    }
}

/// Serializes the state as two fields for programs: its name `shown` and its severity `tone`.
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
                let unmodelled = if display == Off { Display::Unmodelled } else { checked };
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
