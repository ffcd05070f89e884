//! Layers: the file, the local file next to it, variables and flags.

use super::*;

fn pairs(list: &[(&str, &str)]) -> Vec<(String, String)> {
    list.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect()
}

fn layered(environment: &[(&str, &str)], settings: &[(&str, &str)]) -> Result<Loaded, Errors> {
    isotherm_profile::parse(Path::new("machine.toml"), GRINDER, &pairs(settings), &pairs(environment))
}

#[test]
fn later_layers_win_file_local_environment_flag() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, GRINDER).unwrap();
    let local = "[bus.cell]\naddress = \"10.0.0.1:502\"\n\n[signal.wheelhead]\nbad = [7]\nmax_age = \"9s\"\n";
    std::fs::write(folder.path().join("machine.local.toml"), local).unwrap();
    let loaded = isotherm_profile::load(&path, &[], &[]).unwrap().profile;
    assert_eq!(loaded.buses[0].address, "10.0.0.1:502");
    assert_eq!(loaded.buses[0].timeout.as_millis(), 300);
    assert_eq!(
        (loaded.signals[0].name.as_str(), loaded.signals[0].encoding.bad.as_slice()),
        ("wheelhead", [7.into()].as_slice())
    );
    let environment = pairs(&[("ISOTHERM__BUS__CELL__ADDRESS", "10.0.0.2:502"), ("ISOTHERM_LOG", "debug")]);
    assert_eq!(
        isotherm_profile::load(&path, &[], &environment).unwrap().profile.buses[0].address,
        "10.0.0.2:502"
    );
    let settings = pairs(&[("bus.cell.address", "10.0.0.3:502")]);
    assert_eq!(
        isotherm_profile::load(&path, &settings, &environment).unwrap().profile.buses[0].address,
        "10.0.0.3:502"
    );
}

#[test]
fn an_error_in_the_local_file_is_reported_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, GRINDER).unwrap();
    std::fs::write(folder.path().join("machine.local.toml"), "[bus.cell]\nadress = \"10.0.0.1:502\"\n")
        .unwrap();
    let found = errors(isotherm_profile::load(&path, &[], &[]));
    assert!(found[0].file.ends_with("machine.local.toml"), "{}", found[0]);
    assert_eq!(
        (found[0].line, found[0].column, found[0].key.as_str()),
        (Some(2), Some(1), "bus.cell.adress")
    );
}

#[test]
fn a_profile_that_cannot_be_read_is_reported_as_such() {
    let found = errors(isotherm_profile::load(Path::new("/nowhere/machine.toml"), &[], &[]));
    assert_eq!(found.len(), 1);
    assert!(
        found[0].to_string().starts_with("/nowhere/machine.toml: the profile cannot be read"),
        "{}",
        found[0]
    );
}

#[test]
fn a_value_of_a_variable_or_a_flag_has_the_type_that_the_schema_wants() {
    let environment = [("ISOTHERM__AXIS__Z__LIMIT", "30"), ("ISOTHERM__DEVICE__MODULE__EVERY", "2s")];
    let settings = [
        ("device.module.unit", "17"),
        ("signal.wheelhead.range", "[0.0, 60.0]"),
        ("machine.name", "17"),
        (
            "axis.z.model",
            "[{ name = \"m\", kind = \"linear\", terms = [{ signal = \"bed\", gain = 1, reference = \"zero\" }] }]",
        ),
    ];
    let machine = layered(&environment, &settings).unwrap().profile;
    assert!((machine.axes[0].settings.guard.limit.get() - 30.0).abs() < 1e-12);
    assert_eq!(
        (machine.devices[0].unit, machine.devices[0].every.as_secs(), machine.name.as_str()),
        (17, 2, "17")
    );
    assert_eq!(machine.signals[0].range.map(|(low, high)| format!("{low} {high}")), Some("0 60".to_owned()));
    assert_eq!(machine.axes[0].settings.models.len(), 1);
}

