//! Questions of `isotherm init` in their order, from the name of the machine to the signal that shows that the machine
//! is on.

use super::Arguments;
use super::answers::{
    self, Answers, ControlTemplate, Destination, Line, MachineOn, Module, ModuleTemplate, Target,
};
use super::opcua;
use super::questions::{Question, Questions, yes_or_no};
use super::serial_settings::FindSettings;
use super::value_form::{self, ValueForm};
use crate::discovery::{DataType, Register, Table};
use isotherm_profile::template::{Outline, OutlineTarget};
use isotherm_profile::{Bits, Cell};
use port::PortQuestions;

mod nodes;
mod port;

/// Maximum number of temperatures of a module without a template.
const MOST_SIGNALS: usize = 32;

/// Asks all questions that no option answers. `known` are the templates, and `find` tries the settings of a serial port.
pub(super) fn ask(
    arguments: &Arguments,
    known: &[Outline],
    find: FindSettings<'_>,
    questions: &mut Questions<'_>,
) -> anyhow::Result<Answers> {
    let mut asking = Asking { arguments, find, questions };
    if !arguments.yes {
        asking.questions.show("Enter takes the answer in brackets; ? explains a question.")?;
    }
    let machine = asking.text(
        ("machine", "The machine's name", Some("my-machine")),
        "The name becomes part of file names: lower-case letters, digits and hyphens.",
        arguments.machine.as_deref(),
        answers::machine,
    )?;
    let line = asking.text(
        ("bus", "Address or serial port of the temperature module", Some("192.168.0.10:502")),
        "On a network: address and port, such as 192.168.0.10:502. On a serial line: a port such as /dev/ttyUSB0; a name \
         below /dev/serial/by-id stays the same after a restart. For Modbus ASCII: modbus-ascii:///dev/ttyUSB0, or \
         modbus-ascii+tcp://192.168.0.10:4001 through a serial server. For OPC UA: opc.tcp://192.168.0.10:4840.",
        arguments.bus.as_deref(),
        Line::parse,
    )?;
    let (line, unit, module, signals) = match line {
        Line::OpcUa(_) => {
            let signals = asking.signals(MOST_SIGNALS)?;
            let module = asking.nodes(&signals)?;
            (line, None, module, signals)
        }
        _ => {
            let (line, unit, module) = asking.registers(line, known)?;
            let most = module.template().map_or(MOST_SIGNALS, |template| template.outline.temperatures.len());
            (line, Some(unit), module, asking.signals(most)?)
        }
    };
    let axis = asking.text(
        ("axis", "The axis to compensate", Some("z")),
        "The axis as the control names it. Further axes are added to the profile later.",
        arguments.axis.as_deref(),
        answers::name,
    )?;
    let diameter = asking.diameter(&axis)?;
    let limit = asking.text(
        ("limit", "Largest absolute value of Cz of the axis, µm", Some("10")),
        "Cz is what is added to the position. Keep the limit small until the sign is checked with a gauge.",
        arguments.limit.as_deref(),
        answers::limit,
    )?;
    let (target, bits) = asking.target(known, &axis)?;
    let (control, control_unit, machine_on) = match target {
        Target::Node(..) => (asking.server(&line)?, None, asking.machine_on_node()?),
        Target::Template(_) | Target::Register(..) => {
            let has_registers = unit.is_some() && !module.sends_text();
            let (control, unit) = asking.control(&line, has_registers, unit)?;
            (control, Some(unit), asking.machine_on(&bits)?)
        }
    };
    Ok(Answers {
        machine,
        line,
        module,
        unit,
        signals,
        axis,
        diameter,
        limit,
        target,
        control,
        control_unit,
        machine_on,
    })
}

/// Options of the command line, and questions for the values that no option gives.
struct Asking<'a, 'q> {
    arguments: &'a Arguments,
    find: FindSettings<'a>,
    questions: &'a mut Questions<'q>,
}

