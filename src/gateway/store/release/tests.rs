use std::path::Path;

use super::*;
use crate::gateway::store::places::of_output;
use isotherm_core::output::{self, Account, Doubt};
use isotherm_core::place::Stage;
use isotherm_profile::Bus;

const BENCH: &str = include_str!("../../../../tests/gateway/faults/bench.toml");

fn profile(text: &str) -> Profile {
    isotherm_profile::parse(Path::new("bench.toml"), text, &[], &[]).unwrap().profile
}

fn cnc(profile: &Profile) -> &Output {
    profile.outputs.iter().find(|output| output.name == "cnc_z").unwrap()
}

/// Former place of the output of a profile, with a gateway share of 20 µm in it.
fn former(profile: &Profile) -> FormerPlace {
    let output = cnc(profile);
    FormerPlace {
        output: output.name.clone(),
        place: of_output(profile, output),
        held_um: Some(20.0),
        axes: Default::default(),
        bounds: Some(bounds_of(profile, output)),
        found_um: None,
    }
}

fn release(profile: &Profile) -> Release {
    let FormerPlace { output, place, bounds, .. } = former(profile);
    let (bounds, by) = (bounds.unwrap(), "by a test".to_owned());
    Release { output, place, bounds, from_um: 20.0, operator: None, held_um: 20.0, stage: Stage::Asked, by }
}

/// Checks that a former register can be released with this profile.
fn obstacle(profile: &Profile, former: &FormerPlace, kept: &[Entry]) -> Result<(), Explained> {
    why_not(profile, former, kept, &WrittenPlaces::of(profile))
}

/// Bench profile with another register for its output.
fn moved() -> Profile {
    profile(&BENCH.replace("holding:104", "holding:106"))
}

#[test]
fn a_profile_gets_an_axis_and_an_output_at_the_former_place_with_the_former_bounds() {
    let bench = profile(BENCH);
    let mut extended = moved();
    let before = extended.clone();
    let returning = extend(&mut extended, &[release(&bench)]);
    assert_eq!(returning.len(), 1);
    let (axis, output) = (extended.axis(returning[0].axis), extended.output(returning[0].output));
    assert_eq!((axis.settings.name.as_str(), output.name.as_str()), ("release_cnc_z", "cnc_z_released"));
    assert_eq!(axis.settings.guard, GuardSettings { deadband: Micron::ZERO, ..bench.axes[0].settings.guard });
    assert_eq!((axis.settings.every, axis.settings.on_fault), (Duration::from_secs(2), OnFault::Hold));
    assert_eq!((axis.purpose, axis.has_model()), (Purpose::Release, true));
    let was = cnc(&bench);
    assert_eq!((&output.address, &output.encoding, output.device), (&was.address, &was.encoding, was.device));
    assert_eq!(output.when.as_ref().map(|when| &when.text), was.when.as_ref().map(|when| &when.text));
    assert_eq!((output.refresh, output.share, output.verify), (None, Share::Whole, Verify::ReadBack));
    assert!((returning[0].grain_um - 0.0501).abs() < 1e-9, "half a count of 0.1 µm");
    // Everything else in the profile is unchanged.
    assert_eq!(extended.axes[..before.axes.len()], before.axes);
    assert_eq!(extended.outputs[..before.outputs.len()], before.outputs);
    assert_eq!((&extended.devices, &extended.buses), (&before.devices, &before.buses));
    let same = crate::gateway::store::places::Places::of(&extended);
    assert_eq!(same, crate::gateway::store::places::Places::of(&before), "it is no place of the profile");
}

#[test]
fn a_register_whose_device_the_profile_does_not_have_is_not_released() {
    let bench = profile(BENCH);
    let elsewhere = profile(&BENCH.replace("127.0.0.1:1505", "127.0.0.1:1506"));
    let other_unit =
        profile(&BENCH.replacen("bus = \"control\"\nunit = 1", "bus = \"control\"\nunit = 2", 1));
    for mut changed in [elsewhere, other_unit] {
        let before = changed.clone();
        let why = obstacle(&changed, &former(&bench), &[]).unwrap_err();
        let words = ["no longer has the device of this register, unit 1 at 127.0.0.1:1505", "restart --keep"];
        assert!(words.iter().all(|word| why.to_string().contains(word)), "{why}");
        assert_eq!(extend(&mut changed, &[release(&bench)]), []);
        assert_eq!((changed.axes.len(), changed.outputs.len()), (before.axes.len(), before.outputs.len()));
    }
}

