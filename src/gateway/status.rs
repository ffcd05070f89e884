//! The state of the gateway as people and programs see it.

use std::time::Duration;

use super::extrapolation;
use super::shared::{Core, JITTER_MS, Shared, refused_in_words};
use crate::observe::status::{
    AxisStatus, BusStatus, Command, DeviceStatus, GainStatus, OutputStatus, ProbeStatus, ProbedStatus,
    SharesStatus, SignalStatus, Source, Status,
};
use isotherm_core::compensation::Stages;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::{Quality, Reason, SignalId};

impl Source for Shared {
    fn status(&self) -> Status {
        let now = self.clock.now();
        let (events, event_counts) = self.journal.read();
        let mut core = self.core();
        core.board.look(&self.profile, now);
        let machine_on = core.compensation.machine().on_time(now);
        let (axes, devices) = (axes(self, &core, now), devices(self, &core));
        Status {
            machine: self.profile.name.clone(),
            description: self.profile.description.clone(),
            version: env!("CARGO_PKG_VERSION"),
            now: now.to_string(),
            uptime_s: now.since(self.started).as_secs_f64(),
            machine_on_s: machine_on.map(|span| span.as_secs_f64()),
            dry_run: self.dry_run,
            ready: core.devices.iter().all(|device| device.answered)
                && core.compensation.decisions().all(|decision| decision.at > Moment::default()),
            axes,
            signals: signals(self, &core, now),
            buses: buses(self, &core),
            devices,
            outputs: outputs(self, &core, now),
            events,
            log_dropped: core.keeper.dropped(),
            event_counts,
        }
    }

    fn command(&self, command: Command) -> Result<String, String> {
        self.obey(command)
    }

    fn arming(&self) -> Option<Result<String, String>> {
        Shared::arming(self)
    }

    fn measured(&self, axis: &str, error_um: Option<f64>) -> Result<String, String> {
        self.take_measured(axis, error_um)
    }
}

/// Cz as last verified in the first register of an axis that holds it, and when that was asked.
fn verified(shared: &Shared, core: &Core, axis: usize) -> Option<(Micron, Moment)> {
    let mut outputs = core.outputs.of_axis(&shared.profile, axis).filter(|(output, _)| output.writes.is_cz());
    outputs.find_map(|(_, state)| state.cz.zip(state.verified_at))
}

fn axes(shared: &Shared, core: &Core, now: Moment) -> Vec<AxisStatus> {
    let axes = shared.profile.axes.iter().zip(core.compensation.decisions()).enumerate();
    axes.map(|(place, (axis, decision))| AxisStatus {
        name: axis.settings.name.clone(),
        state: decision.state.name(),
        why: core.why(shared, place),
        model: decision
            .model
            .and_then(|model| axis.settings.models.get(model))
            .map(|model| model.name.clone()),
        raw_um: decision.raw.map(Micron::get),
        cz_um: decision.cz.get(),
        verified_um: verified(shared, core, place).map(|(cz, _)| cz.get()),
        verified_age_s: verified(shared, core, place).map(|(_, at)| now.since(at).as_secs_f64()),
        acted: Stages::ALL
            .iter()
            .filter(|(stage, _)| decision.acted.contains(*stage))
            .map(|(_, name)| *name)
            .collect(),
        limit_um: axis.settings.guard.limit.get(),
        warn_um: axis.settings.levels.warn.map(Micron::get),
        warned: core.levels[place].is_warned(),
        error_um: axis.settings.levels.error.map(Micron::get),
        tripped: decision.tripped,
        armed: core.arming[place].armed,
        probe: probe(shared, core, place),
        extrapolating: decision
            .extrapolating
            .as_ref()
            .map(|found| extrapolation::status(&shared.profile, found)),
        excess: decision.excess,
    })
    .collect()
}

