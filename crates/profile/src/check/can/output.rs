//! What is written on a CAN line: objects, and values inside frames.

use super::signal::Direction;
use crate::check::Check;
use crate::place::child;
use crate::raw::{RawOutput, ReadBackValue, ShareWord, VerifyWord, WritesWord};
use crate::{Device, Verify};
use isotherm_core::codec::{Address, BitField, CanId, CanMatch, DataType, Field, Frame, Object};

/// Where an output goes, and how it is believed.
pub(in crate::check) struct Target {
    pub(in crate::check) address: Address,
    pub(in crate::check) data_type: DataType,
    pub(in crate::check) verify: Verify,
}

/// A frame that an output writes a value into.
#[derive(Clone, Debug)]
pub(in crate::check) struct Written {
    pub(super) device: usize,
    pub(super) output: String,
    /// The key that says so.
    pub(super) path: String,
    pub(super) id: CanId,
    is_fd: bool,
    bits: BitField,
    fill: Option<Vec<u8>>,
}

impl Check<'_> {
    /// Whether an output's keys belong to the kind of line its device hangs on; those of the other kind are told.
    pub(in crate::check) fn output_keys(&mut self, path: &str, raw: &RawOutput) {
        let Some(device) = raw.device.as_deref() else { return };
        let Some(on_can) = self.is_on_can(device) else { return };
        let of_can = [("pdo", raw.pdo.is_some()), ("sdo", raw.sdo.is_some()), ("frame", raw.frame.is_some())];
        let boot_counter = raw.restart.as_ref().is_some_and(|restart| restart.boot_counter.is_some());
        let of_modbus = [
            ("register", raw.register.is_some()),
            ("word_order", raw.word_order.is_some()),
            ("byte_swap", raw.byte_swap.is_some()),
            ("beside", raw.beside.is_some()),
            ("stale", raw.stale.is_some()),
            ("share", raw.share == Some(ShareWord::Ledger)),
            ("set", raw.set.is_some()),
            ("handshake", raw.handshake.is_some()),
            ("restart", boot_counter),
        ];
        let (foreign, help): (&[_], _) = if on_can {
            (
                &of_modbus,
                format!("`{device}` hangs on a CAN line: remove it; a value is written by pdo, sdo or frame"),
            )
        } else {
            (&of_can, format!("`{device}` hangs on a Modbus line: write register = \"holding:100\""))
        };
        let whose = if on_can { "a Modbus device" } else { "a device on a CAN line" };
        for (key, _) in foreign.iter().filter(|(_, there)| *there) {
            let what = match *key {
                "share" => "a share of an operator's register",
                other => other,
            };
            let what = if what == *key { format!("`{key}`") } else { what.to_owned() };
            self.wrong_key(&child(path, key), format!("{what} belongs to {whose}"), help.clone());
        }
        let small = raw.kind.map(DataType::from).filter(|kind| kind.width() == 8);
        if let Some(small) = small.filter(|_| !on_can) {
            let message = format!("{} is smaller than a register", small.name());
            self.wrong(&child(path, "type"), message, "take \"u16\" or \"i16\"");
        }
    }

    /// Where an output of a CAN device goes.
    pub(in crate::check) fn can_target(
        &mut self,
        path: &str,
        name: &str,
        raw: &RawOutput,
        device: Option<usize>,
    ) -> Option<Target> {
        let given = [("pdo", raw.pdo.is_some()), ("sdo", raw.sdo.is_some()), ("frame", raw.frame.is_some())];
        let there: Vec<&str> = given.iter().filter(|(_, there)| *there).map(|(key, _)| *key).collect();
        match there.as_slice() {
            [_] => {}
            [] => {
                let wrong = given.iter().any(|(key, _)| self.places.contains(&child(path, key)));
                if !wrong && raw.register.is_none() {
                    let help = "write pdo = { … }, sdo = \"2000:01\" or frame = { … }";
                    self.wrong_key(path, "it is not said where the output is written", help);
                }
                return None;
            }
            _ => {
                let help = "keep one of pdo, sdo, frame";
                self.wrong_key(path, "the output is written to more than one place", help);
                return None;
            }
        }
        let owner = raw.device.as_deref()?;
        if let Some(sdo) = &raw.sdo {
            return self.object_target(path, sdo, raw, owner);
        }
        if raw.kind.is_some() {
            let help = "remove it: `length`, `signed` and `float` say it";
            self.wrong_key(&child(path, "type"), "`type` belongs to registers and objects", help);
        }
        let (at, id, bits, is_fd, fill) = match (&raw.pdo, &raw.frame) {
            (Some(pdo), _) => {
                let at = child(path, "pdo");
                let found = self.pdo(&at, pdo, owner, Direction::Written);
                let (id, bits) = found?;
                (at, id, bits, false, &pdo.fill)
            }
            (None, Some(frame)) => {
                let at = child(path, "frame");
                let (id, bits, multiplex) = self.frame(&at, frame)?;
                if multiplex.is_some() {
                    let help = "write the multiplexer's bits into `fill`";
                    self.wrong_key(&child(&at, "multiplex"), "a frame that is written has no choice", help);
                }
                (at, id, bits, frame.fd.unwrap_or(false), &frame.fill)
            }
            (None, None) => return None,
        };
        let fill = match fill {
            Some(text) => Some(self.fill(&child(&at, "fill"), text, is_fd, bits)?),
            None => None,
        };
        let data_type = bits.data_type();
        let verify = self.believed(path, raw, data_type, owner);
        let (frames, multiplex) = (CanMatch::exactly(id), Vec::new());
        let address = Address::Frame(Field { frames, is_fd, bits, multiplex });
        let (device, output) = (device?, name.to_owned());
        self.written.push(Written { device, output, path: at, id, is_fd, bits, fill });
        Some(Target { address, data_type, verify: verify? })
    }

    fn object_target(&mut self, path: &str, sdo: &str, raw: &RawOutput, owner: &str) -> Option<Target> {
        self.needs_node(&child(path, "sdo"), owner);
        let entry = self.entry(&child(path, "sdo"), sdo);
        if raw.read_back.is_some() {
            let help = "remove it: the object that is written is read back itself";
            self.wrong_key(&child(path, "read_back"), "`read_back` belongs to pdo and frame", help);
        }
        let Some(kind) = raw.kind.map(DataType::from) else {
            let message = "`type` is missing: how does the value lie in its object?";
            self.missing(path, "type", message, "allowed: u8, i8, u16, i16, u32, i32, u64, i64, f32, f64");
            return None;
        };
        let data_type = self.object_type(&child(path, "type"), kind)?;
        let address = Address::Object(Object { entry: entry?, data_type });
        let verify = if raw.verify == Some(VerifyWord::Echo) { Verify::Echo } else { Verify::ReadBack };
        Some(Target { address, data_type, verify })
    }

    /// A frame has no answer: what was written is read elsewhere, or a display shows it and nobody acts on it.
    fn believed(&mut self, path: &str, raw: &RawOutput, data_type: DataType, owner: &str) -> Option<Verify> {
        let at = child(path, "read_back");
        if let Some(verify) =
            raw.verify.filter(|verify| *verify == VerifyWord::Echo || raw.read_back.is_none())
        {
            let word = if verify == VerifyWord::Echo { "echo" } else { "read-back" };
            let message = format!("nothing answers a frame: verify = \"{word}\" cannot be kept");
            let help = "remove it, and write read_back = \"6004:00\", the object that reads what was written";
            self.wrong(&child(path, "verify"), message, help);
        }
        if let Some(ReadBackValue::Register(_)) = &raw.read_back {
            let help = "write read_back = \"6004:00\", the CANopen object that reads what was written";
            self.wrong(&at, "a register is on Modbus: on CAN an object is read back", help);
            return None;
        }
        let Some(ReadBackValue::Object(text)) = &raw.read_back else {
            if raw.writes.is_some_and(|writes| writes != WritesWord::Corrected) && !self.places.contains(&at)
            {
                let message = "`read_back` is missing: an offset that nobody has read back is not believed";
                let help = "write read_back = \"6004:00\", the CANopen object that reads what was written; without one only a display of a corrected position is written";
                self.missing(path, "read_back", message, help);
                return None;
            }
            return (!self.places.contains(&at)).then_some(Verify::Shown);
        };
        self.needs_node(&at, owner);
        let entry = self.entry(&at, text);
        if !data_type.width().is_multiple_of(8) {
            let message = format!("an object has whole bytes, and {} bits are written", data_type.width());
            self.wrong(&at, message, "write 8, 16, 24, 32 or 64 bits, as the object has them");
            return None;
        }
        Some(Verify::ReadBackAt(Object { entry: entry?, data_type }))
    }

    fn fill(&mut self, path: &str, text: &str, is_fd: bool, bits: BitField) -> Option<Vec<u8>> {
        let digits: String = text.split_whitespace().collect();
        let is_hex = digits.bytes().all(|byte| byte.is_ascii_hexdigit()) && digits.len().is_multiple_of(2);
        let byte = |place: usize| u8::from_str_radix(digits.get(2 * place..2 * place + 2)?, 16).ok();
        let bytes: Option<Vec<u8>> = if is_hex { (0..digits.len() / 2).map(byte).collect() } else { None };
        let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) else {
            let help = "write the bytes of the frame in hexadecimal, as \"00 00 00 00 00 00 01 00\"";
            self.wrong(path, format!("`{text}` is no frame"), help);
            return None;
        };
        let fits = if is_fd { Frame::fd_length(bytes.len()) == Some(bytes.len()) } else { bytes.len() <= 8 };
        if !fits {
            let help = if is_fd {
                "a CAN FD frame has 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes"
            } else {
                "a frame has at most 8 bytes; write fd = true if it is a CAN FD frame"
            };
            self.wrong(path, format!("no such frame has {} bytes", bytes.len()), help);
            return None;
        }
        if bits.bytes() > bytes.len() {
            let message = format!("the value needs {} bytes, the frame has {}", bits.bytes(), bytes.len());
            self.wrong(path, message, "write more bytes, or correct `start` and `length`");
            return None;
        }
        Some(bytes)
    }

    /// The frames that are written, each with the values of all its outputs.
    pub(in crate::check) fn written_frames(&mut self, devices: &mut [Option<Device>]) {
        let written = std::mem::take(&mut self.written);
        for (place, one) in written.iter().enumerate() {
            let same = |other: &&Written| other.id == one.id && other.device == one.device;
            for earlier in written[..place].iter().filter(same) {
                self.share_a_frame(earlier, one);
            }
            if written[..place].iter().any(|other| same(&other)) {
                continue;
            }
            let all: Vec<&Written> = written.iter().filter(same).collect();
            let needed = all.iter().map(|one| one.bits.bytes()).max().unwrap_or(0);
            let fill = all.iter().find_map(|one| one.fill.clone());
            let is_fd = all.iter().any(|one| one.is_fd);
            let length = if is_fd { Frame::fd_length(needed).unwrap_or(needed) } else { needed };
            let bytes = fill.unwrap_or_else(|| vec![0; length]);
            let frame = if is_fd { Frame::fd(one.id, &bytes) } else { Frame::classic(one.id, &bytes) };
            let device = devices.get_mut(one.device).and_then(Option::as_mut);
            if let Some(can) = device.and_then(|device| device.can.as_mut()) {
                can.written.extend(frame);
            }
        }
        self.written = written;
    }

    fn share_a_frame(&mut self, earlier: &Written, later: &Written) {
        let there = self.places.line_of(&earlier.path);
        let (output, id) = (&earlier.output, later.id);
        if earlier.bits.overlaps(&later.bits) {
            let message = format!("output `{output}` at {there} writes some of these bits of {id} as well");
            self.wrong(
                &child(&later.path, "start"),
                message,
                "one bit has one writer: correct `start` or `length`",
            );
        }
        if earlier.is_fd != later.is_fd {
            let message = format!("output `{output}` at {there} writes {id} as a frame of the other kind");
            self.wrong(&later.path, message, "write `fd` alike at both");
        }
        match (&earlier.fill, &later.fill) {
            (Some(one), Some(other)) if one != other => {
                let message = format!("output `{output}` at {there} fills {id} otherwise");
                self.wrong(&child(&later.path, "fill"), message, "write `fill` once, or alike at both");
            }
            (Some(fill), None) if later.bits.bytes() > fill.len() => {
                let message =
                    format!("{id} has the {} bytes of `fill` of output `{output}` at {there}", fill.len());
                self.wrong(&child(&later.path, "length"), message, "write more bytes there");
            }
            (None, Some(fill)) if earlier.bits.bytes() > fill.len() => {
                let message =
                    format!("output `{output}` at {there} needs {} bytes of {id}", earlier.bits.bytes());
                self.wrong(&child(&later.path, "fill"), message, "write more bytes");
            }
            _ => {}
        }
    }
}
