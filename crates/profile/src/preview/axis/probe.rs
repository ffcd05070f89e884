//! A probe in words: where errors come from, what they may change.

use crate::{Axis, Profile};
use isotherm_core::compensation::settings::ProbeSettings;

/// Where measured errors come from, their sign, and their bounds.
pub(super) fn probe(profile: &Profile, axis: &Axis, settings: &ProbeSettings) -> String {
    let name = |id| &profile.signal(id).name;
    let from = match &axis.probe_input {
        Some(input) => match input.trigger {
            Some(trigger) => {
                format!("{}, each time {} changes to anything but 0", name(input.signal), name(trigger))
            }
            None => format!("{}, each time it changes", name(input.signal)),
        },
        None => "commands".to_owned(),
    };
    let diameter = if axis.diameter { ", on the diameter" } else { "" };
    let mut words = format!(
        "measured errors (actual minus commanded{diameter}, with Cz acting) come from {from}; a positive one lowers the \
         model's Cz by {} of it, in all by at most {} µm; one by which the model would be wrong by more than {} µm is refused",
        settings.filter,
        settings.limit.get(),
        settings.max_error.get()
    );
    if let Some(warn) = settings.warn {
        words.push_str(&format!("; beyond ±{} µm it warns", warn.get()));
    }
    if let Some(gains) = settings.gains {
        let percent = 100.0 * gains.limit;
        words.push_str(&format!("; the gains of linear models learn by up to ±{percent:.3} % each"));
    }
    words
}
