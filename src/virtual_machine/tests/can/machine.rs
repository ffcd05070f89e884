//! A machine on one CAN line: a thermocouple module, one that only sends, an encoder, a display and a drive.

use super::super::support::{bus, device, output, plain, profile};
use super::*;
use crate::codec::{BitField, BitKind, ByteOrder, CanMatch, DataType, Encoding, Scale};
use crate::profile::{
    CanDevice, Device, Expected, Field, Object, Output, Selector, Signal, Sync, Transport, Unit, Verify,
    Writes,
};
use crate::reading::SignalId;

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

fn object(index: u16, sub: u8, data_type: DataType) -> Object {
    Object { index, sub, data_type }
}

fn set_up(index: u16, sub: u8, data_type: DataType, value: i64) -> crate::profile::Setup {
    crate::profile::Setup { object: object(index, sub, data_type), value, what: String::new() }
}

fn node(node: Option<u8>) -> CanDevice {
    CanDevice {
        node,
        start: true,
        heartbeat: None,
        setup: Vec::new(),
        emergencies: Vec::new(),
        objects: Vec::new(),
        fields: Vec::new(),
        written: Vec::new(),
    }
}

fn on_can(name: &str, every: u64, can: CanDevice) -> Device {
    let every = Duration::from_millis(every);
    Device { every, can: Some(can.clone()), ..device(name, 0, can.node.unwrap_or(0)) }
}

fn signal(name: &str, device: usize, table: Table, offset: u16, encoding: Encoding) -> Signal {
    let template = profile().signals.remove(0);
    let (name, device) = (name.to_owned(), DeviceId(device));
    Signal { name, device, address: Address { table, offset }, encoding, unit: Unit("degC"), ..template }
}

fn written(name: &str, device: usize, table: Table, writes: Writes, verify: Verify) -> Output {
    let address = Address { table, offset: 0 };
    Output { address, verify, ..output(name, device, "holding:0", 0.001, writes) }
}

pub(super) fn can_machine() -> Profile {
    let (signed, unsigned) = (BitKind::Signed, BitKind::Unsigned);
    let mut axtc = node(Some(5));
    axtc.heartbeat = Some(Duration::from_secs(3));
    axtc.setup = vec![set_up(0x1800, 5, DataType::U16, 200)];
    axtc.objects = vec![
        object(0x7130, 1, DataType::I16),
        object(0x6110, 1, DataType::Unsigned(8)),
        object(0x1001, 0, DataType::Unsigned(8)),
        object(0x1017, 0, DataType::U16),
    ];
    axtc.fields = vec![field(0x185, 0, 16, signed), field(0x185, 16, 16, signed)];

    let mut canmod = node(None);
    let selector = |value| Selector { bits: bits(0, 8, unsigned), values: vec![(value, value)] };
    canmod.fields = vec![
        field(0x002, 0, 16, unsigned),
        field(0x002, 16, 2, unsigned),
        field(0x002, 18, 22, unsigned),
        Field { multiplex: vec![selector(3)], ..field(0x300, 8, 16, signed) },
        Field { multiplex: vec![selector(7)], ..field(0x300, 8, 16, signed) },
        Field {
            frames: CanMatch::parameter_group(0x00fe_ee00, None).unwrap(),
            ..field(0x301, 0, 8, unsigned)
        },
        Field { is_fd: true, ..field(0x302, 72, 16, signed) },
    ];

    let mut encoder = node(Some(7));
    encoder.setup = vec![set_up(0x6200, 0, DataType::U16, 50), set_up(0x1801, 2, DataType::Unsigned(8), 2)];
    encoder.fields = vec![field(0x187, 0, 32, signed), field(0x287, 0, 32, signed)];
    encoder.objects = vec![object(0x1800, 5, DataType::U16)];

    let mut display = node(Some(12));
    display.fields = vec![field(0x20c, 0, 32, signed)];
    display.objects = vec![object(0x5f10, 0, DataType::I32)];
    display.start = false;

    let mut drive = node(Some(20));
    drive.objects = vec![object(0x2000, 1, DataType::I32)];

    let position = Encoding { scale: Scale::of(0.001), ..plain(DataType::I32, 1.0) };
    let temperature = Encoding { bad: vec![(-512).into()], ..plain(DataType::I16, 0.0625) };
    let fine = Encoding { offset: -16384.0, ..plain(DataType::Unsigned(22), 0.007_812_5) };
    let (table, sdo) = (Table::Process, Table::Object);
    let signals = vec![
        signal("bed", AXTC, table, 0, temperature.clone()),
        signal("wheelhead", AXTC, table, 1, temperature.clone()),
        signal("bed_object", AXTC, sdo, 0, temperature.clone()),
        signal("junction", 1, table, 0, Encoding { offset: -512.0, ..plain(DataType::U16, 0.015_625) }),
        signal("status", 1, table, 1, plain(DataType::Unsigned(2), 1.0)),
        signal("oil", 1, table, 2, fine),
        signal("third", 1, table, 3, temperature.clone()),
        signal("seventh", 1, table, 4, temperature.clone()),
        signal("coolant", 1, table, 5, Encoding { offset: -40.0, ..plain(DataType::Unsigned(8), 1.0) }),
        signal("far", 1, table, 6, temperature),
        Signal { unit: Unit("mm"), ..signal("position", 2, table, 0, position.clone()) },
        Signal { unit: Unit("mm"), ..signal("synchronous", 2, table, 1, position) },
        Signal { unit: Unit("1"), ..signal("errors", AXTC, sdo, 2, plain(DataType::Unsigned(8), 1.0)) },
        Signal { unit: Unit("1"), ..signal("beats", AXTC, sdo, 3, plain(DataType::U16, 1.0)) },
    ];
    let read_back = Verify::ReadBackAt(Address { table: sdo, offset: 0 });
    let corrected = Writes::Corrected { position: SignalId(10) };
    let mut line = bus("can", "vcan0");
    line.transport = Transport::Can;
    line.sync = Some(Sync { id: CanId::standard(0x80).unwrap(), every: Duration::from_millis(100) });
    let mut devices = vec![
        on_can("axtc", 1000, axtc),
        on_can("canmod", 200, canmod),
        on_can("encoder", 100, encoder),
        on_can("display", 1000, display),
        on_can("drive", 1000, drive),
    ];
    devices[AXTC].verify = vec![Expected {
        address: Address { table: sdo, offset: 1 },
        encoding: plain(DataType::Unsigned(8), 1.0),
        object: Some(object(0x6110, 1, DataType::Unsigned(8))),
        equals: 3,
        what: "type K".to_owned(),
        remedy: String::new(),
    }];
    Profile {
        buses: vec![line],
        devices,
        signals,
        outputs: vec![
            written("display_z", DISPLAY, table, corrected, read_back),
            written("drive_z", DRIVE, sdo, Writes::Offset, Verify::ReadBack),
        ],
        heartbeat: None,
        ..profile()
    }
}
