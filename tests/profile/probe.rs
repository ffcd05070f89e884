//! `[axis.*.probe]`: what it becomes, and what is wrong with one.

use isotherm_core::candidate::Policy;
use isotherm_core::compensation::settings::{Filter, OnWorse};

use super::*;

/// The grinder with a probing cycle in its CNC.
fn probed(probe: &str) -> String {
    format!(
        "{GRINDER}
[signal.probe_z]
device = \"cnc\"
register = \"holding:300\"
type = \"i32\"
word_order = \"msw-first\"
scale = 0.0001
unit = \"mm\"
max_age = \"5s\"
[signal.probed]
device = \"cnc\"
register = \"holding:302\"
type = \"u16\"
unit = \"count\"
max_age = \"5s\"
[axis.z.probe]
{probe}"
    )
}

const WHOLE: &str = "signal = \"probe_z\"
trigger = \"probed\"
limit = 10.0
filter = 0.5
max_error = 25.0
warn = 5.0
gains = { forgetting = 0.98, limit = 0.2 }
";

#[test]
fn a_probe_becomes_final_types_and_is_explained_in_words() {
    let loaded = parse(&probed(WHOLE)).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let machine = loaded.profile;
    let (settings, input) = (machine.axes[0].settings.probe.unwrap(), machine.axes[0].probe_input.unwrap());
    assert_eq!((settings.limit.get(), settings.max_error.get()), (10.0, 25.0));
    assert_eq!(settings.filter, Filter::Share(0.5));
    assert_eq!(settings.warn.map(|warn| warn.get()), Some(5.0));
    assert_eq!(settings.gains.map(|gains| (gains.forgetting, gains.limit)), Some((0.98, 0.2)));
    assert_eq!((input.signal.0, input.trigger.map(|id| id.0), input.micron), (7, Some(8), 1000.0));
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    for words in [
        "probe: measured errors (actual minus commanded, with Cz active) come from probe_z, each time probed \
         changes",
        "A positive error lowers the model's Cz by 0.5 of the error, in total by at most 10 µm",
        "beyond ±5 µm the gateway warns; the gains of linear models are adjusted by up to ±20.000 % each",
        "`isotherm learn` learns a model from these errors",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn a_probing_is_weighed_unless_the_profile_names_a_share() {
    for (written, filter, words) in [
        (
            "",
            Filter::Weighed { repeat: 0.5, walk: 4.0 },
            "±0.5 µm per probing, and a variance of the correction that grows by 4 µm² per hour",
        ),
        ("repeat = 0.2\n", Filter::Weighed { repeat: 0.2, walk: 4.0 }, "±0.2 µm per probing"),
        (
            "q = 0.81\n",
            Filter::Weighed { repeat: 0.5, walk: 0.81 },
            "a variance of the correction that grows by 0.81 µm² per hour",
        ),
        ("filter = 1.0\n", Filter::Share(1.0), "by 1 of the error"),
    ] {
        let text = probed(&WHOLE.replacen("filter = 0.5\n", written, 1));
        let machine = parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile;
        assert_eq!(machine.axes[0].settings.probe.unwrap().filter, filter);
        let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn a_probe_says_what_happens_while_a_model_is_worse_than_no_compensation() {
    for (written, worse, is_said) in [
        ("", OnWorse::Warn, false),
        ("worse = \"warn\"\n", OnWorse::Warn, false),
        ("worse = \"ramp\"\n", OnWorse::Ramp, true),
    ] {
        let text = probed(&format!("{WHOLE}{written}"));
        let machine = parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile;
        assert_eq!(machine.axes[0].settings.probe.unwrap().worse, worse);
        let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
        let words = "while probings show that a model is worse than no compensation, Cz goes to zero";
        assert_eq!(reported.contains(words), is_said, "{reported}");
    }
}

#[test]
fn errors_may_come_by_command_only_and_a_diameter_is_halved() {
    let by_command = format!("{GRINDER}\n[axis.z.probe]\nlimit = 10.0\nfilter = 1.0\nmax_error = 25.0\n");
    let machine = parse(&by_command).unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert_eq!(machine.axes[0].probe_input, None);
    assert!(isotherm_profile::preview::Preview::of(&machine).to_string().contains("come from commands"));
    let text = probed(WHOLE).replacen("limit = 40.0", "limit = 40.0\ndiameter = true", 1);
    let machine = parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert!((machine.axes[0].probe_input.unwrap().micron - 500.0).abs() < 1e-9);
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    assert!(reported.contains("actual minus commanded, on the diameter"), "{reported}");
}

#[test]
fn a_probe_says_that_it_scales_the_expected_error_if_a_model_has_one() {
    for (expected, is_said) in [("", false), ("expected = { since_datum = [0.9, 1.1] }\n", true)] {
        let text = probed(WHOLE).replacen("kind = \"linear\"", &format!("{expected}kind = \"linear\""), 1);
        let machine = parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile;
        let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
        assert_eq!(reported.contains("measured errors scale the expected error"), is_said, "{reported}");
    }
}

#[test]
fn each_mistake_is_reported_at_its_place() {
    for (from, to, key, at, words) in [
        ("limit = 10.0", "limit = 50.0", "limit", "50.0", "larger than the axis's limit of 40 µm"),
        ("limit = 10.0", "limit = 0.0", "limit", "0.0", "not above zero"),
        ("filter = 0.5", "filter = 1.5", "filter", "1.5", "above 0 and up to 1"),
        ("filter = 0.5", "filter = 0.0", "filter", "0.0", "above 0 and up to 1"),
        ("filter = 0.5", "filter = \"half\"", "filter", "\"half\"", "expected a number"),
        ("filter = 0.5", "repeat = 0.0", "repeat", "0.0", "not above zero"),
        ("filter = 0.5", "repeat = \"1 um\"", "repeat", "\"1 um\"", "expected a number"),
        ("filter = 0.5", "q = -4.0", "q", "-4.0", "not above zero"),
        ("filter = 0.5", "filter = 0.5\nrepeat = 0.3", "repeat", "repeat", "remove `filter`"),
        ("filter = 0.5", "filter = 0.5\nq = 0.3", "q", "q", "remove `filter`"),
        ("max_error = 25.0", "max_error = -1.0", "max_error", "-1.0", "not above zero"),
        ("warn = 5.0", "warn = 26.0", "warn", "26.0", "more than the `max_error` of 25 µm"),
        ("warn = 5.0", "warm = 5.0", "warm", "warm", "did you mean `warn`?"),
        ("forgetting = 0.98", "forgetting = 1.01", "gains.forgetting", "1.01", "above 0 and up to 1"),
        (", limit = 0.2", ", limit = 1.0", "gains.limit", "1.0", "a gain never changes its sign"),
        ("\"probe_z\"", "\"probe_y\"", "signal", "\"probe_y\"", "there is no signal named `probe_y`"),
        ("\"probe_z\"", "\"bed\"", "signal", "\"bed\"", "`bed` is in degC, not in um or mm"),
        ("\"probed\"", "\"probe_z\"", "trigger", "\"probe_z\"", "its own trigger"),
    ] {
        let probe = WHOLE.replacen(from, to, 1);
        assert_ne!(probe, WHOLE, "{from}");
        let error = only_error(&probed(&probe), &format!("axis.z.probe.{key}"), at);
        assert!(error.to_string().contains(words), "`{words}` is not in: {error}");
    }
}

#[test]
fn what_is_missing_is_reported_and_all_at_once() {
    let found = errors(parse(&probed("trigger = \"probed\"\ngains = {}\n")));
    let mut keys: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    keys.sort_unstable();
    let wanted = ["gains.forgetting", "gains.limit", "limit", "max_error", "signal"];
    assert_eq!(keys, wanted.map(|key| format!("axis.z.probe.{key}")), "{}", Errors(found.clone()));
}

#[test]
fn gains_learn_only_where_a_model_has_them() {
    let text = probed(WHOLE);
    let (head, tail) = text.split_once("[[axis.z.model]]\nname = \"difference\"").unwrap();
    let (_, rest) = tail.split_once("[[axis.z.model]]").unwrap();
    let error = only_error(&format!("{head}[[axis.z.model]]{rest}"), "axis.z.probe.gains", "gains");
    assert!(error.to_string().contains("no model of this axis is linear"), "{error}");
}

/// The probe without `gains`, with keys for learning.
fn learning(keys: &str) -> String {
    probed(&WHOLE.replacen("gains = { forgetting = 0.98, limit = 0.2 }\n", keys, 1))
}

#[test]
fn an_axis_that_learns_has_one_more_model_with_every_temperature() {
    let text = learning("learn = \"daily\"\nlearn_without = [\"wheelhead\"]\nadopt = \"auto\"\n");
    let machine = parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile;
    let (axis, settings) = (&machine.axes[0], &machine.axes[0].settings);
    let learning = axis.learning.as_ref().unwrap();
    assert_eq!((learning.adopt, learning.without.len()), (Policy::Auto, 1));
    let (slot, plain) = (settings.learned.as_ref().unwrap(), parse(&probed(WHOLE)).unwrap().profile);
    let own = &plain.axes[0].settings.models;
    assert_eq!((settings.own_models(), slot.model), (own.as_slice(), own.len()));
    let model = &settings.models[slot.model];
    assert_eq!(model.name, "learned");
    let of_signal = |name: &str| {
        let place = machine.signals.iter().position(|signal| signal.name == name).unwrap();
        model.rises().filter(|input| input.signal.0 == place).count()
    };
    assert_eq!((of_signal("bed"), of_signal("wheelhead"), of_signal("probe_z")), (4, 0, 0));
    assert!(model.numbers().all(|number| number.abs() < 1e-300), "nothing is learned yet");
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    let words = "once a day, the gateway learns a model from these errors without wheelhead. If the learned \
                 model is better than the model in use, the gateway adopts it at the next datum; the \
                 adoption of a model does not change Cz";
    assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    assert!(!reported.contains("learned:"), "the model without gains is not listed:\n{reported}");
}

#[test]
fn a_learned_model_belongs_to_the_models_of_the_profile_whatever_signals_are_added() {
    let own = |text: &str| {
        let machine = parse(text).unwrap_or_else(|errors| panic!("{errors}")).profile;
        machine.axes[0].settings.learned.clone().unwrap().own
    };
    let text = learning("learn = \"daily\"\n");
    let signal = "[signal.a_new_one]\ndevice = \"module\"\nregister = \"30004\"\ntype = \"i16\"\nscale = 0.1\nunit = \
                  \"degC\"\nmax_age = \"10s\"\n\n[axis.z]";
    assert_eq!(own(&text), own(&text.replacen("[axis.z]", signal, 1)));
    assert_eq!(own(&text), own(&text.replacen("limit = 10.0", "limit = 9.0", 1)));
    assert_ne!(own(&text), own(&text.replacen("gain = 2.4", "gain = 2.5", 1)));
}

#[test]
fn mistakes_about_learning_are_reported_at_their_places() {
    for (keys, key, at, words) in [
        ("learn = \"weekly\"\n", "learn", "\"weekly\"", "daily"),
        ("adopt = \"auto\"\n", "adopt", "adopt", "has no effect without `learn`"),
        ("learn_without = [\"bed\"]\n", "learn_without", "learn_without", "has no effect without `learn`"),
        (
            "learn = \"daily\"\ngains = { forgetting = 0.98, limit = 0.2 }\n",
            "learn",
            "\"daily\"",
            "would both change the gains",
        ),
        (
            "learn = \"daily\"\nlearn_without = [\"bedd\"]\n",
            "learn_without[0]",
            "\"bedd\"",
            "did you mean `bed`?",
        ),
        (
            "learn = \"daily\"\nlearn_without = [\"bed\", \"wheelhead\"]\n",
            "learn_without",
            "[",
            "remove a sensor from `learn_without`",
        ),
    ] {
        let error = only_error(&learning(keys), &format!("axis.z.probe.{key}"), at);
        assert!(error.to_string().contains(words), "`{words}` is not in: {error}");
    }
    let named = learning("learn = \"daily\"\n").replacen("name = \"difference\"", "name = \"learned\"", 1);
    let error = only_error(&named, "axis.z.model[0].name", "\"learned\"");
    assert!(error.to_string().contains("is in use"), "{error}");
}
