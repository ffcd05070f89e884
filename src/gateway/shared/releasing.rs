//! Course of a release: a former register returns to its base value, which is its value without the gateway's offset.
//! An operator requests the release, and the next start arms an additional axis for the register. The release is over
//! when the base value was read back from the register. If the gateway ends during a release, the next start reports
//! the register again.
//!
//! ```text
//! ask ─► state ─► restart --keep ─► begin ─► armed, step by step ─► follow: read back at the base ─► over
//!                                     └────► another value, or the axis is off ─► register-left again
//! ```
//!
//! A command or `arm = "auto"` cannot arm such an axis.

use std::sync::Arc;

use super::state::GatewayState;
use crate::gateway::state::arming::{ArmRequest, Arming, ArmingState};
use crate::gateway::state::output::RegisterHealth;
use crate::gateway::store::places::register_left;
use crate::gateway::store::release::{ReturningRegister, in_doubt, operators_part};
use crate::observe::events::Event;
use crate::observe::requester::{Channel, Requester};
use crate::observe::status::{FormerRegisterStatus, ReleaseProgress};
use isotherm_core::explained::Explained;
use isotherm_core::place::{FormerPlace, Owner, Release, Stage};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::safe_file::quoted;

/// Maximum difference between the Cz (compensation value) that the operator has seen and the present Cz, µm. The
/// display rounds Cz to a tenth of a micrometre.
const AS_SHOWN_UM: f64 = 0.05;

/// Cause and hint that the status shows for the axis of a finished release.
const OVER: (&str, &str) = (
    "the register is back at its base value: the release is over",
    "no action is necessary: after the next start of the gateway, this axis no longer exists",
);

/// Requests to arm the additional axis of each release that begins with this start. A release returns a register to
/// its base value.
pub(in crate::gateway) fn begin(core: &mut GatewayState, now: Moment) {
    for ReturningRegister { axis, release, .. } in core.releases.returning.clone() {
        let by = Requester::new(Channel::Restart, format!("released {}", release.by));
        let asked =
            ArmRequest { by: Arc::new(by), until: Moment::END, reported: (String::new(), now), from: None };
        core.arming[axis.0] = Arming { state: ArmingState::Latched, asked: Some(asked), ..Arming::default() };
        core.storage.remember_soon();
    }
}

/// Records the progress of each release, and ends the releases whose registers are back at their base values.
pub(super) fn follow(core: &mut GatewayState) {
    for one in core.releases.given_up.clone() {
        settle(core, &one);
    }
    for mut one in core.releases.returning.clone() {
        let (arming, state) = (&core.arming[one.axis.0], core.outputs[one.output.0]);
        let verified = state.cz.filter(|_| state.standing == RegisterHealth::Verified);
        if !arming.is_armed() {
            let is_over = arming.asked.is_none() && !core.phase.is_stopping();
            if is_over {
                given_up(core, &one, state.cz);
            }
            continue;
        }
        let Some(cz) = verified else { continue };
        if let Err(why) = one.admit(cz, state.shares) {
            core.disarm(one.axis, why);
            continue;
        }
        let is_new = one.release.stage == Stage::Asked;
        one.release = Release { held_um: cz.get(), stage: Stage::Begun, ..one.release };
        note(core, &one);
        if is_new {
            // From now on only the ledger entry of this output contains the division of a shared register.
            Arc::make_mut(&mut core.places.places).kept.retain(|entry| !entry.lies_at(&one.release.place));
            core.storage.remember_soon();
            continue;
        }
        let is_decided =
            core.compensation.decision(one.axis.0).is_some_and(|decision| decision.cz == Micron::ZERO);
        // A write that may still arrive would move the register again.
        let is_settled = state.waits_until.is_none();
        if is_decided && is_settled && !core.phase.is_stopping() && Release::is_back(cz.get(), one.grain_um) {
            ended(core, &one);
        }
    }
}

/// Saves the progress of a release (return of a register to its base value) in the state.
fn note(core: &mut GatewayState, one: &ReturningRegister) {
    let known = core.releases.returning.iter_mut().find(|known| known.axis == one.axis);
    if known.as_ref().is_some_and(|known| **known == *one) {
        return;
    }
    known.into_iter().for_each(|known| known.clone_from(one));
    let Release { output, place, .. } = &one.release;
    let saved = Arc::make_mut(&mut core.places.places).releases.iter_mut();
    saved.filter(|saved| saved.is_of(output, place)).for_each(|saved| saved.clone_from(&one.release));
}

/// Removes a release (return of a register to its base value) from the state. Returns the former register, or `None` if
/// the operator has confirmed it in the meantime.
fn remove(core: &mut GatewayState, one: &ReturningRegister) -> Option<FormerPlace> {
    let Release { output, place, .. } = &one.release;
    core.releases.returning.retain(|known| known.axis != one.axis);
    core.storage.remember_soon();
    let places = Arc::make_mut(&mut core.places.places);
    places.releases.retain(|release| !release.is_of(output, place));
    let at = places.former.iter().position(|former| former.output == *output && former.place == *place)?;
    Some(places.former.remove(at))
}

