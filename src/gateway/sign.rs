//! What is known of the sign of an axis: a check with a dial gauge that is under way, and what was answered before.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::observe::asker::Asker;
use crate::observe::status::{Moved, SignStatus};
use isotherm_core::compensation::settings::GuardSettings;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Profile, Writes};

/// So far, µm: a dial gauge shows it without a doubt, and no workpiece is lost by it.
pub(super) const WAY: f64 = 5.0;
/// A person looks and answers within this, once the offset is there; then it is taken back.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// A check under way.
#[derive(Clone, Debug)]
pub(super) struct SignCheck {
    pub(super) by: Arc<Asker>,
    pub(super) from: Micron,
    /// Where Cz is taken.
    pub(super) to: Micron,
    /// Taken back then.
    pub(super) until: Moment,
    pub(super) is_there: bool,
}

/// What is known of an axis's sign; kept with the state.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SignMemory {
    /// A person was reminded that there was no check yet.
    #[serde(default)]
    reminded: bool,
    /// When the last check was answered, and how.
    pub(super) checked: Option<(String, Moved)>,
}

impl SignMemory {
    /// Whether a person is to be reminded now: once, where there was no check.
    pub(super) fn reminds(&mut self) -> bool {
        self.checked.is_none() && !std::mem::replace(&mut self.reminded, true)
    }
}

impl SignCheck {
    /// What of it people see.
    pub(super) fn status(&self, profile: &Profile, axis: usize, now: Moment) -> SignStatus {
        SignStatus {
            asked: self.by.way.by(&self.by.who),
            by_um: (self.to - self.from).get(),
            there: self.is_there,
            expires_s: self.until.since(now).as_secs_f64(),
            must: must(profile, axis, self.to - self.from),
        }
    }
}

/// Which way a gauge, or the readout, must have moved.
pub(super) fn must(profile: &Profile, axis: usize, way: Micron) -> String {
    let axis_name = &profile.axes[axis].settings.name;
    let of_axis = || profile.outputs.iter().filter(|output| output.axis.0 == axis);
    let mut texts = Vec::new();
    if of_axis().any(|output| matches!(output.writes, Writes::Offset | Writes::Intercept)) {
        let (way, um) = if way < Micron::ZERO { ("minus", way.abs()) } else { ("plus", way) };
        texts.push(format!("the tool must have moved by {um} to {way} of {axis_name}, seen from the work"));
    }
    if of_axis().any(|output| matches!(output.writes, Writes::Corrected { .. })) {
        let mm = way.get() / 1000.0;
        texts.push(format!("the readout of {axis_name} must show {mm:+.3} mm, with the machine at rest"));
    }
    texts.join("; ")
}

/// Why the way cannot be gone, whatever the axis does now.
pub(super) fn refused(guard: &GuardSettings, from: Micron, axis: &str) -> Option<String> {
    let beyond = (from.get() + WAY).abs() > guard.limit.get();
    if beyond {
        let limit = guard.limit;
        return Some(format!(
            "Cz stands at {from}, and +{WAY} µm would be beyond axis.{axis}.limit of {limit}"
        ));
    }
    let grain = guard.deadband.get().max(guard.count.map_or(0.0, Micron::get));
    (grain > WAY / 2.0).then(|| {
        format!(
            "axis.{axis}.deadband, or one count of its register, is {grain} µm: +{WAY} µm would not be made"
        )
    })
}

/// Cz is as near to it as the guard takes it.
pub(super) fn is_at(guard: &GuardSettings, cz: Micron, place: Micron) -> bool {
    let grain = guard.deadband.get().max(guard.count.map_or(0.0, Micron::get));
    (cz - place).abs().get() <= grain * 1.001 + 1e-6
}
