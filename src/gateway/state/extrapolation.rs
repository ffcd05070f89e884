//! Reports about models that extrapolate: an input is outside the region of the data from which the model was
//! identified.

use crate::observe::events::Event;
use crate::observe::status::ExtrapolationStatus;
use isotherm_core::compensation::model::Outside;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{CLEARLY_INSIDE, Decision, Extrapolation};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Micron;
use isotherm_profile::{Profile, Unit};

/// Hint for inputs outside the region of a model.
const MEASURE: &str =
    "measure a part; if such conditions are usual, identify the model again with data that include them";

/// Returns a text about an extrapolation: the input that is outside, the distance from its range, and the reaction of
/// the axis.
fn message(profile: &Profile, found: &Extrapolation) -> String {
    let farthest = farthest(profile, found, |by, unit| format!("is {by:.2} {unit} "));
    let Some((distance, reach)) = found.distance else {
        return format!(
            "extrapolating: {farthest} of the guideway; Cz is the value at the end of the guideway"
        );
    };
    let does = match found.outside {
        Outside::Warn => "Cz still follows the model".to_owned(),
        Outside::Hold => "Cz does not change".to_owned(),
        Outside::Shrink => format!("Cz is the value of the model times {:.2}", found.gain),
        Outside::Agree => {
            let (apart, share) = (found.apart.unwrap_or_default().abs().get(), found.gain * 100.0);
            format!("the two halves of the model differ by {apart:.1} µm: {share:.0} % of its Cz is used")
        }
    };
    format!("extrapolating: {farthest}; distance {distance:.1}, the limit is {reach:.1}; {does}")
}

/// Returns cause and hint of an extrapolation. The texts contain no figures, because the figures change all the time.
pub(super) fn cause(profile: &Profile, found: &Extrapolation) -> Explained {
    let farthest = farthest(profile, found, |_, _| "is ".to_owned());
    Explained::new(format!("extrapolating: {farthest}"), MEASURE)
}

/// Returns the text of the alarm: how the extrapolation began, what the axis does, and what ends the alarm. The text
/// contains no figures that change, because an alarm may last for days. `has_envelope`: whether the model has an
/// envelope (region of its inputs). A model with a guideway may have an envelope, too.
fn alarm(profile: &Profile, found: &Extrapolation, has_envelope: bool) -> String {
    let farthest = farthest(profile, found, |_, _| "was ".to_owned());
    let is_guideway = found.distance.is_none();
    let does = match found.outside {
        _ if is_guideway => "Cz is the value at the end of the guideway",
        Outside::Warn => "Cz still follows the model",
        Outside::Hold => "Cz does not change",
        Outside::Shrink => "Cz is smaller than the value of the model",
        Outside::Agree => "Cz follows the model as far as its two halves agree",
    };
    let share = -100.0 * CLEARLY_INSIDE;
    let inputs = format!(
        "every input is inside its range by {share:.0} % of the range, and their combination as well"
    );
    let ends = match (is_guideway, has_envelope) {
        (false, _) => inputs,
        (true, false) => format!("the position is inside the guideway by {share:.0} % of its length"),
        (true, true) => format!("the position is inside the guideway, and {inputs}"),
    };
    format!("extrapolating, which began because {farthest}; {does}; the alarm ends when {ends}")
}

/// Returns a text about the input that is farthest outside its range. `by` formats a verb, the distance and its unit.
fn farthest(profile: &Profile, found: &Extrapolation, by: impl Fn(f64, Unit) -> String) -> String {
    let Some(beyond) = found.farthest else {
        return "the model was not identified with this combination of inputs".to_owned();
    };
    let signal = profile.signal(beyond.signal);
    let side = if beyond.by < 0.0 { "below its smallest" } else { "above its largest" };
    format!("{} {}{side} value", signal.name, by(beyond.by.abs(), signal.unit))
}

