//! Sign check of an axis with a dial gauge. Cz (compensation value) moves a little in the plus direction and back,
//! and the operator reports in which direction the gauge moved. Limit, step and rate of the axis also apply to this
//! movement.

use std::sync::Arc;
use std::time::Duration;

use super::state::GatewayState;
use crate::gateway::state::arming::{ArmRequest, ArmingState};
use crate::gateway::state::causes::unmodelled;
use crate::gateway::state::sign::{PATIENCE, SignCheck, SignMove, SignStage, WAY, is_at, must, refused};
use crate::observe::events::Event;
use crate::observe::requester::Requester;
use crate::observe::status::{Answer, DialDirection};
use isotherm_core::compensation::{AxisState, Decision};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{AxisId, Profile};

/// Begins the sign check of an axis. If the axis is not ready yet, the check waits until it is ready. An axis without
/// a model is armed for the check, with a Cz of zero.
pub(in crate::gateway) fn begin(
    core: &mut GatewayState,
    axis: usize,
    requester: &Arc<Requester>,
    now: Moment,
) -> Result<Answer, Explained> {
    let (profile, dry_run) = given(core);
    let settings = &profile.axes[axis].settings;
    let name = &settings.name;
    if dry_run || core.phase.is_stopping() {
        let why = if dry_run { "nothing is written in a dry run" } else { "the gateway is stopping" };
        return Err(why.into());
    }
    if !profile.outputs.iter().any(|output| output.axis.0 == axis && output.writes.is_cz()) {
        return Err(format!("no output writes the Cz of axis {name}: nothing would move").into());
    }
    if core.arming[axis].sign.is_some() {
        return Err(format!(
            "the sign of axis {name} is being checked already: wait until that check has ended"
        )
        .into());
    }
    let arming = &core.arming[axis];
    let has_model = profile.axes[axis].has_model();
    let (is_armed, is_asked) = (arming.is_armed(), arming.is_waiting(&profile, axis));
    if has_model && !is_armed && !is_asked {
        return Err(Explained::new(
            format!("axis {name} is off"),
            format!("arm it first (`isotherm arm --axis {name}`)"),
        ));
    }
    // Cz of an axis without a model is zero when the check begins.
    if let Some(why) = (!has_model).then(|| refused(&settings.guard, Micron::ZERO, name)).flatten() {
        return Err(format!("the sign of axis {name} cannot be checked: {why}").into());
    }
    let until = now.after(profile.arm_timeout);
    let stage = if is_away(core, axis) { SignStage::ReturnsToZero } else { SignStage::Waits };
    let arming = &mut core.arming[axis];
    arming.sign = Some(SignCheck { by: requester.clone(), stage, until });
    arming.sign_ended = None;
    if !has_model && !is_armed {
        let asked = ArmRequest { by: requester.clone(), until, reported: (String::new(), now), from: None };
        (arming.asked, arming.refusal) = (Some(asked), None);
        core.board.check(now);
        core.arm_where_possible(now);
    }
    follow_one(core, axis, now);
    progress(core, axis, now)
}

/// Returns the progress of a sign check. The answer is [`Answer::Done`] when the register holds the changed Cz, so
/// that the operator may read the gauge.
pub(in crate::gateway) fn progress(
    core: &GatewayState,
    axis: usize,
    now: Moment,
) -> Result<Answer, Explained> {
    let (profile, _) = given(core);
    let name = &profile.axes[axis].settings.name;
    let Some(check) = &core.arming[axis].sign else {
        let ended = format!("the check of the sign of axis {name} has ended");
        return Err(match core.arming[axis].sign_ended.clone() {
            Some(why) => why.within(|cause| format!("{ended}: {cause}")),
            None => Explained::new(ended, "`isotherm events` says why"),
        });
    };
    Ok(match check.stage {
        SignStage::ReturnsToZero if core.arming[axis].is_armed() => {
            Answer::Waits(format!("{name}: the register does not hold zero; Cz returns to zero first"))
        }
        SignStage::Waits | SignStage::ReturnsToZero => {
            let why = not_ready(core, axis, now).map(|why| format!(": {why}")).unwrap_or_default();
            Answer::Waits(format!("{name}: the sign check waits for the axis{why}"))
        }
        SignStage::Moves(SignMove { from, to }) => {
            Answer::Waits(format!("{name}: Cz goes from {from} to {to}"))
        }
        SignStage::Reached(moved) => {
            Answer::Done(format!("{name}: Cz has changed by {}; read the gauge now", moved.way()))
        }
    })
}

