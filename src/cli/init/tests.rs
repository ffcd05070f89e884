use std::path::Path;

use super::answers::{ControlTemplate, Line, MachineOn, Module, ModuleTemplate, Target};
use super::serial_settings::{Frames, SerialSettings};
use super::*;
use crate::clock::Clock;
use crate::discovery::bus::Parity;
use crate::virtual_machine::{Ports, Setup, UnknownUnit, VirtualMachine};
use isotherm_profile::template::Outline;
use isotherm_profile::{Writes, preview};

mod nodes;

/// Input for the questions: Enter for each question up to the destination of Cz; then a register with type, word order
/// and scale; then mostly Enter.
const USUAL: &str = "\n\n\n\n\n\n\n\n\n\n40105\ni32\nmsw-first\n0.1\n\n2\n\n";

const FOUND: SerialSettings = SerialSettings { baud: 19_200, parity: Parity::Even, frames: Frames::Rtu };

fn known() -> Vec<Outline> {
    outlines(Path::new("/nowhere"))
}

/// Asks with these options. A unit on a port that begins with `/dev/tty` answers with [`FOUND`]. With frames of Modbus
/// ASCII it has eight data bits.
fn answered_with(options: &[&str], lines: &str) -> (anyhow::Result<Answers>, String, String) {
    let words = ["init"].into_iter().chain(options.iter().copied());
    let arguments = <Parser as clap::Parser>::parse_from(words).arguments;
    let (mut input, mut shown) = (lines.as_bytes(), Vec::<u8>::new());
    let mut questions = Questions::new(&mut input, &mut shown, arguments.yes);
    let find = |port: &str, usual: SerialSettings, _: u8| -> Result<Option<SerialSettings>, String> {
        let frames = match usual.frames {
            Frames::Rtu => Frames::Rtu,
            Frames::Ascii { .. } => Frames::Ascii { data_bits: 8 },
        };
        Ok(port.starts_with("/dev/tty").then_some(SerialSettings { frames, ..FOUND }))
    };
    let answers = ask::ask(&arguments, &known(), &find, &mut questions);
    let command = questions.command("first.toml");
    (answers, String::from_utf8(shown).unwrap(), command)
}

fn answered(lines: &str) -> (anyhow::Result<Answers>, String) {
    let (answers, shown, _) = answered_with(&[], lines);
    (answers, shown)
}

#[derive(clap::Parser)]
struct Parser {
    #[command(flatten)]
    arguments: Arguments,
}

#[track_caller]
fn taken(answers: &Answers) -> isotherm_profile::Profile {
    let text = text::profile(answers);
    let profile = isotherm_profile::parse(Path::new("first.toml"), &text, &[], &[]);
    profile.unwrap_or_else(|errors| panic!("{errors}\n{text}")).profile
}

#[track_caller]
fn usual() -> Answers {
    let (answers, shown) = answered(USUAL);
    answers.unwrap_or_else(|error| panic!("{error}\n{shown}"))
}

#[test]
fn the_defaults_and_a_register_give_a_profile_that_check_takes() {
    let profile = taken(&usual());
    assert_eq!(profile.name, "my-machine");
    assert_eq!(profile.signals.len(), 2);
    assert_eq!(profile.outputs[0].writes, Writes::Offset);
    let limit = profile.axes[0].settings.guard.limit.get();
    assert!((limit - 10.0).abs() < 1e-9, "{limit}");
    let warnings: Vec<String> = preview::warnings(&profile).iter().map(ToString::to_string).collect();
    assert!(warnings.iter().all(|warning| warning.contains("model")), "{warnings:?}");
}

