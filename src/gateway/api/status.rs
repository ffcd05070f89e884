//! State of the gateway for people and programs. The functions copy the shared state and derive the status from the
//! copy, so that the lock is held only during the copying.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashSet};
use std::time::Duration;

use crate::gateway::state::arming::Arming;
use crate::gateway::state::causes::CauseInputs;
use crate::gateway::state::continuity::Devices;
use crate::gateway::state::device_health::{DeviceHealth, JITTER_MS};
use crate::gateway::state::{comparison, extrapolation, stand_in};

use crate::gateway::shared::lock::LockTimes;
use crate::gateway::shared::releasing;
use crate::gateway::shared::shared_state::Shared;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::output::Outputs;
use crate::gateway::state::probing::why_refused;
use crate::gateway::state::reported_conditions::ReportedConditions;
use crate::gateway::state::sign::SignMemory;
use crate::gateway::state::signal_table::Latest;

use crate::clock::{Synchronised, zone};
use crate::observe::status::{
    ArmingStatus, AxisStatus, BusStatus, DeviceStatus, FormerRegisterStatus, GainStatus, LearnedStatus,
    OutputStatus, ProbeStatus, ProbedStatus, SharesStatus, SignalStatus, Status, WaitingStatus,
};
use isotherm_core::compensation::{Decision, Probe, Stages};
use isotherm_core::display::Intent;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::{Quality, Reading, Reason, SignalId};
use isotherm_profile::{Axis, DeviceId, Purpose};

/// Copy of the shared state at one time, from which the status is derived.
struct StatusSnapshot {
    now: Moment,
    /// Time since the machine was switched on; `None` until a signal has shown that the machine runs.
    machine_on: Option<Duration>,
    stopping: bool,
    runs_fault_actions: bool,
    decisions: Vec<Decision>,
    arming: Vec<Arming>,
    is_warned: Vec<bool>,
    signs: BTreeMap<String, SignMemory>,
    probes: Vec<Option<Probe>>,
    learned: Vec<Option<LearnedStatus>>,
    outputs: Outputs,
    latest: Latest,
    /// Readings at the time `now`. Readings that are too old have the quality "stale". Readings of a signal whose
    /// `fault_when` is true or unknown are rejected.
    seen: Vec<Reading>,
    device_health: DeviceHealth,
    devices: Devices,
    left: Vec<FormerRegisterStatus>,
    log_dropped: u64,
    lock_times: LockTimes,
}

impl StatusSnapshot {
    fn of(shared: &Shared) -> StatusSnapshot {
        let now = shared.clock.now();
        let core = shared.core();
        let mut picture = StatusSnapshot {
            now,
            machine_on: core.compensation.machine().on_time(now),
            stopping: core.phase.is_stopping(),
            runs_fault_actions: core.runs_fault_actions(),
            decisions: core.compensation.decisions().copied().collect(),
            arming: core.arming.as_slice().to_vec(),
            signs: core.storage.signs.clone(),
            is_warned: core.reported.iter().map(ReportedConditions::is_warned).collect(),
            probes: (0..shared.profile.axes.len())
                .map(|axis| core.compensation.probe(axis).cloned())
                .collect(),
            learned: (0..shared.profile.axes.len()).map(|axis| learned(shared, &core, axis)).collect(),
            outputs: core.outputs.clone(),
            latest: core.board.latest().clone(),
            seen: Vec::new(),
            device_health: core.device_health.clone(),
            devices: core.devices.clone(),
            left: releasing::left(&core),
            log_dropped: core.storage.dropped(),
            lock_times: core.lock_times,
        };
        drop(core);
        picture.seen = picture.latest.at(now);
        picture
    }

    fn intent(&self, shared: &Shared, axis: usize) -> Intent {
        let intent = self.arming[axis].intent(&shared.profile, axis);
        if self.stopping && intent == Intent::Arm { Intent::Follow } else { intent }
    }