#[test]
fn a_register_that_the_profile_writes_to_under_another_name_of_its_line_is_not_released() {
    let bench = profile(BENCH);
    let mut changed = moved();
    let same = changed.buses.iter().position(|bus| bus.address == "127.0.0.1:1505").unwrap();
    let other =
        Bus { name: "again".to_owned(), address: "localhost:1505".to_owned(), ..changed.buses[same].clone() };
    changed.buses.push(other);
    let device = changed.devices.iter().position(|device| device.bus == BusId(same)).unwrap();
    let (name, bus) = ("again".to_owned(), BusId(changed.buses.len() - 1));
    changed.devices.push(Device { name, bus, ..changed.devices[device].clone() });
    let id = DeviceId(changed.devices.len() - 1);
    assert!(obstacle(&changed, &former(&bench), &[]).is_ok());
    let place = changed.outputs.iter().position(|output| output.name == "cnc_z").unwrap();
    (changed.outputs[place].device, changed.outputs[place].address) = (id, cnc(&bench).address.clone());
    let why = obstacle(&changed, &former(&bench), &[]).unwrap_err();
    assert!(why.to_string().contains("the profile writes to this register"), "{why}");
}

#[test]
fn a_shared_register_is_moved_only_if_the_operators_part_is_the_saved_one() {
    let text = BENCH.replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"");
    let (bench, mut changed) = (profile(&text), profile(&text.replace("holding:104", "holding:106")));
    let account = Account { base: Counts(300), share: Counts(200), doubt: None };
    let kept = output::SavedOutput { account: Some(account), ..Default::default() };
    let asked = release(&bench);
    let operator = operators_part(&asked.place, &asked.bounds, Some(&kept));
    assert_eq!(operator, Some(30.0));
    let returning = extend(&mut changed, &[Release { operator, ..asked }]);
    let one = &returning[0];
    let releases = Releases { returning: returning.clone(), ..Releases::default() };
    let cz = Micron::new(20.0).unwrap();
    let admit = |shares| releases.admit(one.output, cz, shares);
    assert_eq!(admit(Some((30.0, 20.0))), Ok(()));
    // The gateway share was removed by hand: the register holds 30.
    let why = admit(Some((10.0, 20.0))).unwrap_err();
    assert!(why.to_string().contains("the operator offset was 30.0"), "{why}");
    assert!(admit(None).is_err());
    // The axis of the moved output waits.
    let axis = cnc(&changed).axis;
    let attempt = releases.assess(axis, Attempt::From(cz, None), |_| None);
    assert!(
        matches!(&attempt, Attempt::Refused(why) if why.to_string().contains("still returning")),
        "{attempt:?}"
    );
    assert_eq!(Releases::default().assess(axis, Attempt::From(cz, None), |_| None), Attempt::From(cz, None));
}

#[test]
fn two_releases_have_names_of_their_own_and_one_register_is_released_once() {
    let bench = profile(BENCH);
    let mut extended = profile(&BENCH.replace("holding:104", "holding:120"));
    let other = Release {
        place: OutputPlace { address: "holding:106 (40107)".to_owned(), ..release(&bench).place },
        ..release(&bench)
    };
    let all = [release(&bench), other, release(&bench)];
    let returning = extend(&mut extended, &all);
    let names: Vec<(&str, &str)> = returning
        .iter()
        .map(|one| {
            (extended.axis(one.axis).settings.name.as_str(), extended.output(one.output).name.as_str())
        })
        .collect();
    assert_eq!(names, [("release_cnc_z", "cnc_z_released"), ("release_cnc_z_2", "cnc_z_released_2")]);
    assert_eq!(names.len(), 2, "two outputs at one register would move it in turns");
}