/// Returns `true` if the axis has no model, and one of its registers does not hold zero.
fn is_away(core: &GatewayState, axis: usize) -> bool {
    let (profile, _) = given(core);
    let guard = &profile.axes[axis].settings.guard;
    let mut outputs = core.outputs.of_axis(axis).filter(|(output, _)| output.writes.is_cz());
    !profile.axes[axis].has_model()
        && outputs.any(|(_, state)| state.cz.is_some_and(|cz| !is_at(guard, cz, Micron::ZERO)))
}

/// Returns why the sign check cannot move the axis yet; `None` if the axis is ready.
fn not_ready(core: &GatewayState, axis: usize, now: Moment) -> Option<Explained> {
    let (profile, _) = given(core);
    let settled = |decision: &Decision| {
        // An axis without a model first goes to zero.
        let is_at_rest = profile.axes[axis].has_model()
            || is_at(&profile.axes[axis].settings.guard, decision.cz, Micron::ZERO);
        decision.state.is_following() && core.has_arrived(axis) && is_at_rest
    };
    let decision = core.compensation.decision(axis).filter(|_| core.arming[axis].is_armed());
    if decision.is_some_and(settled) {
        return None;
    }
    let why = core.why(axis, now);
    Some(match decision {
        None => why.within(|cause| format!("the axis is off: {cause}")),
        Some(_) if why.cause.is_empty() => "the registers of the axis do not hold its offset yet".into(),
        Some(decision) => {
            let does = AxisState::display_of(decision.state.name());
            why.within(|cause| format!("the axis is {does}: {cause}"))
        }
    })
}

/// Records the answer of the operator, and ends the check. Cz returns to the value of the model. The returned answer
/// contains the direction in which the gauge must move.
pub(in crate::gateway) fn answer(
    core: &mut GatewayState,
    axis: usize,
    moved: DialDirection,
    (requester, stamp): (&Requester, String),
) -> Result<Answer, Explained> {
    let (profile, _) = given(core);
    let name = profile.axes[axis].settings.name.clone();
    let way = match core.arming[axis].sign.as_ref().map(|check| check.stage) {
        None => {
            return Err(Explained::new(
                format!("no check of the sign of axis {name} is under way"),
                "start the sign check first",
            ));
        }
        Some(SignStage::Waits | SignStage::ReturnsToZero | SignStage::Moves(_)) => {
            return Err(Explained::new(
                format!("{name}: the register does not hold the changed Cz yet"),
                "wait until the register holds this Cz",
            ));
        }
        Some(SignStage::Reached(moved)) => moved.way(),
    };
    core.arming[axis].sign = None;
    core.storage.signs.entry(name.clone()).or_default().checked = Some((stamp, moved));
    core.storage.remember_soon();
    let said = moved.explained(&name);
    let (way_of, who) = (requester.way, requester.who.clone());
    core.events.push(Event::SignChecked { axis: name.clone(), moved, way: way_of, who });
    Ok(Answer::Done(format!("{name}: {}; {said}", must(&profile, axis, way))))
}

/// Updates the sign checks of all axes, and disarms axes without a model after their check.
pub(in crate::gateway) fn follow(core: &mut GatewayState, now: Moment) {
    for axis in 0..core.arming.len() {
        follow_one(core, axis, now);
        disarm_unmodelled(core, axis);
    }
}

