//! Sign check of an axis with a dial gauge. Cz moves a little in the plus direction and back, and the operator reports
//! in which direction the gauge moved. Limit, step and rate of the axis apply to this movement as usual.

use std::sync::Arc;
use std::time::Duration;

use super::state::GatewayState;
use crate::gateway::state::causes;
use crate::gateway::state::sign::{PATIENCE, SignCheck, WAY, is_at, must, refused};
use crate::observe::events::Event;
use crate::observe::requester::Requester;
use crate::observe::status::{Answer, DialDirection};
use isotherm_core::compensation::AxisState;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::Profile;

/// Begins the sign check of an axis.
pub(in crate::gateway) fn begin(
    core: &mut GatewayState,
    axis: usize,
    requester: &Arc<Requester>,
    now: Moment,
) -> Result<Answer, Explained> {
    let (profile, dry_run) = given(core);
    let settings = &profile.axes[axis].settings;
    let (name, guard) = (&settings.name, &settings.guard);
    if !profile.axes[axis].has_model() {
        return Err(causes::unmodelled(&profile, axis).within(|cause| format!("axis {name}: {cause}")));
    }
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
    let decision = core.compensation.decision(axis).filter(|_| core.arming[axis].is_armed());
    let Some(decision) = decision else {
        return Err(Explained::new(
            format!("axis {name} is off"),
            format!("arm it first (`isotherm arm --axis {name}`)"),
        ));
    };
    if !decision.state.is_following() || !core.has_arrived(axis) {
        let why = core.why(axis, now);
        let does = AxisState::display_of(decision.state.name());
        let why = if why.cause.is_empty() { "its registers do not hold its offset yet".into() } else { why };
        return Err(Explained::new(
            format!("axis {name} is {does}: {why}"),
            "check the sign when the axis compensates and its registers hold its offset",
        ));
    }
    let from = decision.cz;
    if let Some(why) = refused(guard, from, name) {
        return Err(format!("the sign of axis {name} cannot be checked now: {why}").into());
    }
    let to = Micron::new(from.get() + WAY).unwrap_or(from);
    let steps = (WAY / guard.step.get()).ceil() + 2.0;
    let way = Duration::try_from_secs_f64(steps * settings.ramp_period().as_secs_f64()).unwrap_or(PATIENCE);
    let until =
        now.after(settings.every + way.max(Duration::from_secs_f64(WAY / guard.rate.get())) + PATIENCE);
    core.arming[axis].sign = Some(SignCheck { by: requester.clone(), from, to, until, is_there: false });
    progress(core, axis)
}

/// Returns the progress of a sign check: [`Answer::Done`] when the register holds the offset, so that the operator may
/// read the gauge.
pub(in crate::gateway) fn progress(core: &GatewayState, axis: usize) -> Result<Answer, Explained> {
    let (profile, _) = given(core);
    let name = &profile.axes[axis].settings.name;
    let Some(check) = &core.arming[axis].sign else {
        let cause = format!("the check of the sign of axis {name} has ended");
        return Err(Explained::new(cause, "`isotherm events` says why"));
    };
    let way = check.to - check.from;
    Ok(match check.is_there {
        true => Answer::Done(format!("{name}: {}", must(&profile, axis, way))),
        false => Answer::Waits(format!("{name}: Cz goes from {} to {}", check.from, check.to)),
    })
}

/// Records the answer of the operator, and ends the check. The offset returns to the value of the model.
pub(in crate::gateway) fn answer(
    core: &mut GatewayState,
    axis: usize,
    moved: DialDirection,
    (requester, stamp): (&Requester, String),
) -> Result<Answer, Explained> {
    let (profile, _) = given(core);
    let name = profile.axes[axis].settings.name.clone();
    match &core.arming[axis].sign {
        None => {
            return Err(Explained::new(
                format!("no check of the sign of axis {name} is under way"),
                "start the sign check first",
            ));
        }
        Some(check) if !check.is_there => {
            return Err(Explained::new(
                format!("{name}: the register does not hold the changed Cz yet"),
                "wait until the register holds this Cz",
            ));
        }
        Some(_) => {}
    }
    core.arming[axis].sign = None;
    core.storage.signs.entry(name.clone()).or_default().checked = Some((stamp, moved));
    core.storage.remember_soon();
    let said = moved.explained(&name);
    let (way, who) = (requester.way, requester.who.clone());
    core.events.push(Event::SignChecked { axis: name.clone(), moved, way, who });
    Ok(Answer::Done(format!("{name}: {said}")))
}

/// Updates the sign checks: marks those whose offset the register holds. Ends a check if its axis stops compensating,
/// its client has disconnected, or its time is over.
pub(in crate::gateway) fn follow(core: &mut GatewayState, now: Moment) {
    for axis in 0..core.arming.len() {
        let (Some(check), Some(decision)) = (&core.arming[axis].sign, core.compensation.decision(axis))
        else {
            continue;
        };
        let (profile, _) = given(core);
        let guard = &profile.axes[axis].settings.guard;
        let why = if !decision.state.is_following() {
            let does = AxisState::display_of(decision.state.name());
            Some(core.why(axis, now).within(|cause| format!("the axis is {does}: {cause}")))
        } else if check.by.has_left() {
            Some("the client that requested the check has disconnected".into())
        } else {
            (now >= check.until)
                .then(|| "the operator has not reported in time in which direction the gauge moved".into())
        };
        if let Some(why) = why {
            end(core, axis, why);
        } else if !check.is_there
            && is_at(guard, decision.cz, check.to)
            && core.has_arrived(axis)
            && let Some(check) = &mut core.arming[axis].sign
        {
            check.is_there = true;
        }
    }
}

/// Ends the sign check of an axis, for the reason `why`. Returns whether a check was running.
pub(in crate::gateway) fn end(core: &mut GatewayState, axis: usize, why: Explained) -> bool {
    let (profile, _) = given(core);
    let was = core.arming[axis].sign.is_some();
    if was {
        core.arming[axis].sign = None;
        core.events.push(Event::SignEnded { axis: profile.axes[axis].settings.name.clone(), why });
    }
    was
}

fn given(core: &GatewayState) -> (Arc<Profile>, bool) {
    (core.given.profile.clone(), core.given.dry_run)
}
