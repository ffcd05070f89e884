use super::*;

/// Lines of the model in a shipped profile.
fn model(name: &str) -> Vec<&'static str> {
    let (_, text) = text(name).unwrap();
    text.lines()
        .skip_while(|line| !line.starts_with("[[axis."))
        .take_while(|line| *line != "]")
        .skip(1)
        .collect()
}

#[test]
fn the_lathe_on_can_has_the_gains_and_the_plant_of_the_lathe() {
    assert_eq!(model("xc100-lathe-can"), model("xc100-lathe"));
    assert_eq!(model("xc100-lathe").len(), 7);
    let plant = |name| format!("{:?}", with_plant(name, &[]).unwrap().1);
    assert_eq!(plant("xc100-lathe-can"), plant("xc100-lathe"));
}

#[test]
fn the_mill_under_linuxcnc_has_the_gains_of_the_spindle() {
    assert_eq!(model("linuxcnc-mill"), model("spindle-hmc"));
    assert_eq!(model("spindle-hmc").len(), 5);
}

#[test]
fn a_key_of_a_shipped_machine_can_be_overridden() {
    let set = [("bus.field.interface".to_owned(), "can7".to_owned())];
    let (profile, _) = with_plant("xc100-lathe-can", &set).unwrap();
    assert!(profile.buses.iter().any(|bus| bus.address == "can7"));
}

#[test]
fn a_part_of_a_name_is_no_machine_and_the_whole_name_is_suggested() {
    let why = with_plant("grinder", &[]).unwrap_err().to_string();
    assert!(why.contains("there is no machine `grinder`; did you mean `surface-grinder`?"), "{why}");
}

#[test]
fn a_similar_name_is_suggested_only_for_a_name_that_is_unknown() {
    for (path, suggested) in [
        ("surface-grinder", None),
        ("surface-grindr", Some("surface-grinder")),
        ("grinder", Some("surface-grinder")),
        ("edm", Some("sinker-edm")),
        ("xc100-lathe-can", None),
        ("Cargo.toml", None),
        ("nothing like them", None),
    ] {
        assert_eq!(meant(Path::new(path)), suggested, "{path}");
    }
}
