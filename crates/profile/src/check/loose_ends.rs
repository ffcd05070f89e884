//! What leads nowhere: signals that nobody uses, axes without a model or an output, silent devices.

use std::collections::HashSet;

use super::Check;
use crate::{Device, Output};

impl Check<'_> {
    /// What is there but leads nowhere: a warning, because a profile grows piece by piece.
    pub(super) fn loose_ends(&mut self, devices: &[Option<Device>], outputs: &[Option<Output>]) {
        let raw = self.raw;
        let lacks_model =
            |name: &str| raw.axis.get(name).is_some_and(|axis| axis.model.as_ref().is_none_or(Vec::is_empty));
        let is_unfinished = self.axes.names.iter().any(|name| lacks_model(name));
        for (index, name, path) in self.signals.each() {
            // Which of them a model will use is not known before there is one.
            if !self.used[index] && !is_unfinished {
                let message = format!(
                    "no model, condition, output or machine state uses `{name}`; it is only recorded"
                );
                self.warnings.push(self.places.at_key(&path, message, None));
            }
        }
        let complete = outputs.iter().all(Option::is_some);
        let applied: HashSet<usize> = outputs.iter().flatten().map(|output| output.axis.0).collect();
        for (index, name, path) in self.axes.each() {
            if lacks_model(&name) {
                let message = format!("`{name}` has no model yet: `isotherm run` refuses it");
                let help = "record runs with `isotherm record`, find the model with `isotherm identify`, and put its block here";
                self.warnings.push(self.places.at_key(&path, message, Some(help.to_owned())));
            }
            if complete && !applied.contains(&index) {
                let message =
                    format!("no output writes the Cz of `{name}`; it is computed and shown, never applied");
                self.warnings.push(self.places.at_key(&path, message, None));
            }
        }
        let of_signals = raw.signal.values().filter_map(|signal| signal.device.as_ref());
        let of_outputs = raw.output.values().filter_map(|output| output.device.as_ref());
        let of_heartbeat = raw.heartbeat.iter().filter_map(|heartbeat| heartbeat.device.as_ref());
        let asked: HashSet<&String> = of_signals.chain(of_outputs).chain(of_heartbeat).collect();
        for (index, name, path) in self.devices.each() {
            if !asked.contains(&name) && devices.get(index).is_some_and(Option::is_some) {
                let message = format!("nothing is read from `{name}` and nothing is written to it");
                self.warnings.push(self.places.at_key(&path, message, None));
            }
        }
    }
}