/// Ends a release after the base value was read back from the register.
fn ended(core: &mut GatewayState, one: &ReturningRegister) {
    let Release { output, place, .. } = &one.release;
    let former = remove(core, one).map(|former| FormerPlace { held_um: Some(0.0), found_um: None, ..former });
    let places = Arc::make_mut(&mut core.places.places);
    // The operator must still confirm the new place of an output that was moved.
    let is_moved = places.outputs.contains_key(output);
    places.former.extend(former.filter(|_| is_moved));
    core.arming[one.axis.0] =
        Arming { state: ArmingState::Latched, why: Explained::new(OVER.0, OVER.1), ..Arming::default() };
    core.events.push(Event::RegisterReleased { output: output.clone(), register: place.to_string() });
}

/// Gives up a release because its axis was switched off before the register reached its base value. The register is
/// reported again.
fn given_up(core: &mut GatewayState, one: &ReturningRegister, found: Option<Micron>) {
    let Release { held_um, stage, .. } = one.release;
    let found_um = found.map(Micron::get).filter(|found| (found - held_um).abs() > one.grain_um);
    let former = remove(core, one).unwrap_or_else(|| one.release.former());
    let held_um = if stage == Stage::Begun { Some(held_um) } else { former.held_um };
    let former = FormerPlace { held_um, found_um, ..former };
    let event = register_left(&former, &core.releases, &core.given.profile);
    core.events.push(event);
    Arc::make_mut(&mut core.places.places).former.push(former);
    core.releases.given_up.push(one.clone());
    let place = &one.release.place;
    match core.outputs[one.output.0].shares {
        Some((part, _)) => core.releases.parts.push((place.clone(), part)),
        None if place.share == Owner::Whole => {}
        None => core.releases.refuse(place, &in_doubt()),
    }
}

/// Updates the report of a register whose release was given up. As soon as no write of the gateway can arrive any
/// more, the function reports the last verified value of the register.
fn settle(core: &mut GatewayState, one: &ReturningRegister) {
    let ReturningRegister { release, grain_um, .. } = one;
    let register = core.registers[one.output.0].as_ref();
    if register.is_some_and(|register| register.state().may_arrive().next().is_some()) {
        return;
    }
    core.releases.given_up.retain(|known| known.axis != one.axis);
    let found = core.outputs[one.output.0].cz.map(Micron::get);
    let way = Release { from_um: release.held_um, stage: Stage::Asked, ..release.clone() };
    let is_ours = |found: &f64| release.stage == Stage::Begun && way.may_move_from(*found, *grain_um);
    let Some(found) = found.filter(is_ours).filter(|found| (found - release.held_um).abs() > *grain_um)
    else {
        return;
    };
    let places = Arc::make_mut(&mut core.places.places);
    let mut former = places.former.iter_mut().filter(|former| release.is_of(&former.output, &former.place));
    let Some(former) = former.next() else { return };
    (former.held_um, former.found_um) = (Some(found), None);
    let event = register_left(former, &core.releases, &core.given.profile);
    core.events.push(event);
    core.storage.remember_soon();
}

/// Requests the return of an output's former registers to their base values. The return begins at the next start.
/// `seen` contains the Cz in each register as it was shown to the operator, µm. Returns a sentence for the operator.
///
/// # Errors
/// The output has no such register, the register cannot be released, or it no longer holds the value that was shown.
pub(in crate::gateway) fn ask(
    core: &mut GatewayState,
    (output, seen): (&str, &[f64]),
    by: String,
) -> Result<String, Explained> {
    if core.given.dry_run {
        return Err("nothing is written in a dry run".into());
    }
    if core.phase.is_stopping() {
        return Err("the gateway is stopping".into());
    }
    if core.storage.keeps_nothing() {
        return Err(Explained::new("there is no state directory", "set one with --state"));
    }
    if core.storage.is_in_question() {
        let cause =
            "the saved state was rejected, so the values of the gateway in former registers are not known";
        return Err(Explained::new(
            cause,
            "arm an axis first: the operator must confirm the register values",
        ));
    }
    let all = left(core);
    let of_output: Vec<&FormerRegisterStatus> = all.iter().filter(|left| left.output == output).collect();
    if of_output.is_empty() {
        let cause = format!(
            "output {}: there is nothing to release: no former register of this output holds a value of the \
             gateway. A former register exists only after the output was moved or removed in the profile",
            quoted(output)
        );
        return Err(Explained::new(cause, "`isotherm status` lists the former registers"));
    }
    if let Some(left) = of_output.iter().find(|left| left.state == ReleaseProgress::Returning) {
        return Err(Explained::new(
            format!(
                "output {output}: {} is already returning to its base value; {:.1} µm remain",
                left.register, left.held_um
            ),
            "`isotherm status` shows its progress",
        ));
    }
    let can =
        |former: &FormerPlace| former.output == output && core.releases.obstacle(&former.place).is_none();
    let places = &core.places.places;
    let chosen = places.former.iter().filter(|former| former.is_left_behind(&places.outputs) && can(former));
    let released: Vec<Release> = chosen.filter_map(|former| release(core, former, by.clone())).collect();
    if released.is_empty() {
        let obstacle = of_output.iter().find_map(|left| left.obstacle.clone()).unwrap_or_default();
        return Err(obstacle.within(|cause| format!("output {output} cannot be released: {cause}")));
    }
    let as_shown = |(release, seen): (&Release, &f64)| (release.from_um - seen).abs() <= AS_SHOWN_UM;
    if released.len() != seen.len() || !released.iter().zip(seen).all(as_shown) {
        let cause = format!(
            "the value of the gateway in a former register of output {output} has changed since it was shown"
        );
        return Err(Explained::new(cause, "check the value again, then release it"));
    }
    let each = released.iter().map(|one| format!("{:.1} µm in {}", one.from_um, one.place));
    let said = format!(
        "output {output}: {} return to the base value after the next restart of the gateway",
        each.collect::<Vec<_>>().join(" and ")
    );
    let saved = &mut Arc::make_mut(&mut core.places.places).releases;
    for one in released {
        saved.retain(|known| !known.is_of(&one.output, &one.place));
        saved.push(one);
    }
    core.storage.remember_soon();
    Ok(said)
}

