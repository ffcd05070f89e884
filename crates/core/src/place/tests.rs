use super::*;

fn output() -> OutputPlace {
    OutputPlace {
        bus: "10.0.0.7:502".to_owned(),
        unit: 1,
        address: "holding:104 (40105)".to_owned(),
        layout: "i32 msw-first".to_owned(),
        scale: 0.1,
        bias: 0,
        share: Owner::Whole,
        writes: "offset".to_owned(),
        axis: "z".to_owned(),
        diameter: false,
    }
}

fn signal() -> SignalPlace {
    SignalPlace {
        bus: "10.0.0.8:502".to_owned(),
        unit: 3,
        address: "input:0 (30001)".to_owned(),
        layout: "i16".to_owned(),
        scale: 0.1,
        offset: 0.0,
    }
}

fn named<P: Clone>(all: &[(&str, &P)]) -> BTreeMap<String, P> {
    all.iter().map(|(name, place)| ((*name).to_owned(), (*place).clone())).collect()
}

fn known(all: &[(&str, &OutputPlace, Option<f64>)]) -> BTreeMap<String, KnownOutput> {
    let known =
        |place: &OutputPlace, held_um| KnownOutput { place: place.clone(), held_um, was_driven: true };
    all.iter().map(|(name, place, held_um)| ((*name).to_owned(), known(place, *held_um))).collect()
}

#[track_caller]
fn moved(found: Option<&PlaceComparison>) -> (Part, &str, &str) {
    match found {
        Some(PlaceComparison::Moved(MovedPlace { what, was, is })) => (*what, was, is),
        other => panic!("{other:?}"),
    }
}

#[test]
fn each_part_of_an_output_that_changes_is_found_and_named() {
    type Change = fn(&mut OutputPlace);
    let rows: [(Change, Part, &str, &str); 10] = [
        (|place| place.bus = "10.0.0.9:502".into(), Part::Bus, "bus 10.0.0.7:502", "bus 10.0.0.9:502"),
        (|place| place.unit = 2, Part::Unit, "unit 1", "unit 2"),
        (
            |place| place.address = "holding:106 (40107)".into(),
            Part::Address,
            "holding:104 (40105)",
            "holding:106 (40107)",
        ),
        (
            |place| place.layout = "i32 lsw-first".into(),
            Part::Type,
            "type i32 msw-first",
            "type i32 lsw-first",
        ),
        (|place| place.scale = -0.1, Part::Scale, "scale 0.1", "scale -0.1"),
        (|place| place.bias = 32768, Part::Bias, "bias 0", "bias 32768"),
        (|place| place.share = Owner::Ledger, Part::Share, "share whole", "share ledger"),
        (|place| place.writes = "intercept".into(), Part::Writes, "writes offset", "writes intercept"),
        (|place| place.axis = "x".into(), Part::Axis, "axis z", "axis x"),
        (|place| place.diameter = true, Part::Diameter, "radius", "diameter"),
    ];
    for (change, what, was, is) in rows {
        let mut changed = output();
        change(&mut changed);
        let found = compare(&named(&[("cnc_z", &output())]), &named(&[("cnc_z", &changed)]));
        assert_eq!(moved(found.get("cnc_z")), (what, was, is));
    }
}

#[test]
fn each_part_of_a_signal_that_changes_is_found_and_named() {
    type Change = fn(&mut SignalPlace);
    let rows: [(Change, Part, &str, &str); 6] = [
        (|place| place.bus = "/dev/ttyUSB0".into(), Part::Bus, "bus 10.0.0.8:502", "bus /dev/ttyUSB0"),
        (|place| place.unit = 4, Part::Unit, "unit 3", "unit 4"),
        (
            |place| place.address = "input:1 (30002)".into(),
            Part::Address,
            "input:0 (30001)",
            "input:1 (30002)",
        ),
        (|place| place.layout = "u16".into(), Part::Type, "type i16", "type u16"),
        (|place| place.scale = 0.01, Part::Scale, "scale 0.1", "scale 0.01"),
        (|place| place.offset = -40.0, Part::Offset, "offset 0", "offset -40"),
    ];
    for (change, what, was, is) in rows {
        let mut changed = signal();
        change(&mut changed);
        let found = compare(&named(&[("bed", &signal())]), &named(&[("bed", &changed)]));
        assert_eq!(moved(found.get("bed")), (what, was, is));
    }
}

