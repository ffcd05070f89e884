//! Checks and resolves the output sets.

use std::collections::HashSet;

use super::{OutputSet, RawSet, waits, words};
use crate::kinds::opcua::nodes::Place;
use crate::members::Members;
use crate::tables::output::Output;
use crate::tables::output::share::Share;
use crate::tables::register::holding;
use crate::tables::{Check, KeyContext};
use crate::{OutputId, SetId};
use isotherm_core::codec::Table;

impl OutputSet {
    /// Returns the context of the output set's table in the profile. For an output with its own handshake, it is the
    /// context of the output.
    pub(in crate::tables) fn at<'c>(&self, check: &'c Check<'c>) -> KeyContext<'c> {
        check.at(if self.is_named { "set" } else { "output" }).key(&self.name)
    }
}

/// Resolves the named output sets, and one set for each output with its own handshake. Stores the set at each output.
pub(in crate::tables) fn resolve(check: &mut Check<'_>) {
    let members = members(check);
    let mut in_sets: HashSet<usize> = HashSet::new();
    let mut sets: Vec<Option<OutputSet>> = Vec::new();
    for (place, name) in check.sets.names.iter().enumerate() {
        let of_set: Vec<usize> = members.of(place).collect();
        in_sets.extend(&of_set);
        let is_whole = of_set.iter().all(|output| check.outputs.get(*output).is_some());
        let raw = check.raw.set.get(name);
        let set = raw.and_then(|raw| raw.resolve(check, &check.at("set").key(name), name, &of_set));
        sets.push(set.filter(|_| is_whole));
    }
    for (place, name) in check.outputs.names.iter().enumerate() {
        let Some(raw) = check.raw.output.get(name).and_then(|raw| raw.handshake.as_ref()) else { continue };
        let at = check.at("output").key(name);
        if in_sets.contains(&place) {
            let help = "write `handshake` at the set: one strobe announces the whole set";
            at.key("handshake").wrong_key("the output is in a set, and a set is written as a whole", help);
            continue;
        }
        let Some(output) = check.outputs.get(place) else { continue };
        can_be_exchanged(check, &at, "handshake", output);
        let device = check.devices.get(output.device.0);
        let handshake = raw.resolve(&at.key("handshake"), device, output.address.node().is_some());
        sets.push(handshake.map(|handshake| OutputSet {
            name: name.clone(),
            is_named: false,
            device: output.device,
            outputs: vec![OutputId(place)],
            sequence: None,
            complement: None,
            heartbeat: None,
            control: None,
            version: None,
            zeros: false,
            handshake: Some(handshake),
        }));
    }
    for set in sets.iter().flatten() {
        waits::has_time(check, set);
    }
    waits::acknowledges_apart(check, &sets);
    for (place, set) in sets.iter().enumerate() {
        for OutputId(output) in set.iter().flat_map(|set| &set.outputs) {
            if let Some(Some(output)) = check.outputs.resolved.get_mut(*output) {
                output.set = Some(SetId(place));
            }
        }
    }
    check.sets.resolved = sets;
}

/// Returns the outputs of each set, by the index of the set.
fn members(check: &Check<'_>) -> Members {
    let mut members = Vec::new();
    for (place, name) in check.outputs.names.iter().enumerate() {
        let Some(set) = check.raw.output.get(name).and_then(|raw| raw.set.as_ref()) else { continue };
        let at = check.at("output").key(name);
        let found = at.key("set").named(&check.sets.names, Some(set));
        if let Some(output) = check.outputs.get(place) {
            can_be_exchanged(check, &at, "set", output);
        }
        members.extend(found.map(|set| (set, place)));
    }
    members.into_iter().collect()
}