    fn why(&self, shared: &Shared, axis: usize) -> Explained {
        let reasons = CauseInputs {
            profile: &shared.profile,
            axis,
            arming: &self.arming[axis],
            decision: &self.decisions[axis],
            outputs: &self.outputs,
            device_health: &self.device_health,
            devices: &self.devices,
            seen: &self.seen,
            has_run: self.machine_on.is_some(),
            stopping: self.runs_fault_actions,
            dry_run: shared.dry_run,
        };
        reasons.explained()
    }
}

pub(super) fn status(shared: &Shared) -> Status {
    let (events, event_counts) = shared.journal.read();
    let picture = StatusSnapshot::of(shared);
    let mut status = Status {
        machine: shared.profile.name.clone(),
        label: shared.profile.label.clone(),
        description: shared.profile.description.clone(),
        version: env!("CARGO_PKG_VERSION"),
        now: shared.clock.stamp(picture.now).to_string(),
        zone: zone(),
        clock: match shared.clock.is_virtual() {
            true => "virtual",
            false => Synchronised::by_the_kernel().display(),
        },
        uptime_s: picture.now.since(shared.started).as_secs_f64(),
        machine_on_s: picture.machine_on.map(|span| span.as_secs_f64()),
        language: shared.profile.web.as_ref().and_then(|web| web.language),
        overridden: shared.profile.overridden.clone(),
        profile_changed: shared.profile_changes.read(),
        dry_run: shared.dry_run,
        stopping: picture.stopping,
        ready: picture.device_health.devices.iter().all(|device| device.answered)
            && picture.decisions.iter().all(|decision| decision.at > Moment::default()),
        axes: axes(shared, &picture),
        signals: signals(shared, &picture),
        buses: buses(shared, &picture),
        devices: devices(shared, &picture),
        outputs: outputs(shared, &picture),
        alarms: shared.journal.alarms(),
        events,
        left: picture.left.clone(),
        log_dropped: picture.log_dropped,
        event_counts,
        mqtt: shared.broker.as_ref().map(|figures| figures.read()),
        lock_held: picture.lock_times.read(),
    };
    if !status.alarms.is_empty() {
        let ended = ended(&status);
        status.alarms.retain(|alarm| !ended.contains(&alarm.id));
    }
    status
}

/// Returns the names of alarms that may still be listed as active, although the status shows that their cause
/// is over. No event reports the end of these alarms.
fn ended(status: &Status) -> HashSet<String> {
    let calm = status.axes.iter().filter(|axis| !axis.warned);
    let good = status.signals.iter().filter(|signal| signal.quality == "good");
    let verified = || status.outputs.iter().filter(|output| output.state == "verified");
    (calm.map(|axis| format!("Cz of axis {}", axis.name)))
        .chain(good.map(|signal| format!("signal {}", signal.name)))
        .chain(verified().map(|output| format!("output {}", output.name)))
        .chain(verified().map(|output| format!("foreign write to {}", output.name)))
        .collect()
}

/// Returns the last verified Cz (compensation value) of an axis, and the time of the request that read it. If the axis
/// has several outputs, the first one with a known Cz is used. `None` if no Cz is known.
fn verified(picture: &StatusSnapshot, axis: usize) -> Option<(Micron, Moment)> {
    let mut outputs = picture.outputs.of_axis(axis).filter(|(output, _)| output.writes.is_cz());
    outputs.find_map(|(_, state)| state.cz.zip(state.verified_at))
}