#[test]
fn nothing_that_moves_an_axis_has_a_default() {
    let (answers, shown) = answered(&"\n".repeat(40));
    let why = answers.unwrap_err().to_string();
    assert!(why.contains("the input ended before the question `Destination of Cz"), "{why}");
    assert!(shown.contains("this question has no default"), "{shown}");
    for (options, missing) in [
        (&["--yes"][..], "--output is needed"),
        (&["--yes", "--output", "40105"][..], "--output-type is needed"),
        (&["--yes", "--output", "40105", "--output-type", "i32"][..], "--output-word-order is needed"),
        (&["--yes", "--output", "40105", "--output-type", "i16"][..], "--output-scale is needed"),
        (&["--yes", "--output", "plc-block"][..], "--control-base is needed"),
        (&["--yes", "--axis", "x", "--output", "linuxcnc-eoffset"][..], "--diameter is needed"),
        (&["--yes", "--output", "linuxcnc-eoffset"][..], "--control-unit is needed"),
    ] {
        let (answers, ..) = answered_with(options, "");
        let why = answers.unwrap_err().to_string();
        assert!(why.contains(missing), "{options:?}: {why}");
    }
}

#[test]
fn the_template_of_the_control_gives_the_form_of_the_offset() {
    let on_its_line = ["--control-unit", "2"];
    let options = ["--yes", "--output", "plc-block", "--control-base", "40101"];
    let (answers, ..) = answered_with(&[&options[..], &on_its_line].concat(), "");
    let Target::Template(template) = answers.unwrap().target else { panic!("plc-block is a template") };
    let ControlTemplate { base, keys, target, .. } = *template;
    assert_eq!((base, keys, target.as_str()), (Some(100), vec![], "z"));
    let options = ["--yes", "--output", "plc-block", "--control-base", "0", "--output-scale", "-0.1"];
    let answers = answered_with(&[&options[..], &on_its_line].concat(), "").0.unwrap();
    let profile = taken(&answers);
    let scale = profile.outputs[0].encoding.scale.get();
    assert!((scale + 0.1).abs() < 1e-9, "the profile overrides the template: {scale}");
}

#[test]
fn no_target_is_guessed_for_an_axis_that_the_template_does_not_name() {
    let target = |options: &[&str]| {
        let usual = ["--yes", "--output", "plc-block", "--control-base", "0", "--control-unit", "2"];
        let answers = answered_with(&[&usual, options].concat(), "").0.map_err(|why| why.to_string())?;
        let Target::Template(template) = answers.target else { panic!("plc-block is a template") };
        Ok::<String, String>(template.target)
    };
    assert_eq!(target(&["--axis", "Z"]), Ok("z".to_owned()), "another target would move another axis");
    let why = target(&["--axis", "w"]).unwrap_err();
    assert!(why.contains("--output-target is needed"), "{why}");
    assert_eq!(target(&["--axis", "w", "--output-target", "y"]), Ok("y".to_owned()));
    let why = target(&["--axis", "w", "--output-target", "q"]).unwrap_err();
    assert!(why.contains("allowed: x, y, z"), "{why}");
}

#[test]
fn every_module_and_every_control_that_is_offered_gives_a_profile_that_check_takes() {
    for outline in known() {
        let mut answers = usual();
        answers.control = outline.sends_text.then(|| Line::Tcp("192.168.0.20:502".to_owned()));
        if !outline.temperatures.is_empty() {
            answers.signals = (0..outline.temperatures.len()).map(|place| format!("s{place}")).collect();
            let value = |key: &str| if key == "word_order" { "\"msw-first\"" } else { "0.1" };
            answers.module = Module::Template(Box::new(ModuleTemplate {
                variant: outline.variants.first().cloned(),
                base: outline.is_movable.then_some(0),
                keys: outline.asks.iter().map(|(key, _)| (key.clone(), value(key).to_owned())).collect(),
                outline: outline.clone(),
            }));
            taken(&answers);
        }
        for target in outline.targets.iter().filter(|_| !outline.sends_text) {
            let mut answers = usual();
            answers.axis.clone_from(&target.name);
            answers.target = Target::Template(Box::new(ControlTemplate {
                target: target.name.clone(),
                base: outline.is_movable.then_some(0),
                keys: Vec::new(),
                outline: outline.clone(),
            }));
            if let Some(bit) = outline.bits.first() {
                answers.machine_on = MachineOn::Channel(bit.clone());
            }
            let profile = taken(&answers);
            assert_eq!(profile.machine.on.is_some(), !outline.bits.is_empty(), "{}", outline.name);
        }
    }
}

