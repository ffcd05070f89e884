//! Resolves outputs that are written into CAN frames or CANopen objects.

use super::fields::{self, Sender};
use super::frame_writes::{Written, fill as fill_of};
use crate::kinds::opcua::nodes::not_here;
use crate::tables::output::applied::ReadBackValue;
use crate::tables::output::display::Display;
use crate::tables::output::share::Share;
use crate::tables::output::verify::{Verify, VerifyWord};
use crate::tables::output::{RawOutput, Target, not_one_bit};
use crate::tables::register::plain;
use crate::tables::{Check, KeyContext, optional};
use isotherm_core::codec::{Address, DataType, Encoding, Object};

/// Reports keys of an output that are not allowed if its device is on a CAN line.
pub(super) fn foreign_keys(raw: &RawOutput, at: &KeyContext<'_>, device: &str) {
    not_here(at);
    let of_modbus = ["register", "word_order", "byte_swap", "beside", "stale", "set", "handshake"];
    let help = format!(
        "`{device}` is on a CAN line: remove this key; pdo, sdo or frame sets where a value is written"
    );
    at.not_applicable(&of_modbus, "a Modbus device", &help);
    if at.key("restart").has("boot_counter") {
        at.not_applicable(&["restart"], "a Modbus device", &help);
    }
    if raw.share == Some(Share::Ledger) {
        let message = "share = \"ledger\" is allowed only for a Modbus device";
        at.key("share").wrong_key(message, help);
    }
}

/// Resolves an output on a CAN line: its address, encoding and verification. `name` is the name of the output, `device`
/// the index of its device.
pub(super) fn resolve(
    check: &Check<'_>,
    raw: &RawOutput,
    at: &KeyContext<'_>,
    name: &str,
    device: Option<usize>,
) -> Option<Target> {
    let target = target(check, raw, at, (name, device));
    let data_type = target.as_ref().map(|(address, _)| fields::data_type(address));
    let scale = raw.scale(&at.key("scale"), data_type);
    let ((address, verify), data_type) = target.zip(data_type)?;
    not_one_bit(&at.key("type"), Some(data_type));
    let bias = raw.bias(&at.key("bias"), data_type);
    let encoding = Encoding { scale: scale?, bias, ..plain(data_type) };
    let (applied, display) = (None, Display::default());
    Some(Target { address, encoding, verify, share: Share::Whole, applied, display })
}

fn target(
    check: &Check<'_>,
    raw: &RawOutput,
    at: &KeyContext<'_>,
    (name, device): (&str, Option<usize>),
) -> Option<(Address, Verify)> {
    let places = ["pdo", "sdo", "frame"];
    match places.into_iter().filter(|key| at.has(key)).count() {
        1 => {}
        0 => {
            if places.into_iter().chain(["register"]).all(|key| at.key(key).is_left_out()) {
                let help = "write pdo = { … }, sdo = \"2000:01\" or frame = { … }";
                at.wrong_key("the CAN frame or object to write is missing", help);
            }
            return None;
        }
        _ => {
            let help = "keep one of pdo, sdo, frame";
            at.wrong_key("the output is written to more than one place", help);
            return None;
        }
    }
    let owner = raw.device.as_deref()?;
    if let Some(sdo) = &raw.sdo {
        if raw.read_back.is_some() {
            let help = "remove this key: the gateway reads back the object that it has written";
            at.key("read_back")
                .wrong_key("on a CAN line, `read_back` is allowed only with `pdo` and `frame`", help);
        }
        let types = "allowed: u8, i8, u16, i16, u32, i32, u64, i64, f32, f64";
        let address = fields::object(at, sdo, raw.kind, owner, types)?;
        return Some((address, raw.verification()));
    }
    if raw.kind.is_some() {
        let help = "remove this key: `length`, `signed` and `float` define the type";
        at.key("type").wrong_key("on a CAN line, `type` is allowed only with `sdo`", help);
    }
    let (place, field, fill) = if let Some(pdo) = &raw.pdo {
        let place = at.key("pdo");
        let node = check.raw.device.get(owner).and_then(|device| device.node);
        let field = pdo.resolve(&place, (owner, node), Sender::Gateway)?;
        (place, field, &pdo.fill)
    } else {
        let (place, frame) = (at.key("frame"), raw.frame.as_ref()?);
        let mut field = frame.resolve(&place)?;
        if !std::mem::take(&mut field.multiplex).is_empty() {
            let help = "write the multiplexer's bits into `fill`";
            place.key("multiplex").wrong_key("`multiplex` is allowed only in frames that are read", help);
        }
        (place, field, &frame.fill)
    };
    let fill = optional(fill.as_ref(), |text| fill_of(&place.key("fill"), text, &field))?;
    let verify = of_a_frame(raw, at, field.bits.data_type(), owner);
    let written = Written::of(&place, device?, name, &field, fill);
    check.written_frames.borrow_mut().push(written);
    Some((Address::Frame(field), verify?))
}

/// Resolves the verification of a value in a CAN frame, to which no device answers. The gateway reads the
/// value back from a CANopen object. A corrected position that is only shown on a display is not verified.
fn of_a_frame(raw: &RawOutput, at: &KeyContext<'_>, data_type: DataType, owner: &str) -> Option<Verify> {
    let place = at.key("read_back");
    let kept = |verify: &VerifyWord| *verify == VerifyWord::ReadBack && raw.read_back.is_some();
    if let Some(verify) = raw.verify.filter(|verify| !kept(verify)) {
        let word = if verify == VerifyWord::Echo { "echo" } else { "read-back" };
        let message = format!("no device answers a CAN frame: verify = \"{word}\" is not possible");
        let help = "remove this key, and write read_back = \"6004:00\", the CANopen object that returns the \
             written value";
        at.key("verify").invalid(message, help);
    }
    let text = match &raw.read_back {
        Some(ReadBackValue::Object(text)) => text,
        Some(ReadBackValue::Register(_)) => {
            let help = "write read_back = \"6004:00\", the CANopen object that returns the written value";
            return place.reject("registers are only for Modbus: on CAN an object is read back", help);
        }
        None if raw.is_written_as_cz() => {
            let message = "`read_back` is missing: an offset must be read back";
            let help = "write read_back = \"6004:00\", the CANopen object that returns the written value. \
                        Without `read_back`, only a display of a corrected position can be written";
            place.missing(message, help);
            return None;
        }
        None => return (!place.is_written()).then_some(Verify::Shown),
    };
    fields::needs_node(&place, owner);
    let entry = fields::entry(&place, text);
    if !data_type.width().is_multiple_of(8) {
        let message =
            format!("an object consists of whole bytes, but the output writes {} bits", data_type.width());
        return place.reject(message, "write 8, 16, 24, 32 or 64 bits, the size of the object");
    }
    Some(Verify::ReadBackAt(Object { entry: entry?, data_type }))
}
