//! Sets of outputs and handshakes: whether a control can see them whole, and whether there is time for it.

use super::{Check, Zero, bus_of, get, shown};
use crate::place::child;
use crate::raw::{RawHandshake, RawSet, VerifyWord};
use crate::{Axis, Bus, Device, Flag, Handshake, Output, OutputId, OutputSet, SetId, Share, Writes};
use isotherm_core::codec::{Register, Table};

impl Check<'_> {
    /// The named sets, and one for each output that has a handshake of its own; the outputs are told where they belong.
    pub(super) fn sets(
        &mut self,
        outputs: &mut [Option<Output>],
        axes: &[Option<Axis>],
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) -> Vec<Option<OutputSet>> {
        let raw = self.raw;
        let members = self.members(outputs);
        let mut sets = Vec::new();
        for (place, name, path) in self.sets.each() {
            let of_set: Vec<usize> =
                members.iter().filter(|(_, set)| *set == place).map(|(output, _)| *output).collect();
            let whole = of_set.iter().all(|output| get(outputs, *output).is_some());
            let set = raw
                .set
                .get(&name)
                .and_then(|raw| self.named_set(&path, &name, raw, &of_set, outputs, devices));
            sets.push(set.filter(|_| whole));
        }
        for (place, name, path) in self.outputs.each() {
            let Some(handshake) = raw.output.get(&name).and_then(|raw| raw.handshake.as_ref()) else {
                continue;
            };
            let at = child(&path, "handshake");
            if members.iter().any(|(output, _)| *output == place) {
                let help = "one strobe tells of all of it: write `handshake` at the set";
                self.wrong_key(&at, "its set is written as one", help);
                continue;
            }
            let Some(output) = get(outputs, place) else { continue };
            self.can_be_exchanged(&path, "handshake", output);
            let device = output.device;
            let handshake = self.handshake(&at, handshake, get(devices, device.0));
            let outputs = vec![OutputId(place)];
            let set = handshake.map(|handshake| OutputSet {
                name,
                is_named: false,
                device,
                outputs,
                sequence: None,
                complement: None,
                heartbeat: None,
                control: None,
                version: None,
                zeros: false,
                handshake: Some(handshake),
            });
            sets.push(set);
        }
        for (place, set) in sets.iter().enumerate() {
            let Some(set) = set else { continue };
            let path = child(&child(if set.is_named { "set" } else { "output" }, &set.name), "handshake");
            self.exchange_times(&path, set, outputs, axes, devices, buses);
            for OutputId(output) in &set.outputs {
                if let Some(Some(output)) = outputs.get_mut(*output) {
                    output.set = Some(SetId(place));
                }
            }
        }
        self.acknowledges_apart(&sets);
        sets
    }

    /// Which output belongs to which set, by their places.
    fn members(&mut self, outputs: &[Option<Output>]) -> Vec<(usize, usize)> {
        let raw = self.raw;
        let mut members = Vec::new();
        for (place, name, path) in self.outputs.each() {
            let Some(set) = raw.output.get(&name).and_then(|raw| raw.set.as_ref()) else { continue };
            let found = self.set_index(&child(&path, "set"), set);
            if let Some(output) = get(outputs, place) {
                self.can_be_exchanged(&path, "set", output);
            }
            members.extend(found.map(|set| (place, set)));
        }
        members
    }

    /// What is compared before and after each exchange must be read, and be nobody else's.
    fn can_be_exchanged(&mut self, path: &str, key: &str, output: &Output) {
        let raw = self.raw.output.get(&output.name);
        if matches!(output.writes, Writes::Corrected { .. }) {
            let help = format!("remove `{key}`: the readout is written as soon as its scale is read");
            self.wrong_key(&child(path, key), "a corrected position goes at the scale's own pace", help);
        }
        if raw.is_some_and(|raw| raw.verify == Some(VerifyWord::Echo)) {
            let message = format!("with a {key} the register is read before and after each write");
            self.wrong(&child(path, "verify"), message, "write verify = \"read-back\"");
        }
        if output.share == Share::Ledger {
            let message = format!("a share of an operator's register has no {key}");
            self.wrong(&child(path, "share"), message, format!("remove `{key}`, or write share = \"whole\""));
        }
    }

    fn named_set(
        &mut self,
        path: &str,
        name: &str,
        raw: &RawSet,
        members: &[usize],
        outputs: &[Option<Output>],
        devices: &[Option<Device>],
    ) -> Option<OutputSet> {
        let sequence = self.word_of(path, "sequence", raw.sequence.as_ref());
        let complement = self.word_of(path, "complement", raw.complement.as_ref());
        let heartbeat = self.word_of(path, "heartbeat", raw.heartbeat.as_ref());
        let control = self.word_of(path, "control", raw.control.as_ref());
        let version = raw.version.as_ref().and_then(|version| {
            Some((
                self.word_of(&child(path, "version"), "register", version.register.as_ref())?,
                version.value?,
            ))
        });
        if members.is_empty() {
            let help = format!("write set = \"{name}\" at the outputs that belong together");
            self.wrong_key(path, "no output belongs to this set", help);
        }
        let mut of_set = members.iter().filter_map(|output| get(outputs, *output));
        let first = of_set.next();
        let id = first.map(|output| output.device);
        let device = id.and_then(|id| get(devices, id.0));
        let handshake = raw.handshake.as_ref();
        let wants_handshake = handshake.is_some();
        let handshake = handshake.and_then(|raw| self.handshake(&child(path, "handshake"), raw, device));
        for output in of_set.filter(|output| Some(output.device) != id) {
            let there = device.map_or("", |device| device.name.as_str());
            let message = format!("set `{name}` is at `{there}`: one request cannot reach two devices");
            self.wrong(&child(&child("output", &output.name), "device"), message, "give it a set of its own");
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
            zeros: raw.zeros.unwrap_or(false),
            handshake,
        };
        let device = device?;
        let words = [
            ("sequence", sequence),
            ("complement", complement),
            ("heartbeat", heartbeat),
            ("control", control),
        ];
        for (key, word) in words.into_iter().chain([("version", version.map(|(at, _)| at))]) {
            if word.is_some() {
                self.writable(&child(path, key), 1, device);
                self.readable(&child(path, key), Table::Holding, device);
            }
        }
        let members = members.iter().filter_map(|output| get(outputs, *output));
        let requests = set.stretches(members, device.longest_request()).len();
        if requests > 1 && set.zeros {
            let message = format!("with the registers between its words it takes {requests} requests");
            self.wrong_key(
                &child(path, "zeros"),
                message,
                "put its words nearer to each other, or remove `zeros`",
            );
        } else if requests > 1 && raw.sequence.is_none() && !wants_handshake {
            let message = format!("it takes {requests} requests to write: the control could see half of it");
            let help = "give it a `sequence` or a `handshake`, or registers side by side";
            self.wrong_key(path, message, help);
        }
        (wants_handshake == handshake.is_some()).then_some(set)
    }

    fn word_of(&mut self, path: &str, key: &str, text: Option<&String>) -> Option<Register> {
        self.holding(&child(path, key), text?)
    }

    fn handshake(&mut self, path: &str, raw: &RawHandshake, device: Option<&Device>) -> Option<Handshake> {
        let timeout = self.span(&child(path, "timeout"), raw.timeout.as_ref(), Zero::Refused);
        let (at_strobe, at_acknowledge) = (child(path, "strobe"), child(path, "acknowledge"));
        let strobe = raw.strobe.as_ref().and_then(|text| self.flag(&at_strobe, text));
        let acknowledge = raw.acknowledge.as_ref().and_then(|text| self.flag(&at_acknowledge, text));
        if let Some(strobe) = strobe.filter(|strobe| !strobe.address.table.is_writable()) {
            let help = "write a coil or a holding register, as \"coil:20\" or \"holding:101\"";
            self.wrong(&at_strobe, format!("{} cannot be written", strobe.address), help);
            return None;
        }
        let (strobe, acknowledge) = (strobe?, acknowledge?);
        if strobe.address == acknowledge.address {
            let message =
                format!("{} is the strobe itself: it would acknowledge at once", acknowledge.address);
            self.wrong(&at_acknowledge, message, "name what the control raises when it has taken the value");
            return None;
        }
        if let Some(device) = device {
            if strobe.address.table == Table::Coil && !device.functions.write_coil {
                let message =
                    format!("writing this needs write-coil, which `{}` may not be sent", device.name);
                let help = "add \"write-coil\" to `functions` of the device, or take a holding register";
                self.wrong(&at_strobe, message, help);
            }
            if strobe.address.table == Table::Holding {
                self.writable(&at_strobe, 1, device);
            }
            self.readable(&at_acknowledge, acknowledge.address.table, device);
        }
        Some(Handshake { strobe, acknowledge, timeout: timeout? })
    }

    fn flag(&mut self, path: &str, text: &str) -> Option<Flag> {
        match text.parse() {
            Ok(flag) => Some(flag),
            Err(message) => {
                let help =
                    "allowed: \"coil:20\", \"discrete:20\", \"input:16\", \"input:16.0\", \"holding:101\"";
                self.wrong(path, message, help);
                None
            }
        }
    }

    /// A wait is longer than one answer, and a whole exchange shorter than what calls for the next.
    fn exchange_times(
        &mut self,
        path: &str,
        set: &OutputSet,
        outputs: &[Option<Output>],
        axes: &[Option<Axis>],
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) {
        let Some(handshake) = set.handshake else { return };
        let path = child(path, "timeout");
        let bus = get(devices, set.device.0).and_then(|device| bus_of(device, buses));
        if let Some(bus) = bus.filter(|bus| handshake.timeout <= bus.timeout) {
            let (name, timeout) = (&bus.name, shown(bus.timeout));
            let message =
                format!("the bus `{name}` waits {timeout} for an answer: no time to ask for the acknowledge");
            self.wrong(&path, message, "make it longer than `timeout` of the bus");
        }
        let whole = handshake.timeout * 2;
        for output in set.outputs.iter().filter_map(|id| get(outputs, id.0)) {
            let axis = get(axes, output.axis.0).map(|axis| (&axis.settings.name, axis.settings.every));
            let called = axis.map(|(name, every)| (format!("axis `{name}`'s period"), every));
            let refreshed =
                output.refresh.map(|refresh| (format!("`refresh` of output `{}`", output.name), refresh));
            for (what, every) in called.into_iter().chain(refreshed).filter(|(_, every)| *every <= whole) {
                let message = format!(
                    "two waits of {} (for the acknowledge to come and to drop) are as long as {what}, {}",
                    shown(handshake.timeout),
                    shown(every)
                );
                self.wrong(&path, message, "shorten it, or lengthen that");
            }
        }
    }

    /// An acknowledge that answers two strobes says nothing of either.
    fn acknowledges_apart(&mut self, sets: &[Option<OutputSet>]) {
        let answers = |set: &OutputSet| set.handshake.map(|handshake| (set.device, handshake.acknowledge));
        for (place, set) in sets.iter().enumerate() {
            let Some(set) = set else { continue };
            let same = |other: &&OutputSet| answers(other).is_some() && answers(other) == answers(set);
            if let Some(other) = sets.iter().take(place).flatten().find(same) {
                let path = child(if set.is_named { "set" } else { "output" }, &set.name);
                let message = format!("{} waits for the same acknowledge", other.label());
                let help = "give each its own, or put the outputs into one set";
                self.wrong(&child(&child(&path, "handshake"), "acknowledge"), message, help);
            }
        }
    }
}