/// Withdraws the request to release the former registers of an output, unless the release has begun. Returns a
/// sentence for the operator.
pub(in crate::gateway) fn take_back(core: &mut GatewayState, output: &str) -> String {
    let saved = &mut Arc::make_mut(&mut core.places.places).releases;
    saved.retain(|release| release.output != output || release.stage == Stage::Begun);
    core.storage.remember_soon();
    format!("output {output}: the request to release its registers is withdrawn")
}

fn release(core: &GatewayState, former: &FormerPlace, by: String) -> Option<Release> {
    let (from_um, operator) = (former.found_um.or(former.held_um)?, operators(core, former));
    let FormerPlace { output, place, bounds, .. } = former.clone();
    let (bounds, held_um, stage) = (bounds?, from_um, Stage::Asked);
    Some(Release { output, place, bounds, from_um, operator, held_um, stage, by })
}

/// Returns the last known operator offset of a former register (the part of the register value that the operator
/// entered). The offset has the unit of the register. `None` if the register is not shared, or if the offset is not
/// known.
fn operators(core: &GatewayState, FormerPlace { place, bounds, .. }: &FormerPlace) -> Option<f64> {
    let mut parts = core.releases.parts.iter().rev();
    let found = parts.find(|(known, _)| known == place).map(|(_, part)| *part);
    let saved = || operators_part(place, bounds.as_ref()?, core.places.places.kept_of(place).as_ref());
    found.or_else(saved)
}

/// Returns the registers that no longer belong to an output, but still contain a value of the gateway.
pub(in crate::gateway) fn left(core: &GatewayState) -> Vec<FormerRegisterStatus> {
    let places = &core.places.places;
    let former = places.former.iter().filter(|former| former.is_left_behind(&places.outputs));
    let is_returning = |former: &FormerPlace| {
        core.releases.returning.iter().any(|one| one.release.is_of(&former.output, &former.place))
    };
    let left = former.filter(|former| !is_returning(former)).map(|former| {
        let is_asked = places.releases.iter().any(|release| release.is_of(&former.output, &former.place));
        let from_um = former.found_um.or(former.held_um).unwrap_or_default();
        FormerRegisterStatus {
            output: former.output.clone(),
            register: former.place.to_string(),
            state: if is_asked { ReleaseProgress::Asked } else { ReleaseProgress::Left },
            held_um: former.held_um.unwrap_or_default(),
            found_um: former.found_um,
            operator: operators(core, former),
            limit_um: former.bounds.as_ref().map(|bounds| bounds.limit_um),
            step_um: former.bounds.as_ref().map(|bounds| bounds.step_um),
            rate_um_per_s: former.bounds.as_ref().map(|bounds| bounds.rate_um_per_s),
            back_s: former.bounds.as_ref().map(|bounds| bounds.seconds(from_um)),
            obstacle: core.releases.obstacle(&former.place),
        }
    });
    let returning =
        core.releases.returning.iter().map(|ReturningRegister { release, .. }| FormerRegisterStatus {
            output: release.output.clone(),
            register: release.place.to_string(),
            state: ReleaseProgress::Returning,
            held_um: release.held_um,
            found_um: None,
            operator: release.operator,
            limit_um: Some(release.bounds.limit_um),
            step_um: Some(release.bounds.step_um),
            rate_um_per_s: Some(release.bounds.rate_um_per_s),
            back_s: Some(release.bounds.seconds(release.held_um)),
            obstacle: None,
        });
    left.chain(returning).collect()
}
