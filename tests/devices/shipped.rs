//! Every shipped template: there, whole, and used by a test that decodes its examples.

use std::collections::BTreeSet;

use isotherm_profile::template;

use super::can::{CAN, on_can};
use super::taken;

fn files() -> BTreeSet<String> {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/profiles/devices");
    let names = std::fs::read_dir(directory).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().to_str().unwrap().to_owned());
    names.filter_map(|name| name.strip_suffix(".toml").map(str::to_owned)).collect()
}

#[test]
fn every_file_of_the_directory_is_part_of_the_program() {
    let shipped: BTreeSet<String> = template::names().map(str::to_owned).collect();
    assert_eq!(shipped, files());
}

#[test]
fn every_dbc_file_of_the_directory_belongs_to_a_template() {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/profiles/devices");
    let read = |name: &str| std::fs::read_to_string(format!("{directory}/{name}.toml")).unwrap();
    let named: Vec<String> = template::names().map(read).collect();
    let mut found = 0;
    for entry in std::fs::read_dir(directory).unwrap() {
        let name = entry.unwrap().file_name().to_str().unwrap().to_owned();
        if name.ends_with(".dbc") {
            found += 1;
            assert!(named.iter().any(|text| text.contains(&format!("\"{name}\""))), "nobody names {name}");
        }
    }
    assert_eq!(found, 1);
}

#[test]
fn every_shipped_template_can_be_read_and_names_its_source() {
    for name in template::names() {
        let device = format!("template = \"{name}\"");
        let on_its_line = match CAN.iter().find(|(known, _)| *known == name) {
            Some((_, node)) => on_can(&format!("{node}{device}"), ""),
            None => taken(&device, ""),
        };
        let found = match on_its_line {
            Ok(loaded) => loaded.profile.devices[0].template.clone().unwrap(),
            // Where it has variants, the first will do.
            Err(errors) => {
                let help = errors.0[0].help.clone().unwrap_or_default();
                let variant = help.split("\"…\": ").nth(1).unwrap_or_else(|| panic!("{name}: {errors}"));
                let variant = variant.split([' ', ',']).next().unwrap();
                let device = format!("{device}\nvariant = \"{variant}\"");
                let loaded = taken(&device, "").unwrap_or_else(|errors| panic!("{name}: {errors}"));
                loaded.profile.devices[0].template.clone().unwrap()
            }
        };
        assert!(found.title.len() > 10 && found.source.len() > 20, "{found:?}");
    }
}

#[test]
fn every_shipped_template_has_an_example_that_is_decoded_or_written() {
    let tests =
        [include_str!("can.rs"), include_str!("decoded.rs"), include_str!("../faults/targets.rs")].concat();
    for name in template::names() {
        let written = [format!("\"{name}\""), format!("\\\"{name}\\\"")];
        assert!(written.iter().any(|written| tests.contains(written)), "{name} has no example");
    }
}

#[test]
fn the_schema_of_a_template_knows_the_keys_of_signals_outputs_and_checks() {
    let schema = template::schema();
    let keys = |table: &str| {
        let pointer = format!("/properties/{table}/additionalProperties/properties");
        schema.pointer(&pointer).unwrap().as_object().unwrap().keys().cloned().collect::<Vec<_>>()
    };
    for (table, key) in
        [("channel", "fault_when"), ("target", "largest_step"), ("check", "equals"), ("check", "of")]
    {
        assert!(keys(table).iter().any(|known| known == key), "{table}.{key}");
    }
    assert!(!keys("channel").iter().any(|key| key == "device"));
}