#[test]
fn what_is_no_answer_is_asked_for_again_with_the_reason() {
    let (answers, shown) = answered(
        "Press 7\npress-7\nhttp://192.168.0.10\ncan0\n/dev/ttyUSB0\nicp-das-m7081\nicp-das-m7018\n0\n3\nperhaps\nyes\n\n\n\
         bed,bed\nbed,col umn\nbed\n1z\ny\n9000\n25,5\nplc-blok\ninput:3\nplc-block\nhundred\n100\n\n\n0\n\n192.168.0.20\n\n\
         referenced\n",
    );
    let answers = answers.unwrap_or_else(|error| panic!("{error}\n{shown}"));
    assert_eq!((answers.machine.as_str(), answers.unit), ("press-7", Some(3)));
    assert!((answers.limit - 25.5).abs() < 1e-9);
    assert_eq!(
        (&answers.line, &answers.control),
        (&Line::Serial("/dev/ttyUSB0".to_owned(), FOUND), &Some(Line::Tcp("192.168.0.20:502".to_owned())))
    );
    assert_eq!((&answers.signals, answers.axis.as_str()), (&vec!["bed".to_owned()], "y"));
    assert_eq!(answers.machine_on, MachineOn::Channel("referenced".to_owned()));
    taken(&answers);
    for why in [
        "lower-case letters, digits and hyphens",
        "an address without a prefix",
        "can0 is a CAN interface",
        "did you mean `icp-das-m7018`?",
        "a unit from 1 to 247",
        "write yes or no",
        "unit 3 answers at 19200 baud, parity even",
        "bed is given twice",
        "`col umn`",
        "`1z`",
        "from 1 to 500",
        "did you mean `plc-block`?",
        "input:3 cannot be written",
        "write the first register",
        "a number other than 0",
    ] {
        assert!(shown.contains(why), "{why}: {shown}");
    }
}

#[test]
fn an_address_that_is_none_is_asked_for_again_with_what_is_meant() {
    for (written, why) in [
        ("COM3", "a serial port of Windows"),
        ("com12", "a serial port of Windows"),
        ("ttyUSB0", "/dev/ttyUSB0"),
        ("ttyS1", "/dev/ttyS1"),
        ("192.168.0.300:502", "four numbers from 0 to 255"),
        ("192.168.0:502", "four numbers from 0 to 255"),
    ] {
        let refused = Line::parse(written).unwrap_err();
        assert!(refused.contains(why), "{written}: {refused}");
    }
    for host in
        ["192.168.0.10:502", "com-server-3:502", "common", "tty.example:502", "[::1]:502", "opc-server:502"]
    {
        assert!(matches!(Line::parse(host), Ok(Line::Tcp(_))), "{host}");
    }
}

#[test]
fn a_device_on_a_network_may_have_a_unit_that_a_serial_line_reserves() {
    let (tcp, serial) = (Line::parse("192.168.0.10").unwrap(), Line::parse("/dev/ttyUSB0").unwrap());
    for (unit, of_serial) in [("0", false), ("1", true), ("247", true), ("255", false)] {
        assert!(answers::unit(unit, &tcp).is_ok(), "{unit}");
        assert_eq!(answers::unit(unit, &serial).is_ok(), of_serial, "{unit}");
    }
    assert!(answers::unit("256", &tcp).is_err_and(|why| why.contains("0 to 255")));
}

#[test]
fn the_words_of_a_plc_are_understood_in_the_hint() {
    for (written, meant) in
        [("INT", "i16"), ("DINT", "i32"), ("REAL", "f32"), ("WORD", "u16"), ("DWORD", "u32")]
    {
        let why = value_form::data_type(written, None).unwrap_err();
        assert!(why.contains(&format!("did you mean `{meant}`?")), "{written}: {why}");
    }
    for (written, meant) in [("ABCD", "msw-first"), ("big-endian", "msw-first"), ("CDAB", "lsw-first")] {
        let why = value_form::word_order(written).unwrap_err();
        assert!(why.contains(&format!("did you mean `{meant}`?")), "{written}: {why}");
    }
}

