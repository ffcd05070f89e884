//! Frames that outputs write. Several outputs may write their values into one frame.

use crate::tables::{Check, KeyContext};
use isotherm_core::codec::{CanId, Field, Frame};

/// Value that an output writes into a CAN frame: the output, the bits of the value, and the bytes of the
/// frame before the value is inserted (`fill`).
#[derive(Clone, Debug)]
pub(crate) struct Written {
    pub(super) device: usize,
    pub(super) output: String,
    /// Path of the output's key `pdo` or `frame`, at which conflicts are reported.
    pub(super) path: String,
    pub(super) field: Field,
    pub(super) fill: Option<Vec<u8>>,
}

impl Written {
    /// Describes the value that an output writes into a frame. `at` is the context of the output's key `pdo` or
    /// `frame`.
    pub(super) fn of(
        at: &KeyContext<'_>,
        device: usize,
        output: &str,
        field: &Field,
        fill: Option<Vec<u8>>,
    ) -> Written {
        Written { device, output: output.to_owned(), path: at.path.clone(), field: field.clone(), fill }
    }

    pub(super) fn id(&self) -> CanId {
        self.field.frames.id
    }

    pub(super) fn is_process_data(&self) -> bool {
        self.path.ends_with("pdo")
    }

    pub(super) fn at<'c>(&self, check: &'c Check<'c>) -> KeyContext<'c> {
        KeyContext { report: &check.report, path: self.path.clone() }
    }

    /// Returns the number of bytes that the frame needs for the value.
    fn bytes(&self) -> usize {
        self.field.bits.bytes()
    }

    fn is_in_one_frame_with(&self, other: &Written) -> bool {
        self.id() == other.id() && self.device == other.device
    }
}

/// Parses the key `fill`: the bytes of a frame before the values of outputs are inserted. Reports an error and returns
/// `None` if they are invalid or too few.
pub(super) fn fill(at: &KeyContext<'_>, text: &str, field: &Field) -> Option<Vec<u8>> {
    let digits: String = text.split_whitespace().collect();
    let is_hex = digits.bytes().all(|byte| byte.is_ascii_hexdigit()) && digits.len().is_multiple_of(2);
    let byte = |place: usize| u8::from_str_radix(digits.get(2 * place..2 * place + 2)?, 16).ok();
    let bytes: Option<Vec<u8>> = if is_hex { (0..digits.len() / 2).map(byte).collect() } else { None };
    let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) else {
        let help = "write the bytes of the frame in hexadecimal, as \"00 00 00 00 00 00 01 00\"";
        return at.reject(format!("`{text}` is not the content of a frame"), help);
    };
    let (fits, help) = if field.is_fd {
        let help = "a CAN FD frame has 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes";
        (Frame::fd_length(bytes.len()) == Some(bytes.len()), help)
    } else {
        (bytes.len() <= 8, "a frame has at most 8 bytes; write fd = true if it is a CAN FD frame")
    };
    if !fits {
        return at.reject(format!("a frame cannot have {} bytes", bytes.len()), help);
    }
    let needed = field.bits.bytes();
    if needed > bytes.len() {
        let message = format!("the value needs {needed} bytes, the frame has {}", bytes.len());
        return at.reject(message, "write more bytes, or correct `start` and `length`");
    }
    Some(bytes)
}

/// Adds to each device the frames that its outputs write. A frame has the length of `fill`. Without `fill`,
/// it has the length that the values of all its outputs require.
pub(super) fn resolve(check: &mut Check<'_>) {
    let written = check.written_frames.borrow().clone();
    for (place, one) in written.iter().enumerate() {
        let is_same = |other: &&Written| one.is_in_one_frame_with(other);
        let mut earlier = written[..place].iter().filter(is_same).peekable();
        let is_first = earlier.peek().is_none();
        earlier.for_each(|earlier| share_a_frame(check, earlier, one));
        if !is_first {
            continue;
        }
        let all: Vec<&Written> = written.iter().filter(is_same).collect();
        let needed = all.iter().map(|one| one.bytes()).max().unwrap_or(0);
        let is_fd = all.iter().any(|one| one.field.is_fd);
        let length = if is_fd { Frame::fd_length(needed).unwrap_or(needed) } else { needed };
        let bytes = all.iter().find_map(|one| one.fill.clone()).unwrap_or_else(|| vec![0; length]);
        let frame = if is_fd { Frame::fd(one.id(), &bytes) } else { Frame::classic(one.id(), &bytes) };
        let device = check.devices.resolved.get_mut(one.device).and_then(Option::as_mut);
        if let Some(can) = device.and_then(|device| device.can.as_mut()) {
            can.written.extend(frame);
        }
    }
}

/// Reports conflicts between two outputs that write into the same frame: overlapping bits, or different `fd` or `fill`.
fn share_a_frame(check: &Check<'_>, earlier: &Written, later: &Written) {
    let at = later.at(check);
    let there = earlier.at(check).line();
    let (output, id) = (&earlier.output, later.id());
    if earlier.field.bits.overlaps(&later.field.bits) {
        let message = format!("output `{output}` at {there} writes some of these bits of {id} as well");
        at.key("start").invalid(message, "a bit must have one writer: correct `start` or `length`");
    }
    if earlier.field.is_fd != later.field.is_fd {
        let message = format!("output `{output}` at {there} has a different `fd` for {id}");
        at.invalid(message, "write the same `fd` at both outputs");
    }
    match (&earlier.fill, &later.fill) {
        (Some(one), Some(other)) if one != other => {
            let message = format!("output `{output}` at {there} has a different `fill` for {id}");
            at.key("fill").invalid(message, "write `fill` at one output, or the same `fill` at both");
        }
        (Some(fill), None) if later.bytes() > fill.len() => {
            let message = format!(
                "this output needs {} bytes of {id}, but `fill` of output `{output}` at {there} has only {}",
                later.bytes(),
                fill.len()
            );
            at.key("length").invalid(message, "write more bytes in that `fill`, or correct `length`");
        }
        (None, Some(fill)) if earlier.bytes() > fill.len() => {
            let message = format!("output `{output}` at {there} needs {} bytes of {id}", earlier.bytes());
            at.key("fill").invalid(message, "write more bytes");
        }
        _ => {}
    }
}
