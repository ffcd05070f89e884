//! Summaries of templates, for programs that write new profiles.

use std::borrow::Cow;
use std::path::Path;

use toml::{Table, Value};

use super::find::DIRECTORY;
use super::shipped;
use crate::safe_file;
use crate::sources::names_in;

/// Summary of a template: the names that a new profile uses.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Name of the template, as the key `template` of a device states it.
    pub name: String,
    /// Manufacturer and type of the device.
    pub title: String,
    /// Temperature channels, in the notation of a profile: `3`, `"TL"`.
    pub temperatures: Vec<String>,
    /// Keys of the temperature channels that the profile must set, such as `word_order` or `scale`, each with the
    /// reason.
    pub asks: Vec<(String, String)>,
    /// Targets that can receive Cz, for example "x", "y" and "z".
    pub targets: Vec<OutlineTarget>,
    /// Names of the channels that are one bit, for example "on".
    pub bits: Vec<String>,
    /// Variants, one of which must be chosen. Empty if the template has no variants.
    pub variants: Vec<String>,
    /// Whether the device needs a heartbeat. The template states the register of the heartbeat.
    pub has_heartbeat: bool,
    /// Whether the profile may state the first register of the device (key `base`).
    pub is_movable: bool,
    /// Whether the device sends lines of text, so that it needs a serial-ascii line.
    pub sends_text: bool,
}

/// Target of a template that can receive Cz, with the encoding that the template states.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlineTarget {
    /// Name of the target, as the key `channel` of an output states it.
    pub name: String,
    /// Type of the value; `None` if the template leaves it to the profile.
    pub data_type: Option<String>,
    /// Order of the registers; `None` for a value of one register, or if the template leaves it to the profile.
    pub word_order: Option<String>,
    /// Micrometres per count; `None` if the template leaves it to the profile.
    pub scale: Option<f64>,
}

/// Returns the summaries of all templates of Modbus devices and of devices that send lines of text. They include the
/// user's own templates in the folder `devices` of this directory. A template of the user replaces the shipped one of
/// the same name.
pub fn outlines(directory: &Path) -> Vec<Outline> {
    let folder = directory.join(DIRECTORY);
    let own = names_in(&folder, ".toml");
    let mut names: Vec<&str> = shipped::names().collect();
    names.extend(own.iter().map(String::as_str));
    names.sort_unstable();
    names.dedup();
    let text = |name: &str| -> Option<Cow<'static, str>> {
        if own.iter().any(|known| known == name) {
            let path = folder.join(format!("{name}.toml"));
            return safe_file::read_text_of(&path, safe_file::LARGEST_PROFILE).ok().map(Cow::Owned);
        }
        shipped::text(name).map(Cow::Borrowed)
    };
    let outlined = |name: &str| outline(name, &text(name)?.parse::<Table>().ok()?);
    names.into_iter().filter_map(outlined).collect()
}

/// Returns whether a channel or target of the template, or of a variant, has this key.
fn has_key(text: &Table, key: &str) -> bool {
    let variants = text.get("variant").and_then(Value::as_table).into_iter().flat_map(Table::values);
    let tables = std::iter::once(text).chain(variants.filter_map(Value::as_table));
    let groups = tables.flat_map(|table| ["channel", "target"].map(|kind| table.get(kind)));
    let mut groups = groups.flatten().filter_map(Value::as_table).flat_map(Table::values);
    groups.any(|group| group.get(key).is_some())
}

/// Returns the summary of a template. `None` if the device is neither on Modbus nor sends lines of text.
fn outline(name: &str, text: &Table) -> Option<Outline> {
    let sends_text = has_key(text, "text");
    if !sends_text && !has_key(text, "register") {
        return None;
    }
    let table = |key: &str| text.get(key).and_then(Value::as_table);
    let keys = |key: &str| -> Vec<String> { table(key).into_iter().flat_map(Table::keys).cloned().collect() };
    let first = measuring(text);
    Some(Outline {
        name: name.to_owned(),
        title: text.get("title").and_then(Value::as_str).unwrap_or_default().to_owned(),
        temperatures: first.map(|(name, group)| channels(name, group)).unwrap_or_default(),
        asks: first.map(|(_, group)| asks(group)).unwrap_or_default(),
        targets: table("target").into_iter().flatten().filter_map(target).collect(),
        bits: table("channel").into_iter().flatten().filter_map(bit).collect(),
        variants: keys("variant"),
        has_heartbeat: text.contains_key("heartbeat"),
        is_movable: text.get("movable").and_then(Value::as_bool) == Some(true),
        sends_text,
    })
}