#[test]
fn a_temperature_may_be_a_part_of_a_register() {
    let registers = |options: &[&str]| {
        let usual = ["--yes", "--output", "linuxcnc-eoffset", "--control-unit", "2"];
        let (answers, ..) = answered_with(&[&usual, options].concat(), "");
        let answers = answers.map_err(|why| why.to_string())?;
        let signals = taken(&answers).signals;
        let register = |signal: &isotherm_profile::Signal| signal.address.register().unwrap().to_string();
        let found: Vec<(String, &str)> = signals
            .iter()
            .take(2)
            .map(|signal| (register(signal), signal.encoding.data_type.name()))
            .collect();
        Ok::<_, String>(format!("{found:?} {}", text::profile(&answers)))
    };
    let found = registers(&["--register", "holding:12.4-15"]).unwrap();
    assert!(found.starts_with("[(\"holding:12\", \"i16\"), (\"holding:13\", \"i16\")]"), "{found}");
    assert!(found.contains("register = \"holding:12.4-15\""), "{found}");
    assert!(found.contains("register = \"holding:13.4-15\"") && found.contains("\"40014.4-15\""), "{found}");
    assert!(!found.contains("bad "), "the values of a broken wire are those of a whole register: {found}");
    let wide = ["--register", "input:2.4-23", "--type", "u32", "--word-order", "msw-first"];
    let found = registers(&wide).unwrap();
    assert!(found.contains("\"input:2.4-23\"") && found.contains("\"input:4.4-23\""), "{found}");
    for (options, why) in [
        (&["--register", "input:2.4-23"][..], "bit 23 is beyond one register"),
        (&["--register", "input:2.4-15", "--type", "f32"][..], "f32 is not possible for a part"),
        (&["--register", "input:2.4"][..], "or a part of it, such as input:0.4-15"),
        (&["--register", "input:2.7-4"][..], "smaller bit first"),
    ] {
        let refused = registers(options).unwrap_err();
        assert!(refused.contains(why), "{options:?}: {refused}");
    }
    let refused = answered_with(&["--yes", "--output", "holding:104.4-7"], "").0.unwrap_err().to_string();
    assert!(refused.contains("a part of a register, which cannot be written"), "{refused}");
}

#[test]
fn the_scale_of_the_temperatures_may_be_in_another_register() {
    let lines = USUAL.replacen("\n\n\n\n\n40105", "\nholding:12.3\nholding:12\n\n\n\n40105", 1);
    let (answers, shown) = answered(&lines);
    let answers = answers.unwrap_or_else(|error| panic!("{error}\n{shown}"));
    assert!(shown.contains("holding:12.3 is one bit, which cannot hold a scale"), "{shown}");
    let profile = taken(&answers);
    for signal in profile.signals.iter().filter(|signal| signal.name != "machine_on") {
        let from = signal.scale_from.as_ref().unwrap();
        assert_eq!((from.address.to_string().as_str(), signal.rate_limit()), ("holding:12", Some(5.0)));
    }
    let refused = value_form::scale_or_register("holding:0", answers::first_register("holding:0").ok());
    assert!(refused.unwrap_err().contains("the register of the value itself"));
    let holding = |text: &str| (1.0, Some(text.parse::<isotherm_profile::Cell>().unwrap()));
    assert_eq!(value_form::scale_or_register("40013", None), Ok(holding("holding:12")));
    assert_eq!(value_form::scale_or_register("40013.8-11", None), Ok(holding("holding:12.8-11")));
    assert_eq!(value_form::scale_or_register("1000.0", None), Ok((1000.0, None)));
}

#[test]
fn the_last_register_takes_a_value_of_one_register() {
    let to_the_last = |data_type: &str| {
        let words = ["--yes", "--output", "holding:65535", "--output-type", data_type];
        let more = ["--output-word-order", "msw-first", "--output-scale", "0.1", "--control-unit", "2"];
        answered_with(&[&words[..], &more].concat(), "").0.map_err(|why| why.to_string())
    };
    let profile = taken(&to_the_last("i16").unwrap());
    assert_eq!(profile.outputs.len(), 1);
    let why = to_the_last("i32").unwrap_err();
    assert!(why.contains("i32 needs 2 registers, and 65535 is the last one"), "{why}");
    let (answers, ..) = answered_with(&["--yes", "--output", "input:7"], "");
    let why = answers.unwrap_err().to_string();
    assert!(why.contains("input:7 cannot be written: write a holding register"), "{why}");
}

