//! What is to be done about an output now, as the shared state says.

use crate::gateway::core::Core;
use crate::gateway::line_handle::LineHandle;
use crate::gateway::units::{part, target};
use isotherm_core::compensation::AxisState;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::SignalId;
use isotherm_profile::{OutputId, Writes};

pub(super) struct Order {
    /// Cz, or what the slope comes to at the axis's reach.
    pub(super) cz: Micron,
    /// Target of it.
    pub(super) target: Micron,
    pub(super) decided: Moment,
    pub(super) armed: bool,
    /// Nothing is wanted of it: it is not armed, or nothing was decided since.
    pub(super) off: bool,
    /// The position to be corrected, where it may be used.
    pub(super) position: Option<f64>,
    /// When a change must have left at the latest: what it rests on is too old after that.
    pub(super) not_after: Moment,
    /// Whether the interlock allows writing; `None` where that cannot be known.
    pub(super) allowed: Option<bool>,
    /// What stands in the register has not been taken over yet: the decision is older than that.
    pub(super) outdated: bool,
    /// Restarts of the control so far.
    pub(super) restarts: u64,
    /// How often the computer has stood still so far.
    pub(super) pauses: u64,
    pub(super) follows: bool,
    pub(super) holds: bool,
}

impl Order {
    pub(super) fn of(shared: &LineHandle, core: &Core, id: OutputId, now: Moment) -> Order {
        let output = shared.profile.output(id);
        let decision = core.compensation.decision(output.axis.0);
        let state = decision.map(|decision| decision.state);
        let arming = &core.arming[output.axis.0];
        let value = |id: SignalId| core.board.value(id, now);
        let position = output.writes.position();
        Order {
            cz: decision.map_or(Micron::ZERO, |decision| part(decision, output.writes)),
            target: decision.map_or(Micron::ZERO, |decision| target(decision, output.writes)),
            decided: decision.map_or(Moment::default(), |decision| decision.at),
            position: position.and_then(value),
            not_after: match position {
                Some(position) => core.board.usable_until(position),
                // A constant rests on no reading.
                None if output.writes == Writes::Reference => Moment::END,
                None => core.not_after[output.axis.0],
            },
            armed: arming.armed,
            off: !arming.armed || state.is_none_or(|state| state == AxisState::Off),
            allowed: output.when.as_ref().map_or(Some(true), |when| when.holds(&value)),
            outdated: match output.writes {
                Writes::Slope => arming.take_over_slope.is_some(),
                // A constant.
                Writes::Reference => false,
                _ => arming.take_over.is_some(),
            },
            restarts: core.restarts.of(id),
            pauses: core.pauses.count(),
            follows: state.is_some_and(AxisState::is_following),
            holds: matches!(state, Some(AxisState::Holding(_))),
        }
    }
}
