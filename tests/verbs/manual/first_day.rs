//! The first day of README, walked: every command of its table, on a module at a serial port and a control over TCP, at
//! the pace of a person.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::book::{Chapter, read};
use super::process::{Running, file, free_port, isotherm, until};
use super::shop::cold_start;

/// Largest number of commands, and of words in README's table and in the chapter on commissioning up to its profile.
const MOST_COMMANDS: usize = 10;
const MOST_WORDS: usize = 1_500;

/// Time for an answer of one word, and for a walk to the gauge and back.
const AT_THE_KEYBOARD: Duration = Duration::from_millis(300);
const AT_THE_GAUGE: Duration = Duration::from_secs(10);
const LONG: Duration = Duration::from_secs(120);

/// Devices as they are wired: `isotherm init` gets only what a person can read on them.
const WIRED: &str = r#"
[machine]
name = "my-machine"
[bus.cell]
type = "modbus-rtu"
port = "HOME/tty-module"
baud = 9600
parity = "none"
stop_bits = 1
timeout = "300ms"
[bus.control]
type = "modbus-tcp"
address = "127.0.0.1:PORT"
timeout = "300ms"
[device.module]
bus = "cell"
unit = 1
every = "1s"
[device.cnc]
bus = "control"
unit = 1
every = "1s"
[signal.bed]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
[signal.column]
device = "module"
register = "input:1"
type = "i16"
scale = 0.1
unit = "degC"
[signal.machine_on]
device = "cnc"
register = "discrete:0"
[axis.z]
limit = 10.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:104"
type = "i32"
word_order = "msw-first"
scale = 0.1
"#;

/// Section of a text from a heading to the next one of the same level.
fn section<'t>(text: &'t str, heading: &str) -> &'t str {
    let from = text.find(heading).unwrap_or_else(|| panic!("no {heading}"));
    let rest = &text[from + heading.len()..];
    &rest[..rest.find("\n## ").unwrap_or(rest.len())]
}

/// Commands of README's table, each with what must be seen.
fn steps() -> Vec<(String, String)> {
    let readme = read("README.md");
    let rows = section(&readme, "\n## First day on a machine\n")
        .lines()
        .filter(|line| line.contains("| `isotherm "));
    let step = |row: &str| {
        let cells: Vec<&str> = row.split(" | ").collect();
        let sees = cells[2].trim_end_matches('|').trim();
        (cells[1].trim_matches('`').to_owned(), sees.to_owned())
    };
    rows.map(step).collect()
}

#[test]
fn the_path_is_short_and_readme_commissioning_and_init_have_the_same_one() {
    let steps = steps();
    assert!((5..=MOST_COMMANDS).contains(&steps.len()), "{steps:?}");
    let readme = read("README.md");
    let chapter = Chapter { path: "docs/commissioning.md".into(), text: read("docs/commissioning.md") };
    let (path, _) = chapter.text.split_once("\n## A profile of your own\n").unwrap();
    let words = section(&readme, "\n## First day on a machine\n").split_whitespace().count()
        + path.split_whitespace().count();
    assert!(words <= MOST_WORDS, "{words} words to read");
    let mut rest = path;
    for (command, _) in &steps {
        let after = rest.split_once(command.as_str());
        rest = after.unwrap_or_else(|| panic!("docs/commissioning.md lacks `{command}` at its place")).1;
    }
}

/// Runs a command to its end, as it is written, with these answers.
fn runs(home: &Path, command: &str, answers: &[&str]) -> String {
    let mut running = Running::start(&mut spoken(home, command));
    for answer in answers {
        std::thread::sleep(AT_THE_KEYBOARD);
        // A command that has ended reads no answer. Its output then says why.
        if running.stdin().write_all(format!("{answer}\n").as_bytes()).is_err() {
            break;
        }
    }
    let status = running.ends_within(LONG);
    let said = running.so_far().join("\n");
    assert_eq!(status.code(), Some(0), "{command}:\n{said}");
    said
}

fn spoken(home: &Path, command: &str) -> Command {
    let mut spoken = isotherm(home);
    let words = command.split_whitespace();
    spoken.current_dir(home).args(words.skip(1)).stdin(Stdio::piped());
    spoken
}

/// Starts a command that continues to run, until it prints `word`.
fn starts(home: &Path, command: &str, word: &str) -> Running {
    let mut running = Running::start(&mut spoken(home, command));
    running.receives(word);
    running
}