#[test]
fn a_question_mark_explains_every_question() {
    let explained = USUAL.split('\n').map(|answer| format!("?\n{answer}\n")).collect::<String>();
    let (answers, shown) = answered(&explained);
    assert_eq!(answers.unwrap_or_else(|error| panic!("{error}\n{shown}")), usual());
    for help in ["The name becomes part of file names", "one-based as 40105", "the reference temperature"] {
        assert!(shown.contains(help), "{help}: {shown}");
    }
}

#[test]
fn the_settings_of_a_line_are_tried_only_after_a_yes() {
    let (answers, shown, _) = answered_with(&["--bus", "/dev/ttyUSB0"], "\n\n\nno\n4800\nodd\n");
    let why = answers.unwrap_err().to_string();
    assert!(
        why.contains("Register of the first temperature") && !shown.contains("answers at"),
        "{why} {shown}"
    );
    let options = ["--yes", "--bus", "/dev/ttyUSB0", "--output", "linuxcnc-eoffset", "--control-unit", "2"];
    let answers = answered_with(&options, "").0.unwrap();
    assert_eq!(answers.line, Line::Serial("/dev/ttyUSB0".to_owned(), SerialSettings::RTU));
    let options = ["--bus", "/dev/nothing", "--module", "none", "--unit", "4"];
    let (_, shown, _) = answered_with(&options, "\nyes\n\n");
    assert!(shown.contains("unit 4 does not answer with any setting"), "{shown}");
    assert!(shown.contains("begin again with Modbus ASCII, as modbus-ascii:///dev/nothing"), "{shown}");
}

/// Modbus ASCII on a port of this computer, with settings that are found or asked, and through a serial server.
#[test]
fn a_line_with_modbus_ascii_is_offered_on_a_port_and_through_a_serial_server() {
    let ascii =
        |baud, parity, data_bits| SerialSettings { baud, parity, frames: Frames::Ascii { data_bits } };
    let port = "modbus-ascii:///dev/ttyUSB0";
    let on_port = |lines: &str| {
        let options = ["--bus", port, "--module", "none", "--unit", "3"];
        let rest = USUAL.strip_prefix("\n\n\n\n").unwrap();
        let (answers, shown, command) = answered_with(&options, &format!("\n{lines}{rest}"));
        let answers = answers.unwrap_or_else(|error| panic!("{error}\n{shown}"));
        (answers, shown, command)
    };
    let (answers, shown, command) = on_port("yes\n\n\n\n");
    assert_eq!(
        answers.line,
        Line::Serial("/dev/ttyUSB0".to_owned(), ascii(19_200, Parity::Even, 8)),
        "found: {shown}"
    );
    assert!(command.contains("--bus=modbus-ascii:///dev/ttyUSB0") && command.contains("--data-bits=8"));
    assert!(text::profile(&answers).contains("type    = \"modbus-ascii\""));
    assert_eq!(
        taken(&answers).buses[0].transport.port_settings().as_deref(),
        Some("19200 baud 8E1"),
        "{shown}"
    );
    let (answers, shown, _) = on_port("no\n\n\n9\n\n");
    assert!(shown.contains("write 7 or 8"), "{shown}");
    assert_eq!(answers.line, Line::Serial("/dev/ttyUSB0".to_owned(), SerialSettings::ASCII));
    assert_eq!(taken(&answers).buses[0].transport.port_settings().as_deref(), Some("9600 baud 7E1"));

    let usual = ["--yes", "--output", "linuxcnc-eoffset", "--control-unit", "2"];
    let server = ["--bus", "modbus-ascii+tcp://192.168.0.10:4001"];
    let answers = answered_with(&[&usual[..], &server].concat(), "").0.unwrap();
    assert_eq!(answers.line, Line::AsciiOverTcp("192.168.0.10:4001".to_owned()));
    let transport = taken(&answers).buses[0].transport;
    assert_eq!(transport, isotherm_profile::Transport::ModbusAsciiOverTcp);
    assert!(answers::unit("255", &answers.line).is_err(), "a serial line is behind the server");
    let control = ["--control", port, "--control-data-bits", "8"];
    let answers = answered_with(&[&usual[..], &control].concat(), "").0.unwrap();
    assert_eq!(answers.control, Some(Line::Serial("/dev/ttyUSB0".to_owned(), ascii(9600, Parity::Even, 8))));
    assert_eq!(taken(&answers).buses.len(), 2);
    let refused = answered_with(&[&usual[..], &control, &["--bus", "/dev/ttyUSB0"]].concat(), "").0;
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("the line of the module, which has another frame format"), "{refused}");
    for (written, why) in [
        (
            "modbus-ascii:///dev/ttyUSB0?baud=19200",
            "write only modbus-ascii:///dev/ttyUSB0: further questions",
        ),
        ("modbus-ascii+tcp://192.168.0.10", "write modbus-ascii+tcp://192.168.0.10:4001"),
    ] {
        let refused = Line::parse(written).unwrap_err();
        assert!(refused.contains(why), "{written}: {refused}");
    }
}

