use std::path::Path;

use super::*;
use crate::gateway::store::disk::{Disk, Files};
use crate::gateway::store::documents;
use isotherm_core::output::{Account, Promise, Slots};
use isotherm_core::quantity::Moment;

const GRINDER: &str = include_str!("../../../../profiles/surface-grinder.toml");

fn profile() -> Profile {
    let mut profile = isotherm_profile::parse(Path::new("grinder.toml"), GRINDER, &[], &[]).unwrap().profile;
    profile.outputs.iter_mut().for_each(|output| output.share = Share::Ledger);
    profile
}

fn open(directory: &Path, profile: &Profile) -> Opened {
    let disk: Arc<dyn Disk> = Arc::new(Files);
    documents::open(&disk, (directory, &profile.name), false, Moment::from_nanos(1))
}

fn found(directory: &Path, profile: &Profile) -> (Entries, Option<String>) {
    let (before, trouble) = match open(directory, profile).found {
        Ok(content) => (content.unwrap_or_default().outputs, None),
        Err(why) => (Entries::new(), Some(why)),
    };
    (super::found(profile, before, trouble.is_none(), |_| false), trouble)
}

/// Saves entries, with the number.
fn save(directory: &Path, profile: &Profile, entries: &Entries) {
    let mut file = open(directory, profile).file;
    entries.iter().for_each(|(name, entry)| file.set_output(name, entry));
    file.save().and_then(|()| file.save_number()).unwrap();
}

/// Complete entries of all outputs.
fn entries(profile: &Profile) -> Entries {
    let mut promises = Slots::default();
    assert!(promises.push(Promise { value: Counts(152), at: Moment::from_nanos(1), is_under_way: true }));
    let account = Some(Account { base: Counts(120), share: Counts(31), doubt: None });
    let kept = output::SavedOutput { in_order: false, account, stood: Some(Counts(151)), promises };
    let entry = |output: &Output| Entry::new(places::of_output(profile, output), kept);
    profile.outputs.iter().map(|output| (output.name.clone(), entry(output))).collect()
}

fn kept(directory: &Path, profile: &Profile) -> Entries {
    let entries = entries(profile);
    save(directory, profile, &entries);
    entries
}

fn text_of(profile: &Profile) -> String {
    let directory = tempfile::tempdir().unwrap();
    kept(directory.path(), profile);
    std::fs::read_to_string(directory.path().join(format!("{}.state.json", profile.name))).unwrap()
}

#[test]
fn what_is_kept_is_found_again() {
    let directory = tempfile::tempdir().unwrap();
    let profile = profile();
    assert_eq!(found(directory.path(), &profile), (Entries::new(), None));
    let entries = kept(directory.path(), &profile);
    assert_eq!(found(directory.path(), &profile), (entries, None));
}

#[test]
fn a_file_that_cannot_be_used_puts_every_share_in_question_and_is_kept_aside_before_it_is_replaced() {
    let profile = profile();
    let name = format!("{}.state.json", profile.name);
    let whole = text_of(&profile);
    let half = whole[..whole.len() / 2].to_owned();
    let changed = whole.replacen("\"share\":31", "\"share\":30", 1);
    let huge = whole.replace("\"share\":31", "\"share\":9223372036854775807");
    for spoilt in [half.as_str(), changed.as_str(), huge.as_str(), "", "{}"] {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join(&name), spoilt).unwrap();
        for _ in 0..2 {
            let (entries, trouble) = found(directory.path(), &profile);
            assert!(trouble.is_some_and(|why| why.contains(&name)), "{spoilt}");
            assert_eq!(entries.len(), profile.outputs.len());
            let accounts = entries.values().map(|entry| entry.kept.account.unwrap());
            assert!(
                accounts.clone().all(|one| one.doubt == Some(Doubt::Unreadable) && one.share == Counts(0))
            );
        }
        let (entries, _) = found(directory.path(), &profile);
        save(directory.path(), &profile, &entries);
        let aside = directory.path().join(&name).with_extension("json.bad");
        assert_eq!(std::fs::read_to_string(aside).unwrap(), spoilt);
        assert_eq!(found(directory.path(), &profile), (entries, None), "the question outlives the file");
    }
}

