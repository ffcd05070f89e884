//! Limits of temperatures for which neither the profile nor a template states any.

use isotherm_profile::preview::Preview;
use isotherm_profile::{DefaultLimits, DefaultRange, Profile};

use super::{only_error, parse};

const USED: DefaultLimits =
    DefaultLimits { range: Some(DefaultRange::Within(-40.0, 200.0)), max_rate: Some(5.0) };
const UNUSED: DefaultLimits = DefaultLimits { range: Some(DefaultRange::NotBelow(-273.15)), max_rate: None };

/// Machine with a temperature that a model uses, and one that is only recorded. Each has these further keys.
fn text(used: &str, unused: &str) -> String {
    format!(
        "[machine]\nname = \"bench\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"\n\
         [device.module]\nbus = \"cell\"\nunit = 1\n\
         [signal.bed]\ndevice = \"module\"\nregister = \"input:0\"\ntype = \"i16\"\nscale = 0.1\n{used}\n\
         [signal.oil]\ndevice = \"module\"\nregister = \"input:1\"\ntype = \"i16\"\nscale = 0.1\n{unused}\n\
         [axis.z]\nlimit = 40.0\nstep = 1.0\nrate = 0.5\nevery = \"10s\"\non_fault = {{ action = \"hold\" }}\n\
         [[axis.z.model]]\nname = \"bed\"\nkind = \"linear\"\n\
         terms = [{{ signal = \"bed\", gain = 1.0, reference = 20.0 }}]\n\
         [output.cnc]\naxis = \"z\"\ndevice = \"module\"\nwrites = \"offset\"\nregister = \"holding:0\"\ntype = \"i16\"\n\
         scale = 0.1\n"
    )
}

#[track_caller]
fn profile(used: &str, unused: &str) -> Profile {
    parse(&text(used, unused)).unwrap_or_else(|errors| panic!("{errors}")).profile
}

fn limits(profile: &Profile, name: &str) -> DefaultLimits {
    profile.signals.iter().find(|signal| signal.name == name).unwrap().defaults
}

#[test]
fn a_temperature_that_a_model_uses_has_a_range_and_a_rate_and_any_other_is_not_below_absolute_zero() {
    let celsius = profile("unit = \"degC\"", "unit = \"degC\"");
    assert_eq!((limits(&celsius, "bed"), limits(&celsius, "oil")), (USED, UNUSED));
    let kelvin = profile("unit = \"K\"", "unit = \"K\"");
    let range = Some(DefaultRange::Within(233.15, 473.15));
    assert_eq!(limits(&kelvin, "bed"), DefaultLimits { range, ..USED });
    let range = Some(DefaultRange::NotBelow(0.0));
    assert_eq!(limits(&kelvin, "oil"), DefaultLimits { range, ..UNUSED });
    let others = profile("unit = \"rpm\"", "unit = \"bar\"");
    assert!(limits(&others, "bed").is_empty() && limits(&others, "oil").is_empty());
}

#[test]
fn each_stated_limit_replaces_its_default_and_none_removes_it() {
    let of = |keys: &str| {
        let profile = profile(&format!("unit = \"degC\"\n{keys}"), "unit = \"degC\"");
        let signal = &profile.signals[0];
        (signal.range, signal.max_rate, signal.defaults)
    };
    let without_range = DefaultLimits { range: None, ..USED };
    let without_rate = DefaultLimits { max_rate: None, ..USED };
    let nothing = DefaultLimits::default();
    assert_eq!(of("range = [-10, 80.5]"), (Some((-10.0, 80.5)), None, without_range));
    assert_eq!(of("range = \"none\""), (None, None, without_range));
    assert_eq!(of("max_rate = 2"), (None, Some(2.0), without_rate));
    assert_eq!(of("max_rate = \"none\""), (None, None, without_rate));
    assert_eq!(of("range = \"none\"\nmax_rate = \"none\""), (None, None, nothing));
    assert_eq!(of("difference = true"), (None, None, nothing));
    assert_eq!(of("difference = false"), (None, None, USED));
    assert_eq!(of("difference = true\nrange = [-5.0, 5.0]"), (Some((-5.0, 5.0)), None, nothing));
}

#[test]
fn a_range_of_a_template_is_stated_and_none_removes_it_too() {
    let machine = |keys: &str| {
        let text = text(&format!("unit = \"degC\"\n{keys}"), "unit = \"degC\"")
            .replace("unit = 1\n", "unit = 1\ntemplate = \"comwintop-tc-logger\"\n")
            .replace("register = \"input:0\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"", "channel = 1");
        parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile
    };
    let without_range = DefaultLimits { range: None, ..USED };
    let stated = machine("");
    assert_eq!((stated.signals[0].range, limits(&stated, "bed")), (Some((-200.0, 999.9)), without_range));
    let removed = machine("range = \"none\"");
    assert_eq!((removed.signals[0].range, limits(&removed, "bed")), (None, without_range));
}

#[test]
fn a_layer_may_switch_a_limit_off() {
    let settings = ["signal.bed.range", "signal.bed.max_rate"].map(|key| (key.to_owned(), "none".to_owned()));
    let text = text("unit = \"degC\"", "unit = \"degC\"");
    let loaded = isotherm_profile::parse(std::path::Path::new("machine.toml"), &text, &settings, &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert!(limits(&profile, "bed").is_empty());
}

#[test]
fn check_prints_the_defaults() {
    let shown = |used: &str, unused: &str| Preview::of(&profile(used, unused)).to_string();
    let text = shown("unit = \"degC\"", "unit = \"degC\"");
    for words in [
        "0.1 °C per count; rejected outside -40 to 200 °C (default), faster than 5 °C per second (default), older than",
        "0.1 °C per count; rejected below -273.15 °C (default), older than",
    ] {
        assert!(text.contains(words), "`{words}` is not in:\n{text}");
    }
    let text = shown("unit = \"degC\"\nrange = [0.0, 60.0]", "unit = \"degC\"\nrange = \"none\"");
    assert!(text.contains("rejected outside 0 to 60 °C, faster than 5 °C per second (default)"), "{text}");
    assert_eq!(text.matches("(default)").count(), 1, "{text}");
}

#[test]
fn a_wrong_word_and_a_difference_of_something_else_are_mistakes() {
    let refused = |keys: &str, key: &str, at: &str, words: &[&str]| {
        let error = only_error(&text(keys, "unit = \"degC\""), key, at);
        for word in words {
            assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
        }
    };
    refused("unit = \"degC\"\nrange = \"off\"", "signal.bed.range", "\"off\"", &["none"]);
    refused("unit = \"degC\"\nmax_rate = \"off\"", "signal.bed.max_rate", "\"off\"", &["none"]);
    refused("unit = \"degC\"\nmax_rate = -1.0", "signal.bed.max_rate", "-1.0", &["above zero"]);
    let words = ["not a difference of temperatures", "remove `difference`"];
    refused("unit = \"bar\"\ndifference = true", "signal.bed.difference", "true", &words);
}
