use std::path::Path;

use super::*;
use isotherm_core::codec::{
    Address, BitField, BitKind, ByteOrder, CanId, CanMatch, DataType, Encoding, Field, Node, Object,
    Register, Scale, Selector, WordOrder,
};
use isotherm_core::namespaces::Located;

fn grinder() -> Profile {
    let text = include_str!("../../../../profiles/surface-grinder.toml");
    isotherm_profile::parse(Path::new("grinder.toml"), text, &[], &[]).unwrap().profile
}

/// Places after a start with the second profile, if the first one had left this Cz in each output.
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
    let was = format!(
        "output {name} has changed: from scale {scale} to scale -{scale}; 20.0 µm from the gateway were \
         verified before the change"
    );
    assert_eq!(why.cause, was);
    assert_eq!(kinds(&moves.events(&Releases::default(), &after)), ["output-moved"]);
    let (event, why) = moves.read(OutputId(id), &name, || "-20.0 µm".to_owned()).unwrap();
    assert_eq!(kinds(&[event]), ["output-moved"]);
    assert_eq!(why.cause, format!("{was}; the register holds -20.0 µm now"));
    let name_of_axis = &after.axis(axis).settings.name;
    assert!(moves.is_why(name_of_axis, &barred[0].1) && moves.is_why(name_of_axis, &why));
    assert!(!moves.is_why("another axis", &why));
    assert!(!moves.is_why(name_of_axis, &"switched off by a person".into()));
    assert!(moves.read(OutputId(id), &name, || panic!("it was read before")).is_none());
    assert!(moves.confirm("another axis", &after).is_empty() && moves.is_in_doubt(&name));
    assert_eq!(kinds(&moves.confirm(&after.axis(axis).settings.name, &after)), ["place-confirmed"]);
    assert!(!moves.is_in_doubt(&name) && moves.barred(&after).is_empty());
}

const SERVER: &str = r#"
    [machine]
    name = "mill"
    [bus.control]
    type = "opcua"
    address = "opc.tcp://127.0.0.1:4840"
    security = "none"
    [device.cnc]
    bus = "control"
    [signal.bed]
    device = "cnc"
    node = "ns=2;s=bed"
    unit = "degC"
    max_rate = "none"
    [axis.z]
    limit = 40.0
    step = 1.0
    rate = 1.0
    every = "1s"
    on_fault = { action = "hold" }
    [[axis.z.model]]
    name = "bed"
    kind = "linear"
    terms = [{ signal = "bed", gain = 1.0, reference = 20.0 }]
    [output.offset]
    axis = "z"
    device = "cnc"
    writes = "offset"
    node = "ns=2;s=offset"
    type = "i32"
    scale = 0.1
"#;

fn of(text: &str) -> Profile {
    isotherm_profile::parse(Path::new("mill.toml"), text, &[], &[]).unwrap().profile
}

#[test]
fn a_node_that_is_named_by_its_uri_instead_of_its_index_is_the_same_place() {
    let (by_index, by_uri) = (of(SERVER), of(&SERVER.replace("ns=2;", "nsu=urn:mill;")));
    for (uri, moved) in [(None, 1), (Some("urn:lathe"), 1), (Some("urn:mill"), 0)] {
        let mut known = KnownNamespaces::default();
        uri.into_iter().for_each(|uri| known.remember(2, uri.to_owned()));
        for (before, after) in [(&by_index, &by_uri), (&by_uri, &by_index)] {
            let mut moves = Moves::new(Places::of(before), before);
            moves.remember_namespaces("opc.tcp://127.0.0.1:4840", &[2], &known);
            let places = Places::clone(&moves.places).named_as(&Places::of(after));
            assert_eq!(places.moved_signals(&Places::of(after)).len(), moved, "{uri:?}");
            let found = place::compare(&places.outputs, &Places::of(after).outputs);
            assert_eq!(found["offset"] == PlaceComparison::Same, moved == 0, "{uri:?}");
            let mut entry = Places::of(before).outputs["offset"].clone();
            places.name_output(&Places::of(after), "offset", &mut entry);
            assert_eq!(entry == Places::of(after).outputs["offset"], moved == 0, "its account, {uri:?}");
        }
    }
}