#[test]
fn a_run_that_can_write_nothing_when_it_begins_leaves_nothing_in_order_and_what_is_known_is_found_all_the_same()
 {
    let directory = tempfile::tempdir().unwrap();
    let profile = profile();
    let mut in_order = entries(&profile);
    in_order.values_mut().for_each(|entry| entry.kept.in_order = true);
    save(directory.path(), &profile, &in_order);
    let file = open(directory.path(), &profile).file;
    assert!(file.mark_begun() && file.mark_begun());
    assert_eq!(found(directory.path(), &profile), (entries(&profile), None), "and no run ended in order");
    save(directory.path(), &profile, &in_order);
    assert_eq!(found(directory.path(), &profile), (in_order, None));
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2);
}

#[test]
fn a_register_that_was_ours_alone_and_held_something_is_a_question_when_it_is_to_be_shared() {
    let profile = profile();
    for (stood, is_question) in [(151, true), (0, false)] {
        let mut before = entries(&profile);
        before
            .values_mut()
            .for_each(|entry| (entry.kept.account, entry.kept.stood) = (None, Some(Counts(stood))));
        let found = super::found(&profile, before, true, |_| false);
        let doubts =
            found.values().all(|entry| entry.kept.account.is_some_and(|one| one.doubt == Some(Doubt::Lost)));
        assert_eq!(doubts, is_question, "{stood}");
    }
}

#[test]
fn what_is_no_number_in_a_register_spoils_nobody_elses_account() {
    assert!(!fits(Counts(i64::MAX / 4)) && fits(Counts(i64::from(u32::MAX))));
}

#[test]
fn a_ledger_that_is_gone_while_the_state_remembers_an_offset_is_a_question() {
    let profile = profile();
    let entries = super::found(&profile, Entries::new(), true, |_| true);
    assert_eq!(entries.len(), profile.outputs.len());
    assert!(entries.values().all(|entry| entry.kept.account.unwrap().doubt == Some(Doubt::Lost)));
}

#[test]
fn what_is_known_goes_with_the_register_not_with_the_name() {
    let directory = tempfile::tempdir().unwrap();
    let mut profile = profile();
    let entries = kept(directory.path(), &profile);
    let former = profile.outputs[0].name.clone();
    profile.outputs[0].name = "renamed".to_owned();
    assert_eq!(found(directory.path(), &profile).0["renamed"], entries[&former]);
    let scale = &mut profile.outputs[0].encoding.scale;
    *scale = isotherm_core::codec::Scale::of(2.0 * scale.get());
    profile.outputs[0].name.clone_from(&former);
    let elsewhere = found(directory.path(), &profile).0[&former].kept.account.unwrap();
    assert_eq!((elsewhere.doubt, elsewhere.share), (Some(Doubt::Elsewhere), Counts::ZERO));
}

#[test]
fn an_entry_of_layout_5_is_known_by_its_register_in_words_and_taken_once() {
    let profile = profile();
    let of_layout_5 = |output: &Output, entry: &Entry| {
        let register = Some(in_words(&profile, output));
        Entry { place: None, register, ..entry.clone() }
    };
    let entries = entries(&profile);
    let mut before: Entries = (profile.outputs.iter())
        .map(|output| (output.name.clone(), of_layout_5(output, &entries[&output.name])))
        .collect();
    let text = serde_json::to_string(&before).unwrap();
    assert!(text.contains("\"register\":\"holding:") && !text.contains("\"place\""), "{text}");
    assert_eq!(super::found(&profile, before.clone(), true, |_| false), entries, "the places are added");
    let first = &profile.outputs[0].name;
    before.get_mut(first).unwrap().register = Some("holding:7 (40008) of cnc, i16 msw-first".to_owned());
    let found = super::found(&profile, before, true, |_| false);
    assert_eq!(found[first].kept.account.unwrap().doubt, Some(Doubt::Elsewhere));
}

#[test]
fn a_register_of_another_bus_or_unit_is_another_one_and_another_name_of_its_device_is_none() {
    let profile = profile();
    let entries = entries(&profile);
    let name = &profile.outputs[0].name;
    let doubt = |changed: &Profile| {
        super::found(changed, entries.clone(), true, |_| false)[name].kept.account.unwrap().doubt
    };
    let device = profile.outputs[0].device;
    let mut renamed = profile.clone();
    renamed.devices[device.0].name = "another".to_owned();
    assert_eq!(doubt(&renamed), None);
    let mut unit = profile.clone();
    unit.devices[device.0].unit += 1;
    assert_eq!(doubt(&unit), Some(Doubt::Elsewhere));
    let mut bus = profile.clone();
    bus.buses[profile.device(device).bus.0].address = "10.9.9.9:502".to_owned();
    assert_eq!(doubt(&bus), Some(Doubt::Elsewhere));
}
