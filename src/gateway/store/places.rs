//! Places: the registers of the outputs and the addresses of the signals. The gateway saves them for the next start,
//! and reports each change. After a change, some axes must wait for the operator. [`isotherm_core::place`] compares
//! saved and present places.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::documents::{Entries, Entry};
use super::release::{AXIS, BY_HAND, Releases, bounds_of, layout};
use crate::observe::events::Event;
use isotherm_core::codec::{Namespace, NodeId, ScaleMeaning};
use isotherm_core::explained::Explained;
use isotherm_core::namespaces::KnownNamespaces;
use isotherm_core::output::SavedOutput;
use isotherm_core::place::{
    self, Bounds, FormerPlace, KnownOutput, MovedPlace, OutputPlace, Owner, Place, PlaceComparison, Release,
    SignalPlace, Stage,
};
use isotherm_core::quantity::Micron;
use isotherm_profile::{AxisId, DeviceId, Output, OutputId, Profile, Share, Signal, Writes};

/// Hint about an output whose register was shared with an operator in the previous run, but is no longer shared.
const WHOLE: &str = "arming makes the whole register value the gateway share, including the operator offset; \
                     to keep the operator offset, write share = \"ledger\" again";

/// Registers of outputs and addresses of signals, together called places, in the form in which they are saved.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct Places {
    /// Register of each output, by the output's name.
    pub(in crate::gateway) outputs: BTreeMap<String, OutputPlace>,
    /// Address of each signal, by the signal's name.
    pub(in crate::gateway) signals: BTreeMap<String, SignalPlace>,
    /// Former registers of outputs that were moved or removed, until the operator confirms the change.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::gateway) former: Vec<FormerPlace>,
    /// Names of the outputs whose register the gateway has read, but never written.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    only_read: BTreeSet<String>,
    /// URIs of the OPC UA namespaces that the profile refers to by index. The key is the address of the OPC UA
    /// server.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    namespaces: BTreeMap<String, KnownNamespaces>,
    /// Limit, step and rate for each output, by the output's name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    bounds: BTreeMap<String, Bounds>,
    /// Entries of the register ledger for former registers that no output uses now.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::gateway) kept: Vec<Entry>,
    /// Releases (returns to the base value) of former registers that the operator has requested.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::gateway) releases: Vec<Release>,
}

/// Registers and addresses of this run, and the state of the reports about former registers.
#[derive(Debug, Default)]
pub(in crate::gateway) struct Moves {
    pub(in crate::gateway) places: Arc<Places>,
    /// Outputs whose register has changed since the previous run, and whose new register has not been read yet.
    unread: Vec<OutputId>,
}

/// Returns the register of an output of the profile.
pub(in crate::gateway) fn of_output(profile: &Profile, output: &Output) -> OutputPlace {
    let ((bus, unit), axis) = (line(profile, output.device), profile.axis(output.axis));
    OutputPlace {
        bus,
        unit,
        address: output.address.to_string(),
        layout: layout(&output.encoding),
        scale: output.encoding.scale.get(),
        bias: output.encoding.bias,
        share: match output.share {
            Share::Whole => Owner::Whole,
            Share::Ledger => Owner::Ledger,
        },
        writes: output.writes.name().to_owned(),
        axis: axis.settings.name.clone(),
        diameter: axis.diameter,
    }
}

fn of_signal(profile: &Profile, signal: &Signal) -> SignalPlace {
    let (bus, unit) = line(profile, signal.device);
    let element = signal.address.node().and_then(|node| node.element.as_ref());
    let element = element.map_or(String::new(), |element| format!(" {element}"));
    let scale_from = signal.scale_from.as_ref().map_or(String::new(), |from| {
        let meaning = match from.meaning {
            ScaleMeaning::PowerOfTen => "power of ten",
            ScaleMeaning::Decimals => "decimals",
        };
        format!(", {meaning} in {} ({})", from.address, layout(&from.encoding))
    });
    SignalPlace {
        bus,
        unit,
        address: signal.address.to_string(),
        layout: layout(&signal.encoding) + &element + &scale_from,
        scale: signal.encoding.scale.get(),
        offset: signal.encoding.offset,
    }
}

/// Returns the address of the bus of a device, and the unit address of the device.
fn line(profile: &Profile, device: DeviceId) -> (String, u8) {
    let device = profile.devices.get(device.0);
    let bus = device.and_then(|device| profile.buses.get(device.bus.0));
    (bus.map_or(String::new(), |bus| bus.address.clone()), device.map_or(0, |device| device.unit))
}

