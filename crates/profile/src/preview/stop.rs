//! Preview of a stop of the gateway: its effect on the registers, and its longest duration.

use std::time::Duration;

use crate::document::{Section, entries};
use crate::wording::duration_text;
use crate::{OnStop, Profile, stop};

pub(super) fn preview(profile: &Profile) -> Section {
    let mut section = Section::default();
    let whole =
        |span: Duration| Duration::from_secs(span.saturating_add(Duration::from_millis(999)).as_secs());
    let (does, longest, late) = match profile.on_stop {
        OnStop::FaultAction => {
            ("the fault actions run, without their waiting time", stop::longest(profile), stop::late(profile))
        }
        OnStop::Hold => ("the registers keep their values", stop::hold(profile), None),
    };
    let (longest, late) = (whole(longest), late.map(whole));
    let after = late.map_or(String::new(), |late| {
        format!(", and {} more if a write without an answer may still arrive", duration_text(late))
    });
    let last = match (&profile.mqtt, profile.notify.is_empty()) {
        (Some(_), true) => "the broker has the last state",
        (Some(_), false) => "the broker has the last state and the last messages are posted",
        (None, _) => "the last messages are posted",
    };
    let told = stop::told(profile);
    let until =
        told.map_or(String::new(), |span| format!(", then at most {} until {last}", duration_text(span)));
    section.line("stop");
    section.line(format!("  {does}: at most {}{after}{until}", duration_text(longest)));
    entries!(section, on_stop = profile.on_stop, longest_s = longest.as_secs());
    entries!(section, late_s = late.map(|late| late.as_secs()));
    if let Some(span) = told {
        section.entry("told_s", span.as_secs());
    }
    section
}
