//! Measured errors on their way to the axes: from a probing cycle, or from a person.

use super::{Core, Shared};
use crate::gateway::probing::{Missed, acting};
use crate::observe::events::Event;
use isotherm_core::compensation::{Measured, Probed, Refused, Snapshot};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{AxisId, BusId, Profile};

impl Core {
    /// Looks for a new result of this axis's probing cycle.
    fn hear_probing(&mut self, profile: &Profile, axis: AxisId, now: Moment) {
        let (place, axis) = (axis.0, profile.axis(axis));
        let Some(input) = &axis.probe_input else { return };
        let acting = acting(profile, place, &self.outputs, &self.arming[place]);
        match self.probing[place].look(profile, input, &self.board, now, acting) {
            Some(Ok(measured)) => self.probing[place].measured = Some(measured),
            Some(Err(missed)) => self.untold.push(Event::ProbeRefused {
                axis: axis.settings.name.clone(),
                error: None,
                why: missed.words().to_owned(),
            }),
            None => {}
        }
    }

    /// What came of what was handed to this step; whether anything was.
    pub(super) fn tell_probings(&mut self, profile: &Profile, now: Moment) -> bool {
        let mut any = false;
        for (place, axis) in profile.axes.iter().enumerate() {
            let control = self.controls[place];
            let decision = self.compensation.decision(place).filter(|decision| decision.at == now);
            let Some(decision) = decision.filter(|_| control.teaches()) else { continue };
            any = true;
            (self.probing[place].measured, self.probing[place].forget) = (None, false);
            let name = || axis.settings.name.clone();
            if control.forget {
                self.untold.push(Event::ProbeForgotten { axis: name() });
            }
            let last = self.compensation.probe(place).and_then(|probe| probe.last());
            let Some(probed) = last.filter(|_| control.measured.is_some()) else { continue };
            let residual = probed.residual.unwrap_or(probed.error);
            if let Some(refused) = probed.refused {
                let why = refused_in_words(profile, place, refused, probed);
                self.untold.push(Event::ProbeRefused { axis: name(), error: Some(probed.error), why });
                continue;
            }
            let correction = decision.correction;
            self.untold.push(Event::Probed { axis: name(), error: probed.error, residual, correction });
            let warn = axis.settings.probe.and_then(|probe| probe.warn);
            if let Some(warn) = warn.filter(|warn| residual.abs() > *warn) {
                self.untold.push(Event::ModelAges { axis: name(), residual, warn });
            }
        }
        any
    }
}

impl Shared {
    /// Looks for new results of the probing cycles that are read on this line.
    pub(in crate::gateway) fn hear_probings(&self, line: BusId, now: Moment) {
        let axes = &self.dependents.probed_on[line.0];
        if axes.is_empty() {
            return;
        }
        let mut core = self.core();
        axes.iter().for_each(|axis| core.hear_probing(&self.profile, *axis, now));
    }

    /// A person's measured error in µm, of the diameter where the axis acts on one; `None` takes back what probings
    /// have taught.
    pub(crate) fn take_measured(&self, axis: &str, error: Option<f64>) -> Result<String, String> {
        let axes = &self.profile.axes;
        let place = axes.iter().position(|known| known.settings.name == axis).ok_or_else(|| {
            let names: Vec<&str> = axes.iter().map(|axis| axis.settings.name.as_str()).collect();
            format!("there is no axis {axis}; there are {}", names.join(", "))
        })?;
        let settings = &axes[place];
        if settings.settings.probe.is_none() {
            return Err(format!(
                "axis {axis} takes no measured errors: its profile has no [axis.{axis}.probe]"
            ));
        }
        let mut core = self.core();
        let answer = match error {
            None => {
                core.probing[place].forget = true;
                core.probing[place].measured = None;
                format!("{axis}: what probings have taught is taken back; Cz goes there step by step")
            }
            Some(_) if core.stopping => return Err("the gateway is stopping".to_owned()),
            Some(error) => {
                let of_radius = if settings.diameter { 0.5 } else { 1.0 };
                let error =
                    Micron::new(error * of_radius).ok_or("a measured error is a finite number, in µm")?;
                let acting = acting(&self.profile, place, &core.outputs, &core.arming[place])
                    .ok_or_else(|| format!("{axis}: {}; measure again when it is", Missed::Acting.words()))?;
                let measured = Measured { error, acting: Some(acting) };
                let now = self.clock.now();
                core.board.look(&self.profile, now);
                let snapshot = Snapshot { now, readings: core.board.seen() };
                if let Err(probed) = core.compensation.would_learn(place, &snapshot, measured) {
                    let why = probed.refused.map(|why| refused_in_words(&self.profile, place, why, &probed));
                    return Err(format!("{axis}: not learned from: {}", why.unwrap_or_default()));
                }
                core.probing[place].measured = Some(measured);
                format!("{axis}: {error} with a Cz of {acting} acting; it is learned from at once")
            }
        };
        drop(core);
        self.ring();
        Ok(answer)
    }
}

/// Why nothing was learned.
pub(in crate::gateway) fn refused_in_words(
    profile: &Profile,
    axis: usize,
    refused: Refused,
    probed: &Probed,
) -> String {
    match refused {
        Refused::NoModel => "no model of the axis can be used now".to_owned(),
        Refused::Tripped => "its model asked for more than the error level and is not believed".to_owned(),
        Refused::Outside => "the inputs lie outside what its model was identified on".to_owned(),
        Refused::Implausible => {
            let settings = &profile.axes[axis].settings;
            let most = settings.probe.map_or(Micron::ZERO, |probe| probe.max_error);
            format!(
                "the model would be wrong by {}, more than the {most} of axis.{}.probe.max_error; measure again",
                probed.residual.unwrap_or_default().abs(),
                settings.name
            )
        }
    }
}
