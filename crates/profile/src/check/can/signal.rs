//! Where a signal of a CAN device lies: in a frame, by a DBC file, in process data, in an object.

use crate::Unit;
use crate::check::Check;
use crate::place::child;
use crate::raw::{ByteOrderWord, RawFrame, RawMultiplex, RawPdo, RawSignal};
use isotherm_core::codec::{
    Address, BitField, BitKind, ByteOrder, CanId, CanMatch, DataType, Field, Object, Selector,
};

/// Bytes of a classic frame.
const CLASSIC: usize = 8;

/// Where a signal lies and what is known of it from there.
pub(in crate::check) struct Located {
    pub(in crate::check) address: Address,
    pub(in crate::check) data_type: DataType,
    pub(in crate::check) scale: f64,
    pub(in crate::check) offset: f64,
    pub(in crate::check) unit: Option<Unit>,
}

impl Check<'_> {
    /// Whether a signal's keys belong to the kind of line its device hangs on; those of the other kind are told.
    pub(in crate::check) fn signal_keys(&mut self, path: &str, raw: &RawSignal) {
        let Some(device) = raw.device.as_deref() else { return };
        let Some(on_can) = self.is_on_can(device) else { return };
        let of_can = [
            ("dbc", raw.dbc.is_some()),
            ("pdo", raw.pdo.is_some()),
            ("sdo", raw.sdo.is_some()),
            ("frame", raw.frame.is_some()),
        ];
        let of_modbus = [
            ("register", raw.register.is_some()),
            ("word_order", raw.word_order.is_some()),
            ("byte_swap", raw.byte_swap.is_some()),
            ("merge", raw.merge.is_some()),
        ];
        let (foreign, whose, help): (&[_], _, _) = if on_can {
            let help = format!(
                "`{device}` hangs on a CAN line: remove it, and write dbc, pdo, sdo or frame to say where the value is"
            );
            (&of_modbus, "a Modbus device", help)
        } else {
            let help = format!("`{device}` hangs on a Modbus line: write register = \"input:0\"");
            (&of_can, "a device on a CAN line", help)
        };
        for (key, _) in foreign.iter().filter(|(_, there)| *there) {
            self.wrong_key(&child(path, key), format!("`{key}` belongs to {whose}"), help.clone());
        }
        let captures = raw.counter.as_ref().is_some_and(|counter| counter.capture.is_some());
        if on_can && captures {
            let at = child(&child(path, "counter"), "capture");
            let help = "remove it: a CAN device sends its count by itself";
            self.wrong_key(&at, "`capture` belongs to a Modbus device", help);
        }
        let small = raw.kind.map(DataType::from).filter(|kind| kind.width() == 8);
        if let Some(small) = small.filter(|_| !on_can) {
            let message = format!("{} is smaller than a register", small.name());
            self.wrong(
                &child(path, "type"),
                message,
                "take \"u16\" or \"i16\", or one bit, as \"input:50.3\"",
            );
        }
    }

    /// Where a signal of a CAN device lies.
    pub(in crate::check) fn located(&mut self, path: &str, raw: &RawSignal) -> Option<Located> {
        let name = raw.device.as_deref()?;
        if let Some(dbc) = &raw.dbc {
            self.type_from_bits(path, "dbc", raw);
            let found = self.described(path, dbc, name)?;
            let (scale, offset) = self.described_scale(path, raw, (found.scale, found.offset))?;
            self.described_unit(path, raw, found.unit);
            let data_type = found.field.bits.data_type();
            let address = Address::Frame(found.field);
            return Some(Located { address, data_type, scale, offset, unit: found.unit });
        }
        let (address, data_type) = match (&raw.pdo, &raw.sdo, &raw.frame) {
            (Some(pdo), ..) => {
                self.type_from_bits(path, "pdo", raw);
                let (id, bits) = self.pdo(&child(path, "pdo"), pdo, name, Direction::Read)?;
                self.no_fill(&child(path, "pdo"), pdo.fill.is_some());
                in_frames(id, bits, false, Vec::new())
            }
            (_, Some(sdo), _) => {
                self.needs_node(&child(path, "sdo"), name);
                let entry = self.entry(&child(path, "sdo"), sdo);
                let at = child(path, "type");
                let Some(kind) = raw.kind.map(DataType::from) else {
                    let help = "allowed: bool, u8, i8, u16, i16, u32, i32, u64, i64, f32, f64; the device's manual says which";
                    self.missing(
                        path,
                        "type",
                        "`type` is missing: how does the value lie in its object?",
                        help,
                    );
                    return None;
                };
                let data_type = self.object_type(&at, kind)?;
                (Address::Object(Object { entry: entry?, data_type }), data_type)
            }
            (_, _, Some(frame)) => {
                self.type_from_bits(path, "frame", raw);
                let at = child(path, "frame");
                self.no_fill(&at, frame.fill.is_some());
                let (id, bits, multiplex) = self.frame(&at, frame)?;
                let multiplex = multiplex.into_iter().collect();
                in_frames(id, bits, frame.fd.unwrap_or(false), multiplex)
            }
            (None, None, None) => {
                let keys = ["dbc", "pdo", "sdo", "frame"].map(|key| child(path, key));
                if raw.register.is_none() && !keys.iter().any(|key| self.places.contains(key)) {
                    let message = "it is not said where the signal is read";
                    let help =
                        "write dbc = \"Message.Signal\", pdo = { … }, sdo = \"7130:01\" or frame = { … }";
                    self.wrong_key(path, message, help);
                }
                return None;
            }
        };
        let unit = matches!(data_type, DataType::Bool).then_some(Unit("bool"));
        let (scale, offset) = (raw.scale.unwrap_or(1.0), raw.offset.unwrap_or(0.0));
        Some(Located { address, data_type, scale, offset, unit })
    }

    fn type_from_bits(&mut self, path: &str, key: &str, raw: &RawSignal) {
        if raw.kind.is_some() {
            let help = match key {
                "dbc" => "remove it: the DBC file says how many bits there are, and of which kind",
                _ => "remove it: `length`, `signed` and `float` say it",
            };
            self.wrong_key(&child(path, "type"), "`type` belongs to registers and objects", help);
        }
    }

    fn no_fill(&mut self, path: &str, there: bool) {
        if there {
            let help = "remove it; it belongs to an output";
            self.wrong_key(&child(path, "fill"), "a frame that is read is filled by its sender", help);
        }
    }

    /// The scale and the offset go together: half of each file's makes a wrong value.
    fn described_scale(&mut self, path: &str, raw: &RawSignal, of_file: (f64, f64)) -> Option<(f64, f64)> {
        let own = (raw.scale, raw.offset);
        match own {
            (None, None) => Some(of_file),
            (scale, offset) => {
                let missing = if scale.is_none() { "scale" } else { "offset" };
                let is_plain = if scale.is_none() { (of_file.0 - 1.0).abs() } else { of_file.1.abs() } == 0.0;
                if (scale.is_none() || offset.is_none()) && !is_plain {
                    let message = format!(
                        "the DBC file has scale {} and offset {}; one of them cannot be replaced alone",
                        of_file.0, of_file.1
                    );
                    let help = format!("write `{missing}` as well, or leave both to the file");
                    let there = if scale.is_none() { "offset" } else { "scale" };
                    self.wrong(&child(path, there), message, help);
                    return None;
                }
                Some((scale.unwrap_or(1.0), offset.unwrap_or(0.0)))
            }
        }
    }

    fn described_unit(&mut self, path: &str, raw: &RawSignal, of_file: Option<Unit>) {
        let own = raw.unit.as_deref().and_then(Unit::named);
        if let (Some(own), Some(of_file)) = (own, of_file)
            && own != of_file
            && raw.scale.is_none()
        {
            let message = format!("the DBC file has it in \"{}\"", of_file.0);
            let help = format!(
                "write unit = \"{}\", or `scale` and `offset` that make \"{}\" of the raw count",
                of_file.0, own.0
            );
            self.wrong(&child(path, "unit"), message, help);
        }
    }

    pub(super) fn needs_node(&mut self, path: &str, device: &str) {
        let at = child(&child("device", device), "node");
        if !self.places.contains(&at) {
            let help = format!("write node = 5 at device `{device}`, the node number set there");
            self.wrong(
                path,
                format!("an object is read of a CANopen node, and `{device}` has no `node`"),
                help,
            );
        }
    }

    /// Identifier and bits of process data.
    pub(super) fn pdo(
        &mut self,
        path: &str,
        raw: &RawPdo,
        device: &str,
        direction: Direction,
    ) -> Option<(CanId, BitField)> {
        let bits =
            self.bits(path, (raw.start, raw.length), ByteOrder::Intel, (raw.signed, raw.float), CLASSIC);
        let id = match (raw.cob_id, raw.number) {
            (Some(id), None) => CanId::standard(id),
            (None, Some(number)) => {
                let at = child(path, "number");
                let key = child(&child("device", device), "node");
                let node = self.raw.device.get(device).and_then(|device| device.node);
                if !self.places.contains(&key) {
                    let help = format!("write node = 5 at device `{device}`, or `cob_id` here");
                    self.wrong(&at, "the usual identifiers are those of a CANopen node", help);
                }
                CanId::standard(direction.usual(number, node?))
            }
            (Some(_), Some(_)) => {
                let help = "keep one of them";
                self.wrong_key(
                    &child(path, "number"),
                    "`cob_id` and `number` both say which frame it is",
                    help,
                );
                None
            }
            (None, None) => {
                let wrong = ["cob_id", "number"].iter().any(|key| self.places.contains(&child(path, key)));
                if !wrong {
                    let help = "write cob_id = 0x185, or number = 1 for the usual identifier of the node";
                    self.missing(path, "cob_id", "`cob_id` is missing: which frame is it?", help);
                }
                None
            }
        };
        Some((id?, bits?))
    }

    /// Identifier, bits and multiplexer of a raw frame.
    pub(super) fn frame(
        &mut self,
        path: &str,
        raw: &RawFrame,
    ) -> Option<(CanId, BitField, Option<Selector>)> {
        let is_long = raw.id.is_some_and(|id| id > CanId::LARGEST_STANDARD);
        if is_long && raw.extended == Some(false) {
            let message = "an identifier above 0x7FF has 29 bits";
            self.wrong(&child(path, "extended"), message, "remove it, or correct `id`");
        }
        let needs_order = raw.length.is_some_and(|length| length > 1);
        if raw.order.is_none() && needs_order {
            let message = "`order` is missing: which end of the value comes first?";
            let help = "write \"little\" (Intel, `start` is the least significant bit) or \"big\" (Motorola, `start` is the most significant one)";
            self.missing(path, "order", message, help);
        }
        let order = match raw.order {
            Some(ByteOrderWord::Big) => ByteOrder::Motorola,
            Some(ByteOrderWord::Little) => ByteOrder::Intel,
            None if needs_order => return None,
            None => ByteOrder::Intel,
        };
        let most = if raw.fd == Some(true) { BitField::LONGEST_FRAME } else { CLASSIC };
        let bits = self.bits(path, (raw.start, raw.length), order, (raw.signed, raw.float), most);
        let multiplex = match &raw.multiplex {
            None => None,
            Some(multiplex) => Some(self.multiplex(&child(path, "multiplex"), multiplex, order, most)?),
        };
        let id =
            if raw.extended.unwrap_or(is_long) { CanId::extended(raw.id?) } else { CanId::standard(raw.id?) };
        Some((id?, bits?, multiplex))
    }

    fn multiplex(
        &mut self,
        path: &str,
        raw: &RawMultiplex,
        order: ByteOrder,
        most: usize,
    ) -> Option<Selector> {
        let bits = self.bits(path, (raw.start, raw.length), order, (None, None), most)?;
        let equals = raw.equals?;
        let width = bits.data_type().width();
        if width < 64 && equals >> width != 0 {
            let message = format!("{width} bits never hold {equals}");
            self.wrong(&child(path, "equals"), message, format!("allowed: 0 to {}", (1u64 << width) - 1));
        }
        Some(Selector { bits, values: vec![(equals, equals)] })
    }

    fn bits(
        &mut self,
        path: &str,
        (start, length): (Option<u16>, Option<u16>),
        order: ByteOrder,
        (signed, float): (Option<bool>, Option<bool>),
        most: usize,
    ) -> Option<BitField> {
        let kind = match (signed.unwrap_or(false), float.unwrap_or(false)) {
            (true, true) => {
                let help = "remove `signed`: a floating-point number has its sign";
                self.wrong_key(&child(path, "signed"), "`signed` and `float` exclude each other", help);
                BitKind::Float
            }
            (_, true) => BitKind::Float,
            (true, _) => BitKind::Signed,
            (false, false) => BitKind::Unsigned,
        };
        let (start, length) = (start?, length?);
        let at = child(path, "length");
        let fits_kind =
            if kind == BitKind::Float { matches!(length, 32 | 64) } else { matches!(length, 1..=64) };
        if !fits_kind {
            let help = if kind == BitKind::Float { "allowed: 32 and 64" } else { "allowed: 1 to 64" };
            self.wrong(&at, format!("no such value has {length} bits"), help);
            return None;
        }
        let field = BitField::new(start, length, order, kind);
        if let Some(field) = field.filter(|field| field.bytes() <= most) {
            return Some(field);
        }
        let needed = field.map_or_else(|| "more than 64".to_owned(), |field| field.bytes().to_string());
        let help = match (most, order) {
            (CLASSIC, _) if path.ends_with("pdo") => {
                "process data has at most 64 bits, numbered from 0".to_owned()
            }
            (CLASSIC, _) => {
                "bits are numbered from 0 to 63; write fd = true if it is a CAN FD frame".to_owned()
            }
            _ => "bits are numbered from 0 to 511".to_owned(),
        };
        self.wrong(&at, format!("the frame needs {needed} bytes, and has at most {most}"), help);
        None
    }

    /// Whether an address is of a value that comes by itself: there is no poll that its age could be measured by.
    pub(in crate::check) fn comes_by_itself(raw: &RawSignal) -> bool {
        raw.dbc.is_some() || raw.pdo.is_some() || raw.frame.is_some()
    }
}

fn in_frames(id: CanId, bits: BitField, is_fd: bool, multiplex: Vec<Selector>) -> (Address, DataType) {
    let frames = CanMatch::exactly(id);
    (Address::Frame(Field { frames, is_fd, bits, multiplex }), bits.data_type())
}

/// Who sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// The device.
    Read,
    /// The gateway.
    Written,
}

impl Direction {
    /// The usual identifier of a process data object, by CiA 301.
    fn usual(self, number: u8, node: u8) -> u32 {
        let first = match self {
            Direction::Read => 0x180,
            Direction::Written => 0x200,
        };
        first + 0x100 * (u32::from(number) - 1) + u32::from(node)
    }
}
