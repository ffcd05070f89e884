//! Events of one step of the axes: results of probing, signals that are lost or valid again, and changed states of
//! the axes.

use std::time::Duration;

use super::GatewayState;
use crate::gateway::state::probing::why_refused;
use crate::gateway::state::signal_table::QualityChange;
use crate::observe::events::Event;
use isotherm_core::compensation::Snapshot;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;

impl GatewayState {
    /// Reports the probing results that the axes have processed in this step, and the corrections that they
    /// have discarded. Returns whether an axis has done one of the two.
    pub(super) fn report_probings(&mut self, profile: &Profile, now: Moment) -> bool {
        let mut any = false;
        for (place, axis) in profile.axes.iter().enumerate() {
            let control = self.controls[place];
            let decision = self.compensation.decision(place).filter(|decision| decision.at == now);
            let Some(decision) = decision.filter(|_| control.teaches()) else { continue };
            any = true;
            (self.probing[place].measured, self.probing[place].forget) = (None, false);
            let name = || axis.settings.name.clone();
            if control.forget {
                self.events.push(Event::ProbeForgotten { axis: name() });
            }
            let last = self.compensation.probe(place).and_then(|probe| probe.last());
            let Some(probed) = last.filter(|_| control.measured.is_some()) else { continue };
            let residual = probed.residual.unwrap_or(probed.error);
            if let Some(refused) = probed.refused {
                let why = why_refused(profile, place, refused, probed);
                self.events.push(Event::ProbeRefused { axis: name(), error: Some(probed.error), why });
                continue;
            }
            let correction = decision.correction;
            self.events.push(Event::Probed { axis: name(), error: probed.error, residual, correction });
            let warn = axis.settings.probe.and_then(|probe| probe.warn);
            if let Some(warn) = warn.filter(|warn| residual.abs() > *warn) {
                self.events.push(Event::ModelAges { axis: name(), residual, warn });
            }
        }
        any
    }

    /// Reports the changes of the signals once in each period `every`, if the profile has no axis.
    pub(super) fn report_without_axes(&mut self, profile: &Profile, every: Duration, now: Moment) {
        // If time has gone back, the report is due.
        let is_due = self.next_due.is_none_or(|due| now >= due) || now < self.stepped_at;
        if is_due {
            (self.stepped_at, self.next_due) = (now, Some(now.after(every)));
            self.board.check(now);
            self.report_signals(profile, now);
        }
    }

    pub(super) fn report_signals(&mut self, profile: &Profile, now: Moment) {
        let GatewayState { board, device_health, .. } = &mut *self;
        let is_lost = |id: SignalId| device_health.devices[profile.signal(id).device.0].is_reported_lost();
        for change in board.changes(now, is_lost) {
            match change {
                QualityChange::Lost(id, reason) => {
                    let reason = self.device_health.why(id, reason);
                    let signal = profile.signal(id).name.clone();
                    self.events.push(Event::SignalBad { signal, reason });
                }
                QualityChange::Rereferenced(id, from, to) => {
                    let signal = profile.signal(id);
                    let (signal, unit) = (signal.name.clone(), signal.unit.to_string());
                    self.events.push(Event::Rereferenced { signal, unit, from, to });
                }
                QualityChange::ScaleChanged(id, from, to) => {
                    let signal = profile.signal(id);
                    let per_count = |exponent| signal.encoding.scale.times_power_of_ten(exponent).get();
                    let (name, unit) = (signal.name.clone(), signal.unit.to_string());
                    let (from, to) = (per_count(from), per_count(to));
                    self.events.push(Event::ScaleChanged { signal: name, unit, from, to });
                }
                QualityChange::Back(id, since) => {
                    let signal = profile.signal(id).name.clone();
                    self.events.push(Event::SignalGood { signal, bad_for: now.since(since) });
                }
            }
        }
    }

    pub(super) fn report_axes(&mut self, profile: &Profile, now: Moment) {
        let mut events = std::mem::take(&mut self.events);
        let mut reported = std::mem::take(&mut self.reported);
        for (axis, reported) in reported.iter_mut().enumerate().take(profile.compensated()) {
            let Some(decision) = self.compensation.decision(axis) else { continue };
            let settings = &profile.axes[axis].settings;
            let why = || self.why(axis, now);
            let rejected = self.compensation.rejected(axis);
            let contributions =
                || self.compensation.contributions(axis, &Snapshot::new(now, self.board.seen()));
            let why = (why, self.phase.is_stopping());
            reported.report(profile, settings, decision, why, contributions, &mut events);
            reported.report_rejected(profile, settings, decision, rejected, &mut events);
        }
        (self.events, self.reported) = (events, reported);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::gateway::state::dependents::{Dependents, RunConfig};
    use crate::gateway::state::test_profiles::bench;
    use crate::gateway::store::storage::Storage;
    use isotherm_core::compensation::Remembered;
    use isotherm_core::reading::Reason;

    /// Period of the device `module`, and one signal of it.
    const SIGNAL: &str = r#"
        every = "2s"
        [signal.bed]
        device = "module"
        register = "input:0"
        type = "i16"
        unit = "degC"
        max_age = "20s"
    "#;
    const AXIS: &str =
        "[axis.z]\nlimit = 20.0\nstep = 1.0\nrate = 1.0\nevery = \"1s\"\non_fault = { action = \"hold\" }\n";

    fn given(more: &str) -> RunConfig {
        let profile = Arc::new(bench(more));
        let dependents = Arc::new(Dependents::new(&profile));
        RunConfig { profile, dependents, dry_run: false }
    }

    #[test]
    fn without_an_axis_the_changes_of_the_signals_are_reported_once_a_period() {
        let at = |ms: u64| Moment::default().after(Duration::from_millis(1_000_000 + ms));
        let mut core = GatewayState::new(given(SIGNAL), Remembered::default(), Storage::default(), at(0));
        let reported = |core: &mut GatewayState, now: Moment| -> Vec<String> {
            assert!(!core.advance(now), "nothing is decided");
            std::mem::take(&mut core.events).iter().map(|event| event.entry(now).kind.to_string()).collect()
        };
        core.board.store(SignalId(0), Ok(20.0), at(0), 0);
        assert_eq!(reported(&mut core, at(0)), [""; 0]);
        core.board.store(SignalId(0), Err(Reason::OpenCircuit), at(500), 0);
        assert_eq!(reported(&mut core, at(1999)), [""; 0], "not due yet");
        assert_eq!(reported(&mut core, at(2000)), ["signal-bad"]);
        assert_eq!((reported(&mut core, at(4000)), core.next_due), (Vec::new(), Some(at(6000))));
        core.board.store(SignalId(0), Ok(20.0), at(5000), 0);
        assert_eq!(reported(&mut core, at(6100)), ["signal-good"]);
        assert_eq!(reported(&mut core, at(27_000)), ["signal-bad"], "it is stale");
    }

    #[test]
    fn the_period_of_the_reports_is_that_of_the_most_frequent_device_and_only_without_an_axis() {
        let period = |more: &str| given(more).dependents.reports_every;
        assert_eq!(period(SIGNAL), Some(Duration::from_secs(2)));
        assert_eq!(period(&SIGNAL.replace("\"2s\"", "\"100ms\"")), Some(Duration::from_secs(1)));
        assert_eq!(period(&format!("{SIGNAL}{AXIS}")), None);
    }
}
