//! A machine on one CAN line: a thermocouple module, a device that only sends, an encoder, a display and a drive.

use super::super::support::{bus, device, output, plain, profile};
use super::*;
use isotherm_core::codec::{
    Address, BitField, BitKind, ByteOrder, CanMatch, DataType, Encoding, Field, Object, Scale, Selector,
};
use isotherm_core::reading::SignalId;
use isotherm_profile::{CanDevice, Device, Expected, Output, Signal, Sync, Transport, Unit, Verify, Writes};

pub(super) const AXTC: usize = 0;
pub(super) const DISPLAY: usize = 3;
pub(super) const DRIVE: usize = 4;

fn bits(start: u16, length: u16, kind: BitKind) -> BitField {
    BitField::new(start, length, ByteOrder::Intel, kind).unwrap()
}

fn field(id: u32, start: u16, length: u16, kind: BitKind) -> Field {
    let id = if id > 0x7ff { CanId::extended(id) } else { CanId::standard(id) };
    let frames = CanMatch::exactly(id.unwrap());
    Field { frames, is_fd: false, bits: bits(start, length, kind), multiplex: Vec::new() }
}

fn set_up(index: u16, sub: u8, data_type: DataType, value: i64) -> isotherm_profile::Setup {
    isotherm_profile::Setup { object: Object::new(index, sub, data_type), value, what: String::new() }
}

fn node(node: Option<u8>) -> CanDevice {
    CanDevice {
        node,
        start: true,
        heartbeat: None,
        setup: Vec::new(),
        emergencies: Vec::new(),
        written: Vec::new(),
    }
}

fn on_can(name: &str, every: u64, can: CanDevice) -> Device {
    let every = Duration::from_millis(every);
    Device { every, can: Some(can.clone()), ..device(name, 0, can.node.unwrap_or(0)) }
}

fn signal(name: &str, device: usize, address: Address, encoding: Encoding) -> Signal {
    let template = profile().signals.remove(0);
    let (name, device) = (name.to_owned(), DeviceId(device));
    Signal { name, device, address, encoding, unit: Unit("degC"), ..template }
}

fn written(name: &str, device: usize, address: Address, writes: Writes, verify: Verify) -> Output {
    Output { address, verify, ..output(name, device, "holding:0", 0.001, writes) }
}

/// Frame with the value of the display.
pub(super) fn shown() -> Address {
    Address::Frame(field(0x20c, 0, 32, BitKind::Signed))
}

/// Object with the offset of the drive.
pub(super) fn offset() -> Address {
    Address::Object(Object::new(0x2000, 1, DataType::I32))
}

pub(super) fn can_machine() -> Profile {
    let (signed, unsigned) = (BitKind::Signed, BitKind::Unsigned);
    let mut axtc = node(Some(5));
    axtc.heartbeat = Some(Duration::from_secs(3));
    axtc.setup = vec![set_up(0x1800, 5, DataType::U16, 200)];

    let selector = |value| Selector { bits: bits(0, 8, unsigned), values: vec![(value, value)] };
    let selected = |value| Field { multiplex: vec![selector(value)], ..field(0x300, 8, 16, signed) };
    let group = Field {
        frames: CanMatch::parameter_group(0x00fe_ee00, None).unwrap(),
        ..field(0x301, 0, 8, unsigned)
    };
    let long = Field { is_fd: true, ..field(0x302, 72, 16, signed) };

    let mut encoder = node(Some(7));
    encoder.setup = vec![set_up(0x6200, 0, DataType::U16, 50), set_up(0x1801, 2, DataType::Unsigned(8), 2)];

    let mut display = node(Some(12));
    display.start = false;

    let position = Encoding { scale: Scale::of(0.001), ..plain(DataType::I32, 1.0) };
    let temperature = Encoding { bad: vec![(-512).into()], ..plain(DataType::I16, 0.0625) };
    let fine = Encoding { offset: -16384.0, ..plain(DataType::Unsigned(22), 0.007_812_5) };
    let byte = DataType::Unsigned(8);
    let frame = |id, start, length, kind| Address::Frame(field(id, start, length, kind));
    let object = |index, sub, data_type| Address::Object(Object::new(index, sub, data_type));
    let signals = vec![
        signal("bed", AXTC, frame(0x185, 0, 16, signed), temperature.clone()),
        signal("wheelhead", AXTC, frame(0x185, 16, 16, signed), temperature.clone()),
        signal("bed_object", AXTC, object(0x7130, 1, DataType::I16), temperature.clone()),
        signal(
            "junction",
            1,
            frame(0x002, 0, 16, unsigned),
            Encoding { offset: -512.0, ..plain(DataType::U16, 0.015_625) },
        ),
        signal("status", 1, frame(0x002, 16, 2, unsigned), plain(DataType::Unsigned(2), 1.0)),
        signal("oil", 1, frame(0x002, 18, 22, unsigned), fine),
        signal("third", 1, Address::Frame(selected(3)), temperature.clone()),
        signal("seventh", 1, Address::Frame(selected(7)), temperature.clone()),
        signal(
            "coolant",
            1,
            Address::Frame(group),
            Encoding { offset: -40.0, ..plain(DataType::Unsigned(8), 1.0) },
        ),
        signal("far", 1, Address::Frame(long), temperature),
        Signal { unit: Unit("mm"), ..signal("position", 2, frame(0x187, 0, 32, signed), position.clone()) },
        Signal { unit: Unit("mm"), ..signal("synchronous", 2, frame(0x287, 0, 32, signed), position) },
        Signal {
            unit: Unit("1"),
            ..signal("errors", AXTC, object(0x1001, 0, byte), plain(DataType::Unsigned(8), 1.0))
        },
        Signal {
            unit: Unit("1"),
            ..signal("beats", AXTC, object(0x1017, 0, DataType::U16), plain(DataType::U16, 1.0))
        },
    ];
    let read_back = Verify::ReadBackAt(Object::new(0x5f10, 0, DataType::I32));
    let corrected = Writes::Corrected { position: SignalId(10) };
    let mut line = bus("can", "vcan0");
    line.transport = Transport::Can;
    line.sync = Some(Sync { id: CanId::standard(0x80).unwrap(), every: Duration::from_millis(100) });
    let mut devices = vec![
        on_can("axtc", 1000, axtc),
        on_can("canmod", 200, node(None)),
        on_can("encoder", 100, encoder),
        on_can("display", 1000, display),
        on_can("drive", 1000, node(Some(20))),
    ];
    devices[AXTC].verify = vec![Expected {
        address: object(0x6110, 1, byte),
        encoding: plain(byte, 1.0),
        equals: 3,
        what: "type K".to_owned(),
        remedy: String::new(),
        every: std::time::Duration::from_secs(60),
    }];
    Profile {
        buses: vec![line],
        devices,
        signals,
        outputs: vec![
            written("display_z", DISPLAY, shown(), corrected, read_back),
            written("drive_z", DRIVE, offset(), Writes::Offset, Verify::ReadBack),
        ],
        heartbeat: None,
        ..profile()
    }
}
