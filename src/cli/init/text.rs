//! Text of the first profile.

use std::fmt::Write;

use super::answers::{Answers, Line, Module, Target};

/// Returns the text of a profile with comments, which `check` accepts.
pub(super) fn profile(answers: &Answers) -> String {
    let mut text = String::new();
    // Writing to a string never fails.
    let _ = write_profile(&mut text, answers);
    text
}

fn write_profile(text: &mut String, answers: &Answers) -> std::fmt::Result {
    let Answers { machine, axis, limit, .. } = answers;
    writeln!(
        text,
        "# Written by `isotherm init`. `isotherm check` explains it; `isotherm schema` is the JSON Schema for an editor.\n\n\
         [machine]\nname   = \"{machine}\"\nsettle = \"3min\"                     # \"start\" references are the mean over this long\n\
         arm    = \"manual\"                   # nothing is written before `isotherm arm`; \"auto\" arms by itself\n"
    )?;
    match answers.module.sends_text() {
        true => line_of_text(text, "cell", &answers.line)?,
        false => line(text, "cell", &answers.line)?,
    }
    if let Some(control) = &answers.control {
        line(text, "control", control)?;
    }
    module(text, answers)?;
    let control_bus = if answers.control.is_some() { "control" } else { "cell" };
    writeln!(
        text,
        "[device.cnc]                         # the control\nbus   = \"{control_bus}\"\nunit  = {}\nevery = \"1s\"",
        answers.control_unit
    )?;
    if let Target::Template(outline, _) = &answers.target {
        writeln!(text, "template = \"{}\"", outline.name)?;
        if outline.is_movable {
            writeln!(text, "base  = 0                           # first register; ask the machine builder")?;
        }
    }
    let first = answers.signals.first().map(String::as_str).unwrap_or_default();
    writeln!(
        text,
        "\n[axis.{axis}]\nlimit    = {limit:?}                     # µm: |Cz| is never larger\n\
         step     = 1.0                      # µm: largest change of one update\n\
         rate     = 0.5                      # µm per second\ndeadband = 0.1                      # µm: smaller changes are not made\n\
         every    = \"10s\"                    # interval between updates\n\
         on_fault = {{ action = \"ramp\", after = \"60s\" }}\n\n\
         # The coefficients come from the machine: record a few days with `isotherm record`, and measure the error at the same time.\n\
         # Then replace these lines by the output of `isotherm identify`. Cz = -e; without a model nothing is compensated.\n\
         # [[axis.{axis}.model]]\n# name  = \"{first}\"\n# kind  = \"linear\"\n\
         # terms = [ {{ signal = \"{first}\", gain = -4.0, reference = \"start\" }} ]   # µm per °C\n"
    )?;
    output(text, answers)?;
    writeln!(
        text,
        "[web]\nlisten = \"127.0.0.1:8080\"            # the web page; commands need token_file \
         (isotherm token), other addresses also tls"
    )
}

fn line(text: &mut String, name: &str, line: &Line) -> std::fmt::Result {
    match line {
        Line::Tcp(address) => writeln!(
            text,
            "[bus.{name}]\ntype    = \"modbus-tcp\"\naddress = \"{address}\"\n\
             timeout = \"300ms\"                   # shorter than every `every` below\n"
        ),
        Line::Serial(port) => writeln!(
            text,
            "[bus.{name}]\ntype    = \"modbus-rtu\"\nport    = \"{port}\"             # a name below /dev/serial/by-id stays the same\n\
             baud    = 9600                      # the setting of the devices\nparity  = \"none\"\nstop_bits = 1\n\
             timeout = \"300ms\"                   # shorter than every `every` below\n"
        ),
    }
}

/// Writes the line of a module that sends text.
fn line_of_text(text: &mut String, name: &str, line: &Line) -> std::fmt::Result {
    match line {
        Line::Tcp(address) => writeln!(
            text,
            "[bus.{name}]                           # lines of text through a serial server\ntype    = \"serial-ascii\"\n\
             address = \"{address}\"\ntimeout = \"300ms\"                   # shorter than every `every` below\n"
        ),
        Line::Serial(port) => writeln!(
            text,
            "[bus.{name}]                           # lines of text\ntype    = \"serial-ascii\"\n\
             port    = \"{port}\"             # a name below /dev/serial/by-id stays the same\n\
             baud    = 9600                      # the setting of the module\ndata_bits = 8\nparity  = \"none\"\n\
             stop_bits = 1\ntimeout = \"300ms\"                   # shorter than every `every` below\n"
        ),
    }
}

fn module(text: &mut String, answers: &Answers) -> std::fmt::Result {
    writeln!(
        text,
        "[device.module]                      # the thermocouple module\nbus   = \"cell\"\nunit  = {}\nevery = \"1s\"                        # how \
         often it is read",
        answers.unit
    )?;
    if let Module::Template(outline) = &answers.module {
        writeln!(text, "template = \"{}\"   # {}", outline.name, outline.title)?;
        if let Some(variant) = &answers.variant {
            writeln!(text, "variant = \"{variant}\"")?;
        }
        if outline.is_movable {
            writeln!(
                text,
                "base  = 0                           # first register; it depends on the node's modules"
            )?;
        }
    }
    for (place, signal) in answers.signals.iter().enumerate() {
        writeln!(text, "\n[signal.{signal}]\ndevice   = \"module\"")?;
        match answers.module.outline().and_then(|outline| outline.temperatures.get(place)) {
            Some(channel) => {
                writeln!(text, "channel  = {channel}")?;
                for (key, why) in answers.module.outline().into_iter().flat_map(|outline| &outline.asks) {
                    let guess = if key == "word_order" { "\"msw-first\"" } else { "0.1" };
                    writeln!(text, "{key:<8} = {guess}   # A GUESS, to be tried: {why}")?;
                }
            }
            None => writeln!(
                text,
                "register = \"input:{place}\"                # zero-based; \"3{:04}\" means the same\ntype     = \"i16\"\n\
                 scale    = 0.1                      # °C per count\nbad      = [-32768, 32767]           # values that mean a broken wire",
                place + 1
            )?,
        }
        writeln!(
            text,
            "unit     = \"degC\"\nrange    = [-10.0, 80.0]             # readings outside are rejected\nmax_age  = \"5s\""
        )?;
    }
    writeln!(text)
}

fn output(text: &mut String, answers: &Answers) -> std::fmt::Result {
    let axis = &answers.axis;
    writeln!(
        text,
        "[output.cnc_{axis}]                       # writes Cz to the control\naxis     = \"{axis}\"\ndevice   = \"cnc\""
    )?;
    match &answers.target {
        Target::Template(_, target) => writeln!(text, "channel  = \"{target}\"")?,
        Target::Register(register) => writeln!(
            text,
            "writes   = \"offset\"\nregister = \"holding:{register}\"\ntype     = \"i32\"\nword_order = \"msw-first\"             # 32 bits have no \
             default order\nscale    = 0.1                      # µm per count; negative if the control subtracts it"
        )?,
    }
    writeln!(text, "verify   = \"read-back\"\n")?;
    match &answers.target {
        Target::Template(outline, _) if outline.has_heartbeat => writeln!(
            text,
            "[heartbeat]                          # without it, the control detects a failed gateway\ndevice = \"cnc\"\nevery  = \"500ms\"\n"
        ),
        _ => Ok(()),
    }
}
