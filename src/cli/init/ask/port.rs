//! Questions of `isotherm init` about the settings of a serial port. The settings can be found by trying.

use crate::cli::init::answers::{self, Line};
use crate::cli::init::questions::{Question, Questions};
use crate::cli::init::serial_settings::{FindSettings, Frames, SerialSettings, extent};
use crate::discovery::bus::{Parity, baud};
use isotherm_profile::duration_text;

/// Questions for baud rate, parity and data bits of a serial port.
pub(super) struct PortQuestions<'a> {
    /// Unit number of the device on the port.
    pub(super) unit: u8,
    /// Whether the device sends text. No settings are tried for such a device.
    pub(super) sends_text: bool,
    /// Names of the options for baud rate, parity and data bits.
    pub(super) options: [&'static str; 3],
    /// Values of these options; `None` for an option that is not used.
    pub(super) given: [Option<&'a str>; 3],
}

impl PortQuestions<'_> {
    /// Returns the line with the settings of its serial port. Returns a line without a serial port as it is.
    /// If no option has a value and the user agrees, the settings are found by trying. The user is then asked
    /// for each setting, with the found value as default.
    pub(super) fn ask(
        &self,
        line: Line,
        find: FindSettings<'_>,
        questions: &mut Questions<'_>,
    ) -> anyhow::Result<Line> {
        let (port, mut usual) = match line {
            Line::Serial(port, usual) => (port, usual),
            other @ (Line::Tcp(_) | Line::AsciiOverTcp(_) | Line::OpcUa(_)) => return Ok(other),
        };
        let (options, given) = (self.options, self.given);
        if given.iter().all(Option::is_none) && !self.sends_text {
            usual = self.tried(&port, usual, find, questions)?.unwrap_or(usual);
        }
        let baud = questions.ask(
            Question {
                option: options[0],
                text: &format!("Baud rate of {port}"),
                usual: Some(&usual.baud.to_string()),
                help: "The setting of the devices on this line; their manual or their switches show it.",
            },
            given[0],
            baud,
        )?;
        let parity = questions.ask(
            Question {
                option: options[1],
                text: &format!("Parity of {port}"),
                usual: Some(usual.parity.word()),
                help: "none, even or odd: the setting of the devices on this line.",
            },
            given[1],
            str::parse::<Parity>,
        )?;
        let frames = match usual.frames {
            Frames::Rtu => Frames::Rtu,
            Frames::Ascii { data_bits } => Frames::Ascii {
                data_bits: questions.ask(
                    Question {
                        option: options[2],
                        text: &format!("Data bits of {port}"),
                        usual: Some(&data_bits.to_string()),
                        help: "7 or 8: the setting of the devices on this line.",
                    },
                    given[2],
                    answers::data_bits,
                )?,
            },
        };
        Ok(Line::Serial(port, SerialSettings { baud, parity, frames }))
    }

    /// Finds the settings of a serial port by trying, if the user agrees. Returns the settings with which the
    /// unit answers; `None` if the user does not agree, or if no settings were found.
    fn tried(
        &self,
        port: &str,
        usual: SerialSettings,
        find: FindSettings<'_>,
        questions: &mut Questions<'_>,
    ) -> anyhow::Result<Option<SerialSettings>> {
        let (unit, (count, longest)) = (self.unit, extent());
        let agreed = questions.agrees(
            &format!("Find baud rate and parity of {port} by trying? Only reads, at most {}", duration_text(longest)),
            &format!(
                "Unit {unit} gets two reads with each of {count} settings. Other devices on the line see bytes that they \
                 ignore. Answer no if another program or master uses the line."
            ),
        )?;
        if !agreed {
            return Ok(None);
        }
        let found = find(port, usual, unit);
        questions.show(&match &found {
            Ok(Some(SerialSettings { baud, parity, .. })) => {
                format!("  unit {unit} answers at {baud} baud, parity {}", parity.word())
            }
            Ok(None) => {
                let other = match usual.frames {
                    Frames::Rtu => format!("Modbus ASCII, as modbus-ascii://{port}"),
                    Frames::Ascii { .. } => format!("Modbus RTU, as {port}"),
                };
                format!(
                    "  unit {unit} does not answer with any setting: check its number, power and wires A and \
                     B, or begin again with {other}"
                )
            }
            Err(why) => format!("  {why}"),
        })?;
        Ok(found.unwrap_or_default())
    }
}