/// Returns an event when extrapolation begins, and another event when it is over. Extrapolation is over when all
/// inputs are clearly inside the region of the model again, or when the model in use has no region. While no model
/// can be used, the state is not known, and the function returns `None`.
pub(super) fn event(
    profile: &Profile,
    axis: &AxisSettings,
    decision: &Decision,
    reported: &mut bool,
) -> Option<Event> {
    let name = || axis.name.clone();
    match &decision.extrapolating {
        Some(found) if !*reported => {
            *reported = true;
            let model = decision.model.and_then(|place| axis.models.get(place));
            let has_envelope = model.is_some_and(|model| model.envelope.is_some());
            let how = Explained::new(alarm(profile, found, has_envelope), MEASURE);
            Some(Event::Extrapolating { axis: name(), how })
        }
        None if *reported
            && decision.model.is_some()
            && decision.excess.is_none_or(|excess| excess < CLEARLY_INSIDE) =>
        {
            *reported = false;
            Some(Event::Interpolating { axis: name() })
        }
        _ => None,
    }
}

/// Returns the status of an extrapolation, for programs.
pub(in crate::gateway) fn status(profile: &Profile, found: &Extrapolation) -> ExtrapolationStatus {
    ExtrapolationStatus {
        distance: found.distance.map(|(distance, _)| distance),
        reach: found.distance.map(|(_, reach)| reach),
        signal: found.farthest.map(|beyond| profile.signal(beyond.signal).name.clone()),
        beyond: found.farthest.map(|beyond| beyond.by),
        outside: match found.outside {
            Outside::Warn => "warn",
            Outside::Hold => "hold",
            Outside::Shrink => "shrink",
            Outside::Agree => "agree",
        },
        gain: found.gain,
        apart_um: found.apart.map(Micron::get),
        text: message(profile, found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    use crate::gateway::store::log::sample;
    use isotherm_core::compensation::model::envelope::Identified;
    use isotherm_core::compensation::model::{Beyond, Envelope, Input, Reference};
    use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
    use isotherm_core::quantity::{Celsius, Moment};
    use isotherm_core::reading::{Reading, SignalId};

    /// Events of a test rig whose model was identified with a bed of 18 to 28 °C, for these bed temperatures.
    fn at_the_edge(beds: &[f64]) -> Vec<std::borrow::Cow<'static, str>> {
        let mut profile = sample::profile();
        let input = Input::of(SignalId(0), Reference::Fixed(Celsius::ZERO), None);
        let known = Identified { input, mean: 23.0, range: (18.0, 28.0) };
        let settings = &mut profile.axes[0].settings;
        settings.models[0].envelope = Envelope::new(vec![known], &[vec![9.0]], None, Outside::Warn).ok();
        let axes = vec![settings.clone()];
        let mut compensation = Compensation::new(profile.machine.clone(), axes, Remembered::default());
        let control = [Control { permit: Permit::Armed, ..Control::default() }];
        let (mut now, mut reported, mut events) = (Moment::from_nanos(0), false, Vec::new());
        for bed in beds {
            now = now.after(Duration::from_secs(10));
            let good = |value: f64| if value.is_nan() { Reading::NEVER } else { Reading::good(value, now) };
            let readings = [*bed, 24.0, 1.0, 0.0].map(good);
            compensation.step(&Snapshot::new(now, &readings), &control);
            let decision = compensation.decision(0).unwrap();
            events.extend(
                event(&profile, &profile.axes[0].settings, decision, &mut reported)
                    .map(|event| event.entry(now).kind),
            );
        }
        events
    }

    #[test]
    fn what_trembles_at_the_edge_is_reported_once_and_ends_clearly_inside() {
        let trembling: Vec<f64> = (0..100).map(|row| if row % 2 == 0 { 28.05 } else { 27.95 }).collect();
        assert_eq!(at_the_edge(&trembling), ["extrapolating"]);
        assert_eq!(
            at_the_edge(&[28.1, 27.6, 27.4, 27.6, 28.1]),
            ["extrapolating", "interpolating", "extrapolating"]
        );
        assert_eq!(at_the_edge(&[28.1, f64::NAN, 28.1]), ["extrapolating"], "a broken sensor ends nothing");
        assert_eq!(at_the_edge(&[27.9, 23.0]), [""; 0]);
    }

    #[test]
    fn how_far_outside_and_what_follows_is_a_sentence() {
        let profile = sample::profile();
        let beyond = |by| Some(Beyond { signal: SignalId(0), by });
        let found = |farthest, outside, gain| Extrapolation {
            distance: Some((4.21, 3.04)),
            farthest,
            outside,
            gain,
            apart: Micron::new(-4.13),
        };
        for (found, expected) in [
            (
                found(beyond(2.3), Outside::Hold, 1.0),
                "extrapolating: bed is 2.30 °C above its largest value; distance 4.2, the limit is 3.0; Cz \
                 does not change",
            ),
            (
                found(beyond(-0.5), Outside::Shrink, 0.43),
                "extrapolating: bed is 0.50 °C below its smallest value; distance 4.2, the limit is 3.0; Cz \
                 is the value of the model times 0.43",
            ),
            (
                found(None, Outside::Warn, 1.0),
                "extrapolating: the model was not identified with this combination of inputs; distance 4.2, \
                 the limit is 3.0; Cz still follows the model",
            ),
            (
                found(beyond(2.3), Outside::Agree, 0.612),
                "extrapolating: bed is 2.30 °C above its largest value; distance 4.2, the limit is 3.0; the \
                 two halves of the model differ by 4.1 µm: 61 % of its Cz is used",
            ),
            (
                Extrapolation { distance: None, ..found(beyond(35.0), Outside::Warn, 1.0) },
                "extrapolating: bed is 35.00 °C above its largest value of the guideway; Cz is the value at \
                 the end of the guideway",
            ),
        ] {
            assert_eq!(message(&profile, &found), expected);
            assert_eq!(status(&profile, &found).text, expected);
        }
    }

    #[test]
    fn the_alarm_has_no_figures_that_change_and_says_what_ends_it() {
        let profile = sample::profile();
        let found = |by, outside, distance, gain| Extrapolation {
            distance,
            farthest: Some(Beyond { signal: SignalId(0), by }),
            outside,
            gain,
            apart: Micron::new(by),
        };
        for (outside, does) in [
            (Outside::Warn, "Cz still follows the model"),
            (Outside::Hold, "Cz does not change"),
            (Outside::Shrink, "Cz is smaller than the value of the model"),
            (Outside::Agree, "Cz follows the model as far as its two halves agree"),
        ] {
            let first = alarm(&profile, &found(0.1, outside, Some((3.1, 3.0)), 1.0), true);
            assert_eq!(
                first,
                format!(
                    "extrapolating, which began because bed was above its largest value; {does}; the alarm ends \
                     when every input is inside its range by 5 % of the range, and their combination as well"
                )
            );
            let later = alarm(&profile, &found(9.7, outside, Some((12.0, 3.0)), 0.2), true);
            assert_eq!(first, later);
        }
        assert_eq!(
            alarm(&profile, &found(35.0, Outside::Warn, None, 1.0), false),
            "extrapolating, which began because bed was above its largest value; Cz is the value at the end of the \
             guideway; the alarm ends when the position is inside the guideway by 5 % of its length"
        );
        let both = alarm(&profile, &found(35.0, Outside::Warn, None, 1.0), true);
        let ends =
            "ends when the position is inside the guideway, and every input is inside its range by 5 %";
        assert!(both.contains(ends), "{both}");
        let combination =
            Extrapolation { farthest: None, ..found(0.0, Outside::Hold, Some((3.1, 3.0)), 1.0) };
        let text = alarm(&profile, &combination, true);
        let began =
            "began because the model was not identified with this combination of inputs; Cz does not change";
        assert!(text.contains(began), "{text}");
    }
}
