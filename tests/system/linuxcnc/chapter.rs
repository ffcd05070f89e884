//! Commands that the chapter of the manual gives for a control, executed on this one.

use std::path::Path;
use std::process::Command;

use crate::linuxcnc::mill::Mill;
use crate::linuxcnc::process::{Running, isotherm, until};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Commands of a chapter that run here.
fn commands(chapter: &str) -> Vec<String> {
    let mut command = Command::new(root().join("tests/verbs/manual/commands"));
    let output = command.args([chapter, "tests/linuxcnc/run"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

/// Command that begins with this text.
fn command<'a>(all: &'a [String], begin: &str) -> &'a str {
    all.iter().find(|command| command.starts_with(begin)).unwrap_or_else(|| panic!("no `{begin}` in {all:?}"))
}

/// Executes a command. Returns whether it succeeded, and its output.
fn said(line: &str) -> (bool, String) {
    let output = Command::new("sh").args(["-c", line]).current_dir(root()).output().unwrap();
    let said =
        [output.stdout, output.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    (output.status.success(), said)
}

/// Value with this number in an output like `[3]:   1`.
fn value(said: &str, number: usize) -> Result<String, String> {
    let line = said.lines().find_map(|line| line.trim().strip_prefix(&format!("[{number}]:")));
    line.map(|value| value.trim().to_owned()).ok_or_else(|| format!("no [{number}] in {said}"))
}

#[test]
fn what_the_chapter_reads_and_moves_by_hand_is_as_it_says() {
    let all = commands("docs/linuxcnc/README.md");
    let mut mill = Mill::start();
    // In the chapter, the control is `mill` at the usual port.
    let here = |begin: &str| {
        let line = command(&all, begin).replace("-p 1502 ", &format!("-p {} ", mill.port));
        line.split(' ')
            .map(|word| if word == "mill" { "127.0.0.1" } else { word })
            .collect::<Vec<_>>()
            .join(" ")
    };
    let [bits, inputs, moves] = ["-p 1502 -0 -1 -t 1 ", "-p 1502 -0 -1 -t 3 ", "-p 1502 -0 -t 4 "]
        .map(|rest| here(&format!("mbpoll -m tcp {rest}")));
    let reads = |line: &str| {
        let (done, said) = said(line);
        if done { Ok(said) } else { Err(said) }
    };
    let bits_are = |ones: &'static [usize]| {
        until("the status bits", || {
            let said = reads(&bits)?;
            let found: Vec<String> = (0..8).map(|bit| value(&said, bit)).collect::<Result<_, _>>()?;
            let wanted = (0..8).map(|bit| if ones.contains(&bit) { "1" } else { "0" });
            if found.iter().map(String::as_str).eq(wanted) { Ok(()) } else { Err(format!("{found:?}")) }
        });
    };
    bits_are(&[0, 1, 2]);
    let said_of_inputs = reads(&inputs).unwrap();
    assert_eq!(value(&said_of_inputs, 28).unwrap(), "0", "{said_of_inputs}");

    let (done, first) = said(&moves);
    assert!(done, "{first}");
    until("Z has moved", || match mill.offset_um() {
        offset if (offset - 1.0).abs() < 1e-3 => Ok(()),
        offset => Err(format!("{offset} µm")),
    });
    let (done, again) = said(&moves);
    assert!(!done && again.contains("Illegal data value"), "{again}");
    bits_are(&[0, 1, 6]);
    bits_are(&[0, 1, 6, 7]);
    until("Z is back", || match mill.offset_um() {
        offset if offset.abs() < 1e-3 => Ok(()),
        offset => Err(format!("{offset} µm")),
    });
}

#[test]
fn one_more_linuxcnc_runs_in_namespaces_of_its_own() {
    use std::io::Write;
    let all = commands("docs/linuxcnc/README.md");
    let mut command_of_it = Command::new("sh");
    command_of_it.args(["-c", &format!("exec {}", command(&all, "unshare "))]).current_dir(root());
    let _other = Mill::start();
    let mut mill = Running::start(&mut command_of_it);
    mill.receives("ready");
    writeln!(mill.stdin(), "quit").unwrap();
    assert!(mill.ends_within(crate::linuxcnc::process::PATIENCE).success(), "{:?}", mill.said);
}

#[test]
fn the_demo_holds_the_machine_with_a_real_control_in_the_loop() {
    let home = tempfile::tempdir().unwrap();
    let all = commands("docs/machines.md");
    let words = command(&all, "isotherm demo ").split(' ').skip(1);
    // A fifth of the chapter's time. On a busy computer, the control cannot follow at eighty times real time.
    let words: Vec<_> = words.map(|word| if word == "1h" { "12min" } else { word }).collect();
    let is_compensated = |speed: &str| {
        let mut demo = isotherm(home.path());
        demo.env("TMPDIR", home.path()).args(&words).args(["--speed", speed, "--json"]);
        let output = demo.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let range = |name: &str| report[name].as_f64().unwrap();
        let (without, with) = (range("uncompensated_range_um"), range("compensated_range_um"));
        println!("{without} µm uncompensated, {with} µm compensated, at a speed of {speed}");
        without > 3.0 && with < 2.0
    };
    assert!(is_compensated("80") || is_compensated("20") || is_compensated("5"));
    let left: Vec<_> =
        std::fs::read_dir(home.path()).unwrap().flatten().map(|entry| entry.file_name()).collect();
    let left = left.iter().filter(|name| name.to_string_lossy().starts_with("isotherm-"));
    assert_eq!(left.count(), 0, "it tidies up");
}