fn axes(shared: &Shared, picture: &StatusSnapshot) -> Vec<AxisStatus> {
    let axes = shared.profile.axes.iter().zip(&picture.decisions).enumerate();
    axes.map(|(place, (axis, decision))| AxisStatus {
        truth: None,
        name: axis.settings.name.clone(),
        label: axis.label.clone(),
        state: match picture.intent(shared, place) {
            Intent::Arm => "waiting",
            _ => decision.state.name(),
        },
        shown: picture.outputs.display(
            place,
            (decision.state, picture.intent(shared, place)),
            (&picture.device_health, shared.dry_run),
        ),
        // The request of a release does not expire.
        waiting: picture.arming[place].asked.as_ref().filter(|_| !is_release(axis)).map(|asked| {
            WaitingStatus {
                asked: asked.by.way.by(&asked.by.who),
                expires_s: asked.until.since(picture.now).as_secs_f64(),
            }
        }),
        has_model: axis.has_model(),
        why: picture.why(shared, place),
        model: decision
            .model
            .and_then(|model| axis.settings.models.get(model))
            .map(|model| model.name.clone()),
        raw_um: decision.raw.map(Micron::get),
        expected_um: decision.expected.map(Micron::get),
        expected_touches: decision.expected_touches,
        cz_um: decision.cz.get(),
        verified_um: verified(picture, place).map(|(cz, _)| cz.get()),
        verified_age_s: verified(picture, place).map(|(_, at)| picture.now.since(at).as_secs_f64()),
        acted: Stages::ALL
            .iter()
            .filter(|(stage, _)| decision.acted.contains(*stage))
            .map(|(_, name)| *name)
            .collect(),
        limit_um: axis.settings.guard.limit.get(),
        warn_um: axis.settings.levels.warn.map(Micron::get),
        warned: picture.is_warned[place],
        error_um: axis.settings.levels.error.map(Micron::get),
        tripped: decision.tripped,
        arming: ArmingStatus {
            armed: picture.arming[place].is_armed(),
            left_off: match is_release(axis) {
                true => !picture.arming[place].is_armed(),
                false => axis.has_model() && picture.arming[place].is_left_off(&shared.profile),
            },
            release: is_release(axis),
        },
        sign: picture.arming[place]
            .sign
            .as_ref()
            .map(|sign| sign.status(&shared.profile, place, picture.now)),
        sign_checked: picture.signs.get(&axis.settings.name).and_then(|sign| sign.checked.clone()),
        probe: probe(shared, picture, place),
        learned: picture.learned[place].clone(),
        extrapolating: decision
            .extrapolating
            .as_ref()
            .map(|found| extrapolation::status(&shared.profile, found)),
        excess: decision.excess,
        stood_in: (decision.stood_in.as_ref())
            .map(|found| stand_in::status(&shared.profile, found, |at| shared.clock.stamp(at))),
    })
    .collect()
}

/// Returns whether the axis exists only to return a released register to its base value. Such an axis does not
/// compensate, so the status does not report that it is off.
fn is_release(axis: &Axis) -> bool {
    axis.purpose == Purpose::Release
}

/// Returns the status of the learned model of an axis, and of its candidate (proposed model). `None` if the axis does
/// not learn.
fn learned(shared: &Shared, core: &GatewayState, axis: usize) -> Option<LearnedStatus> {
    let learning = shared.profile.axes[axis].learning.as_ref()?;
    let preference = core.compensation.preference(axis)?;
    Some(core.learning[axis].status(preference, learning.adopt))
}

fn probe(shared: &Shared, picture: &StatusSnapshot, place: usize) -> Option<ProbeStatus> {
    let settings = &shared.profile.axes[place].settings;
    let (bounds, probe) = settings.probe.zip(picture.probes[place].as_ref())?;
    let decision = &picture.decisions[place];
    Some(ProbeStatus {
        correction_um: decision.correction.get(),
        limit_um: bounds.limit.get(),
        warn_um: bounds.warn.map(Micron::get),
        max_error_um: bounds.max_error.get(),
        last: probe.last().map(|last| ProbedStatus {
            at: shared.clock.stamp(last.at).to_string(),
            error_um: last.error.get(),
            acting_um: last.acting.get(),
            residual_um: last.residual.map(Micron::get),
            refused: last.refused.map(|why| why_refused(&shared.profile, place, why, last).to_string()),
        }),
        history: (probe.history())
            .map(|entry| (shared.clock.stamp(entry.at).to_string(), entry.residual.get()))
            .collect(),
        gains: (settings.models.iter().enumerate())
            .flat_map(|(place, model)| {
                model.correctable().iter().zip(probe.gains(place)).map(|(term, change)| GainStatus {
                    model: model.name.clone(),
                    signal: shared.profile.signal(term.input.signal).name.clone(),
                    change: *change,
                })
            })
            .collect(),
        worse: decision.worse.as_ref().map(|worse| comparison::status(settings, worse)),
    })
}

