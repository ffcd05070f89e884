use std::path::Path;

use super::*;
use isotherm_core::codec::{Register, Scale};

fn grinder() -> Profile {
    let text = include_str!("../../../profiles/surface-grinder.toml");
    isotherm_profile::parse(Path::new("grinder.toml"), text, &[], &[]).unwrap().profile
}

/// Places after a start with the second profile, when the first one had left so much in each output.
fn started(before: &Profile, after: &Profile, held_um: Option<f64>) -> Moves {
    let places = Places::of(before);
    let left = places.outputs.iter().map(|(name, place)| {
        let known = KnownOutput { place: place.clone(), held_um, was_driven: true };
        (name.clone(), known)
    });
    let left = left.collect();
    Moves::new(places.after(after, &left, false), after)
}

fn kinds(events: &[Event]) -> Vec<String> {
    let entry = |event: &Event| event.entry(isotherm_core::quantity::Moment::default()).kind.to_string();
    events.iter().map(entry).collect()
}

#[test]
fn a_place_names_line_device_register_and_worth_of_a_count() {
    let profile = grinder();
    let output = &profile.outputs[0];
    let device = profile.device(output.device);
    let place = of_output(&profile, output);
    assert_eq!((&place.bus, place.unit), (&profile.bus(device.bus).address, device.unit));
    assert_eq!(place.address, output.address.to_string());
    assert_eq!(place.scale.to_bits(), output.encoding.scale.get().to_bits());
    assert_eq!(place.axis, profile.axis(output.axis).settings.name);
    let places = Places::of(&profile);
    assert_eq!((places.outputs.len(), places.signals.len()), (profile.outputs.len(), profile.signals.len()));
    let text = serde_json::to_string(&places).unwrap();
    assert_eq!(serde_json::from_str::<Places>(&text).unwrap(), places);
    assert!(!text.contains("former"), "{text}");
}

#[test]
fn the_same_profile_bars_nothing_and_reports_nothing() {
    let profile = grinder();
    let moves = started(&profile, &profile, Some(20.0));
    assert_eq!(moves.barred(&profile).len() + moves.events(&Releases::default(), &profile).len(), 0);
    assert_eq!(moves.places.explain().len(), 0);
}

#[test]
fn a_moved_output_bars_its_axis_until_a_person_confirms_and_its_first_read_is_reported_once() {
    let before = grinder();
    let mut after = before.clone();
    let id = after.outputs.iter().position(|output| output.writes.is_cz()).unwrap();
    let scale = after.outputs[id].encoding.scale.get();
    after.outputs[id].encoding.scale = Scale::of(-scale);
    let (name, axis) = (after.outputs[id].name.clone(), after.outputs[id].axis);
    let mut moves = started(&before, &after, Some(20.0));
    let barred = moves.barred(&after);
    assert_eq!(barred.iter().map(|(axis, _)| *axis).collect::<Vec<_>>(), [axis]);
    let why = &barred[0].1;
    let was =
        format!("output {name} was scale {scale}, 20.0 µm of ours were verified there; it is scale -{scale}");
    assert_eq!(why.cause, was);
    assert_eq!(kinds(&moves.events(&Releases::default(), &after)), ["output-moved"]);
    let (event, why) = moves.read(OutputId(id), &name, || "-20.0 µm".to_owned()).unwrap();
    assert_eq!(kinds(&[event]), ["output-moved"]);
    assert_eq!(why.cause, format!("{was}; its register holds -20.0 µm now"));
    assert!(moves.read(OutputId(id), &name, || panic!("it was read before")).is_none());
    assert!(moves.confirm("another axis", &after).is_empty() && moves.is_in_doubt(&name));
    assert_eq!(kinds(&moves.confirm(&after.axis(axis).settings.name, &after)), ["place-confirmed"]);
    assert!(!moves.is_in_doubt(&name) && moves.barred(&after).is_empty());
}

#[test]
fn what_is_left_in_a_position_counts_by_the_diameter_and_only_in_the_same_register() {
    let profile = grinder();
    let now = OutputPlace { diameter: false, ..of_output(&profile, &profile.outputs[0]) };
    let before =
        |place: OutputPlace| Places { outputs: [("a".to_owned(), place)].into(), ..Places::default() };
    let wide = OutputPlace { diameter: true, ..now.clone() };
    let elsewhere = OutputPlace { unit: now.unit + 1, ..now.clone() };
    for (was, is, left) in [
        (&now, &now, Some(8.0)),
        (&now, &wide, Some(4.0)),
        (&wide, &now, Some(16.0)),
        (&elsewhere, &now, None),
    ] {
        assert_eq!(before(was.clone()).left_in_position(is, "a", 8.0), left);
    }
    assert_eq!(before(now.clone()).left_in_position(&now, "b", 8.0), None);
}

