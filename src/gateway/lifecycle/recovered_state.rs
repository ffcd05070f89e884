//! State that the previous run has saved, and the decision whether it is accepted.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::options::Options;
use crate::clock::{Clock, Correction};
use crate::gateway::shared::state::GatewayState;
use crate::gateway::store::default_limits;
use crate::gateway::store::documents::{self, Entries, Entry, Opened, WHAT};
use crate::gateway::store::log::outputs::ENDING;
use crate::gateway::store::memory::{Memory, RestoredMemory};
use crate::gateway::store::places::{Moves, Places, of_output, why_forgotten};
use crate::gateway::store::release::{Releases, ReturningRegister, extend};
use crate::gateway::store::storage::{clock_correction, newest_stamp, retention};
use crate::observe::events::{Adoption, Event, Journal};
use isotherm_core::compensation::{Preference, Stop};
use isotherm_core::explained::Explained;
use isotherm_core::output::Account;
use isotherm_core::place::{KnownOutput, OutputPlace, Release, Stage};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Axis, AxisId, Profile};

/// State that the previous run has left in the state directory, and the conclusions for this run.
#[derive(Default)]
pub(in crate::gateway) struct RecoveredState {
    pub(in crate::gateway) restored: RestoredMemory,
    /// Correction of the computer's clock; `None` if the clock has continued correctly since the end of the previous
    /// run.
    pub(in crate::gateway) correction: Option<Correction>,
    /// State document (file with the saved state) of the previous run; `None` without a state directory.
    pub(in crate::gateway) opened: Option<Opened>,
    /// Registers and addresses of this profile, with their changes since the previous run.
    pub(in crate::gateway) places: Places,
    /// Whether a saved state exists, but was rejected.
    pub(in crate::gateway) is_lost: bool,
}

impl RecoveredState {
    pub(in crate::gateway) fn open(
        options: &Options,
        profile: &Profile,
        (journal, clock): (&Journal, &Clock),
    ) -> RecoveredState {
        let Some(directory) = options.directory.as_deref() else {
            let remembered = options.remembered_in.as_deref();
            let remembered = remembered.map(|directory| remembered_places(directory, profile));
            let places = Places::of_outputs(profile).with_namespaces_of(remembered.unwrap_or_default());
            return RecoveredState { places, ..RecoveredState::default() };
        };
        let (machine, now) = (&profile.name, clock.now());
        // Without threads there is no log.
        let is_log = |log: &retention::DayLog| log.name.ends_with(ENDING);
        let has_logs = options.has_threads && retention::logs(directory, machine).iter().any(is_log);
        let mut opened = documents::open(&options.disk, (directory, machine), has_logs, clock.stamp(now));
        if let Some((version, kept)) = opened.earlier.take() {
            journal.report(now, &Event::TakenFromEarlier { what: "saved state", version, kept });
        }
        let state = match &mut opened.found {
            Ok(content) => content.as_mut().and_then(|content| content.state.take()),
            Err(why) => {
                journal.report(now, &Event::NotBelieved { why: why.clone() });
                None
            }
        };
        // The state is kept until there is a newer one.
        state.iter().for_each(|state| opened.file.set_state(state));
        let mut is_lost = opened.found.is_err();
        let restored = Memory::recall(state, profile).unwrap_or_else(|why| {
            is_lost = true;
            opened.file.question().open();
            let why =
                format!("{WHAT} in {} is rejected: {why}", documents::path(directory, machine).display());
            journal.report(now, &Event::NotBelieved { why });
            RestoredMemory::default()
        });
        if let Ok(Some(content)) = &mut opened.found {
            name_as(profile, &restored.places, &mut content.outputs);
        }
        for (signal, moved) in &restored.moved {
            let (signal, why) = (signal.clone(), why_forgotten(signal, moved));
            journal.report(now, &Event::ReferenceForgotten { signal, why });
        }
        let settings = profile.axes.iter().map(|axis| &axis.settings);
        for (axis, model) in restored.remembered.superseded(settings) {
            let (axis, model) = (axis.to_owned(), model.to_owned());
            journal.report(now, &Event::Adoption(Adoption::Superseded { axis, model }));
        }
        // Without a saved state, nothing has changed for the operator.
        if restored.at.is_some() {
            for event in default_limits::new_since(&restored.limits, profile) {
                journal.report(now, &event);
            }
        }
        let nothing = Entries::new();
        let entries = match &opened.found {
            Ok(Some(content)) => &content.outputs,
            Ok(None) | Err(_) => &nothing,
        };
        let places = restored.places.clone();
        let mut places = places.after(profile, &outputs(&restored, entries), opened.is_first && !is_lost);
        places.keep(entries);
        let mut left = RecoveredState { restored, correction: None, opened: Some(opened), places, is_lost };
        left.correction = left.restored.resume((directory, machine), (journal, clock));
        left
    }