/// A node that was added may mean the present namespaces of the server. If they have changed places, its meaning is
/// unclear.
#[test]
fn an_index_under_which_a_node_was_added_is_unclear_where_its_namespace_has_moved() {
    let address = "opc.tcp://127.0.0.1:4840";
    let added = SERVER.replace("s=bed", "s=coolant");
    let with_uri = SERVER.replace("ns=2;", "nsu=urn:mill;");
    let array = ["ua", "urn:server", "urn:lathe", "urn:mill"].map(str::to_owned);
    for (before, after, is_clear) in
        [(SERVER, SERVER, true), (SERVER, &added, false), (&with_uri, SERVER, false)]
    {
        let mut known = KnownNamespaces::default();
        known.remember(2, "urn:mill".to_owned());
        let mut moves = Moves::new(Places::of(&of(before)), &of(before));
        moves.remember_namespaces(address, &[2], &known);
        let places = Places::clone(&moves.places).named_as(&Places::of(&of(after)));
        let known = Moves::new(places, &of(after)).namespaces(address);
        let expected = if is_clear { Located::Moved(3) } else { Located::Unclear };
        assert_eq!(known.locate(2, &array), expected, "{before} {after}");
    }
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

/// A start compares these texts with those of the last run. With another text for the same place, the next update of
/// the program would switch off every axis of every machine. A change must accept the former text as the same place.
#[test]
fn the_texts_of_places_on_disk_are_what_earlier_versions_have_written() {
    let register = |text: &str| Address::Modbus(text.parse().unwrap());
    let bits = |start, length, order, kind| BitField::new(start, length, order, kind).unwrap();
    let (standard, extended) = (CanId::standard(0x185).unwrap(), CanId::extended(0x18FE_F100).unwrap());
    let frame = |frames, bits, multiplex| Address::Frame(Field { frames, is_fd: false, bits, multiplex });
    let intel = bits(8, 16, ByteOrder::Intel, BitKind::Signed);
    let selector =
        Selector { bits: bits(0, 8, ByteOrder::Intel, BitKind::Unsigned), values: vec![(2, 2), (5, 7)] };
    let node = |text: &str| Address::Node(Node::new(text.parse().unwrap(), None));
    let sensor = |text: &str| Address::Sensor(text.parse().unwrap());
    let rows = [
        (register("coil:3"), "coil:3 (00004)"),
        (register("discrete:3"), "discrete:3 (10004)"),
        (register("input:0"), "input:0 (30001)"),
        (register("holding:104"), "holding:104 (40105)"),
        (register("holding:10000"), "holding:10000 (410001)"),
        (Address::Object(Object::new(0x6004, 0x1A, DataType::I32)), "object 6004:1A"),
        (frame(CanMatch::exactly(standard), intel, Vec::new()), "0x185, 16 bits from 8 up (Intel), signed"),
        (
            frame(
                CanMatch::exactly(extended),
                bits(7, 32, ByteOrder::Motorola, BitKind::Float),
                vec![selector],
            ),
            "0x18fef100, 32 bits from 7 down (Motorola), float, where 8 bits from 0 up (Intel), unsigned is 2 or 5 to 7",
        ),
        (node("ns=2;s=/Plc/DB100.DBD4"), "node ns=2;s=/Plc/DB100.DBD4"),
        (node("nsu=http://plc.example/data;i=7"), "node nsu=http://plc.example/data;i=7"),
        (sensor("hwmon:coretemp/Package id 0"), "sensor hwmon:coretemp/Package id 0"),
        (sensor("iio:mcp9808"), "sensor iio:mcp9808"),
        (sensor("w1:28-0316a2794f01"), "sensor w1:28-0316a2794f01"),
    ];
    for (address, text) in rows {
        assert_eq!(address.to_string(), text);
    }
    let encoding = grinder().outputs[0].encoding.clone();
    let layout_of = |data_type, word_order, byte_swap| {
        layout(&Encoding { data_type, word_order, byte_swap, ..encoding.clone() })
    };
    for (data_type, text) in [
        (DataType::Bool, "bool"),
        (DataType::U16, "u16"),
        (DataType::I16, "i16"),
        (DataType::U32, "u32 msw-first"),
        (DataType::I32, "i32 msw-first"),
        (DataType::U64, "u64 msw-first"),
        (DataType::I64, "i64 msw-first"),
        (DataType::F32, "f32 msw-first"),
        (DataType::F64, "f64 msw-first"),
    ] {
        assert_eq!(layout_of(data_type, WordOrder::MswFirst, false), text);
    }
    assert_eq!(layout_of(DataType::I32, WordOrder::LswFirst, true), "i32 lsw-first byte-swapped");
    let names = [Writes::Offset, Writes::Intercept, Writes::Slope, Writes::Reference].map(Writes::name);
    assert_eq!(names, ["offset", "intercept", "slope", "reference"]);
    let corrected = Writes::Corrected { position: isotherm_core::reading::SignalId(0) };
    assert_eq!(corrected.name(), "corrected");
    let owners = serde_json::to_string(&[Owner::Whole, Owner::Ledger]).unwrap();
    assert_eq!(owners, r#"["whole","ledger"]"#);
}

/// The grinder, the grinder with its offset in another register, and the index of that output.
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
    // After a further start, the bounds are those of the former place, not those of the profile.
    let again = found.clone().after(&after, &left(&found), false);
    assert_eq!(again.former[0].bounds, found.former[0].bounds);

    assert!(saved.as_object_mut().unwrap().remove("bounds").is_some());
    let of_today: Places = serde_json::from_value(saved).unwrap();
    let found = of_today.clone().after(&after, &left(&of_today), false);
    assert_eq!(found.former[0].bounds, None);
    let events = Moves::new(found.clone(), &after).events(&Releases::of(&after, &found.former, &[]), &after);
    let text = events[1].entry(isotherm_core::quantity::Moment::default()).text;
    assert!(
        text.contains("an earlier version of the program may have written it; set that register to zero"),
        "{text}"
    );
}

#[test]
fn what_the_ledger_has_of_a_former_place_is_kept_until_nothing_is_left_there() {
    let (before, after, place) = elsewhere();
    let output = &before.outputs[place];
    let kept = isotherm_core::output::SavedOutput { in_order: true, ..Default::default() };
    let entry = Entry::new(of_output(&before, output), kept);
    let entries: Entries = [(output.name.clone(), entry.clone())].into();
    let mut places = started_places(&before, &after);
    places.keep(&entries);
    assert_eq!(places.kept, std::slice::from_ref(&entry));
    // The ledger contains another register under this name by now.
    let other = Entry::new(of_output(&after, &after.outputs[place]), kept);
    let entries: Entries = [(output.name.clone(), other.clone())].into();
    places.keep(&entries);
    assert_eq!(places.kept, std::slice::from_ref(&entry));
    let place = OutputPlace { axis: "release_cnc_z".to_owned(), ..of_output(&before, output) };
    let moved = Entry::new(place, kept);
    assert!(places.is_of_a_release("cnc_z_released", &moved));
    assert!(
        !places.is_of_a_release(&output.name, &other) && !places.is_of_a_release("cnc_z_released", &other)
    );
    // A release has moved the register.
    let kept = isotherm_core::output::SavedOutput { in_order: false, ..kept };
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
        operator: None,
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

#[test]
fn another_output_that_takes_all_of_a_shared_register_waits_for_a_person() {
    let (mut before, _, place) = elsewhere();
    before.outputs[place].share = Share::Ledger;
    let mut after = before.clone();
    (after.outputs[place].share, after.outputs[place].name) = (Share::Whole, "other".to_owned());
    let places = Places::of(&before);
    let only_read =
        |place: &OutputPlace| KnownOutput { place: place.clone(), held_um: None, was_driven: false };
    let left = places.outputs.iter().map(|(name, place)| (name.clone(), only_read(place))).collect();
    let moves = Moves::new(places.after(&after, &left, false), &after);
    let barred = moves.barred(&after);
    assert_eq!(barred.iter().map(|(axis, _)| *axis).collect::<Vec<_>>(), [after.outputs[place].axis]);
    let why = barred[0].1.to_string();
    let words =
        ["with an operator offset", "output other uses the whole register", "share = \"ledger\" again"];
    assert!(words.iter().all(|word| why.contains(word)), "{why}");
    let events = moves.events(&Releases::default(), &after);
    assert_eq!(kinds(&events), ["output-moved"]);
}