/// A pseudo-terminal has no baud rate and no parity. A busy computer may delay the answer to the first setting.
#[test]
fn the_settings_of_a_port_with_modbus_ascii_are_found_by_its_frames() {
    let text = "[machine]\nname = \"found\"\n[bus.line]\ntype = \"modbus-ascii\"\nport = \"/dev/isotherm-none\"\n\
                baud = 9600\n[device.module]\nbus = \"line\"\nunit = 3\n[signal.bed]\ndevice = \"module\"\n\
                register = \"input:0\"\ntype = \"i16\"\n";
    let profile = isotherm_profile::parse(Path::new("found.toml"), text, &[], &[]);
    let profile = profile.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let (tell, told) = std::sync::mpsc::channel();
    let (end, ended) = tokio::sync::oneshot::channel::<()>();
    let devices = std::thread::spawn(move || {
        crate::cli::runtime::start().unwrap().block_on(async {
            let setup = Setup { ports: Ports::Free, unknown_unit: UnknownUnit::Silence, ..Setup::default() };
            let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
            tell.send(machine.serving(profile).buses[0].address.clone()).unwrap();
            ended.await.unwrap();
            machine.stop().await.unwrap();
        });
    });
    let found = serial_settings::find(&told.recv().unwrap(), SerialSettings::ASCII, 3).unwrap();
    let frames = found.map(|settings| settings.frames);
    assert!(matches!(frames, Some(Frames::Ascii { .. })), "{found:?}");
    end.send(()).unwrap();
    devices.join().unwrap();
}

#[test]
fn the_signal_that_shows_the_machine_on_becomes_the_machine_start() {
    for (answer, address) in [("holding:16.3", "holding:16"), ("10004", "discrete:3"), ("coil:7", "coil:7")] {
        let answers =
            answered(&USUAL.replacen("0.1\n\n2\n\n", &format!("0.1\n\n2\n{answer}\n"), 1)).0.unwrap();
        let profile = taken(&answers);
        let on = profile.machine.on.map(|id| profile.signal(id)).unwrap();
        let register = on.address.register().unwrap().to_string();
        assert_eq!((on.name.as_str(), register.as_str()), ("machine_on", address));
    }
    let (_, shown) = answered(&USUAL.replacen("0.1\n\n2\n\n", "0.1\n\n2\nholding:5\n\n", 1));
    assert!(shown.contains("add the bit"), "{shown}");
}

#[test]
fn the_diameter_is_asked_for_on_the_axis_of_a_lathe() {
    let lines = USUAL.replacen("\n\n\n40105", "\nx\n\nyes\n\n40105", 1);
    let (answers, shown) = answered(&lines);
    let profile = taken(&answers.unwrap_or_else(|error| panic!("{error}\n{shown}")));
    assert!(profile.axes[0].diameter, "{shown}");
}