#[test]
fn several_changes_are_told_together_under_the_gravest() {
    let changed = OutputPlace { unit: 2, scale: 0.2, diameter: true, ..output() };
    let found = MovedPlace::between(&output(), &changed).unwrap();
    let MovedPlace { what, was, is } = found;
    assert_eq!(
        (what, was.as_str(), is.as_str()),
        (Part::Unit, "unit 1, scale 0.1, radius", "unit 2, scale 0.2, diameter")
    );
}

#[test]
fn the_same_place_a_new_one_a_renamed_one_and_one_that_is_gone() {
    let other = OutputPlace { address: "holding:200 (40201)".into(), ..output() };
    let remembered = named(&[("a", &output()), ("b", &other)]);
    let now = named(&[("a", &output()), ("c", &other), ("d", &OutputPlace { unit: 9, ..output() })]);
    let found = compare(&remembered, &now);
    let of = |name: &str| found.get(name);
    assert_eq!((of("a"), of("b")), (Some(&PlaceComparison::Same), None), "b is called c now");
    assert_eq!(
        (of("c"), of("d")),
        (Some(&PlaceComparison::Renamed("b".to_owned())), Some(&PlaceComparison::Unknown))
    );
    let found = compare(&remembered, &named(&[("a", &output())]));
    assert_eq!(found.get("b"), Some(&PlaceComparison::Removed));
    // Several names of one place: each former name is taken once, in the order of the names.
    let several = named(&[("a", &other), ("b", &other)]);
    let found = compare(&several, &named(&[("x", &other), ("y", &other), ("z", &other)]));
    let renamed = |name: &str| PlaceComparison::Renamed(name.to_owned());
    let expected = [renamed("a"), renamed("b"), PlaceComparison::Unknown];
    assert_eq!(found.into_values().collect::<Vec<_>>(), expected);
    let found = compare(&several, &named(&[("x", &other)]));
    let expected = [("b", PlaceComparison::Removed), ("x", renamed("a"))];
    assert_eq!(found, BTreeMap::from(expected.map(|(name, found)| (name.to_owned(), found))));
    let found = compare(&BTreeMap::new(), &now);
    assert!(
        found.values().all(|found| *found == PlaceComparison::Unknown),
        "a state without places takes those"
    );
}

/// Returns the former places after a start: output, the axes that wait, and whether a Cz was left in its register.
fn after(
    open: Vec<FormerPlace>,
    remembered: &BTreeMap<String, KnownOutput>,
    now: &BTreeMap<String, OutputPlace>,
) -> Vec<(String, Vec<String>, bool)> {
    let all = FormerPlace::after(open, remembered, now);
    let row = |former: &FormerPlace| {
        (former.output.clone(), former.axes.iter().cloned().collect(), former.is_left_behind(now))
    };
    all.iter().map(row).collect()
}

fn none() -> [(String, Vec<String>, bool); 0] {
    []
}

fn row(output: &str, axes: &[&str], is_left: bool) -> (String, Vec<String>, bool) {
    (output.to_owned(), axes.iter().map(|axis| (*axis).to_owned()).collect(), is_left)
}

#[test]
fn an_axis_waits_for_a_person_when_its_output_lies_elsewhere_or_counts_otherwise() {
    let elsewhere = OutputPlace { address: "holding:106 (40107)".into(), ..output() };
    let scaled = OutputPlace { scale: -0.1, ..output() };
    let shared = OutputPlace { share: Owner::Ledger, ..output() };
    let wide = OutputPlace { diameter: true, ..output() };
    let axis = OutputPlace { axis: "x".into(), ..output() };
    for (is, axes, is_left) in [
        (&elsewhere, &["z"][..], true),
        (&scaled, &["z"][..], false),
        (&shared, &["z"][..], false),
        (&wide, &["z"][..], false),
        (&axis, &["x"][..], false),
    ] {
        let now = named(&[("cnc_z", is)]);
        let found = after(Vec::new(), &known(&[("cnc_z", &output(), Some(20.0))]), &now);
        assert_eq!(found, [row("cnc_z", axes, is_left)], "{is:?}");
        let found = after(Vec::new(), &known(&[("cnc_z", &output(), Some(0.0))]), &now);
        assert_eq!(found, [row("cnc_z", axes, false)], "nothing of ours is left: {is:?}");
    }
    let now = named(&[("cnc_z", &output())]);
    assert_eq!(after(Vec::new(), &known(&[("cnc_z", &output(), Some(20.0))]), &now), none());
    assert_eq!(after(Vec::new(), &BTreeMap::new(), &now), none(), "nothing is remembered");
}