/// The grinder, and the same with its offset in another register.
fn elsewhere() -> (Profile, Profile, usize) {
    let before = grinder();
    let mut after = before.clone();
    let place = after.outputs.iter().position(|output| output.writes.is_cz()).unwrap();
    let offset = after.outputs[place].address.register().unwrap().offset + 400;
    after.outputs[place].address = format!("holding:{offset}").parse::<Register>().unwrap().into();
    (before, after, place)
}

#[test]
fn a_former_place_has_the_bounds_that_the_state_has_and_none_in_a_document_without_them() {
    let (before, after, place) = elsewhere();
    let name = &before.outputs[place].name;
    let left = |places: &Places| {
        let known =
            |place: &OutputPlace| KnownOutput { place: place.clone(), held_um: Some(20.0), was_driven: true };
        let left = places.outputs.iter().map(|(name, place)| (name.clone(), known(place)));
        left.collect()
    };
    let places = Places::of(&before);
    let known = left(&places);
    let mut saved = serde_json::to_value(&places).unwrap();
    let found = places.after(&after, &known, false);
    let former = found.former.iter().find(|former| former.output == *name).unwrap();
    assert_eq!(former.bounds, Some(bounds_of(&before, &before.outputs[place])));
    let events = Moves::new(found.clone(), &after).events(&Releases::of(&after, &found.former, &[]), &after);
    assert_eq!(kinds(&events), ["output-moved", "register-left"]);
    let text = events[1].entry(isotherm_core::quantity::Moment::default()).text;
    assert!(text.contains(&format!("isotherm release grinder.toml {name}")), "{text}");
    // Over a further start the bounds are those of the place, not those of the profile.
    let again = found.clone().after(&after, &left(&found), false);
    assert_eq!(again.former[0].bounds, found.former[0].bounds);

    assert!(saved.as_object_mut().unwrap().remove("bounds").is_some());
    let of_today: Places = serde_json::from_value(saved).unwrap();
    let found = of_today.clone().after(&after, &left(&of_today), false);
    assert_eq!(found.former[0].bounds, None);
    let events = Moves::new(found.clone(), &after).events(&Releases::of(&after, &found.former, &[]), &after);
    let text = events[1].entry(isotherm_core::quantity::Moment::default()).text;
    assert!(text.contains("an earlier version of the program wrote it; set that register to zero"), "{text}");
}

#[test]
fn what_the_ledger_has_of_a_former_place_is_kept_until_nothing_is_left_there() {
    let (before, after, place) = elsewhere();
    let output = &before.outputs[place];
    let kept = isotherm_core::output::Kept { in_order: true, ..Default::default() };
    let entry = Entry::new(of_output(&before, output), kept);
    let entries: Entries = [(output.name.clone(), entry.clone())].into();
    let mut places = started_places(&before, &after);
    places.keep(&entries);
    assert_eq!(places.kept, std::slice::from_ref(&entry));
    // The ledger has another register under its name by now.
    let other = Entry::new(of_output(&after, &after.outputs[place]), kept);
    let entries: Entries = [(output.name.clone(), other.clone())].into();
    places.keep(&entries);
    assert_eq!(places.kept, std::slice::from_ref(&entry));
    assert!(
        places.is_of_a_release("cnc_z_released", &entry) && !places.is_of_a_release(&output.name, &other)
    );
    // A release has moved the register.
    let kept = isotherm_core::output::Kept { in_order: false, ..kept };
    let newer = Entry::new(of_output(&before, output), kept);
    places.keep(&[("cnc_z_released".to_owned(), newer.clone())].into());
    assert_eq!(
        (places.kept.as_slice(), places.kept_of(&of_output(&before, output))),
        (&[newer][..], Some(kept))
    );
    places.former.clear();
    places.keep(&entries);
    assert_eq!(places.kept, []);
}

fn started_places(before: &Profile, after: &Profile) -> Places {
    Places::clone(&started(before, after, Some(20.0)).places)
}

#[test]
fn a_release_ends_when_an_output_has_its_register_again() {
    let (before, after, place) = elsewhere();
    let mut places = started_places(&before, &after);
    let former = places.former[0].clone();
    places.releases.push(Release {
        output: former.output.clone(),
        place: former.place.clone(),
        bounds: bounds_of(&before, &before.outputs[place]),
        from_um: 20.0,
        held_um: 12.0,
        stage: isotherm_core::place::Stage::Begun,
        by: "by a test".to_owned(),
    });
    let text = serde_json::to_string(&places).unwrap();
    assert_eq!(serde_json::from_str::<Places>(&text).unwrap(), places);
    let nothing = BTreeMap::new();
    assert_eq!(places.clone().after(&after, &nothing, false).releases.len(), 1);
    assert_eq!(places.clone().after(&before, &nothing, false).releases.len(), 0);
    let names: BTreeMap<String, String> = [(former.output, "feed_z".to_owned())].into();
    assert_eq!(places.renamed(&names).releases[0].output, "feed_z");
}