#[test]
fn a_module_that_sends_text_is_on_a_line_of_its_own() {
    let (answers, shown) = answered(
        "press-7\n/dev/ttyUSB0\nicp-das-i7018-dcon\n\n4\n\n\nbed,column\nz\n40\nholding:104\ni32\nmsw-first\n0.1\nsame\n\
         /dev/ttyUSB1\n\nno\n\n\n\n",
    );
    let answers = answers.unwrap_or_else(|error| panic!("{error}\n{shown}"));
    assert!(shown.contains("the control needs another line"), "{shown}");
    assert_eq!(answers.control, Some(Line::Serial("/dev/ttyUSB1".to_owned(), SerialSettings::RTU)));
    let variant = answers.module.template().and_then(|template| template.variant.as_deref());
    assert_eq!(variant, Some("checksum-off"));
    let profile = taken(&answers);
    let measured = profile.signals.iter().filter(|signal| signal.name != "machine_on");
    assert!(measured.map(|signal| signal.address.text()).all(|text| text.is_some()), "{profile:?}");
    assert_eq!(profile.buses.len(), 2);
}

#[test]
fn a_control_at_the_address_of_the_module_is_on_its_line() {
    let lines = USUAL.replacen("0.1\n\n", "0.1\n192.168.0.10\n", 1);
    let (answers, shown) = answered(&lines);
    let answers = answers.unwrap_or_else(|error| panic!("{error}\n{shown}"));
    assert_eq!((&answers.control, answers.control_unit), (&None, Some(2)));
    assert_eq!(taken(&answers).buses.len(), 1);
    let options =
        ["--yes", "--bus", "/dev/ttyUSB0", "--output", "linuxcnc-eoffset", "--control", "/dev/ttyUSB0"];
    let why = answered_with(&options, "").0.unwrap_err().to_string();
    assert!(why.contains("--control-unit is needed"), "{why}");
    let options = [&options[..], &["--control-unit", "2"]].concat();
    assert_eq!(answered_with(&options, "").0.unwrap().control, None, "a port has one bus");
}

#[test]
fn answers_that_end_write_nothing() {
    let (answers, _) = answered("press-7\n");
    let why = answers.unwrap_err().to_string();
    assert!(why.contains("the input ended") && why.contains("--yes"), "{why}");
}

#[test]
fn the_command_with_all_answers_gives_the_same_profile() {
    let (answers, _, command) = answered_with(&[], USUAL);
    let words: Vec<&str> = command.split(' ').skip(3).collect();
    assert_eq!((words[0], words.last()), ("--yes", Some(&"--machine-on=none")), "{command}");
    let again = answered_with(&words, "").0.unwrap();
    assert_eq!(again, answers.unwrap(), "{command}");
}

#[test]
fn a_file_that_exists_keeps_the_answers_for_another_file() {
    let home = tempfile::tempdir().unwrap();
    let (taken, free) = (home.path().join("taken.toml"), home.path().join("free.toml"));
    std::fs::write(&taken, "of another machine").unwrap();
    let lines = format!("\n{}\n{}\n", taken.display(), free.display());
    let (mut input, mut shown) = (lines.as_bytes(), Vec::<u8>::new());
    let mut questions = Questions::new(&mut input, &mut shown, false);
    let written = write(Some(&taken), &usual(), &mut questions).unwrap();
    assert_eq!(written, free);
    assert_eq!(std::fs::read_to_string(&taken).unwrap(), "of another machine");
    assert!(std::fs::read_to_string(&free).unwrap().contains("[output.cnc_z]"));
    let (mut input, mut shown) = ("".as_bytes(), Vec::<u8>::new());
    let mut questions = Questions::new(&mut input, &mut shown, false);
    let why = write(Some(&taken), &usual(), &mut questions).unwrap_err().to_string();
    assert!(why.contains("exists already") && why.contains("isotherm init OTHER.toml --yes"), "{why}");
    assert_eq!(questions.command("my mill.toml"), "isotherm init 'my mill.toml' --yes");
}