/// Parses an address as an OPC UA node. If the URI of the node's namespace is known, the URI replaces the index.
/// `None` if the address is not an OPC UA node.
fn by_uri(address: &str, known: &KnownNamespaces) -> Option<NodeId> {
    let mut node: NodeId = address.strip_prefix("node ")?.parse().ok()?;
    if let Namespace::Index(index) = node.namespace
        && let Some(uri) = known.uri(index)
    {
        node.namespace = Namespace::Uri(uri.to_owned());
    }
    Some(node)
}

/// Returns the namespace index in the address of an OPC UA node. `None` if the address contains a URI, or is not a
/// node.
fn index_of(address: &str) -> Option<u16> {
    let node: NodeId = address.strip_prefix("node ")?.parse().ok()?;
    match node.namespace {
        Namespace::Index(index) => Some(index),
        Namespace::Uri(_) => None,
    }
}

/// Returns old and new name of each output or signal that was renamed without another change.
fn new_names<P: Place>(before: &BTreeMap<String, P>, now: &BTreeMap<String, P>) -> BTreeMap<String, String> {
    let found = place::compare(before, now).into_iter();
    let renamed = found.filter_map(|(name, found)| match found {
        PlaceComparison::Renamed(former) => Some((former, name)),
        PlaceComparison::Same
        | PlaceComparison::Moved(_)
        | PlaceComparison::Unknown
        | PlaceComparison::Removed => None,
    });
    renamed.collect()
}

impl Places {
    /// Returns the registers and addresses of a profile. Registers of releases are left out.
    pub(in crate::gateway) fn of(profile: &Profile) -> Places {
        let signals = profile.signals.iter().map(|signal| (signal.name.clone(), of_signal(profile, signal)));
        Places { signals: signals.collect(), ..Places::of_outputs(profile) }
    }

    /// Returns the registers of the outputs of a profile, without the addresses of signals. A run that saves nothing
    /// does not need these addresses.
    pub(in crate::gateway) fn of_outputs(profile: &Profile) -> Places {
        let own = || profile.outputs.iter().filter(|output| !profile.is_release(output.axis));
        let outputs = own().map(|output| (output.name.clone(), of_output(profile, output)));
        let bounds = own().map(|output| (output.name.clone(), bounds_of(profile, output)));
        Places { outputs: outputs.collect(), bounds: bounds.collect(), ..Places::default() }
    }

    /// Replaces each saved node name by the name in this profile (`now`), if both names mean the same node. For
    /// example, `ns=2;s=offset` and `nsu=urn:mill;s=offset` may mean the same node.
    fn named_as(mut self, now: &Places) -> Places {
        let known = Places { namespaces: self.namespaces.clone(), ..Places::default() };
        if known.namespaces.is_empty() {
            return self;
        }
        let mut namespaces = std::mem::take(&mut self.namespaces);
        for (bus, known) in &mut namespaces {
            // A node that was added may mean the present namespace of the server, not the saved one.
            let (before, after) = (self.addresses(bus), now.addresses(bus));
            known.doubt_unless(|index| {
                let is_at = |address: &&&str| index_of(address) == Some(index);
                after.iter().filter(is_at).all(|address| before.contains(address))
            });
        }
        self.namespaces = namespaces;
        self.outputs.iter_mut().for_each(|(name, place)| known.name_output(now, name, place));
        for FormerPlace { output, place, .. } in &mut self.former {
            known.name_output(now, output, place);
        }
        for (name, place) in &mut self.signals {
            let same_name = now.signals.get(name).map(|place| place.address.as_str());
            known.name_node(now, same_name, &place.bus, &mut place.address);
        }
        self
    }

    /// Replaces the saved namespaces of all servers by the namespaces in `others`.
    pub(in crate::gateway) fn with_namespaces_of(self, others: Places) -> Places {
        Places { namespaces: others.namespaces, ..self }
    }

    /// Replaces the node name of an output by the name in this profile (`now`), if both names mean the same node.
    pub(in crate::gateway) fn name_output(&self, now: &Places, name: &str, place: &mut OutputPlace) {
        let same_name = now.outputs.get(name).map(|place| place.address.as_str());
        self.name_node(now, same_name, &place.bus, &mut place.address);
    }