impl Asking<'_, '_> {
    fn text<T>(
        &mut self,
        (option, text, usual): (&'static str, &str, Option<&str>),
        help: &str,
        given: Option<&str>,
        understand: impl Fn(&str) -> Result<T, String>,
    ) -> anyhow::Result<T> {
        self.questions.ask(Question { option, text, usual, help }, given, understand)
    }

    fn unit(
        &mut self,
        question: (&'static str, &str, Option<&str>),
        help: &str,
        given: Option<&str>,
        line: &Line,
    ) -> anyhow::Result<u8> {
        self.text(question, help, given, |text| answers::unit(text, line))
    }

    /// Asks for template, unit and line settings of a module with registers or text.
    fn registers(&mut self, line: Line, known: &[Outline]) -> anyhow::Result<(Line, u8, Module)> {
        let (outline, variant, base) = self.module(known)?;
        let unit = self.unit(
            ("unit", "Unit number of the module", Some("1")),
            "The Modbus unit, often set by switches on the module; `isotherm scan` finds it.",
            self.arguments.unit.as_deref(),
            &line,
        )?;
        let sends_text = outline.as_ref().is_some_and(|outline| outline.sends_text);
        let given = [&self.arguments.baud, &self.arguments.parity, &self.arguments.data_bits];
        let options = ["baud", "parity", "data-bits"];
        let given = given.map(Option::as_deref);
        let port = PortQuestions { unit, sends_text, options, given };
        let line = port.ask(line, self.find, self.questions)?;
        let module = self.channels(outline, variant, base)?;
        Ok((line, unit, module))
    }

    fn signals(&mut self, most: usize) -> anyhow::Result<Vec<String>> {
        self.text(
            (
                "signals",
                &format!("Names of the temperatures, in the order of the channels, at most {most}"),
                Some(if most > 1 { "bed,column" } else { "bed" }),
            ),
            "A name for each sensor that is connected, such as bed,column,spindle, from the first channel on. Letters, \
             digits and underscores.",
            self.arguments.signals.as_deref(),
            |text| answers::signals(text, most),
        )
    }

    /// Asks for the template of the module, its variant and its first register. All three are `None` for a
    /// module without a template. The variant or the first register is `None` if the template does not need
    /// it.
    fn module(
        &mut self,
        known: &[Outline],
    ) -> anyhow::Result<(Option<Outline>, Option<String>, Option<u16>)> {
        let modules: Vec<Outline> =
            known.iter().filter(|outline| !outline.temperatures.is_empty()).cloned().collect();
        if self.arguments.module.is_none() && !self.arguments.yes {
            self.questions.show("Known modules, by their templates:")?;
            for Outline { name, title, .. } in &modules {
                self.questions.show(&format!("  {name:<26} {title}"))?;
            }
        }
        let outline = self.text(
            ("module", "Template of the module, or none", Some("none")),
            "A template knows the registers of a module. Without a template, isotherm asks for the registers. \
             Templates of your own are files devices/NAME.toml next to the profile.",
            self.arguments.module.as_deref(),
            |text| answers::module(text, &modules),
        )?;
        let Some(outline) = outline else { return Ok((None, None, None)) };
        let variant = self.variant(&outline)?;
        let base = match outline.is_movable {
            true => Some(self.text(
                ("base", "First register of the module", Some("0")),
                "Register of the module's first channel at the coupler: it begins where the registers of the other modules end.",
                self.arguments.base.as_deref(),
                answers::base,
            )?),
            false => None,
        };
        Ok((Some(outline), variant, base))
    }

    fn variant(&mut self, outline: &Outline) -> anyhow::Result<Option<String>> {
        let variants = &outline.variants;
        let Some(first) = variants.first() else { return Ok(None) };
        let usual = variants.iter().find(|variant| *variant == "K").unwrap_or(first);
        let known = |text: &str| {
            let found = variants.iter().find(|variant| variant.eq_ignore_ascii_case(text));
            let words = variants.iter().map(String::as_str);
            found.cloned().ok_or_else(|| isotherm_profile::allowed(text, words))
        };
        let text = format!("Variant of the module: {}", variants.join(", "));
        let help = "The setting of the module, for example the type of its thermocouples.";
        self.text(("variant", &text, Some(usual)), help, self.arguments.variant.as_deref(), known).map(Some)
    }

    /// Returns the module with type, word order and scale of its temperatures: from its template, or from the answers.
    fn channels(
        &mut self,
        outline: Option<Outline>,
        variant: Option<String>,
        base: Option<u16>,
    ) -> anyhow::Result<Module> {
        let Some(outline) = outline else {
            let register = self.text(
                ("register", "Register of the first temperature", Some("input:0")),
                "Zero-based as input:0 or holding:0, or one-based as 30001 or 40001. holding:12.4-7 is a part of a \
                 register, bits 4 to 7. The registers of the other temperatures follow.",
                self.arguments.register.as_deref(),
                answers::first_register,
            )?;
            let unknown = OutlineTarget {
                name: String::new(),
                data_type: Some(DataType::I16.name().to_owned()),
                word_order: None,
                scale: Some(0.1),
            };
            let given = [&self.arguments.data_type, &self.arguments.word_order, &self.arguments.scale];
            let given = given.map(|given| given.as_deref());
            let form = self.form(&OF_TEMPERATURE, (&unknown, Some(register)), given)?;
            return Ok(Module::SpelledOut(register, form));
        };
        let mut keys = Vec::new();
        for (key, why) in outline.asks.clone() {
            let value = match key.as_str() {
                "word_order" => self
                    .text(
                        ("word-order", "Word order of the temperatures", Some("msw-first")),
                        &format!("msw-first or lsw-first: {why}"),
                        self.arguments.word_order.as_deref(),
                        value_form::word_order,
                    )
                    .map(|order| format!("\"{order}\""))?,
                "scale" => self
                    .text(
                        ("scale", "Degrees Celsius per count", Some("0.1")),
                        &why,
                        self.arguments.scale.as_deref(),
                        value_form::scale,
                    )
                    .map(|scale| format!("{scale:?}"))?,
                _ => continue,
            };
            keys.push((key, value));
        }
        Ok(Module::Template(Box::new(ModuleTemplate { outline, variant, base, keys })))
    }

    /// Asks for type, word order and scale of a value. `known` contains the default answers (Enter key). `first` is the
    /// first register; `None` if a template knows it. `given` are the options.
    fn form(
        &mut self,
        questions: &FormQuestions,
        (known, first): (&OutlineTarget, Option<Cell>),
        [data_type, word_order, scale]: [Option<&str>; 3],
    ) -> anyhow::Result<ValueForm> {
        let FormQuestions { options, texts, scale_help, parse_scale } = questions;
        let data_type = self.text(
            (options[0], texts[0], known.data_type.as_deref()),
            "i16, u16, i32, u32 or f32: see the manual of the device, or ask the PLC programmer. i16 and i32 \
             have a sign, also for a part of a register.",
            data_type,
            |text| value_form::data_type(text, first),
        )?;
        let word_order = match data_type.registers() > 1 {
            true => Some(self.text(
                (options[1], texts[1], known.word_order.as_deref()),
                "msw-first: the most significant register comes first. lsw-first: the least significant one.",
                word_order,
                value_form::word_order,
            )?),
            false => None,
        };
        let usual = known.scale.map(|scale| scale.to_string());
        let (scale, scale_from) =
            self.text((options[2], texts[2], usual.as_deref()), scale_help, scale, |text| {
                parse_scale(text, first)
            })?;
        Ok(ValueForm { data_type, word_order, scale, scale_from })
    }

    /// Asks whether the position of an axis is a diameter, if the axis has a name that lathes use for it.
    fn diameter(&mut self, axis: &str) -> anyhow::Result<bool> {
        let given = self.arguments.diameter.as_deref();
        if given.is_none() && !axis.to_ascii_lowercase().starts_with(['x', 'u']) {
            return Ok(false);
        }
        self.text(
            (
                "diameter",
                &format!("Does the control show {axis} as a diameter, as a lathe does? yes or no"),
                None,
            ),
            "yes: twice Cz is written, because the diameter changes by twice as much as the radius.",
            given,
            yes_or_no,
        )
    }

    /// Asks for the destination of Cz, and for type, word order and scale of the offset. Also returns the bits of the
    /// control's template.
    fn target(&mut self, known: &[Outline], axis: &str) -> anyhow::Result<(Target, Vec<String>)> {
        let controls: Vec<Outline> = known
            .iter()
            .filter(|outline| !outline.targets.is_empty() && !outline.sends_text)
            .cloned()
            .collect();
        if self.arguments.output.is_none() && !self.arguments.yes {
            self.questions.show(
                "Known controls, by their templates; for any other control, give its register or node:",
            )?;
            for Outline { name, title, targets, .. } in &controls {
                let targets: Vec<&str> = targets.iter().map(|target| target.name.as_str()).collect();
                self.questions.show(&format!("  {name:<26} {title} ({})", targets.join(", ")))?;
            }
        }
        let destination = self.text(
            ("output", "Destination of Cz: template of the control, or its register, or its node", None),
            "A register of the control, zero-based as holding:104 or one-based as 40105. The control adds its value to the \
             position. For an OPC UA server, write a node, as ns=2;s=Offset.Z or nsu=http://plc.example;s=Offset.Z. \
             `isotherm read --bus opc.tcp://192.168.0.20:4840 --browse` shows the nodes.",
            self.arguments.output.as_deref(),
            |text| answers::destination(text, &controls),
        )?;
        let given = [
            self.arguments.output_type.as_deref(),
            self.arguments.output_word_order.as_deref(),
            self.arguments.output_scale.as_deref(),
        ];
        let outline = match destination {
            Destination::Register(register) => {
                let address = Register { table: Table::Holding, offset: register };
                let first = Some(Cell { address, bits: Bits::All });
                let form = self.form(&OF_OFFSET, (&NOTHING_KNOWN, first), given)?;
                return Ok((Target::Register(register, form), Vec::new()));
            }
            Destination::Node(node) => return Ok((Target::Node(node, self.node_form()?), Vec::new())),
            Destination::Template(outline) => outline,
        };
        let target = self.target_of(&outline, axis)?;
        let base = match outline.is_movable {
            true => Some(self.text(
                ("control-base", "First register of the control's block", None),
                "The first register of the block, as the machine builder or the PLC programmer has defined it: 0, 100, \
                 or 40101.",
                self.arguments.control_base.as_deref(),
                answers::base,
            )?),
            false => None,
        };
        let form = self.form(&OF_OFFSET, (&target, None), given)?;
        let bits = outline.bits.clone();
        let keys = changed_keys(&target, form);
        let target = target.name;
        Ok((Target::Template(Box::new(ControlTemplate { outline, target, base, keys })), bits))
    }

    /// Returns the target of the template that has the name of the axis, or the only target. Otherwise asks for a
    /// target, because a wrong target moves another axis.
    fn target_of(&mut self, outline: &Outline, axis: &str) -> anyhow::Result<OutlineTarget> {
        let targets = &outline.targets;
        let named =
            |name: &str| targets.iter().find(|target| target.name.eq_ignore_ascii_case(name)).cloned();
        let given = self.arguments.output_target.as_deref();
        let only = if let [only] = targets.as_slice() { Some(only.clone()) } else { None };
        if given.is_none()
            && let Some(found) = named(axis).or(only)
        {
            return Ok(found);
        }
        let names = || targets.iter().map(|target| target.name.as_str());
        let listed = names().collect::<Vec<_>>().join(", ");
        self.text(
            ("output-target", &format!("Target of the template for axis {axis}: {listed}"), None),
            "The template has a register for each of these axes. A wrong register moves another axis.",
            given,
            |text| named(text).ok_or_else(|| isotherm_profile::allowed(text, names())),
        )
    }

    /// Asks for the line and the unit of the control. The line is `None` if the control is on the line of the module.
    /// The module must then have registers.
    fn control(
        &mut self,
        module: &Line,
        has_registers: bool,
        module_unit: Option<u8>,
    ) -> anyhow::Result<(Option<Line>, u8)> {
        let usual = if has_registers { "same" } else { "192.168.0.20:502" };
        let other_line = |text: &str| {
            if let Some(place) = opcua::place(text) {
                return Err(opcua::has_no_registers(place));
            }
            let line = if text == "same" { None } else { Some(Line::parse(text)?) };
            // A line has one bus, also if its address is written a second time.
            match line {
                Some(line) if !line.is_same(module) => Ok(Some(line)),
                _ if !has_registers => Err(
                    "the module has no registers, so the control needs another line: write 192.168.0.20:502, or \
                         /dev/ttyUSB1"
                        .to_owned(),
                ),
                Some(line) if line.is_ascii() != module.is_ascii() => Err(format!(
                    "{text} is the line of the module, which has another frame format: write same, or the \
                     address of another line"
                )),
                _ => Ok(None),
            }
        };
        let control = self.text(
            ("control", "Address or serial port of the control, or same for the module's line", Some(usual)),
            "Address and port, such as 192.168.0.20:502, or a serial port. Write same if module and control \
             are on one line.",
            self.arguments.control.as_deref(),
            other_line,
        )?;
        // On the line of the module, another unit may be another drive.
        let usual = control.is_some().then_some("1");
        let unit = self.unit(
            ("control-unit", "Unit number of the control", usual),
            "The Modbus unit of the control; over a network it is often 1. Another unit of the line may move another \
             axis.",
            self.arguments.control_unit.as_deref(),
            control.as_ref().unwrap_or(module),
        )?;
        let Some(line) = control else {
            if Some(unit) == module_unit {
                self.questions.show(&format!(
                    "module and control are both unit {unit} of one line: this works only if they are one device"
                ))?;
            }
            return Ok((None, unit));
        };
        let Arguments { control_baud, control_parity, control_data_bits, .. } = self.arguments;
        let given = [control_baud, control_parity, control_data_bits].map(Option::as_deref);
        let options = ["control-baud", "control-parity", "control-data-bits"];
        let port = PortQuestions { unit, sends_text: false, options, given };
        let line = port.ask(line, self.find, self.questions)?;
        Ok((Some(line), unit))
    }

    /// Asks for the signal that is set while the machine is on. `bits` are the bits of the control's template.
    fn machine_on(&mut self, bits: &[String]) -> anyhow::Result<MachineOn> {
        let usual = bits.iter().find(|bit| *bit == "on").map_or("none", String::as_str);
        let examples = if bits.is_empty() { String::new() } else { format!("{}, ", bits.join(", ")) };
        self.text(
            ("machine-on", "Bit of the control that is 1 while the machine is on, or none", Some(usual)),
            &format!(
                "Models often use temperature rises since the machine start. Without this bit, the reference \
                 temperature is never captured again after the first run. Write {examples}discrete:0, coil:0, \
                 holding:16.3 or none."
            ),
            self.arguments.machine_on.as_deref(),
            |text| answers::machine_on(text, bits),
        )
    }
}

/// Options and texts of the questions for the form of a value: type, word order and scale.
struct FormQuestions {
    options: [&'static str; 3],
    texts: [&'static str; 3],
    scale_help: &'static str,
    /// Parses the answer for the scale of a value with this first register: the scale, or the register that contains it.
    parse_scale: ParseScale,
}

type ParseScale = fn(&str, Option<Cell>) -> Result<(f64, Option<Cell>), String>;

const OF_TEMPERATURE: FormQuestions = FormQuestions {
    options: ["type", "word-order", "scale"],
    texts: ["Type of the temperatures", "Word order of the temperatures", "Degrees Celsius per count"],
    scale_help: "0.1 if the register shows 215 at 21.5 °C. If the device has the power of ten in a register, as \
                 SunSpec devices do, write that register: holding:12, or 40013.",
    parse_scale: value_form::scale_or_register,
};

const OF_OFFSET: FormQuestions = FormQuestions {
    options: ["output-type", "output-word-order", "output-scale"],
    texts: [
        "Type of the offset register",
        "Word order of the offset",
        "Micrometres per count of the offset, negative if the control subtracts it",
    ],
    scale_help: "0.1 if the control adds 1 µm for the value 10. A wrong scale moves the axis too far.",
    parse_scale: |text, _| Ok((value_form::scale(text)?, None)),
};

/// Target for a register without a template. Its type, word order and scale are unknown, so the user must answer each
/// question.
const NOTHING_KNOWN: OutlineTarget =
    OutlineTarget { name: String::new(), data_type: None, word_order: None, scale: None };

/// Returns the keys of an output that differ from the target of its template.
fn changed_keys(target: &OutlineTarget, form: ValueForm) -> Vec<(String, String)> {
    let mut keys = Vec::new();
    if target.data_type.as_deref() != Some(form.data_type.name()) {
        keys.push(("type".to_owned(), format!("\"{}\"", form.data_type.name())));
    }
    if let Some(order) = form.word_order.map(|order| order.to_string())
        && target.word_order.as_deref() != Some(order.as_str())
    {
        keys.push(("word_order".to_owned(), format!("\"{order}\"")));
    }
    if target.scale.is_none_or(|scale| (scale - form.scale).abs() > 0.0) {
        keys.push(("scale".to_owned(), format!("{:?}", form.scale)));
    }
    keys
}