/// Reports an output that cannot be in a set, or cannot have a handshake. Such outputs are corrected positions, outputs
/// that are not read back, and outputs that share their register with an operator.
fn can_be_exchanged(check: &Check<'_>, at: &KeyContext<'_>, key: &str, output: &Output) {
    if output.writes.position().is_some() {
        let help =
            format!("remove `{key}`: the corrected position is written as soon as the position is read");
        at.key(key).wrong_key("a corrected position is written each time the position is read", help);
    }
    if check.raw.output.get(&output.name).is_some_and(|raw| raw.is_accepted_by_echo()) {
        let message = format!("with a {key} the register is read before and after each write");
        at.key("verify").invalid(message, "write verify = \"read-back\"");
    }
    if output.share == Share::Ledger {
        let message = format!("share = \"ledger\" and {key} exclude each other");
        at.key("share").invalid(message, format!("remove `{key}`, or write share = \"whole\""));
    }
}

impl RawSet {
    fn resolve(
        &self,
        check: &Check<'_>,
        at: &KeyContext<'_>,
        name: &str,
        members: &[usize],
    ) -> Option<OutputSet> {
        let of_set: Vec<&Output> = members.iter().filter_map(|output| check.outputs.get(*output)).collect();
        let is_in_nodes = of_set.iter().any(|output| output.address.node().is_some());
        if is_in_nodes {
            words::foreign_to_nodes(at);
        }
        let register = |key: &str, text: &Option<String>| {
            text.as_ref().filter(|_| !is_in_nodes).and_then(|text| holding(&at.key(key), Some(text)))
        };
        let sequence = register("sequence", &self.sequence);
        let complement = register("complement", &self.complement);
        let word = |key: &str, place: &Option<Place>, most| {
            place.as_ref().and_then(|place| place.word(&at.key(key), is_in_nodes, most))
        };
        let heartbeat = word("heartbeat", &self.heartbeat, words::HIGHEST_BEAT);
        let control = word("control", &self.control, words::EVERY_BIT);
        let version =
            self.version.as_ref().and_then(|version| version.resolve(&at.key("version"), is_in_nodes));
        if members.is_empty() {
            let help = format!("write set = \"{name}\" at the outputs of this set");
            at.wrong_key("no output is in this set", help);
        }
        let id = of_set.first().map(|output| output.device);
        let device = id.and_then(|id| check.devices.get(id.0));
        let handshake = self.handshake.as_ref();
        let handshake = handshake.map(|raw| raw.resolve(&at.key("handshake"), device, is_in_nodes));
        let is_wrong = handshake == Some(None);
        for output in of_set.iter().filter(|output| Some(output.device) != id) {
            let there = device.map_or("", |device| device.name.as_str());
            let message =
                format!("set `{name}` is written to `{there}`: one request cannot reach two devices");
            let of_output = check.at("output").key(&output.name);
            of_output.key("device").invalid(message, "use another set for this output");
        }
        let set = OutputSet {
            name: name.to_owned(),
            is_named: true,
            device: id?,
            outputs: members.iter().copied().map(OutputId).collect(),
            sequence,
            complement,
            heartbeat,
            control,
            version,
            zeros: self.zeros.unwrap_or(false),
            handshake: handshake.flatten(),
        };
        let device = device?;
        for (key, _) in set.own().filter(|_| !is_in_nodes) {
            device.must_write(&at.key(key), 1);
            device.must_read(&at.key(key), Table::Holding);
        }
        let requests = set.stretches(of_set.into_iter(), device.longest_request()).len();
        if requests > 1 && set.zeros {
            let message =
                format!("with the unused registers between its words, the set needs {requests} requests");
            at.key("zeros").wrong_key(message, "put the words of the set closer together, or remove `zeros`");
        } else if requests > 1 && self.sequence.is_none() && self.handshake.is_none() {
            let message =
                format!("the set needs {requests} requests: the control could read a part of the set");
            let help = "write a `sequence` or a `handshake`, or use adjacent registers";
            at.wrong_key(message, help);
        }
        (!is_wrong).then_some(set)
    }
}
