//! `isotherm init`: writes a first profile from a few answers, and reads every value once.

use std::path::{Path, PathBuf};

use super::hints::Hints;
use super::loading::load_with;
use super::print::{Out, say, say_all, say_beside};
use super::run::known_directory;
use super::{new_file, read_once};
use isotherm_profile::template::outlines;

mod answers;
mod ask;
mod opcua;
mod questions;
mod remedies;
mod serial_settings;
mod steps;
#[cfg(test)]
mod tests;
mod text;
mod value_form;

use answers::{Answers, Line};
use questions::Questions;

/// Asks for machine, bus, temperature module, axis and output. From the answers it writes a profile with comments,
/// which `check` accepts. Then it reads every value once, so that a wrong register is seen at once. It writes to no
/// device.
///
/// The verb does not ask for values that are given as options. Values that would move an axis if they were wrong have
/// no default: destination, type, word order and scale of the offset. The Modbus unit number of a control on the
/// module's line has no default either. The coefficients of the axis are found later, by `isotherm record` and
/// `isotherm identify`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm init\n  isotherm init press-7.toml --yes --machine press-7 --bus 192.168.0.10:502 --module \
                  icp-das-m7018 --signals bed,column --output plc-block --control-base 0 --control 192.168.0.20:502\n  isotherm init \
                  press-7.toml --yes --output 40105 --output-type i32 --output-word-order msw-first --output-scale 0.1 \
                  --control-unit 2"
)]
pub(super) struct Arguments {
    /// The profile to write [default: <machine>.toml]
    #[arg(value_name = "PROFILE.toml")]
    file: Option<PathBuf>,
    /// The machine's name, in file names and on the gateway's web page
    #[arg(long, value_name = "NAME")]
    machine: Option<String>,
    /// Address of the temperature module: 192.168.0.10:502, or a serial port: /dev/ttyUSB0. For Modbus ASCII:
    /// modbus-ascii:///dev/ttyUSB0, modbus-ascii+tcp://192.168.0.10:4001. For OPC UA: opc.tcp://192.168.0.10:4840
    #[arg(long, value_name = "ADDRESS|PORT")]
    bus: Option<String>,
    /// Baud rate of the module's serial line
    #[arg(long, value_name = "BAUD")]
    baud: Option<String>,
    /// Parity of the module's serial line: none, even, odd
    #[arg(long, value_name = "PARITY")]
    parity: Option<String>,
    /// Data bits of the module's line with Modbus ASCII: 7, 8
    #[arg(long, value_name = "BITS")]
    data_bits: Option<String>,
    /// The module's device template, or `none` to write its registers in the profile
    #[arg(long, value_name = "TEMPLATE")]
    module: Option<String>,
    /// The variant of the module's template, for example the type of thermocouple
    #[arg(long, value_name = "VARIANT")]
    variant: Option<String>,
    /// The first register of the module, if its template does not fix it
    #[arg(long, value_name = "N")]
    base: Option<String>,
    /// The Modbus unit number of the module
    #[arg(long, value_name = "N")]
    unit: Option<String>,
    /// Register of the first temperature of a module without a template: input:0, 30001, or a part: input:0.4-15
    #[arg(long, value_name = "REGISTER")]
    register: Option<String>,
    /// Type of the temperatures: i16, u16, i32, u32, f32
    #[arg(long = "type", value_name = "TYPE")]
    data_type: Option<String>,
    /// Word order of the temperatures: msw-first, lsw-first
    #[arg(long, value_name = "ORDER")]
    word_order: Option<String>,
    /// Degrees Celsius per count of the temperatures, or the register of the module with the power of ten: holding:12
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    scale: Option<String>,
    /// Node of a temperature at an OPC UA server: ns=2;s=Temps. Repeat this option for each name of --signals
    #[arg(long = "node", value_name = "NODE")]
    nodes: Vec<String>,
    /// Index in the array of a temperature's node, once for each name: 2, or 1,2, or none
    #[arg(long = "element", value_name = "INDEX")]
    elements: Vec<String>,
    /// Names of the measured temperatures, in the order of the module's channels
    #[arg(long, value_name = "NAMES")]
    signals: Option<String>,
    /// The axis to compensate
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    /// Whether the control shows the axis as a diameter, as X of a lathe: yes, no
    #[arg(long, value_name = "YES|NO")]
    diameter: Option<String>,
    /// Limit of Cz: its largest permitted absolute value, µm
    #[arg(long, value_name = "UM")]
    limit: Option<String>,
    /// Destination of Cz: the control's device template, or a register (holding:104, 40105), or a node of an OPC UA server
    /// (ns=2;s=Offset.Z)
    #[arg(long, value_name = "TEMPLATE|REGISTER|NODE")]
    output: Option<String>,
    /// Target of the control's template that receives Cz; needed if no target has the name of the axis
    #[arg(long, value_name = "TARGET")]
    output_target: Option<String>,
    /// Type of the offset: i16, u16, i32, u32, f32; of a node also i8, u8, i64, u64, f64
    #[arg(long, value_name = "TYPE")]
    output_type: Option<String>,
    /// Word order of the offset: msw-first, lsw-first
    #[arg(long, value_name = "ORDER")]
    output_word_order: Option<String>,
    /// Micrometres per count of the offset; negative if the control subtracts the offset
    #[arg(long, value_name = "UM", allow_hyphen_values = true)]
    output_scale: Option<String>,
    /// The first register of the control, if its template does not fix it
    #[arg(long, value_name = "N")]
    control_base: Option<String>,
    /// Address of the control, if it is on another line than the module. For OPC UA: opc.tcp://192.168.0.20:4840
    #[arg(long, value_name = "ADDRESS|PORT")]
    control: Option<String>,
    /// The Modbus unit number of the control
    #[arg(long, value_name = "N")]
    control_unit: Option<String>,
    /// Baud rate of the control's serial line
    #[arg(long, value_name = "BAUD")]
    control_baud: Option<String>,
    /// Parity of the control's serial line: none, even, odd
    #[arg(long, value_name = "PARITY")]
    control_parity: Option<String>,
    /// Data bits of the control's line with Modbus ASCII: 7, 8
    #[arg(long, value_name = "BITS")]
    control_data_bits: Option<String>,
    /// Bit of the control that is 1 while the machine is on: a channel of its template, discrete:0, holding:16.3, a node,
    /// or none
    #[arg(long, value_name = "BIT")]
    machine_on: Option<String>,
    /// Asks no questions and reads nothing: values that are not given as options get their defaults
    #[arg(long, short)]
    yes: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(file) = arguments.file.as_deref().filter(|file| file.exists()) {
        anyhow::bail!("{} exists already and is not overwritten: name another file", file.display());
    }
    let (mut input, mut out) = (std::io::stdin().lock(), Out);
    let mut questions = Questions::new(&mut input, &mut out, arguments.yes);
    let directory = arguments.file.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let answers = ask::ask(arguments, &outlines(directory), &serial_settings::find, &mut questions)?;
    let file = write(arguments.file.as_deref(), &answers, &mut questions)?;
    let shown = file.display().to_string();
    say!("{shown} is written.")?;
    let mut lines = std::iter::once(&answers.line).chain(&answers.control);
    if lines.any(|line| matches!(line, Line::OpcUa(_))) {
        say!("{}", opcua::UNSECURED)?;
    }
    let agreed = questions.agrees(
        "Read every value once now? Nothing is written to a device",
        "The gateway connects to module and control, and shows each temperature and the offset register.",
    )?;
    // The steps are shown also if the values cannot be read.
    if agreed && let Err(why) = show_values(&file, &shown) {
        say_beside!("{why:#}");
    }
    say_all!("{}", steps::after_init(&shown, &answers.axis))?;
    Ok(())
}

