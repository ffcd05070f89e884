use super::*;
use crate::gateway::store::log::sample;
use isotherm_core::quantity::Moment;
use isotherm_profile::DefaultRange;

const OF_A_MODEL: DefaultLimits =
    DefaultLimits { range: Some(DefaultRange::Within(-40.0, 200.0)), max_rate: Some(5.0) };
const PHYSICAL: DefaultLimits =
    DefaultLimits { range: Some(DefaultRange::NotBelow(-273.15)), max_rate: None };

fn profile(limits: &[DefaultLimits]) -> Profile {
    let mut profile = sample::profile();
    for (signal, limits) in profile.signals.iter_mut().zip(limits) {
        signal.defaults = *limits;
    }
    profile
}

fn texts(known: &KnownLimits, profile: &Profile) -> Vec<String> {
    new_since(known, profile).iter().map(|event| event.entry(Moment::default()).text).collect()
}

#[test]
fn each_signal_with_a_new_limit_is_named_once_together_with_those_of_the_same_limits() {
    let profile = profile(&[OF_A_MODEL, PHYSICAL, OF_A_MODEL, DefaultLimits::default()]);
    let names: Vec<&str> = profile.signals.iter().map(|signal| signal.name.as_str()).collect();
    let found = texts(&KnownLimits::new(), &profile);
    assert_eq!(found.len(), 2, "{found:?}");
    let both = format!(
        "signals {}, {}: readings outside -40 to 200 °C or faster than 5 °C per second are rejected",
        names[0], names[2]
    );
    assert!(found[0].starts_with(&both), "{found:?}");
    let one = format!("signal {}: readings below -273.15 °C are rejected", names[1]);
    assert!(found[1].starts_with(&one), "{found:?}");
    assert!(found.iter().all(|text| text.contains("difference = true")), "{found:?}");
    assert!(texts(&of(&profile), &profile).is_empty(), "known from the last run");
}

#[test]
fn a_signal_whose_limits_changed_is_named_again_and_one_without_limits_is_not() {
    let before = of(&profile(&[PHYSICAL, PHYSICAL]));
    let after = profile(&[OF_A_MODEL, PHYSICAL]);
    let found = texts(&before, &after);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].starts_with(&format!("signal {}:", after.signals[0].name)), "{found:?}");
    assert!(texts(&before, &profile(&[])).is_empty());
}

/// The limits are saved as JSON. If a number changed by this, the limits would be reported at every start.
#[test]
fn limits_are_the_same_after_they_were_saved() {
    let kelvin = DefaultLimits { range: Some(DefaultRange::Within(233.15, 473.15)), max_rate: Some(5.0) };
    let known = of(&profile(&[OF_A_MODEL, PHYSICAL, kelvin]));
    let value = serde_json::to_value(&known).unwrap();
    let text = serde_json::to_string(&value).unwrap();
    assert_eq!(serde_json::from_str::<KnownLimits>(&text).unwrap(), known);
}
