//! The end of a run: the fault actions, or registers that keep what they hold; how long that takes, and what it leaves.

use std::time::Duration;

use super::core::Core;
use super::output::Standing;
use super::shared::Shared;
use super::units::Units;
use isotherm_core::compensation::AxisState;
use isotherm_core::compensation::settings::OnFault;
use isotherm_profile::{OnStop, Share, stop};

/// A request to stop: the axes take their fault actions, or nothing more is decided. How long that takes at most.
pub(super) fn begin_stop(shared: &Shared, how: OnStop) -> Duration {
    let mut core = shared.core();
    core.stop = Some(how);
    core.arming.note_all();
    core.next_due = core.compensation.next_due().filter(|_| how == OnStop::FaultAction);
    if how == OnStop::Hold {
        drop(core);
        return stop::hold(&shared.profile);
    }
    let ways = core.compensation.decisions().map(|decision| [decision.cz, decision.slope]);
    let longest = stop::fault_actions(&shared.profile, ways);
    // What may still arrive can forbid the next step for so long, of a device that answers.
    let answers = core.outputs.states().iter().filter(|output| output.standing == Standing::Verified);
    let now = shared.clock.now();
    let waits = answers.filter_map(|output| Some(output.waits_until?.since(now))).max();
    drop(core);
    shared.wake();
    longest.saturating_add(waits.unwrap_or_default())
}

/// Nothing is under way in a register: a stop now is one in order.
pub(super) fn has_settled(shared: &Shared) -> bool {
    let core = shared.core();
    let waits = core.outputs.states().iter().any(|output| output.handshake.waits.is_some());
    !waits && core.registers.iter().flatten().copied().all(|mut one| one.state_mut().end().in_order)
}

/// The process ends: what may still arrive in the registers goes on disk, and whether it ended in order.
pub(super) fn end_registers(shared: &Shared) {
    if shared.dry_run {
        return;
    }
    let mut core = shared.core();
    let Core { registers, outputs, .. } = &mut *core;
    for ((output, controller), seen) in shared.profile.outputs.iter().zip(registers).zip(outputs.states()) {
        if let Some(controller) = controller {
            let mut kept = controller.state_mut().end();
            // What the control has not taken is sent again before anything else, by the next run too.
            kept.in_order &= !seen.handshake.is_untaken;
            let _ = shared.ledger.keep(output, kept, false);
        }
    }
}

/// The lines drop what strobes are up, and what says that an axis is armed; whether there is one.
pub(super) fn leave(shared: &Shared) -> bool {
    let mut core = shared.core();
    // Where the registers keep what they hold, the control goes on with it.
    let drops_enabled = core.runs_fault_actions();
    let any = core
        .outputs
        .states()
        .iter()
        .any(|output| output.handshake.strobe_up || (drops_enabled && output.handshake.says_enabled));
    core.leaving = true;
    drop(core);
    if any {
        shared.wake();
    }
    any
}

/// Every axis has done what its fault action asks for, and what it decided stands in the registers.
pub(super) fn at_rest(shared: &Shared) -> bool {
    let core = shared.core();
    let waits = core.outputs.states().iter().any(|output| output.handshake.waits.is_some());
    !waits
        && shared.profile.axes.iter().enumerate().all(|(axis, settings)| {
            let Some(decision) = core.compensation.decision(axis) else { return true };
            let rested = match decision.state {
                AxisState::Off | AxisState::Zeroed => true,
                AxisState::Holding(_) => settings.settings.on_fault == OnFault::Hold,
                _ => false,
            };
            rested && core.has_arrived(axis)
        })
}

/// What stays in the registers: as verified, with its age, and what may still arrive.
pub(super) fn what_is_left(shared: &Shared) -> String {
    let core = shared.core();
    let now = shared.clock.now();
    let each = shared.profile.outputs.iter().zip(core.outputs.states().iter().zip(&core.registers));
    let left: Vec<String> = each
        .filter(|(output, _)| output.writes.is_cz())
        .map(|(output, (state, register))| {
            let ago = state.verified_at.map_or(0, |at| now.since(at).as_secs());
            let held = match (state.standing, state.cz) {
                (Standing::Verified, Some(cz)) if output.share == Share::Ledger => {
                    format!("{} holds {cz} of ours beside the operator's part", output.name)
                }
                (Standing::Verified, Some(cz)) => format!("{} holds {cz}", output.name),
                (_, Some(cz)) => {
                    format!("{} held {cz} when it was last verified, {ago} s ago", output.name)
                }
                (_, None) => format!("{} was never read", output.name),
            };
            let open = register.map(|one| Units::of(&shared.profile, output).may_arrive(one.state()));
            match open.filter(|open| !open.is_empty()) {
                Some(open) => format!("{held} ({} may still arrive)", open.join(" or ")),
                None => held,
            }
        })
        .collect();
    if left.is_empty() { "no offset outputs".to_owned() } else { left.join(", ") }
}
