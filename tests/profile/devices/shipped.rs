//! Completeness of every shipped template.

use std::collections::BTreeSet;

use isotherm_profile::template;

use super::can::on_can;
use super::opcua::on_opcua;
use super::taken;
use super::text::on_text;

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
fn every_shipped_template_is_taken_in_each_of_its_variants_and_names_its_source() {
    for name in template::names() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/profiles/devices");
        let text = std::fs::read_to_string(format!("{file}/{name}.toml")).unwrap();
        let written: toml::Table = text.parse().unwrap();
        let variants = written.get("variant").and_then(toml::Value::as_table);
        let variants = variants.into_iter().flat_map(toml::Table::keys);
        let mut devices: Vec<String> =
            variants.map(|variant| format!("template = \"{name}\"\nvariant = \"{variant}\"")).collect();
        if devices.is_empty() {
            devices.push(format!("template = \"{name}\""));
        }
        for device in devices {
            // The device is accepted on one of these lines: as a Modbus unit, as a CANopen node, as a sender of frames,
            // as a server, as a sender of text.
            let node = format!("node = 5\n{device}");
            let lines = [
                taken(&device, ""),
                on_can(&node, ""),
                on_can(&device, ""),
                on_opcua(&device, ""),
                on_text(&device, ""),
            ];
            let refused: Vec<String> =
                lines.iter().filter_map(|line| Some(line.as_ref().err()?.to_string())).collect();
            let loaded = lines.into_iter().find_map(Result::ok);
            let machine = loaded.unwrap_or_else(|| panic!("{name}: {}", refused.join("\n"))).profile;
            let found = machine.devices[0].template.clone().unwrap();
            assert!(found.title.len() > 10 && found.source.len() > 20, "{found:?}");
        }
    }
}

/// A device sends a number for a sensor with an open circuit. If it were used, the axis would move to its limit.
#[test]
fn every_shipped_template_states_the_values_of_an_open_circuit_or_lists_them_as_unverified() {
    let mut found = 0;
    for name in template::names() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/profiles/devices");
        let text = std::fs::read_to_string(format!("{file}/{name}.toml")).unwrap();
        let written: toml::Table = text.parse().unwrap();
        let unverified = written.get("unverified").and_then(toml::Value::as_array);
        let unverified = unverified.into_iter().flatten().filter_map(toml::Value::as_str);
        let is_listed = unverified.into_iter().any(|fact| fact.contains("open ") || fact.contains("broken "));
        let channels = written.get("channel").and_then(toml::Value::as_table).into_iter().flatten();
        for (channel, group) in channels {
            let is_temperature = group.get("unit").and_then(toml::Value::as_str) == Some("degC");
            // The sensor of a cold junction is inside the device.
            let is_inside = ["cold_junction", "cjc", "junction", "reference"].contains(&channel.as_str());
            if is_temperature && !is_inside {
                found += 1;
                let states = ["bad", "fault_when", "range"].iter().any(|key| group.get(*key).is_some());
                assert!(states || is_listed, "{name}.{channel}");
            }
        }
    }
    assert!(found >= 20, "{found} groups of temperatures");
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
