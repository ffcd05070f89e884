//! Reports about a model that makes the error larger than no compensation would ("worse than no compensation").

use crate::observe::events::{Comparison, Event};
use crate::observe::status::WorseStatus;
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{AxisState, Decision, Worse};
use isotherm_core::explained::Explained;

/// Hint for a model that is worse than no compensation.
const IDENTIFY: &str = "identify the model again";

/// Returns why the Cz of an axis is zero, or moves to zero: the model is worse than no compensation. `None` if Cz has
/// another reason.
pub(super) fn cause(axis: &AxisSettings, decision: &Decision) -> Option<Explained> {
    let is_left = decision.worse.is_some()
        && axis.leaves_what_is_worse()
        && matches!(decision.state, AxisState::Ramping | AxisState::Zeroed);
    is_left.then(|| Explained::new("the model is worse than no compensation", IDENTIFY))
}

/// Returns an event when a model becomes worse than no compensation, and when this ends. `reported` is the state that
/// was reported last; the function updates it.
pub(super) fn event(axis: &AxisSettings, decision: &Decision, reported: &mut bool) -> Option<Event> {
    let was_worse = std::mem::replace(reported, decision.worse.is_some());
    let name = axis.name.clone();
    match decision.worse {
        Some(Worse { touches, without, with }) if !was_worse => {
            let ramps = axis.leaves_what_is_worse();
            Some(Event::Comparison(Comparison::Worse { axis: name, touches, without, with, ramps }))
        }
        None if was_worse => Some(Event::Comparison(Comparison::Over { axis: name })),
        _ => None,
    }
}

/// Returns the result of the comparison between a model and no compensation, for the status.
pub(in crate::gateway) fn status(axis: &AxisSettings, worse: &Worse) -> WorseStatus {
    WorseStatus {
        touches: worse.touches,
        without_um: worse.without.get(),
        with_um: worse.with.get(),
        ramps: axis.leaves_what_is_worse(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::store::log::sample;
    use isotherm_core::compensation::settings::{Filter, OnWorse, ProbeSettings};
    use isotherm_core::compensation::{Compensation, Remembered};
    use isotherm_core::quantity::{Micron, Moment};

    #[test]
    fn it_is_reported_once_with_its_figures_and_once_when_it_is_over() {
        let um = |value| Micron::new(value).unwrap();
        let profile = sample::profile();
        for (worse, hint) in [
            (OnWorse::Warn, "identify the model again, or disarm the axis"),
            (
                OnWorse::Ramp,
                "Cz goes to zero until touches show that the model is better; identify the model again",
            ),
        ] {
            let filter = Filter::Share(0.5);
            let (limit, max_error) = (um(10.0), um(20.0));
            let probe = ProbeSettings { limit, filter, max_error, warn: None, gains: None, worse };
            let axis = AxisSettings { probe: Some(probe), ..profile.axes[0].settings.clone() };
            let compensation =
                Compensation::new(profile.machine.clone(), vec![axis.clone()], Remembered::default());
            let mut decision = *compensation.decision(0).unwrap();
            let mut reported = false;
            let mut told = |worse, state| {
                (decision.worse, decision.state) = (worse, state);
                let cause = cause(&axis, &decision).map(|why| why.cause);
                let text = event(&axis, &decision, &mut reported);
                (text.map(|event| event.entry(Moment::default()).text), cause)
            };
            let found = Some(Worse { touches: 5, without: um(2.0), with: um(3.2) });
            let text = format!(
                "axis z: the model is worse than no compensation: the residual error is 3.2 µm with the \
                 model, 2.0 µm without (root mean square of the last 5 touches); {hint}"
            );
            assert_eq!(told(None, AxisState::Active), (None, None));
            assert_eq!(told(found, AxisState::Active), (Some(text), None));
            let why = (worse == OnWorse::Ramp).then(|| "the model is worse than no compensation".to_owned());
            assert_eq!(told(found, AxisState::Ramping), (None, why));
            let over = "axis z: the model is no longer worse than no compensation".to_owned();
            assert_eq!(told(None, AxisState::Active), (Some(over), None));
        }
    }
}