/// Ends a command as Ctrl-C does.
fn ends(mut running: Running) -> String {
    running.signal("INT");
    let status = running.ends_within(LONG);
    let said = running.so_far().join("\n");
    assert_eq!(status.code(), Some(0), "{said}");
    said
}

#[test]
fn a_person_gets_from_init_to_an_axis_with_a_checked_sign_without_a_refusal() {
    let home = tempfile::tempdir().unwrap();
    let (home, port, module) = (home.path(), free_port(), home.path().join("tty-module"));
    let wired = WIRED.replace("HOME", &home.display().to_string()).replace("PORT", &port.to_string());
    file(home, "wired.toml", &wired);
    let _devices = starts(home, "isotherm virtual wired.toml", "stop with Ctrl-C");
    let steps = steps();
    let mut commands = steps.iter().map(|(command, _)| command.as_str());
    let mut next = |verb: &str| {
        let command = commands.next().unwrap();
        assert_eq!(command.split_whitespace().nth(1), Some(verb), "{command}");
        command
    };

    // The values are read off the devices: port, register, type, word order, scale, address, and the bit for "on".
    let (module, control) = (module.display().to_string(), format!("127.0.0.1:{port}"));
    let answers = [
        "",
        &module,
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "",
        "40105",
        "i32",
        "msw-first",
        "0.1",
        &control,
        "",
        "discrete:0",
        "",
    ];
    let said = runs(home, next("init"), &answers);
    for words in ["unit 1 answers at 9600 baud", "my-machine.toml is written", "output cnc_z at", "connected"]
    {
        assert!(said.contains(words), "`{words}`:\n{said}");
    }
    for (command, sees) in &steps[1..] {
        let is_step =
            |line: &str| line.trim_start().starts_with(command.as_str()) && line.ends_with(sees.as_str());
        assert!(said.lines().any(is_step), "init does not list `{command}`: {sees}:\n{said}");
    }
    // The test waits neither three minutes for a reference nor ten seconds for each step, and has a page of its own.
    let path = home.join("my-machine.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let hurried = text
        .replace("settle = \"3min\"", "settle = \"2s\"")
        .replace("every    = \"10s\"", "every    = \"1s\"");
    let hurried = hurried.replace("127.0.0.1:8080", &format!("127.0.0.1:{}", free_port()));
    assert_ne!(hurried, text);
    std::fs::write(&path, hurried).unwrap();

    let said = runs(home, next("check"), &[]);
    assert!(
        said.contains("device module") && said.contains("device cnc") && !said.contains("warning: bus"),
        "{said}"
    );
    let said = runs(home, next("read"), &[]);
    assert!(["bed", "column", "machine_on"].iter().all(|signal| said.contains(signal)), "{said}");
    let recording = starts(home, next("record"), "recording 3 signals into campaign/");
    std::thread::sleep(AT_THE_KEYBOARD * 10);
    ends(recording);
    // Days with the error of the gauge take days.
    let recorded: Vec<_> =
        std::fs::read_dir(home.join("campaign")).unwrap().map(|file| file.unwrap().path()).collect();
    assert_eq!(recorded.len(), 1, "{recorded:?}");
    std::fs::remove_file(&recorded[0]).unwrap();
    for day in 0..3 {
        file(&home.join("campaign"), &format!("day{day}.csv"), &cold_start(day));
    }
    let said = runs(home, next("identify"), &["yes"]);
    assert!(said.contains("the model is in ") && !said.contains("no signal shows the start"), "{said}");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("# Written by `isotherm init`") && text.contains("\n[[axis.z.model]]"), "{text}");

    let dry = starts(home, next("run"), "the gateway runs");
    std::thread::sleep(AT_THE_KEYBOARD * 10);
    ends(dry);
    let mut gateway = starts(home, next("run"), "the gateway runs");
    let said = runs(home, next("arm"), &[]);
    assert!(said.contains("z: armed"), "{said}");
    let mut sign = Running::start(&mut spoken(home, next("sign")));
    sign.receives("Put a dial gauge");
    std::thread::sleep(AT_THE_GAUGE);
    sign.stdin().write_all(b"\n").unwrap();
    sign.receives("read the gauge now");
    std::thread::sleep(AT_THE_GAUGE);
    sign.stdin().write_all(b"plus\n").unwrap();
    sign.receives("the sign is right");
    assert_eq!(sign.ends_within(LONG).code(), Some(0));
    until("the axis follows its model again", || match gateway.so_far() {
        said if said.iter().any(|line| line.contains("the sign is right")) => Ok(()),
        said => Err(said.join("\n")),
    });
    ends(gateway);
}
