use std::time::Duration;

use super::*;
use crate::gateway::state::signal_table::SignalTable;
use crate::gateway::store::default_limits;
use crate::gateway::store::log::sample;
use isotherm_core::compensation::model::{Input, Kind, Reference};
use isotherm_core::compensation::{Compensation, Control, Permit, Snapshot};
use isotherm_core::quantity::Micron;
use isotherm_core::reading::Reading;
use isotherm_profile::{DefaultLimits, DefaultRange};

/// Profile in which both terms of the first model of axis z lag behind their temperature by half an hour.
fn lagging() -> Profile {
    let mut profile = sample::profile();
    profile.machine.on = None;
    let Kind::Linear(linear) = &mut profile.axes[0].settings.models[0].kind else { panic!("linear") };
    for term in &mut linear.terms {
        term.input = Input::of(term.input.signal, Reference::Start, Some(Duration::from_secs(1800)));
    }
    profile
}

fn gateway(profile: &Profile, remembered: Remembered) -> Compensation {
    let axes = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
    Compensation::new(profile.machine.clone(), axes, remembered)
}

/// Rest of a state without signs and values. The signals have the places of this profile.
fn rest(profile: &Profile) -> UnchangedParts {
    UnchangedParts { signs: BTreeMap::new(), places: Arc::new(Places::of(profile)), values: BTreeMap::new() }
}

fn memory(profile: &Profile, at: Moment, remembered: Remembered) -> Memory {
    Memory::new(Arc::new(profile.clone()), at, remembered, BTreeMap::new(), rest(profile))
}