    /// Replaces the node name in an address by the name in this profile (`now`), if both names mean the same node. If
    /// the profile has two names for the node, the name of the same output or signal is preferred.
    fn name_node(&self, now: &Places, same_name: Option<&str>, bus: &str, address: &mut String) {
        let Some(known) = self.namespaces.get(bus) else { return };
        let Some(was) = by_uri(address, known) else { return };
        let is_same = |is: &&str| by_uri(is, known).as_ref() == Some(&was);
        let another = || now.addresses(bus).into_iter().find(is_same);
        if let Some(is) = same_name.filter(is_same).or_else(another) {
            is.clone_into(address);
        }
    }

    /// Returns the addresses of outputs and signals on a bus.
    fn addresses(&self, bus: &str) -> Vec<&str> {
        let outputs = self.outputs.values().map(|place| (&place.bus, &place.address));
        let signals = self.signals.values().map(|place| (&place.bus, &place.address));
        outputs.chain(signals).filter(|(of, _)| *of == bus).map(|(_, address)| address.as_str()).collect()
    }

    /// Returns the signals whose address has changed in this profile.
    pub(super) fn moved_signals(&self, now: &Places) -> BTreeMap<String, MovedPlace> {
        let found = place::compare(&self.signals, &now.signals).into_iter();
        let moved = found.filter_map(|(name, found)| match found {
            PlaceComparison::Moved(moved) => Some((name, moved)),
            PlaceComparison::Same
            | PlaceComparison::Renamed(_)
            | PlaceComparison::Unknown
            | PlaceComparison::Removed => None,
        });
        moved.collect()
    }

    /// Replaces old names of nodes and outputs by the names in this profile (`now`). Also returns old and new name of
    /// each output that was renamed and has the same register as before.
    pub(super) fn under_names_of(self, now: &Places) -> (Places, BTreeMap<String, String>) {
        let places = self.named_as(now);
        let names = new_names(&places.outputs, &now.outputs);
        (places.renamed(&names), names)
    }

    /// Returns old and new name of each signal that was renamed in this profile and has the same address as before.
    pub(super) fn new_names_of_signals(&self, now: &Places) -> BTreeMap<String, String> {
        new_names(&self.signals, &now.signals)
    }

    /// Replaces the old names of outputs by the new names.
    fn renamed(self, names: &BTreeMap<String, String>) -> Places {
        let (outputs, bounds) = (renamed(self.outputs, names), renamed(self.bounds, names));
        let former = self.former.into_iter().map(|former| former.renamed(names)).collect();
        let new = |name: String| names.get(&name).cloned().unwrap_or(name);
        let only_read = self.only_read.into_iter().map(new).collect();
        let of_release = |release: Release| Release { output: new(release.output), ..release };
        let releases = self.releases.into_iter().map(of_release).collect();
        Places { outputs, former, only_read, bounds, releases, ..self }
    }

    /// Returns whether the gateway may have written to the register of this output before.
    pub(in crate::gateway) fn was_driven(&self, output: &str) -> bool {
        !self.only_read.contains(output)
    }

    /// Returns the registers and addresses for the next run. `left` contains the outputs at the end of this run.
    /// `is_first`: whether no earlier run has left a file.
    pub(in crate::gateway) fn after(
        self,
        profile: &Profile,
        left: &BTreeMap<String, KnownOutput>,
        is_first: bool,
    ) -> Places {
        let now = Places::of(profile);
        // A document of layout 5 has no places, and does not show which outputs were written.
        let is_new_unwritten = is_first || !self.outputs.is_empty();
        let found = place::compare(&self.outputs, &now.outputs);
        // An output counts as written by the gateway if its register keeps a value of the gateway.
        let keeps_ours =
            |name: &String| self.former.iter().any(|former| now.outputs[name].is_at(&former.place));
        let is_only_read = |name: &String| match found.get(name) {
            Some(PlaceComparison::Same | PlaceComparison::Renamed(_)) => self.only_read.contains(name),
            Some(PlaceComparison::Moved(_)) => !keeps_ours(name),
            Some(PlaceComparison::Unknown | PlaceComparison::Removed) | None => {
                is_new_unwritten && !keeps_ours(name)
            }
        };
        let only_read = now.outputs.keys().filter(|name| is_only_read(name)).cloned().collect();
        let mut former = FormerPlace::after(self.former, left, &now.outputs);
        for former in former.iter_mut().filter(|former| former.bounds.is_none()) {
            let known = self.outputs.get(&former.output).filter(|place| **place == former.place);
            former.bounds = known.and_then(|_| self.bounds.get(&former.output).cloned());
        }
        let mut namespaces = self.namespaces;
        namespaces.retain(|address, _| profile.buses.iter().any(|bus| bus.address == *address));
        let mut releases = self.releases;
        releases.retain(|release| now.outputs.values().all(|place| !place.is_at(&release.place)));
        Places { former, only_read, kept: self.kept, releases, namespaces, ..now }
    }

