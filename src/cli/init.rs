//! `isotherm init`: writes a first profile from a few answers.

use std::io::{BufRead, Write};
use std::path::PathBuf;

use super::new_file;
use super::print::{Out, say, say_beside};
use isotherm_profile::template::{Outline, on_modbus};

mod answers;
mod questions;
#[cfg(test)]
mod tests;
mod text;

use answers::{Answers, Line, Module, Target};
use questions::Questions;

/// Asks for machine, bus, thermocouple module, axis and output. From the answers it writes a profile with comments,
/// which `check` accepts.
///
/// The verb does not ask for values that are given as options. The coefficients of the axis are found later, by
/// `isotherm record` and `isotherm identify`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm init\n  isotherm init press-7.toml --yes --machine press-7 --bus 192.168.0.10:502 --module \
                  icp-das-m7018 --signals bed,column --output plc-block --control 192.168.0.20:502"
)]
pub(super) struct Arguments {
    /// The profile to write [default: <machine>.toml]
    #[arg(value_name = "PROFILE.toml")]
    file: Option<PathBuf>,
    /// The machine's name, in file names and on the gateway's web page
    #[arg(long, value_name = "NAME")]
    machine: Option<String>,
    /// Address of the thermocouple module: 192.168.0.10:502, or a serial port: /dev/ttyUSB0
    #[arg(long, value_name = "ADDRESS|PORT")]
    bus: Option<String>,
    /// The module's device template, or `none` to write its registers in the profile
    #[arg(long, value_name = "TEMPLATE")]
    module: Option<String>,
    /// The variant of the module's template, for example the type of thermocouple
    #[arg(long, value_name = "VARIANT")]
    variant: Option<String>,
    /// The unit number of the module
    #[arg(long, value_name = "N")]
    unit: Option<String>,
    /// Names of the measured temperatures, in the order of the module's channels
    #[arg(long, value_name = "NAMES")]
    signals: Option<String>,
    /// The axis to compensate
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    /// Limit of Cz: its largest permitted absolute value, µm
    #[arg(long, value_name = "UM")]
    limit: Option<String>,
    /// Destination of Cz: the control's device template, or a register, for example holding:104
    #[arg(long, value_name = "TEMPLATE|REGISTER")]
    output: Option<String>,
    /// Address of the control, if it is on another line than the module
    #[arg(long, value_name = "ADDRESS|PORT")]
    control: Option<String>,
    /// The unit number of the control
    #[arg(long, value_name = "N")]
    control_unit: Option<String>,
    /// Asks no questions: values that are not given as options get their defaults
    #[arg(long, short)]
    yes: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(file) = arguments.file.as_deref().filter(|file| file.exists()) {
        anyhow::bail!("{} exists already and is not overwritten: name another file", file.display());
    }
    let answers = ask(arguments, &mut std::io::stdin().lock(), &mut Out)?;
    let file = arguments.file.clone().unwrap_or_else(|| format!("{}.toml", answers.machine).into());
    let text = text::profile(&answers);
    isotherm_profile::parse(&file, &text, &[], &[]).map_err(|errors| {
        anyhow::anyhow!(
            "{errors}\nthe profile is not written, because with these answers it would have errors"
        )
    })?;
    new_file::create(&file, &text)?;
    let shown = file.display();
    say!("{shown} is written. Next:")?;
    for (verb, what) in [
        ("check", "shows what the profile means, and what would be read and written"),
        ("check --online", "also reads from every device, and writes nothing"),
        ("record --out day-1.csv", "records a day; measure the error at the same time"),
        (
            "identify day-1.csv day-2.csv",
            "finds the coefficients; replace the model in comments by its output",
        ),
    ] {
        let (verb, more) = verb.split_once(' ').unwrap_or((verb, ""));
        let command = format!("isotherm {verb} {shown} {more}");
        say!("  {:<56} {what}", command.trim_end())?;
    }
    Ok(())
}

