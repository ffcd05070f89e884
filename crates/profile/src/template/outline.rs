//! Outlines of shipped templates, for programs that write new profiles.

use toml::{Table, Value};

use super::shipped;

/// Parts of a template that a new profile names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outline {
    /// Name of the template.
    pub name: &'static str,
    /// Manufacturer and type.
    pub title: String,
    /// Temperature channels, in the notation of a profile: `3`, `"TL"`.
    pub temperatures: Vec<String>,
    /// Keys of the temperature channels that the profile must set, such as `word_order` or `scale`, each with the
    /// reason.
    pub asks: Vec<(String, String)>,
    /// Names of the targets that can receive Cz, for example "x", "y" and "z".
    pub targets: Vec<String>,
    /// Variants, one of which must be chosen. Empty if there are none.
    pub variants: Vec<String>,
    /// Whether the device needs a heartbeat. The template states the register of the heartbeat.
    pub has_heartbeat: bool,
    /// Whether the profile may state the first register of the device (key `base`).
    pub is_movable: bool,
    /// Whether the device sends lines of text, and needs a serial-ascii line.
    pub sends_text: bool,
}

/// Returns the shipped templates of Modbus devices.
pub fn on_modbus() -> impl Iterator<Item = Outline> {
    with_key("register")
}

/// Returns the shipped templates of devices that send lines of text.
pub fn on_text() -> impl Iterator<Item = Outline> {
    with_key("text")
}

/// Returns the shipped templates with this key in a channel or target, also of a variant.
fn with_key(key: &'static str) -> impl Iterator<Item = Outline> {
    shipped::names().filter_map(move |name| {
        let text: Table = shipped::text(name)?.parse().ok()?;
        let variants = text.get("variant").and_then(Value::as_table).into_iter().flat_map(Table::values);
        let tables = std::iter::once(&text).chain(variants.filter_map(Value::as_table));
        let groups = tables.flat_map(|table| ["channel", "target"].map(|kind| table.get(kind)));
        let mut groups = groups.flatten().filter_map(Value::as_table).flat_map(Table::values);
        groups.any(|group| group.get(key).is_some()).then(|| outline(name, &text, key))
    })
}

fn outline(name: &'static str, text: &Table, key: &str) -> Outline {
    let table = |key: &str| text.get(key).and_then(Value::as_table);
    let keys = |key: &str| -> Vec<String> { table(key).into_iter().flat_map(Table::keys).cloned().collect() };
    let targets = table("target").into_iter().flatten();
    let first = measuring(text);
    let takes_cz = |target: &Value| target.get("writes").and_then(Value::as_str) == Some("offset");
    Outline {
        name,
        title: text.get("title").and_then(Value::as_str).unwrap_or_default().to_owned(),
        temperatures: first.map(|(name, group)| channels(name, group)).unwrap_or_default(),
        asks: first.map(|(_, group)| asks(group)).unwrap_or_default(),
        targets: targets.filter(|(_, target)| takes_cz(target)).map(|(name, _)| name.clone()).collect(),
        variants: keys("variant"),
        has_heartbeat: text.contains_key("heartbeat"),
        is_movable: text.get("movable").and_then(Value::as_bool) == Some(true),
        sends_text: key == "text",
    }
}

/// Returns the first group of measuring channels with the unit °C. Channels for cold junctions and those with a finer
/// resolution are skipped.
fn measuring(text: &Table) -> Option<(&String, &Value)> {
    let mut groups = text.get("channel").and_then(Value::as_table).into_iter().flatten();
    let is_beside =
        |name: &str| ["cjc", "cold_junction", "fine"].iter().any(|beside| name.starts_with(beside));
    groups.find(|(name, group)| group.get("unit").and_then(Value::as_str) == Some("degC") && !is_beside(name))
}

/// Returns the channels of a group, in the notation of a profile.
fn channels(name: &str, group: &Value) -> Vec<String> {
    let number = |key: &str| group.get(key).and_then(Value::as_integer);
    match (group.get("name").and_then(Value::as_str), number("count")) {
        (Some("{n}"), Some(count)) => {
            let from = number("from").unwrap_or(0);
            (from..from + count).map(|channel| channel.to_string()).collect()
        }
        (None, None) => vec![format!("\"{name}\"")],
        _ => Vec::new(),
    }
}

fn asks(group: &Value) -> Vec<(String, String)> {
    let why = group.get("unverified").and_then(Value::as_str).unwrap_or("not stated in the manual");
    let keys = group.get("ask").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str);
    keys.map(|key| (key.to_owned(), why.to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str) -> Outline {
        on_modbus().find(|outline| outline.name == name).unwrap()
    }

    #[test]
    fn a_module_says_its_channels_and_a_control_what_it_takes() {
        let wago = of("wago-750-469");
        assert_eq!((wago.temperatures, wago.is_movable), (vec!["1".to_owned(), "2".to_owned()], true));
        let plc = of("plc-block");
        assert_eq!((plc.targets, plc.temperatures), (["x", "y", "z"].map(str::to_owned).to_vec(), vec![]));
        assert!(of("advantech-adam-6018").variants.contains(&"K".to_owned()));
        assert!(on_modbus().all(|outline| outline.name != "axiomatic-axtc4co"), "it is on CAN");
        let dcon = on_text().find(|outline| outline.name == "icp-das-i7018-dcon").unwrap();
        assert_eq!((dcon.temperatures.len(), dcon.variants[0].as_str()), (8, "checksum-off"));
        assert!(on_modbus().all(|outline| !outline.sends_text && outline.name != dcon.name));
    }

    #[test]
    fn every_thermocouple_module_has_channels_that_measure() {
        for outline in on_modbus() {
            let measures = outline.title.contains("thermocouple") || outline.title.contains("temperatures");
            assert!(!measures || !outline.temperatures.is_empty(), "{outline:?}");
        }
    }
}
