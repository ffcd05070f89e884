//! End of a run: the axes run their fault actions, or the registers keep their values. The functions calculate the
//! maximum duration of the end, and describe the values that remain in the registers.

use std::time::Duration;

use crate::gateway::shared::shared_state::Shared;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::output::RegisterHealth;
use crate::gateway::state::run_phase::RunPhase;
use crate::gateway::state::units::Units;
use isotherm_core::compensation::AxisState;
use isotherm_core::compensation::settings::OnFault;
use isotherm_profile::{OnStop, Share, stop};

/// Begins a stop. The axes run their fault actions, or keep their last Cz (compensation value). Returns the maximum
/// duration of the stop.
pub(in crate::gateway) fn begin_stop(shared: &Shared, how: OnStop) -> Duration {
    let mut core = shared.core();
    core.phase = RunPhase::Stopping(how);
    core.arming.note_all();
    core.next_due = core.compensation.next_due().filter(|_| how == OnStop::FaultAction);
    if how == OnStop::Hold {
        drop(core);
        return stop::hold(&shared.profile);
    }
    let ways = core.compensation.decisions().map(|decision| [decision.cz, decision.slope]);
    let longest = stop::fault_actions(&shared.profile, ways);
    // If the device answers, a write that may still arrive can delay the next step until this time.
    let answers = core.outputs.states().iter().filter(|output| output.standing == RegisterHealth::Verified);
    let now = shared.clock.now();
    let waits = answers.filter_map(|output| Some(output.waits_until?.since(now))).max();
    drop(core);
    shared.wake();
    longest.saturating_add(waits.unwrap_or_default())
}

/// Returns whether no exchange with a register is running. If so, the run may end, and the next run need not wait for
/// late writes.
pub(in crate::gateway) fn has_settled(shared: &Shared) -> bool {
    let core = shared.core();
    let waits = core.outputs.states().iter().any(|output| output.handshake.waits.is_some());
    !waits && core.registers.iter().flatten().copied().all(|mut one| one.state_mut().end().in_order)
}

/// Saves the state of each register at the end of the process: the written values that may still arrive at the
/// register, and whether all its exchanges had ended.
pub(in crate::gateway) fn end_registers(shared: &Shared) {
    if shared.dry_run {
        return;
    }
    let mut core = shared.core();
    let GatewayState { registers, outputs, .. } = &mut *core;
    for ((output, controller), seen) in shared.profile.outputs.iter().zip(registers).zip(outputs.states()) {
        if let Some(controller) = controller {
            let mut kept = controller.state_mut().end();
            // The next run, too, must first send again what the control has not taken.
            kept.in_order &= !seen.handshake.is_untaken;
            let _ = shared.ledger.keep(output, kept, false);
        }
    }
}

/// Requests the bus lines to reset the signals of output sets before the end: each strobe signal (request to
/// the control to accept values) that is set, and each control word that reports an armed axis. The control
/// words are reset only if the axes run their fault actions. Returns `true` while such a signal or control
/// word exists.
pub(in crate::gateway) fn leave(shared: &Shared) -> bool {
    let mut core = shared.core();
    // If the registers keep their values, the control continues with them.
    let drops_enabled = core.runs_fault_actions();
    let any = core
        .outputs
        .states()
        .iter()
        .any(|output| output.handshake.strobe_up || (drops_enabled && output.handshake.says_enabled));
    core.phase.leave();
    drop(core);
    if any {
        shared.wake();
    }
    any
}

/// Returns whether every axis has completed its fault action, and its registers hold its last decision.
pub(in crate::gateway) fn is_idle(shared: &Shared) -> bool {
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

/// Describes the values that remain in the registers. The text contains the last verified value of each register, its
/// age, and the values that may still arrive.
pub(in crate::gateway) fn what_is_left(shared: &Shared) -> String {
    let core = shared.core();
    let now = shared.clock.now();
    let each = shared.profile.outputs.iter().zip(core.outputs.states().iter().zip(&core.registers));
    let left: Vec<String> = each
        .filter(|(output, _)| output.writes.is_cz())
        .map(|(output, (state, register))| {
            let ago = state.verified_at.map_or(0, |at| now.since(at).as_secs());
            let held = match (state.standing, state.cz) {
                (RegisterHealth::Verified, Some(cz)) if output.share == Share::Ledger => {
                    format!("{} holds {cz} from the gateway, in addition to the operator offset", output.name)
                }
                (RegisterHealth::Verified, Some(cz)) => format!("{} holds {cz}", output.name),
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
