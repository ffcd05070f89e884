//! Demand on an output: the value that its axis requires, and the conditions under which the value may be written.
//! The demand is derived from the state that all bus lines share.

use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::units::{Units, part, target};
use isotherm_core::compensation::AxisState;
use isotherm_core::output::{Condition, Demand, Mode, OutputDecision, PositionDecision, Who};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::SignalId;
use isotherm_profile::{OutputId, Writes};

/// Demand on an output: required value in µm, and the conditions under which the value may be written.
pub(super) struct OutputDemand {
    /// Cz (compensation value) that the axis requires, after the limits of the axis. For an output that writes a
    /// slope: the effect of the slope at the axis's largest distance from the reference position.
    cz: Micron,
    /// Cz that the axis requires in the end. The value `cz` approaches this target step by step.
    target: Micron,
    /// Time at which the axis decided.
    decided: Moment,
    /// Requester that armed the axis. `None` if the axis is off.
    armed: Option<Who>,
    decision: Decision,
    /// Position that the output must correct. `None` if the output corrects no position, or if the position has no
    /// usable reading.
    pub(super) position: Option<f64>,
    /// Latest time at which a changed value may be sent. After this time, the readings from which the axis has
    /// calculated the value are too old.
    pub(super) not_after: Moment,
    /// State of the interlock (`when` of the output): it permits writes, forbids writes, or is unknown.
    pub(super) interlock: Condition,
    /// Number of restarts of the control (machine controller) since the start of the gateway.
    restarts: u64,
    /// Number of pauses of the computer since the start of the gateway.
    pauses: u64,
}

/// Whether the last decision of an axis is written to its output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Decision {
    /// Nothing is written: the axis is off, or has not decided since it was armed.
    Off,
    /// Nothing is written yet. The axis must first continue from the register value, and then make a new decision.
    Outdated,
    /// The controller of the output writes the value, in the contained mode.
    Current(Mode),
}

impl OutputDemand {
    pub(super) fn of(shared: &LineHandle, core: &GatewayState, id: OutputId, now: Moment) -> OutputDemand {
        let output = shared.profile.output(id);
        let decision = core.compensation.decision(output.axis.0);
        let arming = &core.arming[output.axis.0];
        let value = |id: SignalId| core.board.value(id, now);
        let position = output.writes.position();
        let is_outdated = match output.writes {
            Writes::Slope => arming.take_over_slope.is_some(),
            // The reference position is a constant.
            Writes::Reference => false,
            _ => arming.take_over.is_some(),
        };
        OutputDemand {
            cz: decision.map_or(Micron::ZERO, |decision| part(decision, output.writes)),
            target: decision.map_or(Micron::ZERO, |decision| target(decision, output.writes)),
            decided: decision.map_or(Moment::default(), |decision| decision.at),
            armed: arming.armed_by(),
            decision: match decision.map(|decision| decision.state) {
                None | Some(AxisState::Off) => Decision::Off,
                Some(_) if !arming.is_armed() => Decision::Off,
                Some(_) if is_outdated => Decision::Outdated,
                // A constant is written whatever the axis does.
                Some(_) if output.writes == Writes::Reference => Decision::Current(Mode::Finish),
                // The axis returns to the value that it held before the settings of a sensor were changed.
                Some(AxisState::Holding(_)) if arming.return_to.is_some() => Decision::Current(Mode::Finish),
                Some(AxisState::Holding(_)) => Decision::Current(Mode::Hold),
                Some(state) if state.is_following() => Decision::Current(Mode::Follow),
                Some(_) => Decision::Current(Mode::Finish),
            },
            position: position.and_then(value),
            not_after: match position {
                Some(position) => core.board.usable_until(position),
                // A constant has no reading that could be too old.
                None if output.writes == Writes::Reference => Moment::END,
                None => core.not_after[output.axis.0],
            },
            interlock: match output.when.as_ref().map_or(Some(true), |when| when.holds(&value)) {
                Some(true) => Condition::Met,
                Some(false) => Condition::NotMet,
                None => Condition::Unknown,
            },
            restarts: core.restarts.of(id),
            pauses: core.pauses.count(),
        }
    }

    /// Returns whether nothing is written, because the axis is off or has not decided since it was armed.
    pub(super) fn is_off(&self) -> bool {
        self.decision == Decision::Off
    }

    /// Converts the demand from µm to counts, for the controller of the output's register.
    pub(super) fn in_counts(&self, shared: &LineHandle, id: OutputId, units: &Units) -> Demand {
        let output = shared.profile.output(id);
        let decision = match self.decision {
            Decision::Off | Decision::Outdated => None,
            Decision::Current(mode) => Some(mode),
        };
        let decision = decision.map(|mode| {
            let (offset, target) =
                match (output.writes, shared.profile.axis(output.axis).settings.intercept_slope) {
                    // A reference position is no correction, and is written without steps.
                    (Writes::Reference, Some(line)) => (units.counts(line.reference.get()), None),
                    (Writes::Reference, None) => (units.offset(self.cz), None),
                    _ => (units.offset(self.cz), Some(units.offset(self.target))),
                };
            OutputDecision { offset, target, at: self.decided, not_after: self.not_after, mode }
        });
        Demand {
            armed: self.armed.filter(|_| !shared.dry_run),
            interlock: self.interlock,
            decision,
            restarts: self.restarts,
            pauses: self.pauses,
        }
    }

    /// Returns the Cz for a corrected position, with its target and the time of its decision. `None` if nothing is
    /// written.
    pub(super) fn of_position(&self) -> Option<PositionDecision> {
        let decision = PositionDecision { cz: self.cz, target: self.target, at: self.decided };
        (!self.is_off()).then_some(decision)
    }
}
