//! Settings of an output as the profile file states them, without the layers above the file (local file,
//! environment, `--set`). These settings determine how the control interprets the registers of the output.

use serde_json::Value;

use super::writes::{MICRONS, Writes};
use super::{Output, Stated};
use crate::Profile;
use crate::protected_keys::allowed;
use crate::source_map::child;
use isotherm_core::codec::{ControlView, Encoding, Scale};
use isotherm_core::quantity::Micron;

/// Stores at each output the settings that the profile file itself states.
pub(crate) fn by(file: &Value, profile: &mut Profile) {
    let allowed = allowed(file);
    let at = |kind: &str, name: &str, key: &str| {
        let path = child(&child(kind, name), key);
        file.get(kind)?.get(name)?.get(key).filter(|_| !allowed.contains(&path))
    };
    for place in 0..profile.outputs.len() {
        let merged = Stated::of(profile, &profile.outputs[place]);
        let output = &mut profile.outputs[place];
        let axis = &profile.axes[output.axis.0].settings.name;
        let number = |key| at("output", &output.name, key);
        let limit = at("axis", axis, "limit").and_then(Value::as_f64).and_then(Micron::new);
        output.stated = Some(Stated {
            scale: number("scale").and_then(Value::as_f64).map_or(merged.scale, Scale::of),
            bias: number("bias").and_then(Value::as_i64).unwrap_or(merged.bias),
            diameter: at("axis", axis, "diameter").and_then(Value::as_bool).unwrap_or(merged.diameter),
            limit: limit.filter(|limit| *limit < merged.limit).unwrap_or(merged.limit),
        });
    }
}

impl Stated {
    /// Returns the settings of an output in the merged profile, which includes the layers above the file.
    fn of(profile: &Profile, output: &Output) -> Stated {
        let axis = profile.axis(output.axis);
        let Encoding { scale, bias, .. } = output.encoding;
        Stated { scale, bias, diameter: axis.diameter, limit: axis.settings.guard.limit }
    }
}

impl Profile {
    /// Returns how the control converts the registers of this output into a correction. `None` if the output writes the
    /// reference position P0, which is not a correction.
    pub fn control_view(&self, output: &Output) -> Option<ControlView> {
        let Stated { scale, bias, diameter, limit } =
            output.stated.unwrap_or_else(|| Stated::of(self, output));
        let radii = if diameter { 2.0 } else { 1.0 };
        let per_micron = match (output.writes, self.axis(output.axis).settings.intercept_slope) {
            (Writes::Reference, _) => return None,
            (Writes::Slope, Some(line)) => 1.0 / line.reach.get(),
            (Writes::Corrected { .. }, _) => radii / MICRONS,
            _ => radii,
        };
        let encoding = Encoding { scale, bias, ..output.encoding.clone() };
        Some(ControlView { encoding, per_micron, limit })
    }
}
