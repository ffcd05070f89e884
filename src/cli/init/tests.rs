use super::*;
use isotherm_profile::preview;
use isotherm_profile::template::on_text;

fn answered(lines: &str) -> (anyhow::Result<Answers>, String) {
    let arguments = <Parser as clap::Parser>::parse_from(["init"]).arguments;
    let mut shown = Vec::new();
    let answers = ask(&arguments, &mut lines.as_bytes(), &mut shown);
    (answers, String::from_utf8(shown).unwrap())
}

#[derive(clap::Parser)]
struct Parser {
    #[command(flatten)]
    arguments: Arguments,
}

#[track_caller]
fn taken(answers: &Answers) -> isotherm_profile::Profile {
    let text = text::profile(answers);
    let profile = isotherm_profile::parse(std::path::Path::new("first.toml"), &text, &[], &[]);
    profile.unwrap_or_else(|errors| panic!("{errors}\n{text}")).profile
}

fn usual() -> Answers {
    answered(&"\n".repeat(20)).0.unwrap()
}

#[test]
fn enter_alone_gives_a_profile_that_check_takes() {
    let profile = taken(&usual());
    assert_eq!(profile.name, "my-machine");
    assert_eq!(profile.signals.len(), 2);
    let warnings: Vec<String> = preview::warnings(&profile).iter().map(ToString::to_string).collect();
    assert!(warnings.iter().all(|warning| warning.contains("model")), "{warnings:?}");
}

#[test]
fn every_module_and_every_control_that_is_offered_gives_a_profile_that_check_takes() {
    for outline in on_modbus().chain(on_text()) {
        let mut answers = usual();
        answers.control = outline.sends_text.then(|| Line::Tcp("192.168.0.20:502".to_owned()));
        if !outline.temperatures.is_empty() {
            answers.signals = (0..outline.temperatures.len()).map(|place| format!("s{place}")).collect();
            answers.variant = outline.variants.first().cloned();
            answers.module = Module::Template(outline.clone());
            taken(&answers);
        }
        for axis in &outline.targets {
            let mut answers = usual();
            answers.axis.clone_from(axis);
            answers.target = Target::parse(outline.name, axis).unwrap();
            taken(&answers);
        }
    }
}

#[test]
fn what_is_no_answer_is_asked_for_again_with_the_reason() {
    let (answers, shown) = answered(
        "Press 7\npress-7\nhttp://192.168.0.10\ncan0\n/dev/ttyUSB0\nicp-das-m7081\nicp-das-m7018\n0\n3\nbed,bed\nbed,col umn\nbed\n\
         1z\ny\n9000\n25,5\nplc-blok\nplc-block\n192.168.0.20\n\n",
    );
    let answers = answers.unwrap();
    assert_eq!((answers.machine.as_str(), answers.unit, answers.limit), ("press-7", 3, 25.5));
    assert_eq!(
        (answers.line, answers.control),
        (Line::Serial("/dev/ttyUSB0".to_owned()), Some(Line::Tcp("192.168.0.20:502".to_owned())))
    );
    assert_eq!((answers.signals, answers.axis), (vec!["bed".to_owned()], "y".to_owned()));
    for why in [
        "lower-case letters, digits and hyphens",
        "an address without a prefix",
        "can0 is a CAN interface",
        "did you mean `icp-das-m7018`?",
        "a unit from 1 to 247",
        "bed is given twice",
        "`col umn`",
        "`1z`",
        "from 1 to 500",
        "did you mean `plc-block`?",
    ] {
        assert!(shown.contains(why), "{why}: {shown}");
    }
}

#[test]
fn a_module_that_sends_text_is_on_a_line_of_its_own() {
    let (answers, shown) = answered(
        "press-7\n/dev/ttyUSB0\nicp-das-i7018-dcon\n\n4\nbed,column\nz\n40\nholding:104\nsame\n/dev/ttyUSB1\n\n",
    );
    let answers = answers.unwrap_or_else(|error| panic!("{error}\n{shown}"));
    assert!(shown.contains("the control needs another line"), "{shown}");
    assert_eq!(answers.control, Some(Line::Serial("/dev/ttyUSB1".to_owned())));
    assert_eq!(answers.variant.as_deref(), Some("checksum-off"));
    let profile = taken(&answers);
    assert!(profile.signals.iter().all(|signal| signal.address.text().is_some()), "{profile:?}");
    assert_eq!(profile.buses.len(), 2);
}

#[test]
fn answers_that_end_write_nothing() {
    let (answers, _) = answered("press-7\n");
    let why = answers.unwrap_err().to_string();
    assert!(why.contains("the answers ended") && why.contains("--yes"), "{why}");
}