    /// Stores entries of the register ledger for former registers. They replace older entries of the same registers.
    pub(in crate::gateway) fn keep(&mut self, entries: &Entries) {
        let Places { kept, former, releases, .. } = self;
        let places = || former.iter().map(|one| &one.place).chain(releases.iter().map(|one| &one.place));
        let is_former = |entry: &Entry| places().any(|place| entry.lies_at(place));
        let is_same =
            |one: &Entry, other: &Entry| one.place.as_ref().is_some_and(|place| other.lies_at(place));
        kept.retain(|entry| is_former(entry) && entries.values().all(|newer| !is_same(newer, entry)));
        kept.extend(entries.values().filter(|entry| is_former(entry)).cloned());
    }

    /// Returns the register ledger's entry (saved account) of a former register that no output uses now. `None` if no
    /// entry exists.
    pub(in crate::gateway) fn kept_of(&self, place: &OutputPlace) -> Option<SavedOutput> {
        self.kept.iter().find(|entry| entry.lies_at(place)).map(|entry| entry.kept)
    }

    /// Ends a release, and lists its register with the last verified value as a former register again.
    pub(in crate::gateway) fn ends(&mut self, release: &Release) {
        match self.former.iter_mut().find(|former| release.is_of(&former.output, &former.place)) {
            // No movement was verified in the register.
            Some(_) if release.held_um.to_bits() == release.from_um.to_bits() => {}
            Some(former) => (former.held_um, former.found_um) = (Some(release.held_um), None),
            None => self.former.push(release.former()),
        }
    }

    /// Returns whether an entry of the register ledger belongs to a release. A release has then changed the register,
    /// and no output of the last run uses it.
    pub(in crate::gateway) fn is_of_a_release(&self, name: &str, entry: &Entry) -> bool {
        let is_of_release = |place: &OutputPlace| {
            place.axis.starts_with(AXIS) && self.outputs.values().all(|output| output.axis != place.axis)
        };
        !self.outputs.contains_key(name) && entry.place.as_ref().is_some_and(is_of_release)
    }

    /// Returns the Cz in the last written value of a corrected position (position plus Cz), in µm of the present
    /// axis. `None` if the register of the output has changed.
    pub(in crate::gateway) fn left_in_position(
        &self,
        now: &OutputPlace,
        name: &str,
        last_um: f64,
    ) -> Option<f64> {
        let factor = |place: &OutputPlace| if place.diameter { 2.0 } else { 1.0 };
        let was = self.outputs.get(name)?;
        was.is_same_register(now).then_some(last_um * factor(was) / factor(now))
    }

    /// Explains each changed or removed register that the operator has not confirmed. `isotherm check` shows the
    /// texts for a machine whose gateway is stopped.
    pub(in crate::gateway) fn explain(&self) -> Vec<Explained> {
        self.former.iter().map(|former| self.explained(former, None)).collect()
    }

    /// Explains why the axis of an output must wait because of a former register. `holds` is the value in the
    /// output's present register, if the register was read.
    fn explained(&self, former: &FormerPlace, holds: Option<&str>) -> Explained {
        let FormerPlace { output, place, held_um, .. } = former;
        let held = held_um.map(|um| format!("{um:.1} µm"));
        let moved = self.outputs.get(output).and_then(|is| MovedPlace::between(place, is));
        let (Some(MovedPlace { was, is, .. }), Some(now)) = (moved, self.outputs.get(output)) else {
            if let Some(name) = former.becomes_whole(&self.outputs) {
                let holds = holds.map_or(String::new(), |holds| format!("; the register holds {holds} now"));
                return Explained::new(
                    format!(
                        "output {output} shared {place} with an operator offset; output {name} uses the \
                         whole register{holds}"
                    ),
                    WHOLE,
                );
            }
            let held = held.unwrap_or_default();
            return Explained::new(
                format!(
                    "output {output} is no longer in the profile; {held} from the gateway were verified \
                     in {place}"
                ),
                "remove the value with `isotherm release` if that is offered. Otherwise set that register to \
                 zero at the control, unless the operator needs the value. Then arm the axis",
            );
        };
        let held = held.map_or("the value before the change is not known".to_owned(), |held| {
            format!("{held} from the gateway were verified before the change")
        });
        let holds = holds.map_or(String::new(), |holds| format!("; the register holds {holds} now"));
        let hint = match (place.share, now.share) {
            (Owner::Ledger, Owner::Whole) => WHOLE,
            _ => {
                "compare both registers at the control, set an unneeded value to zero, then arm the axis; or \
                 write the former register into the profile again"
            }
        };
        Explained::new(format!("output {output} has changed: from {was} to {is}; {held}{holds}"), hint)
    }
}