    /// Adds the released registers to the profile, with their entries in the register ledger. An operator has
    /// requested that these registers return to their base values. A register is not added in a dry run,
    /// while the saved state is in question (an operator must accept it), or while another gateway writes to
    /// the register. If an earlier run began a release, the gateway does not repeat the release. It reports
    /// the former register again.
    pub(in crate::gateway) fn extend(&mut self, profile: &mut Profile, options: &Options) -> Releases {
        let RecoveredState { places, opened, is_lost, .. } = self;
        let releases = std::mem::take(&mut places.releases);
        let (asked, begun): (Vec<Release>, Vec<Release>) =
            releases.into_iter().partition(|release| release.stage == Stage::Asked);
        begun.iter().for_each(|release| places.ends(release));
        let mut releases = Releases::of(profile, &places.former, &places.kept);
        let found = opened.as_mut().filter(|opened| !opened.file.question().is_open());
        let Some(Ok(found)) = found.map(|opened| &mut opened.found) else { return releases };
        if options.dry_run || *is_lost {
            return releases;
        }
        if let Err(why) = &options.may_release {
            let why =
                Explained::new(why.clone(), "leave the register to the other gateway, then arm the axis");
            asked.iter().for_each(|release| releases.refuse(&release.place, &why));
        }
        let can = |release: &Release| releases.obstacle(&release.place).is_none();
        let asked: Vec<Release> = asked.into_iter().filter(can).collect();
        releases.returning = extend(profile, &asked);
        for one in &mut releases.returning {
            let mut former = places.former.iter();
            let former = former.find(|former| one.release.is_of(&former.output, &former.place));
            let waits = |axis: &Axis| former.is_some_and(|former| former.axes.contains(&axis.settings.name));
            let axes = profile.axes.iter().enumerate();
            one.waits.extend(axes.filter(|(_, axis)| waits(axis)).map(|(axis, _)| AxisId(axis)));
        }
        let entries = &mut found.get_or_insert_default().outputs;
        for one in &releases.returning {
            let output = profile.output(one.output);
            if let Some(kept) = places.kept_of(&one.release.place) {
                entries.insert(output.name.clone(), Entry::new(of_output(profile, output), kept));
            }
        }
        // No later run repeats the release, however this run ends.
        let begun = |one: &ReturningRegister| Release { stage: Stage::Begun, ..one.release.clone() };
        places.releases = releases.returning.iter().map(begun).collect();
        releases
    }
}

impl RestoredMemory {
    /// Adds the duration of the stop to the ages in the saved state, if the computer's clock is correct. Returns the
    /// correction of the clock; `None` if the clock has continued correctly since the previous run.
    fn resume(
        &mut self,
        (directory, machine): (&Path, &str),
        (journal, clock): (&Journal, &Clock),
    ) -> Option<Correction> {
        let now = clock.now();
        let by_the_clock = clock.stamp(now);
        let logged = newest_stamp(directory, machine, by_the_clock);
        let correction = clock_correction(by_the_clock, self.at.max(logged));
        if let Some(Correction { from: last, .. }) = correction {
            journal.report(now, &Event::ClockDoubtful { last });
        }
        if let Some(at) = self.at {
            let stop = match correction {
                None => Stop::between(at, by_the_clock),
                Some(_) => Stop::default(),
            };
            match stop.by_the_clock {
                Some(span) => {
                    self.values.values_mut().for_each(|last| last.age = last.age.saturating_add(span))
                }
                None => self.values.clear(),
            }
            self.remembered = std::mem::take(&mut self.remembered).resumed(at, now, stop);
        }
        correction
    }
}

