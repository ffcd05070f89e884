//! What leads nowhere: signals that nobody uses, axes without a model or an output, silent devices. A warning, because a
//! profile grows piece by piece.

use std::collections::HashSet;

use super::Check;

pub(super) fn warn(check: &Check<'_>) {
    let raw = check.raw;
    let lacks_model =
        |name: &String| raw.axis.get(name).is_some_and(|axis| axis.model.as_ref().is_none_or(Vec::is_empty));
    // Which signals a model will use is not known before there is one.
    if !check.axes.names.iter().any(lacks_model) {
        let names = check.signals.names.iter().zip(check.used.borrow().clone());
        for (name, _) in names.filter(|(_, is_used)| !is_used) {
            let message =
                format!("no model, condition, output or machine state uses `{name}`; it is only recorded");
            check.at("signal").key(name).warn_key(message, None);
        }
    }
    let is_complete = check.outputs.resolved.iter().all(Option::is_some);
    let written: HashSet<usize> = check.outputs.right().map(|output| output.axis.0).collect();
    for (index, name) in check.axes.names.iter().enumerate() {
        let at = check.at("axis").key(name);
        if lacks_model(name) {
            let message = format!("`{name}` has no model yet: `isotherm run` refuses it");
            let help = "record runs with `isotherm record`, find the model with `isotherm identify`, and put its block here";
            at.warn_key(message, Some(help));
        }
        if is_complete && !written.contains(&index) {
            let message =
                format!("no output writes the Cz of `{name}`; it is computed and shown, never applied");
            at.warn_key(message, None);
        }
    }
    let of_signals = raw.signal.values().filter_map(|signal| signal.device.as_ref());
    let of_outputs = raw.output.values().filter_map(|output| output.device.as_ref());
    let of_heartbeat = raw.heartbeat.iter().filter_map(|heartbeat| heartbeat.device.as_ref());
    let asked: HashSet<&String> = of_signals.chain(of_outputs).chain(of_heartbeat).collect();
    for (index, name) in check.devices.names.iter().enumerate() {
        if !asked.contains(name) && check.devices.get(index).is_some() {
            let message = format!("nothing is read from `{name}` and nothing is written to it");
            check.at("device").key(name).warn_key(message, None);
        }
    }
}