#[test]
fn each_type_and_order_is_found_again_by_its_words() {
    let bench = profile(BENCH);
    for data_type in DataType::ALL.into_iter().filter(|one| *one != DataType::Bool) {
        for word_order in [WordOrder::MswFirst, WordOrder::LswFirst] {
            for byte_swap in [false, true] {
                let encoding = Encoding { data_type, word_order, byte_swap, ..cnc(&bench).encoding.clone() };
                let place = OutputPlace { layout: layout(&encoding), ..release(&bench).place };
                let (register, found) = register(&place).unwrap();
                let is_same_order = data_type.registers() == 1 || found.word_order == word_order;
                assert_eq!((register.offset, found.data_type, found.byte_swap), (104, data_type, byte_swap));
                assert!(is_same_order, "{data_type:?} {word_order:?}");
            }
        }
    }
    for (address, layout, scale) in [
        ("input:104 (30105)", "i32 msw-first", 0.1),
        ("node ns=2;i=5", "i32 msw-first", 0.1),
        ("holding:104 (40105)", "i31", 0.1),
        ("holding:104 (40105)", "bool", 0.1),
        ("holding:104 (40105)", "i32 msw-first", 0.0),
        ("", "i32 msw-first", 0.1),
    ] {
        let place = OutputPlace {
            address: address.to_owned(),
            layout: layout.to_owned(),
            scale,
            ..release(&bench).place
        };
        assert!(register(&place).is_none(), "{address} {layout} {scale}");
    }
}

/// Reason why this former place cannot be released in a profile. Empty if it can.
fn why(profile: &Profile, former: &FormerPlace, kept: &[Entry]) -> String {
    obstacle(profile, former, kept).err().map_or(String::new(), |why| why.to_string())
}

#[test]
fn each_obstacle_is_said_with_what_to_do() {
    let (bench, now) = (profile(BENCH), moved());
    let plain = former(&bench);
    assert_eq!(why(&now, &plain, &[]), "");
    let bounded = |change: &dyn Fn(&mut Bounds)| {
        let mut former = plain.clone();
        former.bounds.iter_mut().for_each(change);
        former
    };
    let placed = |change: &dyn Fn(&mut OutputPlace)| {
        let mut former = plain.clone();
        change(&mut former.place);
        former
    };
    let rows: [(&str, FormerPlace, &str); 9] = [
        (
            "no bounds",
            FormerPlace { bounds: None, ..plain.clone() },
            "an earlier version of the program may have written it",
        ),
        ("spoiled", bounded(&|bounds| bounds.step_um = 0.0), "does not contain a valid limit"),
        (
            "set",
            bounded(&|bounds| bounds.obstacle = Some(Obstacle::Set)),
            "the other registers of its output set",
        ),
        (
            "limit",
            FormerPlace { held_um: Some(40.5), ..plain.clone() },
            "40.5 µm is more than the former limit of ±40 µm",
        ),
        (
            "node",
            placed(&|place| place.address = "node ns=2;i=5".into()),
            "the program cannot read a register node ns=2;i=5",
        ),
        (
            "interlock",
            bounded(&|bounds| bounds.when = Some("door == 1".into())),
            "the interlock door == 1 of this register has a signal",
        ),
        (
            "taken",
            placed(&|place| place.address = "holding:106 (40107)".into()),
            "the profile writes to this register",
        ),
        (
            "heartbeat",
            placed(&|place| place.address = "holding:100 (40101)".into()),
            "the profile writes to this register",
        ),
        (
            "line",
            placed(&|place| place.bus = "/dev/ttyUSB7".into()),
            "the profile no longer has the device of this register, unit 1 at /dev/ttyUSB7",
        ),
    ];
    for (what, former, words) in rows {
        let why = why(&now, &former, &[]);
        assert!(why.contains(words), "{what}: {why}");
        let has_remedy =
            why.contains("set that register to zero") || why.contains("arm the axis of that output");
        assert!(has_remedy, "{what}: {why}");
    }
    let mut forbidden = moved();
    let device = cnc(&forbidden).device;
    forbidden.devices[device.0].functions.write_multiple = false;
    assert!(
        why(&forbidden, &plain, &[]).contains("`functions` of device cnc"),
        "two registers need function 16"
    );
}