#[test]
fn a_variable_or_a_flag_that_means_nothing_is_an_error_with_its_name() {
    type Pairs<'a> = &'a [(&'a str, &'a str)];
    let cases: [(Pairs<'_>, Pairs<'_>, &str, &str); 8] = [
        (
            &[("ISOTHERM__BUS__CELL__ADRESS", "x")],
            &[],
            "environment ISOTHERM__BUS__CELL__ADRESS",
            "`address`",
        ),
        (&[("ISOTHERM__BUS__CEL__ADDRESS", "x")], &[], "environment ISOTHERM__BUS__CEL__ADDRESS", "`cell`"),
        (&[("ISOTHERM__", "x")], &[], "environment ISOTHERM__", "unknown key"),
        (
            &[("ISOTHERM__AXIS__Z__LIMIT", "forty")],
            &[],
            "environment ISOTHERM__AXIS__Z__LIMIT",
            "expected a number",
        ),
        (&[], &[("axis.z.limt", "3")], "--set axis.z.limt", "`limit`"),
        (&[], &[("axis.z.limit", "nan")], "--set axis.z.limit", "finite"),
        (&[], &[("axis.z.model[0].name", "x")], "--set axis.z.model[0].name", "`model`"),
        (&[], &[("bus.cell", "x")], "--set bus.cell", "expected a table"),
    ];
    for (environment, settings, file, words) in cases {
        let found = errors(layered(environment, settings));
        assert_eq!(
            (found.len(), found[0].file.as_str(), found[0].line),
            (1, file, None),
            "{}",
            Errors(found.clone())
        );
        assert!(found[0].to_string().contains(words), "{}", found[0]);
    }
}

#[test]
fn a_layer_above_the_profile_tightens_a_guard_and_never_loosens_it() {
    for (key, tighter, looser, words) in [
        ("axis.z.limit", "39.5", "40.5", "40.5 is more than the 40.0 of the profile"),
        ("axis.z.step", "1", "2", "2 is more than the 1.0 of the profile"),
        ("axis.z.rate", "0.5", "0.51", "0.51 is more than the 0.5 of the profile"),
        ("axis.z.on_fault.after", "60s", "61s", "\"61s\" differs from \"60s\" in the profile"),
        ("axis.z.on_fault.action", "ramp", "hold", "\"hold\" differs from \"ramp\" in the profile"),
        (
            "axis.z.on_fault",
            "{ action = \"ramp\" }",
            "{ action = \"zero\" }",
            "\"zero\" differs from \"ramp\"",
        ),
        ("machine.arm", "manual", "auto", "the profile has arm = \"manual\""),
    ] {
        let with = |value: &str, allow: &str| {
            let text = match key {
                "machine.arm" if value == "auto" => {
                    GRINDER.replacen("[machine]\n", "[machine]\narm = \"manual\"\n", 1)
                }
                _ => GRINDER.to_owned(),
            };
            let text = text.replacen("[machine]\n", &format!("[machine]\n{allow}"), 1);
            isotherm_profile::parse(Path::new("machine.toml"), &text, &pairs(&[(key, value)]), &[])
        };
        assert!(with(tighter, "").is_ok(), "{key} = {tighter}");
        let found = errors(with(looser, ""));
        let error = found.iter().find(|error| error.message.contains(words));
        let error = error.unwrap_or_else(|| panic!("{}", Errors(found.clone())));
        assert_eq!(error.file, format!("--set {key}"));
        let guard = if key.starts_with("axis.z.on_fault") { "axis.z.on_fault" } else { key };
        let allow = format!("allow_override = [\"{guard}\"]\n");
        assert!(error.help.as_ref().unwrap().contains(allow.trim()), "{error}");
        // Its other mistakes do not concern the layers.
        let allowed = with(looser, &allow);
        let reported = allowed.map_or_else(|errors| errors.to_string(), |_| String::new());
        assert!(!reported.contains("of the profile"), "{reported}");
    }
}

#[test]
fn the_file_beside_the_profile_is_a_layer_too_and_each_layer_is_judged_at_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, GRINDER).unwrap();
    std::fs::write(folder.path().join("machine.local.toml"), "[axis.z]\nlimit = 50.0\n").unwrap();
    let found = errors(isotherm_profile::load(&path, &pairs(&[("axis.z.limit", "30")]), &[]));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert!(found[0].file.ends_with("machine.local.toml"), "{}", found[0]);
    assert_eq!((found[0].line, found[0].column), (Some(2), Some(9)));
}

#[test]
fn an_axis_that_only_a_layer_has_gets_no_guard_from_it_unless_the_profile_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    let axis =
        "[axis.y]\nlimit = 5.0\nstep = 1.0\nrate = 0.5\nevery = \"10s\"\non_fault = { action = \"hold\" }\n";
    std::fs::write(folder.path().join("machine.local.toml"), axis).unwrap();
    std::fs::write(&path, GRINDER).unwrap();
    let found = errors(isotherm_profile::load(&path, &[], &[]));
    let keys: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(keys, ["axis.y.limit", "axis.y.step", "axis.y.rate", "axis.y.on_fault.action"]);
    assert!(found[0].message.contains("the profile has no `axis.y.limit`"), "{}", found[0]);
    let names = ["limit", "step", "rate", "on_fault"].map(|key| format!("\"axis.y.{key}\"")).join(", ");
    std::fs::write(
        &path,
        GRINDER.replacen("[machine]\n", &format!("[machine]\nallow_override = [{names}]\n"), 1),
    )
    .unwrap();
    let loaded = isotherm_profile::load(&path, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert_eq!(loaded.axes.len(), 2);
    let [only] = loaded.overridden.as_slice() else { panic!("{:?}", loaded.overridden) };
    assert!(
        only.key == "axis.y" && only.profile.is_none() && only.from.ends_with("machine.local.toml:1"),
        "{only}"
    );
}