fn signals(shared: &Shared, picture: &StatusSnapshot) -> Vec<SignalStatus> {
    let signals = shared.profile.signals.iter().enumerate().zip(&picture.seen);
    signals
        .map(|((place, signal), reading)| {
            let taken = picture.latest.taken(SignalId(place));
            let why = match reading.quality {
                Quality::Good => Explained::default(),
                Quality::Bad(reason) => picture.device_health.why(SignalId(place), reason),
            };
            SignalStatus {
                name: signal.name.clone(),
                label: signal.label.clone(),
                device: shared.profile.device(signal.device).name.clone(),
                value: reading.usable(),
                unit: signal.unit.0,
                quality: match reading.quality {
                    Quality::Good => "good",
                    Quality::Bad(reason) => reason.code(),
                },
                reason: why.to_string(),
                hint: why.hint.map(Cow::into_owned),
                remedy: match reading.quality {
                    Quality::Good => None,
                    Quality::Bad(reason) => Some(reason.remedy()),
                },
                age_s: (taken > Moment::default() && reading.quality != Quality::Bad(Reason::NeverRead))
                    .then(|| picture.now.since(taken).as_secs_f64()),
            }
        })
        .collect()
}

fn buses(shared: &Shared, picture: &StatusSnapshot) -> Vec<BusStatus> {
    let bounds = || JITTER_MS.iter().copied().chain([f64::INFINITY]);
    let buses = shared.profile.buses.iter().zip(&picture.device_health.buses);
    buses
        .map(|(bus, count)| BusStatus {
            name: bus.name.clone(),
            address: bus.address.clone(),
            connected: count.connected,
            cycles: count.cycles,
            overruns: count.overruns,
            jitter_ms: bounds().zip(count.jitter).collect(),
        })
        .collect()
}

fn devices(shared: &Shared, picture: &StatusSnapshot) -> Vec<DeviceStatus> {
    let devices = shared.profile.devices.iter().zip(&picture.device_health.devices).enumerate();
    devices
        .map(|(place, (device, count))| {
            let changed = picture.devices.changed(DeviceId(place));
            let (state, fault) = match &count.lost {
                Some(lost) if lost.answers_since.is_none() => ("lost", lost.fault.clone()),
                _ if !count.answered => ("never-answered", changed.unwrap_or_default().into()),
                _ => match changed {
                    Some(changed) => ("not-as-expected", changed.into()),
                    None => ("ok", Explained::default()),
                },
            };
            DeviceStatus {
                name: device.name.clone(),
                label: device.label.clone(),
                bus: shared.profile.bus(device.bus).name.clone(),
                unit: device.unit,
                at: device.at(),
                state,
                fault: fault.to_string(),
                hint: fault.hint.map(Cow::into_owned),
                requests: count.requests,
                failures: count.failures.clone(),
            }
        })
        .collect()
}

fn outputs(shared: &Shared, picture: &StatusSnapshot) -> Vec<OutputStatus> {
    let outputs = shared.profile.outputs.iter().zip(picture.outputs.states());
    outputs
        .map(|(output, state)| OutputStatus {
            name: output.name.clone(),
            axis: shared.profile.axis(output.axis).settings.name.clone(),
            device: shared.profile.device(output.device).name.clone(),
            register: output.address.to_string(),
            writes: output.writes.name(),
            state: if picture.arming[output.axis.0].is_armed() { state.standing.name() } else { "off" },
            handshake: state
                .handshake
                .message(output.set.and_then(|id| shared.profile.set(id).handshake.as_ref())),
            value: state.value,
            shares: state.shares.map(|(base, share)| SharesStatus { base, share }),
            applied: state.applied.map(|(value, _)| value),
            note: state.note(picture.now),
            waits_s: state.waits(picture.now).map(|span| span.as_secs_f64()),
            writes_done: state.writes,
            age_s: state.verified_at.map(|at| picture.now.since(at)).as_ref().map(Duration::as_secs_f64),
        })
        .collect()
}