impl Moves {
    pub(in crate::gateway) fn new(places: Places, profile: &Profile) -> Moves {
        let is_moved = |name: &str| places.former.iter().any(|former| former.output == name);
        let outputs = profile.outputs.iter().enumerate();
        let unread = outputs.filter(|(_, output)| is_moved(&output.name) && output.writes.is_scheduled());
        Moves { unread: unread.map(|(place, _)| OutputId(place)).collect(), places: Arc::new(places) }
    }

    /// Returns the axes that must wait for the operator, each with the reason.
    pub(in crate::gateway) fn barred(&self, profile: &Profile) -> Vec<(AxisId, Explained)> {
        let axes = profile.axes.iter().enumerate();
        let barred = axes.filter_map(|(place, axis)| {
            let of_axis = |former: &&FormerPlace| former.axes.contains(&axis.settings.name);
            let former = self.places.former.iter().find(of_axis)?;
            Some((AxisId(place), self.places.explained(former, None)))
        });
        barred.collect()
    }

    /// Records the outputs whose registers the gateway may write from now on. Returns whether the gateway has only
    /// read one of these registers before.
    pub(in crate::gateway) fn drive(
        &mut self,
        profile: &Profile,
        is_driven: impl Fn(OutputId) -> bool,
    ) -> bool {
        if self.places.only_read.is_empty() {
            return false;
        }
        let outputs = profile.outputs.iter().enumerate();
        let driven = outputs.filter(|(place, _)| is_driven(OutputId(*place)));
        let mut is_new = false;
        for (_, output) in driven {
            if !self.places.was_driven(&output.name) {
                is_new |= Arc::make_mut(&mut self.places).only_read.remove(&output.name);
            }
        }
        is_new
    }

    /// Returns whether the reason `why`, for which this axis is off, is a former register.
    pub(in crate::gateway) fn is_why(&self, axis: &str, why: &Explained) -> bool {
        let waits = |former: &&FormerPlace| former.axes.contains(axis);
        // The register value is appended to the cause as soon as it was read.
        let mut former = self.places.former.iter().filter(waits);
        former.any(|former| why.cause.starts_with(&self.places.explained(former, None).cause))
    }

    /// Returns the saved namespaces of the server with this address.
    pub(in crate::gateway) fn namespaces(&self, bus: &str) -> KnownNamespaces {
        self.places.namespaces.get(bus).cloned().unwrap_or_default()
    }

    /// Saves the namespaces with these indices for the server at the address `bus`. Returns whether the saved
    /// namespaces have changed.
    pub(in crate::gateway) fn remember_namespaces(
        &mut self,
        bus: &str,
        indices: &[u16],
        known: &KnownNamespaces,
    ) -> bool {
        let mut all = self.namespaces(bus);
        indices.iter().for_each(|index| all.take(*index, known));
        if all == self.namespaces(bus) {
            return false;
        }
        Arc::make_mut(&mut self.places).namespaces.insert(bus.to_owned(), all);
        true
    }

    /// Returns whether the register of the output has changed, and the operator has not confirmed the change yet.
    pub(in crate::gateway) fn is_in_doubt(&self, output: &str) -> bool {
        self.places.former.iter().any(|former| former.output == output)
    }

    /// Returns the events for the start of the gateway: outputs with another register, and registers that still
    /// contain a value of the gateway. Registers that a release returns to their base values have no event here,
    /// because their axes report the progress.
    pub(in crate::gateway) fn events(&self, releases: &Releases, profile: &Profile) -> Vec<Event> {
        let mut events = Vec::new();
        for former in &self.places.former {
            events.extend(self.moved(former, None));
            let is_of_it = |release: &Release| release.is_of(&former.output, &former.place);
            let is_returning = releases.returning.iter().any(|one| is_of_it(&one.release));
            if former.is_left_behind(&self.places.outputs) && !is_returning {
                events.push(register_left(former, releases, profile));
            }
        }
        events
    }