#[test]
fn a_corrected_position_continues_in_steps_with_another_axis_or_diameter_and_waits_elsewhere() {
    let position = OutputPlace { writes: "corrected".into(), ..output() };
    for (is, axes) in [
        (OutputPlace { diameter: true, ..position.clone() }, None),
        (OutputPlace { axis: "w".into(), ..position.clone() }, None),
        (OutputPlace { scale: 0.2, ..position.clone() }, Some(["z"])),
        (OutputPlace { unit: 2, ..position.clone() }, Some(["z"])),
    ] {
        let found =
            after(Vec::new(), &known(&[("readout", &position, Some(20.0))]), &named(&[("readout", &is)]));
        let expected: Vec<_> = axes.iter().map(|axes| row("readout", axes, false)).collect();
        assert_eq!(found, expected, "{is:?}");
    }
    let found = after(Vec::new(), &known(&[("readout", &position, Some(20.0))]), &BTreeMap::new());
    assert_eq!(found, none(), "nothing of ours stays in a position that is not written");
}

#[test]
fn a_removed_output_that_holds_something_is_named_and_bars_the_axes_of_new_outputs_that_repeat_it() {
    let x = OutputPlace { address: "holding:200 (40201)".into(), axis: "x".into(), ..output() };
    let new = OutputPlace { address: "holding:106 (40107)".into(), ..output() };
    let renamed_axis = OutputPlace { axis: "w".into(), ..new.clone() };
    let in_its_place = OutputPlace { axis: "x".into(), ..output() };
    let remembered = |held| known(&[("cnc_z", &output(), held), ("cnc_x", &x, Some(3.0))]);
    for (now, axes, is_left) in [
        (named(&[("cnc_x", &x)]), &[][..], true),
        (named(&[("cnc_x", &x), ("other", &new)]), &["z"][..], true),
        (named(&[("cnc_x", &x), ("other", &renamed_axis)]), &["w"][..], true),
        (named(&[("cnc_x", &x), ("other", &in_its_place)]), &["x"][..], false),
    ] {
        assert_eq!(
            after(Vec::new(), &remembered(Some(20.0)), &now),
            [row("cnc_z", axes, is_left)],
            "{now:?}"
        );
        for held in [Some(0.0), Some(-0.04), None] {
            assert_eq!(after(Vec::new(), &remembered(held), &now), none(), "{held:?}");
        }
    }
}

#[test]
fn a_register_that_was_only_read_leaves_nothing_of_ours_and_bars_nothing() {
    let elsewhere = OutputPlace { address: "holding:106 (40107)".into(), ..output() };
    let scaled = OutputPlace { scale: -0.1, ..output() };
    let shared = OutputPlace { share: Owner::Ledger, ..output() };
    let read = |place: &OutputPlace| {
        let mut known = known(&[("cnc_z", place, Some(123.0))]);
        known.values_mut().for_each(|known| known.was_driven = false);
        known
    };
    for is in [&elsewhere, &scaled, &shared] {
        assert_eq!(after(Vec::new(), &read(&output()), &named(&[("cnc_z", is)])), none(), "{is:?}");
    }
    for now in [named(&[]), named(&[("z2", &elsewhere)])] {
        assert_eq!(after(Vec::new(), &read(&output()), &now), none(), "{now:?}");
    }
    let all_ours = after(Vec::new(), &read(&shared), &named(&[("cnc_z", &output())]));
    assert_eq!(all_ours, [row("cnc_z", &["z"], false)], "the operator has an offset in it");
}

#[test]
fn an_output_that_is_removed_at_one_start_and_new_at_a_later_one_bars_its_axis_as_at_one_start() {
    let x = OutputPlace { address: "holding:200 (40201)".into(), axis: "x".into(), ..output() };
    let new = OutputPlace { address: "holding:105 (40106)".into(), ..output() };
    let renamed_axis = OutputPlace { axis: "w".into(), ..new.clone() };
    for (is, axis, others) in [(&new, "z", &["x"][..]), (&renamed_axis, "w", &["x"]), (&new, "z", &[])] {
        let others: Vec<_> = others.iter().map(|_| ("cnc_x", &x)).collect();
        let with_held = |all: &[(&str, &OutputPlace)], held| {
            known(&all.iter().map(|(name, place)| (*name, *place, Some(held))).collect::<Vec<_>>())
        };
        let removed = output();
        let first: Vec<_> = others.iter().copied().chain([("cnc_z", &removed)]).collect();
        let now = named(&others);
        let mut open = FormerPlace::after(Vec::new(), &with_held(&first, 20.0), &now);
        for _ in 0..2 {
            open = FormerPlace::after(open, &with_held(&others, 20.0), &now);
            assert_eq!(after(open.clone(), &with_held(&others, 20.0), &now), [row("cnc_z", &[], true)]);
        }
        let both: Vec<_> = others.iter().copied().chain([("z2", is)]).collect();
        let now = named(&both);
        open = FormerPlace::after(open, &with_held(&others, 20.0), &now);
        for _ in 0..2 {
            let rows = after(open.clone(), &with_held(&both, 0.0), &now);
            assert_eq!(rows, [row("cnc_z", &[axis], true)], "{is:?}");
            open = FormerPlace::after(open, &with_held(&both, 0.0), &now);
        }
    }
}

