use super::*;
use crate::compensation::model::Reference;
use crate::reading::SignalId;

fn profile(signals: &[&str]) -> Profile {
    let text = include_str!("../../../profiles/surface-grinder.toml");
    let parsed = crate::profile::parse(Path::new("m.toml"), text, &[], &[]);
    let mut profile = parsed.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let by_name = |name: &str| profile.signals.iter().find(|signal| signal.name == name).unwrap().clone();
    profile.signals = signals.iter().map(|name| by_name(name)).collect();
    profile
}

const BED_FIRST: [&str; 2] = ["bed", "wheelhead"];

/// What a machine remembers whose "start" references are these, by signal.
fn machine(references: [f64; 2]) -> Machine {
    let captures = references.map(|value| serde_json::json!({ "value": value, "gathering": null }));
    let json = serde_json::json!({
        "on_since": null, "was_on": true, "was_zeroed": null, "start": captures, "zero": captures
    });
    serde_json::from_value(json).unwrap()
}

#[test]
fn what_was_saved_is_recalled_and_a_missing_file_is_no_trouble() {
    let directory = tempfile::tempdir().unwrap();
    let profile = profile(&BED_FIRST);
    let path = Memory::path(directory.path(), &profile);
    let nothing = Memory::recall(&path, &profile);
    assert_eq!((nothing.machine, nothing.trouble), (Machine::default(), None));
    let saved = machine([20.0, 21.0]);
    Memory::new(&profile, Moment::default(), &saved, BTreeMap::new()).save(&path).unwrap();
    let recalled = Memory::recall(&path, &profile);
    assert_eq!((recalled.machine, recalled.trouble), (saved, None));
}

#[test]
fn a_file_that_cannot_be_used_is_set_aside_and_kept() {
    let profile = profile(&BED_FIRST);
    let older = serde_json::json!({
        "version": 0, "at": Moment::default(), "signals": [], "machine": Machine::default(), "verified_um": {}
    });
    for content in ["{ half a fi", &older.to_string()] {
        let directory = tempfile::tempdir().unwrap();
        let path = Memory::path(directory.path(), &profile);
        std::fs::write(&path, content).unwrap();
        let recalled = Memory::recall(&path, &profile);
        assert_eq!(recalled.machine, Machine::default());
        let trouble = recalled.trouble.unwrap();
        assert!(trouble.contains("it is kept as") && trouble.contains("begin anew"), "{trouble}");
        assert!(!path.exists());
        assert_eq!(std::fs::read_to_string(path.with_extension("json.bad")).unwrap(), content);
    }
}

#[test]
fn references_follow_their_signals_where_the_profile_was_reordered() {
    let directory = tempfile::tempdir().unwrap();
    let (before, after) = (profile(&BED_FIRST), profile(&["scale_z", "wheelhead", "bed"]));
    let path = Memory::path(directory.path(), &before);
    Memory::new(&before, Moment::default(), &machine([20.0, 21.0]), BTreeMap::new()).save(&path).unwrap();
    let machine = Memory::recall(&path, &after).machine;
    let references = [0, 1, 2].map(|place| machine.reference(Reference::Start, SignalId(place)));
    assert_eq!(references, [None, Some(21.0), Some(20.0)]);
}