/// Writes the profile. If that fails, asks for another file, so that the answers are not lost. If the input ends, the
/// error contains the command that gives the same answers again.
fn write(file: Option<&Path>, answers: &Answers, questions: &mut Questions<'_>) -> anyhow::Result<PathBuf> {
    let text = text::profile(answers);
    let mut file = file.map_or_else(|| PathBuf::from(format!("{}.toml", answers.machine)), Path::to_owned);
    loop {
        let again = |file: &str, questions: &Questions<'_>| {
            format!("the same answers without questions:\n  {}", questions.command(file))
        };
        let parsed = isotherm_profile::parse_beside(&file, &text);
        if let Err(errors) = parsed {
            anyhow::bail!(
                "{errors}\nthe profile is not written, because with these answers it would have errors; {}",
                again(&file.display().to_string(), questions)
            );
        }
        let Err(why) = new_file::create(&file, &text) else { return Ok(file) };
        if questions.takes_defaults {
            return Err(why);
        }
        questions.show(&why.to_string())?;
        match questions.line("Another file for the profile: ")? {
            Some(other) if !other.trim().is_empty() => file = PathBuf::from(other.trim()),
            Some(_) => {}
            None => anyhow::bail!("{why}; {}", again("OTHER.toml", questions)),
        }
    }
}

/// Reads every signal and every offset register once, and prints the values.
fn show_values(file: &Path, shown: &str) -> anyhow::Result<()> {
    let profile = load_with(file, &[], false)?;
    let directory = known_directory(profile.history.directory.as_deref());
    let status = read_once::once(profile, directory)?;
    let mut hints = Hints::default();
    say_all!("{}", read_once::signals(&status, &mut hints))?;
    say_all!("{}", read_once::fieldbus(&status, &mut hints))?;
    if let Err(why) = read_once::assess(&status) {
        say_beside!("{why}");
        for remedy in remedies::remedies(&status.signals, shown) {
            say_beside!("{remedy}");
        }
        say_beside!("Then repeat: isotherm check {shown} --online");
    }
    Ok(())
}
