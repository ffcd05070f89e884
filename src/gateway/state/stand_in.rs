//! Reports about frozen or lost sensors, and about the stand-ins (values estimated from other sensors) that replace
//! them.

use crate::observe::events::{Event, StandIn, others};
use crate::observe::status::SubstitutedSensorStatus;
use isotherm_core::compensation::{Decision, RejectedSensor, SubstitutedSensor};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;

use super::causes::SEE_TO_THE_SENSOR;

/// Returns cause and hint for a sensor that a stand-in replaces, for example
/// `bed frozen, replaced by a stand-in from 5 other sensors`.
pub(super) fn explained(profile: &Profile, found: &SubstitutedSensor) -> Explained {
    let is = if found.frozen { "frozen" } else { "lost" };
    let signal = &profile.signal(found.signal).name;
    let cause = format!("{signal} {is}, replaced by a stand-in from {}", others(found.others));
    Explained::new(cause, SEE_TO_THE_SENSOR)
}

/// Sensor whose fault (frozen or lost) was reported and has not ended, with its reported state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReportedSensor {
    signal: SignalId,
    /// Whether a stand-in replaces the sensor. If not, the sensor may be frozen, and its reading is still used.
    taken: bool,
}

/// Adds events about each sensor when its fault begins, when its state changes, and when its fault ends.
pub(super) fn report(
    (profile, axis): (&Profile, &str),
    decision: &Decision,
    found: &[RejectedSensor],
    reported: &mut Vec<ReportedSensor>,
    events: &mut Vec<Event>,
) {
    let name = |signal| profile.signal(signal).name.clone();
    // A lost sensor without a stand-in is not reported here. The events of the signal and of the axis contain all about
    // it.
    let is_reported = |found: &&RejectedSensor| found.others.is_some() || found.frozen;
    reported.retain(|known| {
        let now = found.iter().find(|found| found.signal == known.signal);
        let is_over = !now.iter().any(is_reported);
        if is_over {
            let (axis, signal) = (axis.to_owned(), name(known.signal));
            events.push(Event::StandIn(StandIn::Over { axis, signal, accepted: now.is_none() }));
        }
        !is_over
    });
    for found in found.iter().filter(is_reported) {
        let new = ReportedSensor { signal: found.signal, taken: found.others.is_some() };
        if reported.contains(&new) {
            continue;
        }
        reported.retain(|known| known.signal != new.signal);
        reported.push(new);
        events.push(Event::StandIn(StandIn::Taken {
            axis: axis.to_owned(),
            signal: name(found.signal),
            frozen: found.frozen,
            span: decision.at.since(found.since),
            others: found.others,
        }));
    }
}

/// Returns the status of a sensor that a stand-in replaces. `stamp` converts monotonic time to the time of day.
pub(in crate::gateway) fn status(
    profile: &Profile,
    found: &SubstitutedSensor,
    stamp: impl Fn(Moment) -> Moment,
) -> SubstitutedSensorStatus {
    SubstitutedSensorStatus {
        signal: profile.signal(found.signal).name.clone(),
        frozen: found.frozen,
        since: stamp(found.since).to_string(),
        others: found.others,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::store::log::sample;
    use isotherm_core::compensation::{Compensation, Remembered};

    #[test]
    fn each_sensor_is_reported_for_itself_and_its_end_says_what_it_is() {
        let profile = sample::profile();
        let axes = vec![profile.axes[0].settings.clone()];
        let compensation = Compensation::new(profile.machine.clone(), axes, Remembered::default());
        let decision = compensation.decision(0).unwrap();
        let found = |place, frozen, others| RejectedSensor {
            signal: SignalId(place),
            since: Moment::default(),
            frozen,
            others,
        };
        let mut reported = Vec::new();
        let mut told = |found: &[RejectedSensor]| -> Vec<String> {
            let mut events = Vec::new();
            report((&profile, "z"), decision, found, &mut reported, &mut events);
            let texts = events.iter().map(|event| event.entry(Moment::default()).text);
            texts.map(|text| text.split("; check the sensor").next().unwrap().to_owned()).collect()
        };
        let bed = found(0, true, Some(5));
        assert_eq!(told(&[bed]), ["axis z: bed frozen for 0s, replaced by a stand-in from 5 other sensors"]);
        assert_eq!(told(&[bed]), [""; 0]);
        let both = [found(0, true, None), found(1, true, None)];
        let nobody = "frozen for 0s, and not replaced by a stand-in";
        assert_eq!(told(&both), [format!("axis z: bed {nobody}"), format!("axis z: wheelhead {nobody}")]);
        assert_eq!(told(&both), [""; 0]);
        let lost = found(1, false, None);
        assert_eq!(
            told(&[bed, lost]),
            [
                "axis z: wheelhead is no longer replaced by a stand-in".to_owned(),
                "axis z: bed frozen for 0s, replaced by a stand-in from 5 other sensors".to_owned()
            ]
        );
        assert_eq!(told(&[lost]), ["axis z: bed is accepted again"]);
        assert_eq!(told(&[]), [""; 0], "a lost sensor without a stand-in was not reported");
    }
}
