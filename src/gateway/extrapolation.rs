//! "Extrapolating" in words and numbers, with the names of the profile.

use crate::compensation::Extrapolation;
use crate::compensation::model::Outside;
use crate::observe::status::ExtrapolationStatus;
use crate::profile::Profile;

/// By how much, in which input, and what the axis does.
pub(super) fn words(profile: &Profile, found: &Extrapolation) -> String {
    let farthest = found.farthest.map(|beyond| {
        let signal = profile.signal(beyond.signal);
        let (side, by) = if beyond.by < 0.0 {
            ("below its smallest", -beyond.by)
        } else {
            ("above its largest", beyond.by)
        };
        format!("{} is {by:.2} {} {side} value", signal.name, signal.unit)
    });
    let farthest = farthest.unwrap_or_else(|| "the inputs never stood like this to each other".to_owned());
    let Some((distance, reach)) = found.distance else {
        return format!("extrapolating: {farthest} of the guideway; Cz is that of its end");
    };
    let does = match found.outside {
        Outside::Warn => "Cz follows the model all the same".to_owned(),
        Outside::Hold => "Cz is kept".to_owned(),
        Outside::Shrink => format!("Cz is the model's times {:.2}", found.gain),
    };
    format!("extrapolating: {farthest}; distance {distance:.1}, {reach:.1} is the edge; {does}")
}

/// The same for programs.
pub(super) fn status(profile: &Profile, found: &Extrapolation) -> ExtrapolationStatus {
    ExtrapolationStatus {
        distance: found.distance.map(|(distance, _)| distance),
        reach: found.distance.map(|(_, reach)| reach),
        signal: found.farthest.map(|beyond| profile.signal(beyond.signal).name.clone()),
        beyond: found.farthest.map(|beyond| beyond.by),
        outside: match found.outside {
            Outside::Warn => "warn",
            Outside::Hold => "hold",
            Outside::Shrink => "shrink",
        },
        gain: found.gain,
        text: words(profile, found),
    }
}