/// Begins a run with the registers and addresses of its profile, and with the state of the previous run. `is_lost`:
/// whether a saved state exists, but was rejected.
pub(in crate::gateway) fn begin(
    core: &mut GatewayState,
    (places, is_lost): (Places, bool),
    restored: RestoredMemory,
    now: Moment,
) {
    let profile = Arc::clone(&core.given.profile);
    for (place, output) in profile.outputs.iter().enumerate() {
        if output.writes.position().is_none() {
            continue;
        }
        let (name, last) = (&output.name, restored.verified_um.get(&output.name));
        let left = last.zip(places.outputs.get(name));
        let left = left.and_then(|(last, now)| restored.places.left_in_position(now, name, *last));
        core.outputs[place].cz = left.and_then(Micron::new).or(is_lost.then_some(Micron::ZERO));
        if is_lost {
            core.events.push(Event::PositionFromZero { output: name.clone() });
        }
    }
    let mut left_um = restored.verified_um;
    left_um.retain(|name, _| {
        let (was, is) = (restored.places.outputs.get(name), places.outputs.get(name));
        was.zip(is).is_none_or(|(was, is)| was.is_same_register(is))
    });
    core.storage.left_um = left_um;
    core.board.recall(&restored.values, now);
    core.places = Moves::new(places, &profile);
    core.storage.left_um.retain(|name, _| !core.places.is_in_doubt(name));
    core.events.extend(core.places.events(&core.releases, &profile));
}

/// Replaces the node names in the entries of the register ledger by the names that this profile uses for the same
/// nodes.
fn name_as(profile: &Profile, places: &Places, entries: &mut Entries) {
    let now = Places::of(profile);
    for (name, entry) in entries {
        entry.place.iter_mut().for_each(|place| places.name_output(&now, name, place));
    }
}

/// Returns the state of each output at the end of the previous run. The keys are the names that the outputs have in
/// the present profile.
fn outputs(restored: &RestoredMemory, entries: &Entries) -> BTreeMap<String, KnownOutput> {
    let own = entries.iter().filter(|(name, entry)| !restored.places.is_of_a_release(name, entry));
    let entries: BTreeMap<&String, &Entry> =
        own.map(|(name, entry)| (restored.renamed.get(name).unwrap_or(name), entry)).collect();
    let of_entries = entries.iter().filter_map(|(name, entry)| Some((*name, entry.place.as_ref()?)));
    // The state also contains outputs to which nothing was written.
    let all = of_entries.chain(&restored.places.outputs);
    let known = all.map(|(name, place)| {
        let share = entries.get(name).and_then(|entry| share_um(entry, place));
        // The state of a run that was killed may be older than its first write.
        let is_promised = entries.get(name).is_some_and(|entry| entry.kept.promises.iter().next().is_some());
        let was_driven = is_promised || restored.places.was_driven(name);
        let verified = restored.verified_um.get(name).filter(|_| was_driven);
        let held_um = share.or(verified.copied());
        (name.clone(), KnownOutput { place: place.clone(), held_um, was_driven })
    });
    known.collect()
}

/// Returns the gateway share in a shared register (the part that the gateway has added), in µm, from the entry of the
/// register ledger. `None` if the share is not known, or the entry belongs to another register.
fn share_um(entry: &Entry, place: &OutputPlace) -> Option<f64> {
    let is_of_it = entry.place.as_ref().is_some_and(|known| known.is_same_register(place));
    let Account { share, .. } = entry.kept.account.filter(|account| is_of_it && account.doubt.is_none())?;
    #[allow(clippy::cast_precision_loss, reason = "no register holds 2^53 counts")]
    let share = share.0 as f64;
    Some(share * place.scale / if place.diameter { 2.0 } else { 1.0 })
}

