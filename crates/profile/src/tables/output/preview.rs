//! Preview of an output, which `isotherm check` prints: its address, the written quantity, the range of its
//! counts, and the verification of its writes.

use super::applied::Applied;
use super::share::Share;
use super::verify::Verify;
use super::{Output, range};
use crate::Profile;
use crate::document::{Section, entries};
use crate::duration::shown;
use crate::tables::device::Device;
use crate::tables::register::{self, Notation};
use crate::wording::counted;
use isotherm_core::codec::Address;

impl Output {
    /// Preview of the output: quantity, address, encoding, and verification.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let (axis, device, encoding) = (profile.axis(self.axis), profile.device(self.device), &self.encoding);
        let (name, device_name) = (&self.name, &device.name);
        let (data_type, scale) = (encoding.data_type.name(), encoding.scale.get());
        let registers = encoding.data_type.registers();
        let function = self.address.register().map_or(0, |_| device.functions.write_code(registers));
        let register = Notation::of(&self.address, encoding.data_type);
        let word_order = register::shown_order(&self.address, encoding);
        let unit = self.writes.unit();
        let mut line = match self.address.is_in_frames() {
            true => format!("  {name}: {register}, to {device_name}"),
            false => format!("  {name}: {register} of {device_name}, {data_type}"),
        };
        line.extend(word_order.iter().map(|order| format!(" {order}")));
        line += &format!(", {scale} {unit} per {}", register::one_of(&self.address));
        if encoding.bias != 0 {
            line += &format!(", bias {}", encoding.bias);
        }
        if function != 0 {
            line += &format!("; function {function:02}, {}", counted(registers, "register"));
        }
        let mut section = Section::default();
        section.line(line);
        entries!(section, output = name, axis = &axis.settings.name, device = device_name);
        section.json("register", register);
        entries!(section, registers, data_type, word_order, scale, unit, bias = encoding.bias);
        let counts = range::counts(self, axis, profile);
        entries!(section, counts, function);
        let meaning = range::meaning(self, axis, profile);
        section.line(format!("    writes {meaning}"));
        section.entry("meaning", meaning);
        let display = self.display.preview();
        section.lines("    ", &display);
        let channel = device.channel(name);
        section.lines("    ", &channel);
        let is_shared = self.share == Share::Ledger;
        section.line(match counts {
            Some((low, high)) if is_shared => format!("    counts {low} to {high}, plus the operator offset"),
            Some((low, high)) => format!("    counts {low} to {high}"),
            None => "    counts are limited only by the register's type".to_owned(),
        });
        let share = is_shared.then_some(
            "the operator offset in the register stays; the gateway share is added to it, and is stored in a \
             ledger on disk",
        );
        section.lines("    ", share);
        let verify = verification(self, device);
        section.line(format!("    accepted {verify}"));
        section.entry("verify", verify);
        let refresh = self.refresh.map(shown);
        let again = if is_shared { "read" } else { "written" };
        section.lines(&format!("    {again} again every "), &refresh);
        section.entry("refresh", refresh);
        let when = self.when.as_ref().map(|condition| &condition.text);
        section.entry("when", when);
        let restart = self.restart(profile);
        section.lines("    read again, and Cz resumes from the value read, when ", &restart);
        section.entry("restart", restart);
        section.line(match when {
            Some(when) => format!("    written only when {when}; otherwise the register value stays"),
            None => "    no interlock".to_owned(),
        });
        entries!(section, share, channel, display);
        section
    }

    /// Describes how a restart of the control is detected, in addition to the register becoming zero. `None` if nothing
    /// else is configured.
    fn restart(&self, profile: &Profile) -> Option<String> {
        let counter = self.boot_counter.map(|id| format!("{} changes", profile.signal(id).address));
        let on = profile.machine.on.filter(|_| self.writes.is_scheduled());
        let on = on.map(|id| format!("{} rises", profile.signal(id).name));
        let seen: Vec<String> = counter.into_iter().chain(on).collect();
        (!seen.is_empty()).then(|| seen.join(", or "))
    }
}

/// Describes how the writes of this output are verified.
fn verification(output: &Output, device: &Device) -> String {
    let is_object = matches!(output.address, Address::Object(_));
    let is_node = matches!(output.address, Address::Node(_));
    if let Some(Applied { address, tolerance, settle, .. }) = &output.applied {
        let (register, settle) = (Notation::from(*address), shown(*settle));
        return format!(
            "once {register} reports the value as applied, within {tolerance} µm after {settle} at most; the \
             written register is also compared"
        );
    }
    let accepted = match output.verify {
        Verify::Echo if output.is_single_offset() && device.functions.reads_at(&output.reads_at()) => {
            "once the value is read back: the register is read before and after each write, whatever the \
             answer is"
        }
        Verify::ReadBack if is_node => "once the node was read and contains the written value",
        Verify::Echo if is_node => "once the server has answered Good; the node is not read back",
        Verify::ReadBack if is_object => "once the object was read and contains the written value",
        Verify::Echo if is_object => "once the node has accepted the value; the object is not read back",
        Verify::ReadBack => "once the register was read and contains the written value",
        Verify::Echo => "once the answer repeats what was written; the register is not read back",
        Verify::ReadBackAt(object) => return format!("once object {object} was read and contains the value"),
        Verify::Shown => "as soon as the value is sent: it is only displayed, and not verified",
    };
    accepted.to_owned()
}