fn ask(arguments: &Arguments, input: &mut dyn BufRead, out: &mut dyn Write) -> anyhow::Result<Answers> {
    let mut questions = Questions { input, out, takes_defaults: arguments.yes };
    let given = |option: &Option<String>| option.clone();
    let machine = questions.ask(
        "machine",
        given(&arguments.machine),
        ("The machine's name", "my-machine"),
        answers::machine,
    )?;
    let where_ = "The thermocouple module's address (192.168.0.10:502) or serial port (/dev/ttyUSB0)";
    let line = questions.ask("bus", given(&arguments.bus), (where_, "192.168.0.10:502"), Line::parse)?;
    if arguments.module.is_none() && !arguments.yes {
        questions.show("Known modules, by their templates:")?;
        for outline in answers::modules() {
            questions.show(&format!("  {:<26} {}", outline.name, outline.title))?;
        }
    }
    let what = "The module's template, or none";
    let module = questions.ask("module", given(&arguments.module), (what, "none"), Module::parse)?;
    let variant = variant(&mut questions, module.outline(), given(&arguments.variant))?;
    let unit = questions.ask("unit", given(&arguments.unit), ("The module's unit", "1"), answers::unit)?;
    let most = module.channels();
    let what = format!("Names of the measured temperatures, in the order of the channels, at most {most}");
    let names = |text: &str| answers::signals(text, most);
    let signals = questions.ask("signals", given(&arguments.signals), (&what, "bed,column"), names)?;
    let axis =
        questions.ask("axis", given(&arguments.axis), ("The axis to compensate", "z"), answers::name)?;
    let most = "Largest absolute value of its Cz, µm";
    let limit = questions.ask("limit", given(&arguments.limit), (most, "40"), answers::limit)?;
    if arguments.output.is_none() && !arguments.yes {
        questions.show(
            "Known controls, by their templates; for any other control, give a register, for example \
             holding:104:",
        )?;
        for outline in on_modbus().filter(|outline| !outline.targets.is_empty()) {
            questions.show(&format!(
                "  {:<26} {} ({})",
                outline.name,
                outline.title,
                outline.targets.join(", ")
            ))?;
        }
    }
    let target = |text: &str| Target::parse(text, &axis);
    let what = "Destination of Cz: the control's template, or a register";
    let target = questions.ask("output", given(&arguments.output), (what, "holding:104"), target)?;
    let what = "The control's address or serial port, or `same` for the module's line";
    let (sends_text, usual) = if module.sends_text() { (true, "192.168.0.20:502") } else { (false, "same") };
    let other_line = |text: &str| match text {
        "same" if sends_text => {
            Err("the module sends text, so the control needs another line: write 192.168.0.20:502, or \
                 /dev/ttyUSB1"
                .to_owned())
        }
        "same" => Ok(None),
        address => Line::parse(address).map(Some),
    };
    let control = questions.ask("control", given(&arguments.control), (what, usual), other_line)?;
    let other = if control.is_none() && unit == 1 { "2" } else { "1" };
    let control_unit = questions.ask(
        "control-unit",
        given(&arguments.control_unit),
        ("The control's unit", other),
        answers::unit,
    )?;
    if control.is_none() && control_unit == unit {
        say_beside!(
            "module and control are both unit {unit} of one line: this works only if they are one device"
        );
    }
    Ok(Answers { machine, line, module, variant, unit, signals, axis, limit, target, control, control_unit })
}

fn variant(
    questions: &mut Questions<'_>,
    outline: Option<&Outline>,
    given: Option<String>,
) -> anyhow::Result<Option<String>> {
    let Some(outline) = outline.filter(|outline| !outline.variants.is_empty()) else { return Ok(None) };
    let variants = &outline.variants;
    let usual = variants.iter().find(|variant| *variant == "K").or_else(|| variants.first());
    let what = format!("The template's variant: {}", variants.join(", "));
    let known = |text: &str| {
        let found = variants.iter().find(|variant| variant.eq_ignore_ascii_case(text));
        found.cloned().ok_or_else(|| isotherm_profile::allowed(text, variants.iter().map(String::as_str)))
    };
    let usual = usual.map(String::as_str).unwrap_or_default();
    questions.ask("variant", given, (&what, usual), known).map(Some)
}