/// Reads the registers and addresses that a gateway has saved in its state directory. Returns an empty list if the
/// state cannot be read.
fn remembered_places(directory: &Path, profile: &Profile) -> Places {
    let state = documents::content(directory, &profile.name).and_then(|content| content.state);
    Memory::recall(state, profile).unwrap_or_default().places
}

/// Describes the changes of registers and addresses since the last run, in one sentence each. Changes that an
/// operator has confirmed are left out. The list is empty if the saved state cannot be read.
pub fn moved_since(directory: &Path, profile: &Profile) -> Vec<String> {
    let Some((places, restored)) = places_in(directory, profile) else { return Vec::new() };
    let signals = restored.moved.iter().map(|(signal, moved)| why_forgotten(signal, moved));
    places.explain().into_iter().chain(signals).map(|why| why.to_string()).collect()
}

/// Returns which model the operator prefers for each axis that learns, as saved in this state directory. The list is
/// empty if the state cannot be read. It does not contain an axis whose models in the profile have changed.
pub fn preferences_in(directory: &Path, profile: &Profile) -> Vec<(String, Preference)> {
    let state = documents::content(directory, &profile.name).and_then(|content| content.state);
    let Ok(restored) = Memory::recall(state, profile) else { return Vec::new() };
    let settings = || profile.axes.iter().map(|axis| &axis.settings);
    let superseded: Vec<&str> = restored.remembered.superseded(settings()).map(|(axis, _)| axis).collect();
    let own = |axis: &str| settings().find(|own| own.name == axis).and_then(|own| own.learned.as_ref());
    let kept = restored.remembered.axes.iter().filter_map(|axis| {
        let preference = axis.preference().filter(|_| !superseded.contains(&axis.name()))?;
        let is_own = own(axis.name()).is_some_and(|slot| slot.own == preference.own());
        is_own.then(|| (axis.name().to_owned(), preference.clone()))
    });
    kept.collect()
}

/// Returns names of axis and model for each learned model in this state directory that the gateway does not use with
/// this profile. The reason is that the models of the profile have changed, or that the axis lacks an input. The list
/// is empty if the state cannot be read.
pub fn superseded_in(directory: &Path, profile: &Profile) -> Vec<(String, String)> {
    let state = documents::content(directory, &profile.name).and_then(|content| content.state);
    let Ok(restored) = Memory::recall(state, profile) else { return Vec::new() };
    let superseded = restored.remembered.superseded(profile.axes.iter().map(|axis| &axis.settings));
    superseded.map(|(axis, model)| (axis.to_owned(), model.to_owned())).collect()
}

/// Returns the profile with which the next gateway with this state directory will run. The result contains the
/// released registers (an operator has requested to return them to their base values).
pub fn with_releases(directory: &Path, mut profile: Profile) -> Profile {
    if let Some((places, _)) = places_in(directory, &profile) {
        let asked = places.releases.iter().filter(|release| release.stage == Stage::Asked);
        extend(&mut profile, &asked.cloned().collect::<Vec<_>>());
    }
    profile
}

/// Reads the saved state of a machine whose gateway is stopped, and compares the saved registers and addresses with
/// those of a profile. Returns `None` if the state cannot be read.
fn places_in(directory: &Path, profile: &Profile) -> Option<(Places, RestoredMemory)> {
    let mut content = documents::content(directory, &profile.name)?;
    let mut restored = Memory::recall(content.state.take(), profile).ok()?;
    name_as(profile, &restored.places, &mut content.outputs);
    let left = outputs(&restored, &content.outputs);
    let places = std::mem::take(&mut restored.places).after(profile, &left, false);
    Some((places, restored))
}

/// Checks that a gateway may start with the content of its state directory.
///
/// # Errors
/// A later version of isotherm has written the content, or every user may write to it. The error is a sentence with the
/// remedy.
pub fn may_start(options: &Options, profile: &Profile) -> Result<(), String> {
    let Some(directory) = options.directory.as_deref() else { return Ok(()) };
    documents::may_start(&*options.disk, directory, &profile.name)
}
