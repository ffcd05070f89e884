//! Layers: the file, the local file beside it, variables and flags.

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
            "a number is wanted",
        ),
        (&[], &[("axis.z.limt", "3")], "--set axis.z.limt", "`limit`"),
        (&[], &[("axis.z.limit", "nan")], "--set axis.z.limit", "finite"),
        (&[], &[("axis.z.model[0].name", "x")], "--set axis.z.model[0].name", "`model`"),
        (&[], &[("bus.cell", "x")], "--set bus.cell", "a table is wanted"),
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