fn probe(shared: &Shared, core: &Core, place: usize) -> Option<ProbeStatus> {
    let settings = &shared.profile.axes[place].settings;
    let (bounds, probe) = settings.probe.zip(core.compensation.probe(place))?;
    let decision = core.compensation.decision(place);
    Some(ProbeStatus {
        correction_um: decision.map_or(0.0, |decision| decision.correction.get()),
        limit_um: bounds.limit.get(),
        warn_um: bounds.warn.map(Micron::get),
        max_error_um: bounds.max_error.get(),
        last: probe.last().map(|last| ProbedStatus {
            at: last.at.to_string(),
            error_um: last.error.get(),
            acting_um: last.acting.get(),
            residual_um: last.residual.map(Micron::get),
            refused: last.refused.map(|why| refused_in_words(&shared.profile, place, why, last)),
        }),
        history: probe.history().map(|entry| (entry.at.to_string(), entry.residual.get())).collect(),
        gains: (settings.models.iter().enumerate())
            .flat_map(|(place, model)| {
                model.gained().zip(probe.gains(place)).map(|(term, change)| GainStatus {
                    model: model.name.clone(),
                    signal: shared.profile.signal(term.signal).name.clone(),
                    change: *change,
                })
            })
            .collect(),
    })
}

fn signals(shared: &Shared, core: &Core, now: Moment) -> Vec<SignalStatus> {
    let seen = core.board.seen();
    let signals = shared.profile.signals.iter().enumerate().zip(seen);
    signals
        .map(|((place, signal), reading)| {
            let taken = core.board.taken(SignalId(place));
            SignalStatus {
                name: signal.name.clone(),
                device: shared.profile.device(signal.device).name.clone(),
                value: reading.usable(),
                unit: signal.unit.0,
                quality: match reading.quality {
                    Quality::Good => "good",
                    Quality::Bad(reason) => reason.code(),
                },
                reason: match reading.quality {
                    Quality::Good => String::new(),
                    Quality::Bad(reason) => reason.to_string(),
                },
                age_s: (taken > Moment::default() && reading.quality != Quality::Bad(Reason::NeverRead))
                    .then(|| now.since(taken).as_secs_f64()),
            }
        })
        .collect()
}

fn buses(shared: &Shared, core: &Core) -> Vec<BusStatus> {
    let bounds = || JITTER_MS.iter().copied().chain([f64::INFINITY]);
    let buses = shared.profile.buses.iter().zip(&core.buses);
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

fn devices(shared: &Shared, core: &Core) -> Vec<DeviceStatus> {
    let devices = shared.profile.devices.iter().zip(&core.devices).enumerate();
    devices
        .map(|(place, (device, count))| DeviceStatus {
            name: device.name.clone(),
            bus: shared.profile.bus(device.bus).name.clone(),
            unit: device.unit,
            at: device.at(),
            state: match (&count.lost, count.answered) {
                (Some(lost), _) if lost.answers_since.is_none() => "lost",
                (_, false) => "never-answered",
                (_, true) if core.commissioning.wrong(place).is_some() => "not-as-expected",
                (_, true) => "ok",
            },
            fault: count
                .lost
                .as_ref()
                .filter(|lost| lost.answers_since.is_none())
                .map(|lost| lost.fault.clone())
                .or_else(|| core.commissioning.wrong(place).map(str::to_owned))
                .unwrap_or_default(),
            requests: count.requests,
            failures: count.failures.clone(),
        })
        .collect()
}

fn outputs(shared: &Shared, core: &Core, now: Moment) -> Vec<OutputStatus> {
    let outputs = shared.profile.outputs.iter().zip(core.outputs.states());
    outputs
        .map(|(output, state)| OutputStatus {
            name: output.name.clone(),
            axis: shared.profile.axis(output.axis).settings.name.clone(),
            device: shared.profile.device(output.device).name.clone(),
            register: output.address.to_string(),
            writes: output.writes.name(),
            state: if core.arming[output.axis.0].armed { state.standing.name() } else { "off" },
            handshake: state.handshake.words(output.set.and_then(|id| shared.profile.set(id).handshake)),
            value: state.value,
            shares: state.shares.map(|(base, share)| SharesStatus { base, share }),
            applied: state.applied.map(|(value, _)| value),
            note: state.note(now),
            waits_s: state.waits(now).map(|span| span.as_secs_f64()),
            writes_done: state.writes,
            age_s: state.verified_at.map(|at| now.since(at)).as_ref().map(Duration::as_secs_f64),
        })
        .collect()
}