/// State as the next start finds it.
fn saved(mut memory: Memory) -> Value {
    let text = serde_json::to_string(&memory.saved().unwrap()).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Steps every 10 s in this range of seconds. Returns the values of Cz of axis z. The temperatures change linearly.
fn run(
    compensation: &mut Compensation,
    seconds: std::ops::Range<u64>,
    mut take_over: Option<Micron>,
) -> Vec<Micron> {
    let mut found = Vec::new();
    for second in seconds.step_by(10) {
        let now = Moment::from_nanos(second * 1_000_000_000);
        let time = now.as_secs_f64();
        let values = [20.0 + 0.0015 * time, 20.0 - 0.0005 * time, 1.0, 0.0];
        let readings = values.map(|value| Reading::good(value, now));
        let control = Control { permit: Permit::Armed, take_over: take_over.take(), ..Control::default() };
        compensation.step(&Snapshot::new(now, &readings), &[control; 2]);
        found.push(compensation.decision(0).unwrap().cz);
    }
    found
}

#[test]
fn an_hour_off_differs_from_an_uninterrupted_run_by_no_more_than_a_count() {
    let profile = lagging();
    let mut whole = gateway(&profile, Remembered::default());
    let uninterrupted = run(&mut whole, 0..9000, Some(Micron::ZERO));

    let mut before = gateway(&profile, Remembered::default());
    let last = *run(&mut before, 0..1810, Some(Micron::ZERO)).last().unwrap();
    let stopped = Moment::from_nanos(1_800_000_000_000);
    let saved = saved(memory(&profile, stopped, before.remembered()));
    let restored = Memory::recall(Some(saved), &profile).unwrap();
    assert_eq!(restored.remembered, before.remembered());

    let mut after = gateway(&profile, restored.remembered);
    let resumed = run(&mut after, 5400..9000, Some(last));
    for pair in [&[last][..], &resumed].concat().windows(2) {
        assert!((pair[1] - pair[0]).abs().get() <= 1.0 + 1e-9, "{pair:?}");
    }
    let (raw, wanted) = (after.decision(0).unwrap().raw.unwrap(), whole.decision(0).unwrap().raw.unwrap());
    assert!((raw - wanted).abs().get() < 1e-9, "{raw:?} {wanted:?}");
    let (end, wanted) = (resumed.last().unwrap(), uninterrupted.last().unwrap());
    assert!((*end - *wanted).abs().get() < 0.1 + 1e-9, "{end:?} {wanted:?}");
}

#[test]
fn a_lag_is_found_again_by_its_signals_name_when_the_list_has_changed() {
    let profile = lagging();
    let mut before = gateway(&profile, Remembered::default());
    run(&mut before, 0..1810, None);
    let stopped = Moment::from_nanos(1_800_000_000_000);
    let saved = saved(memory(&profile, stopped, before.remembered()));
    let mut changed = profile.clone();
    changed.signals.swap(0, 1);
    for axis in &mut changed.axes {
        for model in &mut axis.settings.models {
            let Kind::Linear(linear) = &mut model.kind else { continue };
            linear.terms.iter_mut().for_each(|term| term.input.signal.0 = 1 - term.input.signal.0);
        }
    }
    let restored = Memory::recall(Some(saved), &changed).unwrap().remembered;
    assert_eq!(gateway(&changed, restored.clone()).remembered().axes.len(), 1);
    assert_eq!(gateway(&changed, restored.clone()).remembered(), restored, "nothing was forgotten");
}

#[test]
fn references_are_kept_by_name_and_one_of_a_signal_that_is_gone_is_dropped_with_its_lag() {
    let profile = lagging();
    let mut before = gateway(&profile, Remembered::default());
    run(&mut before, 0..1810, None);
    let saved = saved(memory(&profile, Moment::default(), before.remembered()));
    let names = [&profile.signals[0].name, &profile.signals[1].name];
    assert!(
        names.iter().all(|name| saved["machine"]["start"][name.as_str()]["value"].is_number()),
        "{saved}"
    );
    assert_eq!(saved["machine"]["axes"]["z"]["lags"][0]["signal"], names[0].as_str());
    let mut renamed = profile.clone();
    renamed.signals[0].name = "renamed".to_owned();
    let restored = Memory::recall(Some(saved), &renamed).unwrap().remembered;
    let captured =
        |place| restored.machine.captured(Reference::Start, isotherm_core::reading::SignalId(place));
    assert!(captured(0).is_none() && captured(1).is_some());
    let again = serde_json::to_value(&restored).unwrap();
    assert_eq!(again["axes"][0]["lags"].as_array().unwrap().len(), 1, "{again}");
}

#[test]
fn without_a_file_nothing_is_remembered() {
    let restored = Memory::recall(None, &sample::profile()).unwrap();
    assert_eq!((restored.remembered, restored.verified_um.len()), (Remembered::default(), 0));
}

#[test]
fn what_was_captured_from_a_signal_that_lies_elsewhere_is_forgotten_with_its_lag_and_nothing_else_is() {
    let profile = lagging();
    let mut before = gateway(&profile, Remembered::default());
    run(&mut before, 0..1810, None);
    let saved = saved(memory(&profile, Moment::default(), before.remembered()));
    type Change = fn(&mut isotherm_profile::Signal);
    let changes: [Change; 3] = [
        |signal| signal.encoding.scale = isotherm_core::codec::Scale::of(0.2),
        |signal| signal.encoding.offset = 5.0,
        |signal| {
            let register =
                isotherm_core::codec::Register { table: isotherm_core::codec::Table::Input, offset: 77 };
            signal.address = register.into();
        },
    ];
    let captured = |restored: &RestoredMemory, place| {
        restored.remembered.machine.captured(Reference::Start, SignalId(place)).is_some()
    };
    for change in changes {
        let mut moved = profile.clone();
        change(&mut moved.signals[0]);
        let restored = Memory::recall(Some(saved.clone()), &moved).unwrap();
        assert_eq!(restored.moved.keys().collect::<Vec<_>>(), [&profile.signals[0].name]);
        assert!(!captured(&restored, 0) && captured(&restored, 1));
        let again = serde_json::to_value(&restored.remembered).unwrap();
        assert_eq!(again["axes"][0]["lags"].as_array().unwrap().len(), 1, "{again}");
        let mut after = gateway(&moved, restored.remembered);
        run(&mut after, 5400..6000, None);
        assert!(after.machine().captured(Reference::Start, SignalId(0)).is_some(), "it is captured again");
    }
    let restored = Memory::recall(Some(saved.clone()), &profile).unwrap();
    assert!(restored.moved.is_empty() && captured(&restored, 0));
    let mut of_layout_5 = saved;
    of_layout_5.as_object_mut().unwrap().remove("places");
    let mut moved = profile.clone();
    moved.signals[0].encoding.offset = 5.0;
    let restored = Memory::recall(Some(of_layout_5), &moved).unwrap();
    assert!(
        restored.moved.is_empty() && captured(&restored, 0),
        "a state without places takes those of the profile"
    );
}

#[test]
fn last_good_values_age_over_a_stop_and_go_with_the_place_of_their_signal() {
    let mut profile = sample::profile();
    profile.signals[0].max_rate = Some(0.5);
    let name = profile.signals[0].name.clone();
    let mut board = SignalTable::new(&Arc::new(profile.clone()));
    let at = |seconds: u64| Moment::from_nanos(seconds * 1_000_000_000);
    board.store(SignalId(0), Ok(21.5), at(100), 0);
    let values = board.last_good(at(130));
    assert_eq!(values[&name], LastGood { value: 21.5, age: Duration::from_secs(30), exponent: None });
    let rest = UnchangedParts { values: values.clone(), ..rest(&profile) };
    let memory =
        Memory::new(Arc::new(profile.clone()), at(130), Remembered::default(), BTreeMap::new(), rest);
    let state = saved(memory);
    assert_eq!(Memory::recall(Some(state.clone()), &profile).unwrap().values, values);
    let mut moved = profile;
    moved.signals[0].encoding.scale = isotherm_core::codec::Scale::of(7.0);
    assert!(
        Memory::recall(Some(state.clone()), &moved).unwrap().values.is_empty(),
        "another worth of a count"
    );
    moved.signals[0].encoding.scale = isotherm_core::codec::Scale::ONE;
    moved.signals[0].scale_from = Some(Box::new(isotherm_core::codec::ScaleFrom {
        address: "holding:12".parse().unwrap(),
        encoding: moved.signals[0].encoding.clone(),
        meaning: isotherm_core::codec::ScaleMeaning::Decimals,
    }));
    assert!(Memory::recall(Some(state), &moved).unwrap().values.is_empty(), "a scale in another register");
}

#[test]
fn default_limits_are_saved_and_a_state_of_a_version_without_them_has_none() {
    let mut profile = sample::profile();
    let limits = DefaultLimits { range: Some(DefaultRange::Within(-40.0, 200.0)), max_rate: Some(5.0) };
    profile.signals[0].defaults = limits;
    // The sample gives all its signals the same register. This one can be recognised under another name.
    profile.signals[0].encoding.offset = 1.5;
    let known = default_limits::of(&profile);
    let at = Moment::from_nanos(1_000_000_000);
    let mut state = saved(memory(&profile, at, Remembered::default()));
    assert_eq!(Memory::recall(Some(state.clone()), &profile).unwrap().limits, known);
    let mut renamed = profile.clone();
    renamed.signals[0].name = "another_name".to_owned();
    let recalled = Memory::recall(Some(state.clone()), &renamed).unwrap().limits;
    assert_eq!(recalled.get("another_name"), Some(&limits));
    state.as_object_mut().unwrap().remove("limits");
    assert!(Memory::recall(Some(state), &profile).unwrap().limits.is_empty());
}
