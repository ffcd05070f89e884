//! Settings of a serial line, found by trying: with each setting, two reads are sent to one unit.

use std::time::Duration;

use crate::discovery::bus::{LineAddress, Parity, Serial};
use crate::discovery::scan::{AnswerKind, Event, Scan};
use crate::discovery::{Register, Table};
use crate::fieldbus::explain::explain_on;
use isotherm_profile::Quirks;

/// Baud rates and parities that are tried, the most frequent first.
const BAUDS: [u32; 5] = [9600, 19_200, 38_400, 57_600, 115_200];
const PARITIES: [Parity; 3] = [Parity::None, Parity::Even, Parity::Odd];
/// Registers that are read. Some units answer only for a register that they have.
const REGISTERS: [Register; 2] =
    [Register { table: Table::Holding, offset: 0 }, Register { table: Table::Input, offset: 0 }];
const TIMEOUT: Duration = Duration::from_millis(300);

/// Frame format of Modbus on a serial port: RTU or ASCII.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frames {
    Rtu,
    /// Frames of Modbus ASCII, with 7 or 8 data bits.
    Ascii {
        data_bits: u8,
    },
}

/// Settings of a serial line: baud rate, parity and frame format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SerialSettings {
    pub(super) baud: u32,
    pub(super) parity: Parity,
    pub(super) frames: Frames,
}

impl SerialSettings {
    /// Most frequent settings of Modbus RTU.
    pub(super) const RTU: SerialSettings =
        SerialSettings { baud: BAUDS[0], parity: Parity::None, frames: Frames::Rtu };
    /// Usual settings of Modbus ASCII.
    pub(super) const ASCII: SerialSettings =
        SerialSettings { baud: BAUDS[0], parity: Parity::Even, frames: Frames::Ascii { data_bits: 7 } };

    /// Returns settings with this baud rate and parity, and with the frame format of `self`. With Modbus ASCII, the
    /// settings have seven data bits if there is a parity bit, and eight without a parity bit.
    fn tried(self, baud: u32, parity: Parity) -> SerialSettings {
        let frames = match self.frames {
            Frames::Rtu => Frames::Rtu,
            Frames::Ascii { .. } => Frames::Ascii { data_bits: if parity == Parity::None { 8 } else { 7 } },
        };
        SerialSettings { baud, parity, frames }
    }

    /// Returns the line address of a serial port with these settings.
    fn address(self, port: &str) -> Result<LineAddress, String> {
        let SerialSettings { baud, parity, frames } = self;
        let address: LineAddress = match frames {
            Frames::Rtu => format!("rtu://{port}"),
            Frames::Ascii { data_bits } => format!("modbus-ascii://{port}?data_bits={data_bits}"),
        }
        .parse()?;
        Ok(address.with_serial(|serial| Serial { baud, parity, ..serial }))
    }
}

/// Function that finds the settings with which a unit on a port answers. The settings in its arguments state the frame
/// format. Returns `None` if the unit answers with none of the settings, and an error in one sentence if the port
/// cannot be used.
pub(super) type FindSettings<'a> =
    &'a dyn Fn(&str, SerialSettings, u8) -> Result<Option<SerialSettings>, String>;

/// Returns the number of settings that are tried, and the longest total time of the tries.
pub(super) fn extent() -> (usize, Duration) {
    let count = BAUDS.len() * PARITIES.len();
    let requests = u32::try_from(count * REGISTERS.len()).unwrap_or(u32::MAX);
    // A request waits for its timeout, and for the line to be silent before it.
    (count, (TIMEOUT * 2).saturating_mul(requests))
}

/// Tries every setting on this port until the unit answers, and returns this setting. `None` if the unit
/// answers with none of the settings. `usual` states the frame format. The function writes to no register.
pub(super) fn find(port: &str, usual: SerialSettings, unit: u8) -> Result<Option<SerialSettings>, String> {
    let runtime = crate::cli::runtime::start().map_err(|error| error.to_string())?;
    for baud in BAUDS {
        for parity in PARITIES {
            let settings = usual.tried(baud, parity);
            let line = settings.address(port)?;
            let transport = line.transport;
            let scan = Scan {
                bus: line.bus(TIMEOUT),
                lines: vec![line],
                quirks: Quirks::default(),
                units: unit..=unit,
                registers: REGISTERS.to_vec(),
                trace: None,
            };
            let mut answers = false;
            let note = |event: Event| {
                if let Event::Found(_, found) = event {
                    answers |= !matches!(found.how, AnswerKind::Garbled(_));
                }
            };
            if let Err(failed) = runtime.block_on(scan.run(note)) {
                return Err(explain_on(transport, failed.fault).to_string());
            }
            if answers {
                return Ok(Some(settings));
            }
        }
    }
    Ok(None)
}