/// Returns the summary of a target. `None` if the target does not receive Cz as an offset.
fn target((name, target): (&String, &Value)) -> Option<OutlineTarget> {
    let word = |key: &str| target.get(key).and_then(Value::as_str).map(str::to_owned);
    let scale = target.get("scale");
    (word("writes").as_deref() == Some("offset")).then(|| OutlineTarget {
        name: name.clone(),
        data_type: word("type"),
        word_order: word("word_order"),
        scale: scale.and_then(|scale| {
            scale.as_float().or_else(|| Some(f64::from(i32::try_from(scale.as_integer()?).ok()?)))
        }),
    })
}

/// Returns the name of a channel that is one bit: a coil, a discrete input, or a bit of a register. `None` for any
/// other channel, and for a group of several channels.
fn bit((name, group): (&String, &Value)) -> Option<String> {
    let register = group.get("register").and_then(Value::as_str)?;
    let is_bit = ["coil:", "discrete:"].iter().any(|table| register.starts_with(table))
        || register.rsplit_once('.').is_some_and(|(_, bit)| bit.parse::<u8>().is_ok());
    (is_bit && group.get("type").is_none() && group.get("count").is_none()).then(|| name.clone())
}

/// Returns the first group of measuring channels with the unit °C. Channels for cold junctions, and channels with a
/// finer resolution, are skipped.
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

    fn shipped() -> Vec<Outline> {
        outlines(Path::new("/nowhere"))
    }

    fn of(name: &str) -> Outline {
        shipped().into_iter().find(|outline| outline.name == name).unwrap()
    }

    #[test]
    fn a_module_says_its_channels_and_a_control_what_it_takes() {
        let wago = of("wago-750-469");
        assert_eq!((wago.temperatures, wago.is_movable), (vec!["1".to_owned(), "2".to_owned()], true));
        let plc = of("plc-block");
        let names: Vec<&str> = plc.targets.iter().map(|target| target.name.as_str()).collect();
        assert_eq!((names, plc.temperatures), (vec!["x", "y", "z"], vec![]));
        let z = &plc.targets[2];
        assert_eq!((z.data_type.as_deref(), z.word_order.as_deref()), (Some("i32"), Some("msw-first")));
        assert!(z.scale.is_some_and(|scale| (scale - 0.1).abs() < 1e-12), "{z:?}");
        assert!(plc.bits.contains(&"referenced".to_owned()) && !plc.bits.contains(&"echo_z".to_owned()));
        assert!(of("linuxcnc-eoffset").bits.contains(&"on".to_owned()));
        assert!(of("advantech-adam-6018").variants.contains(&"K".to_owned()));
        assert!(shipped().iter().all(|outline| outline.name != "axiomatic-axtc4co"), "it is on CAN");
        let dcon = of("icp-das-i7018-dcon");
        assert!(dcon.sends_text);
        assert_eq!((dcon.temperatures.len(), dcon.variants[0].as_str()), (8, "checksum-off"));
    }

    #[test]
    fn every_thermocouple_module_has_channels_that_measure() {
        for outline in shipped().iter().filter(|outline| !outline.sends_text) {
            let measures = outline.title.contains("thermocouple") || outline.title.contains("temperatures");
            assert!(!measures || !outline.temperatures.is_empty(), "{outline:?}");
        }
    }

    #[test]
    fn a_template_of_the_user_is_offered_and_replaces_the_shipped_one_of_its_name() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join(DIRECTORY);
        std::fs::create_dir(&folder).unwrap();
        let own = "title = \"own\"\nsource = \"here\"\n[target.z]\nwrites = \"offset\"\nregister = \"holding:7\"\n\
                   type = \"i16\"\nscale = 1\n";
        for name in ["shop-cnc", "plc-block"] {
            std::fs::write(folder.join(format!("{name}.toml")), own).unwrap();
        }
        std::fs::write(folder.join("broken.toml"), "title = ").unwrap();
        let found = outlines(home.path());
        for name in ["shop-cnc", "plc-block"] {
            let outline = found.iter().find(|outline| outline.name == name).unwrap();
            assert_eq!((outline.title.as_str(), outline.targets.len()), ("own", 1), "{name}");
            assert!(outline.targets[0].scale.is_some_and(|scale| (scale - 1.0).abs() < 1e-12));
        }
        assert!(found.iter().all(|outline| outline.name != "broken"));
    }
}
