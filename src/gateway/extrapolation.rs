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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compensation::model::Beyond;
    use crate::gateway::log::sample;
    use crate::reading::SignalId;

    #[test]
    fn how_far_outside_and_what_follows_is_a_sentence() {
        let profile = sample::profile();
        let beyond = |by| Some(Beyond { signal: SignalId(0), by });
        let found =
            |farthest, outside, gain| Extrapolation { distance: Some((4.21, 3.04)), farthest, outside, gain };
        for (found, expected) in [
            (
                found(beyond(2.3), Outside::Hold, 1.0),
                "extrapolating: bed is 2.30 °C above its largest value; distance 4.2, 3.0 is the edge; Cz is kept",
            ),
            (
                found(beyond(-0.5), Outside::Shrink, 0.43),
                "extrapolating: bed is 0.50 °C below its smallest value; distance 4.2, 3.0 is the edge; \
                 Cz is the model's times 0.43",
            ),
            (
                found(None, Outside::Warn, 1.0),
                "extrapolating: the inputs never stood like this to each other; distance 4.2, 3.0 is the edge; \
                 Cz follows the model all the same",
            ),
            (
                Extrapolation { distance: None, ..found(beyond(35.0), Outside::Warn, 1.0) },
                "extrapolating: bed is 35.00 °C above its largest value of the guideway; Cz is that of its end",
            ),
        ] {
            assert_eq!(words(&profile, &found), expected);
            assert_eq!(status(&profile, &found).text, expected);
        }
    }
}