#[test]
fn what_no_person_has_confirmed_is_open_over_any_number_of_starts_and_ends_with_a_person_or_the_old_place() {
    let elsewhere = OutputPlace { address: "holding:106 (40107)".into(), ..output() };
    let now = named(&[("cnc_z", &elsewhere)]);
    let mut open = FormerPlace::after(Vec::new(), &known(&[("cnc_z", &output(), Some(20.0))]), &now);
    for _ in 0..3 {
        open = FormerPlace::after(open, &known(&[("cnc_z", &elsewhere, Some(0.0))]), &now);
        assert_eq!(open.len(), 1);
        assert_eq!(open[0].held_um, Some(20.0));
    }
    let saved: Vec<FormerPlace> = serde_json::from_str(&serde_json::to_string(&open).unwrap()).unwrap();
    assert_eq!(saved, open, "every digit survives the disk");
    let back = named(&[("cnc_z", &output())]);
    assert_eq!(
        after(open.clone(), &known(&[("cnc_z", &elsewhere, Some(0.0))]), &back),
        none(),
        "it is back, and nothing was written between"
    );
    let mut former = open.remove(0);
    assert!(former.confirm("x", |_| true), "another axis says nothing");
    assert!(!former.confirm("z", |_| true));
}

#[test]
fn a_removed_output_for_which_no_axis_waits_ends_with_its_own_axis_or_with_any_if_that_cannot_be_armed() {
    let former = |axes: &[&str]| FormerPlace {
        output: "cnc_z".to_owned(),
        place: output(),
        held_um: Some(20.0),
        axes: axes.iter().map(|axis| (*axis).to_owned()).collect(),
        bounds: None,
        found_um: None,
    };
    assert!(former(&[]).confirm("x", |_| true), "axis z can be armed, and was not");
    assert!(!former(&[]).confirm("z", |_| true));
    assert!(!former(&[]).confirm("x", |axis| axis != "z"), "no arming of z will come");
    assert!(!former(&["w"]).confirm("w", |axis| axis != "z"));
    assert!(former(&["w"]).confirm("x", |axis| axis != "z"), "w waits");
    assert!(!former(&["x"]).confirm("x", |_| true), "it has taken the register");
}

#[test]
fn a_register_is_the_same_whatever_the_axis_and_the_share_are() {
    let same = OutputPlace { axis: "x".into(), share: Owner::Ledger, diameter: true, ..output() };
    assert!(output().is_same_register(&same) && output().is_at(&same));
    let scaled = OutputPlace { scale: 0.2, ..output() };
    assert!(!output().is_same_register(&scaled) && output().is_at(&scaled));
    assert!(!output().is_at(&OutputPlace { bus: "10.0.0.8:502".into(), ..output() }));
}

#[test]
fn a_former_place_of_an_earlier_version_is_read_and_has_no_bounds() {
    let former = FormerPlace::of("cnc_z".to_owned(), output(), Some(20.0));
    let text = serde_json::to_string(&former).unwrap();
    assert!(!text.contains("bounds") && !text.contains("found"), "{text}");
    assert_eq!(serde_json::from_str::<FormerPlace>(&text).unwrap(), former);
}

#[test]
fn a_register_that_an_operator_may_have_used_in_between_waits_for_a_person() {
    let shared = OutputPlace { share: Owner::Ledger, ..output() };
    let elsewhere = OutputPlace { address: "holding:200 (40201)".to_owned(), ..shared.clone() };
    for (between, waits) in [(shared, true), (elsewhere, false)] {
        let driven = known(&[("cnc_z", &output(), Some(10.0))]);
        let open = FormerPlace::after(Vec::new(), &driven, &named(&[("cnc_z", &between)]));
        assert!(open.iter().any(|former| former.axes.contains("z")), "{between}");
        let idle = KnownOutput { place: between.clone(), held_um: None, was_driven: false };
        let back = BTreeMap::from([("cnc_z".to_owned(), idle)]);
        let open = FormerPlace::after(open, &back, &named(&[("cnc_z", &output())]));
        assert_eq!(open.iter().any(|former| former.axes.contains("z")), waits, "{between}: {open:?}");
    }
}