#[test]
fn a_shared_register_is_released_only_if_the_ledger_says_which_part_is_the_operators() {
    let text = BENCH.replace("refresh = \"10s\"", "share = \"ledger\"");
    let (before, now) = (profile(&text), profile(&text.replace("holding:104", "holding:106")));
    let former = former(&before);
    let account = |doubt| Account { base: Counts(200), share: Counts(200), doubt };
    let entry = |account: Option<Account>| {
        Entry::new(former.place.clone(), output::SavedOutput { account, ..output::SavedOutput::default() })
    };
    assert_eq!(why(&now, &former, &[entry(Some(account(None)))]), "");
    assert!(why(&now, &former, &[]).contains("does not show which part"));
    assert!(why(&now, &former, &[entry(None)]).contains("does not show which part"));
    let doubted = entry(Some(account(Some(Doubt::Lost))));
    assert!(why(&now, &former, &[doubted]).contains("it is not certain which part"));
    let elsewhere = Entry::new(
        OutputPlace { unit: 7, ..former.place.clone() },
        output::SavedOutput { account: Some(account(None)), ..output::SavedOutput::default() },
    );
    assert!(
        why(&now, &former, &[elsewhere]).contains("does not show which part"),
        "it is of another register"
    );
}

#[test]
fn bounds_name_what_keeps_an_output_from_being_moved_by_itself() {
    let rows = [
        ("writes = \"offset\"", "writes = \"offset\"", None),
        ("verify = \"read-back\"", "verify = \"echo\"", Some(Obstacle::Unread)),
    ];
    for (from, to, obstacle) in rows {
        let profile = profile(&BENCH.replace(from, to));
        let bounds = bounds_of(&profile, cnc(&profile));
        assert_eq!(bounds.obstacle, obstacle, "{to}");
        assert_eq!(bounds.when.as_deref(), Some("cnc_on == 1"));
    }
    let bench = profile(BENCH);
    let readout = bench.outputs.iter().find(|output| output.name == "readout_z").unwrap();
    assert_eq!(bounds_of(&bench, readout).obstacle, Some(Obstacle::Writes));
    let mut together = bench.clone();
    let place = together.outputs.iter().position(|output| output.name == "cnc_z").unwrap();
    together.outputs[place].set = Some(isotherm_profile::SetId(0));
    assert_eq!(bounds_of(&together, &together.outputs[place]).obstacle, Some(Obstacle::Set));
}

#[test]
fn only_the_axis_of_a_release_is_refused_a_value_that_no_person_has_seen() {
    let bench = profile(BENCH);
    let mut extended = moved();
    let mut releases = Releases::of(&extended, &[former(&bench)], &[]);
    assert_eq!(releases.obstacle(&former(&bench).place), None);
    assert!(releases.obstacle(&cnc_place(&extended)).is_some(), "nothing is known of it");
    releases.returning = extend(&mut extended, &[release(&bench)]);
    let axis = releases.returning[0].axis;
    let from = |um: f64| Attempt::From(Micron::new(um).unwrap(), None);
    let assess = |axis, attempt| releases.assess(axis, attempt, |_| None);
    assert_eq!(assess(axis, from(20.0)), from(20.0));
    assert_eq!(assess(axis, from(0.0)), from(0.0), "it is back already");
    assert_eq!(assess(axis, Attempt::NotYet), Attempt::NotYet);
    let Attempt::Refused(why) = assess(axis, from(5.0)) else { panic!() };
    assert!(why.cause.contains("holds 5.0 µm, but 20.0 µm from the gateway were expected in it"), "{why}");
}

fn cnc_place(profile: &Profile) -> OutputPlace {
    of_output(profile, cnc(profile))
}
