//! What a measured error may change, and where it is read.

use super::{Check, Signals};
use crate::ProbeInput;
use crate::place::child;
use crate::raw::{ModelKind, RawAxis, RawGains, RawProbe};
use isotherm_core::compensation::settings::{GainSettings, ProbeSettings};
use isotherm_core::quantity::Micron;
use isotherm_core::reading::SignalId;

impl Check<'_> {
    /// The bounds and the input of an axis's probe. `None`: something about them is wrong; `Some(None)`: it has none.
    pub(super) fn probe(
        &mut self,
        path: &str,
        axis: &RawAxis,
        signals: &Signals,
    ) -> Option<Option<(ProbeSettings, Option<ProbeInput>)>> {
        let Some(raw) = &axis.probe else { return Some(None) };
        let path = child(path, "probe");
        let limit = self.positive(&child(&path, "limit"), raw.limit);
        if let (Some(limit), Some(most)) = (limit, axis.limit.filter(|most| *most > 0.0))
            && limit > most
        {
            let message = format!("a correction of {limit} µm is larger than the axis's limit of {most} µm");
            self.wrong(
                &child(&path, "limit"),
                message,
                "make it smaller: it trims the model, it does not replace it",
            );
        }
        let filter = self.fraction(&child(&path, "filter"), raw.filter);
        let max_error = self.positive(&child(&path, "max_error"), raw.max_error);
        let warn = match raw.warn {
            Some(_) => self.positive(&child(&path, "warn"), raw.warn).map(Micron::new),
            None => Some(None),
        };
        if let (Some(warn), Some(most)) = (raw.warn, max_error)
            && warn > most
        {
            let message = format!("warn at {warn} µm lies beyond the max_error of {most} µm");
            self.wrong(&child(&path, "warn"), message, "such a probing is refused: make `warn` smaller");
        }
        let gains = match &raw.gains {
            Some(gains) => self.gains(&child(&path, "gains"), gains, axis).map(Some),
            None => Some(None),
        };
        let input = self.probe_input(&path, raw, signals, axis.diameter.unwrap_or(false));
        let settings = ProbeSettings {
            limit: Micron::new(limit?)?,
            filter: filter?,
            max_error: Micron::new(max_error?)?,
            warn: warn?,
            gains: gains?,
        };
        Some(Some((settings, input?)))
    }

    fn gains(&mut self, path: &str, raw: &RawGains, axis: &RawAxis) -> Option<GainSettings> {
        let linear = |kind: Option<ModelKind>| kind.is_none_or(|kind| kind == ModelKind::Linear);
        let models = axis.model.as_deref().unwrap_or_default();
        if !models.is_empty() && !models.iter().any(|model| linear(model.kind)) {
            let help = "remove `gains`: only the gains of linear models learn";
            self.wrong_key(path, "no model of this axis is linear", help);
        }
        let limit = self.positive(&child(path, "limit"), raw.limit);
        if let Some(limit) = limit.filter(|limit| *limit >= 1.0) {
            let help = "write a share below 1, as 0.2: a gain never changes its sign";
            self.wrong(&child(path, "limit"), format!("{limit} would let a gain vanish"), help);
        }
        let forgetting = self.fraction(&child(path, "forgetting"), raw.forgetting);
        Some(GainSettings { forgetting: forgetting?, limit: limit? })
    }

    fn fraction(&mut self, path: &str, number: Option<f64>) -> Option<f64> {
        let number = number?;
        if number > 0.0 && number <= 1.0 {
            return Some(number);
        }
        self.wrong(path, format!("{number} is no share"), "write a number above 0 and up to 1");
        None
    }

    fn probe_input(
        &mut self,
        path: &str,
        raw: &RawProbe,
        signals: &Signals,
        diameter: bool,
    ) -> Option<Option<ProbeInput>> {
        let (at, at_trigger) = (child(path, "signal"), child(path, "trigger"));
        let signal = raw.signal.as_ref().map(|name| (name, self.signal(&at, name)));
        let trigger = raw.trigger.as_ref().map(|name| self.signal(&at_trigger, name));
        let Some((name, signal)) = signal else {
            if trigger.is_some() {
                let help = "write `signal`, where the measured error is read, or remove `trigger`";
                self.missing(path, "signal", "`signal` is missing: a trigger alone tells no error", help);
            }
            return Some(None);
        };
        let signal = signal?;
        let trigger = match trigger {
            Some(found) => Some(found?),
            None => None,
        };
        if trigger == Some(signal) {
            let help = "remove `trigger`: each change of the error counts then; or name a flag or a counter";
            self.wrong(&at_trigger, "the error cannot be its own trigger", help);
        }
        let of_radius = if diameter { 0.5 } else { 1.0 };
        let micron = of_radius * self.micron_per_unit(&at, name, signal, signals)?;
        Some(Some(ProbeInput { signal, trigger, micron }))
    }

    fn micron_per_unit(
        &mut self,
        path: &str,
        name: &str,
        signal: SignalId,
        signals: &Signals,
    ) -> Option<f64> {
        match super::get(signals, signal.0)?.unit.0 {
            "um" => Some(1.0),
            "mm" => Some(1000.0),
            unit => {
                let help = format!(
                    "give the signal unit = \"um\" or \"mm\", with the `scale` that makes it so: signal.{name}"
                );
                self.wrong(path, format!("`{name}` is in {unit}, not in um or mm"), help);
                None
            }
        }
    }
}