    fn moved(&self, former: &FormerPlace, holds: Option<&str>) -> Option<Event> {
        let outputs = &self.places.outputs;
        let output = match outputs.contains_key(&former.output) {
            true => former.output.clone(),
            false => former.becomes_whole(outputs)?.to_owned(),
        };
        Some(Event::OutputMoved { output, why: self.places.explained(former, holds) })
    }

    /// Handles a read of an output's register. If this is the first read of a changed register, returns an event and
    /// the reason why the axis waits. Otherwise returns `None`.
    pub(in crate::gateway) fn read(
        &mut self,
        id: OutputId,
        name: &str,
        holds: impl FnOnce() -> String,
    ) -> Option<(Event, Explained)> {
        let place = self.unread.iter().position(|unread| *unread == id)?;
        self.unread.swap_remove(place);
        let (former, holds) = (self.places.former.iter().find(|former| former.output == name)?, holds());
        Some((self.moved(former, Some(&holds))?, self.places.explained(former, Some(&holds))))
    }

    /// Confirms the changed registers of an axis, because the operator has armed the axis after the reports about
    /// these registers. Returns the events about this.
    pub(in crate::gateway) fn confirm(&mut self, axis: &str, profile: &Profile) -> Vec<Event> {
        let may_arm = |name: &str| {
            let mut axes = profile.axes.iter();
            axes.any(|axis| axis.settings.name == name && axis.has_model())
        };
        if self.places.former.is_empty() {
            return Vec::new();
        }
        let mut confirmed = Vec::new();
        Arc::make_mut(&mut self.places).former.retain_mut(|former| {
            let is_open = former.confirm(axis, may_arm);
            if !is_open {
                confirmed.push(former.output.clone());
            }
            is_open
        });
        // A place that the operator has confirmed is not released later.
        let Places { former, releases, .. } = Arc::make_mut(&mut self.places);
        let is_open = |release: &Release| former.iter().any(|one| release.is_of(&one.output, &one.place));
        releases.retain(|release| release.stage == Stage::Begun || is_open(release));
        let is_over = |output: &String| self.places.former.iter().all(|former| former.output != *output);
        confirmed.retain(is_over);
        confirmed.dedup();
        confirmed.into_iter().map(|output| Event::PlaceConfirmed { output }).collect()
    }
}

/// Creates the event about a former register that still contains a value of the gateway.
pub(in crate::gateway) fn register_left(
    former: &FormerPlace,
    releases: &Releases,
    profile: &Profile,
) -> Event {
    let (output, path) = (former.output.clone(), profile.path.display());
    let hint = match releases.obstacle(&former.place) {
        None => format!(
            "remove the value with `isotherm release {path} {output}`. Or set that register to zero at the \
             control, unless the operator needs the value. Then arm the axis"
        ),
        Some(why) => {
            let remedy = why.hint.unwrap_or(BY_HAND.into());
            format!("`isotherm release` cannot remove the value: {}; {remedy}", why.cause)
        }
    };
    let held = former.held_um.and_then(Micron::new).unwrap_or_default();
    Event::RegisterLeft { output, register: former.place.to_string(), held, hint }
}

/// Replaces the old names of outputs by the new names.
pub(super) fn renamed<T>(all: BTreeMap<String, T>, names: &BTreeMap<String, String>) -> BTreeMap<String, T> {
    all.into_iter().map(|(name, one)| (names.get(&name).cloned().unwrap_or(name), one)).collect()
}

/// Explains why a captured reference of a signal is not used.
pub(in crate::gateway) fn why_forgotten(signal: &str, MovedPlace { was, is, .. }: &MovedPlace) -> Explained {
    Explained::new(
        format!(
            "signal {signal} has changed: from {was} to {is}; the captured reference of the signal is not \
             used"
        ),
        "the reference is captured again from now on; measure a part, or write the former address into the \
         profile again",
    )
}

/// Returns whether the Cz of an output is saved for the next start.
pub(super) fn remembers_cz(writes: Writes) -> bool {
    writes.is_cz() || writes.position().is_some()
}

#[cfg(test)]
mod tests;