#[test]
fn only_the_profile_itself_says_what_may_be_loosened_and_only_guards_can_be_named() {
    let found =
        errors(layered(&[], &[("machine.allow_override", "[\"axis.z.limit\"]"), ("axis.z.limit", "50")]));
    assert_eq!(found.len(), 2, "{}", Errors(found.clone()));
    assert!(found[0].message.contains("only the profile itself"), "{}", found[0]);
    for (entry, nearest) in
        [("axis.z.limt", "axis.z.limit"), ("axis.x.rate", "axis.z.rate"), ("machine.am", "machine.arm")]
    {
        let text =
            GRINDER.replacen("[machine]\n", &format!("[machine]\nallow_override = [\"{entry}\"]\n"), 1);
        let error = only_error(&text, "machine.allow_override[0]", &format!("\"{entry}\""));
        assert!(error.to_string().contains(&format!("did you mean `{nearest}`?")), "{error}");
    }
}

#[test]
fn what_layers_above_the_profile_set_is_listed_with_both_values_and_where_from() {
    assert_eq!(parse(GRINDER).unwrap().profile.overridden, []);
    let environment = [("ISOTHERM__AXIS__Z__LIMIT", "30"), ("ISOTHERM__SIGNAL__BED__MAX_AGE", "9s")];
    let loaded = layered(&environment, &[("axis.z.limit", "20.5"), ("web.language", "de")]).unwrap();
    let told: Vec<String> = loaded.profile.overridden.iter().map(ToString::to_string).collect();
    assert_eq!(
        told,
        [
            "axis.z.limit = 20.5 instead of the profile's 40.0, from --set axis.z.limit",
            "signal.bed.max_age = \"9s\", from environment ISOTHERM__SIGNAL__BED__MAX_AGE (not in the profile)",
            "web.language = \"de\", from --set web.language (not in the profile)",
        ]
    );
    let preview = isotherm_profile::preview::Preview::of(&loaded.profile);
    assert!(
        preview.to_string().contains(&format!("settings that override the profile\n  {}\n", told[0])),
        "{preview}"
    );
    let document = serde_json::to_value(preview).unwrap();
    assert_eq!(document["overridden"][0]["profile"], "40.0");
}

#[test]
fn a_variable_that_only_looks_like_ours_is_a_warning_and_one_warning_for_all_of_them() {
    let set: Vec<String> = (1..=7).map(|port| format!("ISOTHERM_PORT_808{port}_TCP")).collect();
    let mut environment: Vec<(&str, &str)> =
        set.iter().map(|name| (name.as_str(), "tcp://10.0.0.1:1")).collect();
    environment.push(("ISOTHERM_LOG", "debug"));
    let loaded = layered(&environment, &[]).unwrap();
    let [only] = loaded.warnings.as_slice() else { panic!("{:?}", loaded.warnings) };
    let only = only.to_string();
    assert!(only.contains("ISOTHERM_PORT_8081_TCP") && only.contains("and 2 more"), "{only}");
    assert!(only.contains("ISOTHERM__BUS__CELL__ADDRESS") && !only.contains("debug"), "{only}");
    assert_eq!(layered(&[("ISOTHERM_LOG", "debug")], &[]).unwrap().warnings, []);
}

#[test]
fn a_large_profile_is_read_as_a_small_one_and_its_mistakes_have_their_lines() {
    let large = format!("{GRINDER}\n{}", "# what is said of the machine\n".repeat(10_000));
    let read = |text: &str| isotherm_profile::parse(Path::new("machine.toml"), text, &[], &[]);
    assert_eq!(read(&large).unwrap(), read(GRINDER).unwrap());
    let wrong = large + "[bus.other]\ntype = \"telepathy\"\n";
    let line = wrong.lines().count();
    let errors = read(&wrong).unwrap_err();
    assert!(errors.0.iter().any(|error| error.line == Some(line)), "{errors}");
}
