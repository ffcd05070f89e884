//! Events of one step of the axes: results of probing, signals that were lost or are valid again, and states of the
//! axes.

use super::GatewayState;
use crate::gateway::state::probing::why_refused;
use crate::gateway::state::signal_table::QualityChange;
use crate::observe::events::Event;
use isotherm_core::compensation::Snapshot;
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

impl GatewayState {
    /// Reports the results of probing that the axes have processed in this step. Returns whether there was a result.
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

    pub(super) fn report_signals(&mut self, profile: &Profile, now: Moment) {
        for change in self.board.changes(now) {
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