/// Updates the sign check of an axis. Begins the movement when the axis is ready, and records when the register holds
/// the changed Cz. Ends the check if the axis stops compensating, the client has disconnected, or the time is over.
fn follow_one(core: &mut GatewayState, axis: usize, now: Moment) {
    let Some(check) = core.arming[axis].sign.clone() else { return };
    let (profile, _) = given(core);
    if check.by.has_left() {
        end(core, axis, "the client that requested the check has disconnected".into());
        return;
    }
    match check.stage {
        SignStage::Waits | SignStage::ReturnsToZero => {
            begin_movement(core, axis, (&*profile, &check), now);
        }
        SignStage::Moves(moved) | SignStage::Reached(moved) => {
            let Some(decision) = core.compensation.decision(axis).copied() else { return };
            let guard = &profile.axes[axis].settings.guard;
            if !decision.state.is_following() {
                let does = AxisState::display_of(decision.state.name());
                let why = core.why(axis, now).within(|cause| format!("the axis is {does}: {cause}"));
                end(core, axis, why);
            } else if now >= check.until {
                let why = "the operator has not reported in time in which direction the gauge moved";
                end(core, axis, why.into());
            } else if matches!(check.stage, SignStage::Moves(_))
                && is_at(guard, decision.cz, moved.to)
                && core.has_arrived(axis)
                && let Some(check) = &mut core.arming[axis].sign
            {
                check.stage = SignStage::Reached(moved);
            }
        }
    }
}

/// Begins the movement of a sign check if its axis is ready. Ends the check if the axis can no longer become ready.
fn begin_movement(
    core: &mut GatewayState,
    axis: usize,
    (profile, check): (&Profile, &SignCheck),
    now: Moment,
) {
    let settings = &profile.axes[axis].settings;
    let (name, guard) = (&settings.name, &settings.guard);
    if let Some(why) = not_ready(core, axis, now) {
        let arming = &core.arming[axis];
        let is_lost = !arming.is_armed() && !arming.is_waiting(profile, axis);
        if is_lost || now >= check.until {
            let why = core.arming[axis].refusal.clone().unwrap_or(why);
            end(core, axis, why);
        } else if is_away(core, axis)
            && let Some(check) = &mut core.arming[axis].sign
        {
            check.stage = SignStage::ReturnsToZero;
        }
        return;
    }
    if check.stage == SignStage::ReturnsToZero {
        let why = "the register did not hold zero before the check; it holds zero now";
        end(core, axis, Explained::new(why, "set the gauge to zero, and start the check again"));
        return;
    }
    let Some(from) = core.compensation.decision(axis).map(|decision| decision.cz) else { return };
    if let Some(why) = refused(guard, from, name) {
        end(core, axis, why.into());
        return;
    }
    let steps = (WAY / guard.step.get()).ceil() + 2.0;
    let way = Duration::try_from_secs_f64(steps * settings.ramp_period().as_secs_f64()).unwrap_or(PATIENCE);
    let longest = settings.every + way.max(Duration::from_secs_f64(WAY / guard.rate.get())) + PATIENCE;
    if let Some(check) = &mut core.arming[axis].sign {
        check.stage = SignStage::Moves(SignMove::beginning_at(from));
        check.until = now.after(longest);
    }
}

/// Disarms an axis without a model when its Cz has returned to zero after a sign check. The axis does not
/// count as switched off by an operator. If the axis later has a model, the key `arm` of the profile decides
/// whether the gateway arms the axis.
fn disarm_unmodelled(core: &mut GatewayState, axis: usize) {
    let (profile, _) = given(core);
    let arming = &core.arming[axis];
    if profile.axes[axis].has_model() || !arming.is_armed() || arming.sign.is_some() {
        return;
    }
    let guard = &profile.axes[axis].settings.guard;
    let is_at_zero =
        core.compensation.decision(axis).is_some_and(|decision| is_at(guard, decision.cz, Micron::ZERO));
    if is_at_zero && core.has_arrived(axis) {
        let why = unmodelled(&profile, axis).within(|cause| format!("the sign check is over, and {cause}"));
        core.disarm(AxisId(axis), why);
        core.arming[axis].state = ArmingState::Off;
    }
}

/// Ends the sign check of an axis, for the reason `why`. Returns whether a check was running.
pub(in crate::gateway) fn end(core: &mut GatewayState, axis: usize, why: Explained) -> bool {
    let (profile, _) = given(core);
    let was = core.arming[axis].sign.is_some();
    if was {
        core.arming[axis].sign = None;
        core.arming[axis].sign_ended = Some(why.clone());
        core.events.push(Event::SignEnded { axis: profile.axes[axis].settings.name.clone(), why });
    }
    was
}

fn given(core: &GatewayState) -> (Arc<Profile>, bool) {
    (core.given.profile.clone(), core.given.dry_run)
}
