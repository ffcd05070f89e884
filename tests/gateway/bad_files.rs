//! Paths at which something other than the expected file is: pipes, devices, sockets, directories, endless files. The
//! program starts and ends at once, and reports what is there. Files that must be private are created so.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::support::process;

use process::{Running, file, isotherm, nowhere};

const MACHINE: &str = include_str!("../interop/machine.toml");
/// Limit for a start and an end. A program that waits for a pipe, or reads an endless device, exceeds it.
const SOON: Duration = process::PATIENCE;
const SECRET: &str = "root:$6$nobody$knows:20228:0:99999:7:::";

/// Words of the message about it, and the function that creates it.
type Obstacle = (&'static str, fn(&Path));

/// Things that may be at the path of a file.
const OBSTACLES: [Obstacle; 5] = [
    ("a named pipe", |path| assert!(Command::new("mkfifo").arg(path).status().unwrap().success())),
    ("a device", |path| symlink("/dev/zero", path).unwrap()),
    ("a directory", |path| std::fs::create_dir(path).unwrap()),
    ("a socket", |path| drop(std::os::unix::net::UnixListener::bind(path).unwrap())),
    ("larger than", |path| std::fs::File::create(path).unwrap().set_len(65 << 20).unwrap()),
];

/// The machine with one part of its text replaced.
fn with(from: &str, to: &str) -> String {
    assert!(MACHINE.contains(from), "{from}");
    MACHINE.replacen(from, to, 1)
}

struct Home {
    home: tempfile::TempDir,
    profile: PathBuf,
    state: PathBuf,
}

impl Home {
    fn new(text: &str) -> Home {
        let home = tempfile::tempdir().unwrap();
        let text = text.replace("127.0.0.1:1\"", &format!("{}\"", nowhere()));
        let profile = file(home.path(), "machine.toml", &text);
        let state = home.path().join("state");
        std::fs::create_dir(&state).unwrap();
        Home { profile, state, home }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn run(&self) -> Command {
        let mut run = isotherm(self.home.path());
        run.arg("run").arg(&self.profile).arg("--state").arg(&self.state).args(["--listen", "127.0.0.1:0"]);
        run
    }

    /// Checks that the program starts, ends soon with this code, and prints these words.
    #[track_caller]
    fn refuses(&self, code: i32, words: &[&str]) {
        let mut program = Running::start(&mut self.run());
        let status = program.ends_within(SOON);
        let said = program.said.join("\n");
        assert_eq!(status.code(), Some(code), "{said}");
        for word in words {
            assert!(said.contains(word), "`{word}` is not in:\n{said}");
        }
    }

    /// Checks that the program starts, runs, and ends soon after it was asked to. Returns what it has printed.
    #[track_caller]
    fn runs_and_ends(&self) -> String {
        let mut program = Running::start(&mut self.run());
        program.receives("the gateway runs");
        program.signal("TERM");
        program.ends_within(SOON);
        program.said.join("\n")
    }
}

#[test]
fn what_a_profile_names_is_refused_at_once_whatever_lies_there() {
    let model = with("kind  = \"linear\"", "kind = \"matrix\"\nfile = \"there\"");
    let bus =
        "[bus.can]\ntype = \"can\"\ninterface = \"vcan0\"\n[device.node]\nbus = \"can\"\ndbc = \"there\"\n";
    let dbc = format!("{MACHINE}\n{bus}");
    let template = format!("{MACHINE}\n[device.more]\nbus = \"cell\"\nunit = 9\ntemplate = \"mine\"\n");
    let tls = "timeout = \"300ms\"\ntls = { ca = \"there\", cert = \"there\", key = \"there\" }";
    let tls = with("timeout = \"300ms\"", tls);
    for (what, lay) in OBSTACLES {
        for (text, name) in [
            (MACHINE, "machine.local.toml"),
            (&model, "there"),
            (&dbc, "there"),
            (&tls, "there"),
            (&template, "devices/mine.toml"),
        ] {
            let home = Home::new(text);
            let there = home.path(name);
            std::fs::create_dir_all(there.parent().unwrap()).unwrap();
            lay(&there);
            home.refuses(64, &[what, there.file_name().unwrap().to_str().unwrap()]);
        }
        let home = Home::new("");
        std::fs::remove_file(&home.profile).unwrap();
        lay(&home.profile);
        home.refuses(64, &[what, "machine.toml"]);
    }
}

#[test]
fn a_gateway_runs_without_its_page_whatever_lies_in_the_place_of_a_token() {
    for (what, lay) in OBSTACLES {
        let web = "[web]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"there\"\n";
        let home = Home::new(&format!("{MACHINE}\n{web}"));
        let there = home.path("there");
        lay(&there);
        let mut program = Running::start(&mut home.run());
        let line = program.receives("is not served");
        assert!(line.contains(what) && line.contains(there.to_str().unwrap()), "{what}: {line}");
        program.signal("TERM");
        program.ends_within(SOON);
        let said = program.said.join("\n");
        assert!(said.contains("the gateway runs"), "{what}: {said}");
    }
}

#[test]
fn logs_and_scripts_that_are_none_are_refused_at_once() {
    for (what, lay) in &OBSTACLES[..4] {
        let home = Home::new(MACHINE);
        let there = home.path("there.csv");
        lay(&there);
        for verb in ["replay", "identify", "virtual"] {
            let mut command = isotherm(home.home.path());
            command.arg(verb).arg(&home.profile);
            if verb == "virtual" {
                command.arg("--faults");
            }
            let mut program = Running::start(command.arg(&there));
            let status = program.ends_within(SOON);
            let said = program.said.join("\n");
            // A directory is accepted as a place for logs.
            assert!(!status.success() && said.contains("there.csv"), "{verb} on {what}: {said}");
            assert!(said.contains(what) || *what == "a directory", "{verb} on {what}: {said}");
        }
    }
}

#[test]
fn a_gateway_starts_and_ends_whatever_lies_in_its_directory() {
    let name = "interop";
    for (what, lay) in OBSTACLES {
        for file in ["state.json", "number", "number.begun", "ledger.json", "ledger.begun.json"] {
            let home = Home::new(MACHINE);
            lay(&home.state.join(format!("{name}.{file}")));
            let said = home.runs_and_ends();
            assert!(said.contains(what) && said.contains("is rejected"), "{file}, {what}:\n{said}");
        }
        let home = Home::new(MACHINE);
        let kept = ["state.json.bad", "number.bad", "state.json.new", "number.new"];
        for file in kept {
            lay(&home.state.join(format!("{name}.{file}")));
        }
        for file in ["state.json", "number"] {
            std::fs::write(home.state.join(format!("{name}.{file}")), "{ half").unwrap();
        }
        let today = String::from_utf8(Command::new("date").args(["-u", "+%F"]).output().unwrap().stdout);
        for ending in [".csv", ".outputs.csv"] {
            lay(&home.state.join(format!("{name}-{}{ending}", today.as_ref().unwrap().trim())));
        }
        home.runs_and_ends();
    }
}

#[test]
fn what_lies_in_the_place_of_the_command_socket_is_left_alone_and_named() {
    for (_, lay) in [OBSTACLES[0], OBSTACLES[1], OBSTACLES[2], OBSTACLES[4]] {
        let home = Home::new(MACHINE);
        let socket = home.state.join("interop.sock");
        lay(&socket);
        home.refuses(1, &["interop.sock", "another file is at the path of the command socket"]);
        assert!(socket.symlink_metadata().is_ok());
    }
    // A listener that accepts no connection.
    let home = Home::new(MACHINE);
    let socket = home.state.join("interop.sock");
    let _deaf = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let callers: Vec<_> = (0..200)
        .map(|_| {
            let socket = socket.clone();
            std::thread::spawn(move || std::os::unix::net::UnixStream::connect(socket).map(std::mem::forget))
        })
        .collect();
    std::thread::sleep(Duration::from_millis(200));
    home.refuses(1, &["interop.sock", "another gateway"]);
    drop(callers);
    // Obstacles at the path of the state directory.
    for (_, lay) in [OBSTACLES[0], OBSTACLES[3], OBSTACLES[4]] {
        let mut home = Home::new(MACHINE);
        home.state = home.path("there");
        lay(&home.state);
        home.refuses(1, &["the state directory", "there"]);
    }
}

#[test]
fn nothing_is_quoted_of_a_file_that_is_something_else() {
    let bus =
        "[bus.can]\ntype = \"can\"\ninterface = \"vcan0\"\n[device.node]\nbus = \"can\"\ndbc = \"there\"\n";
    let matrix = with("kind  = \"linear\"", "kind = \"matrix\"\nfile = \"there\"");
    let network = with("kind  = \"linear\"", "kind = \"network\"\nfile = \"there\"");
    let tls = "timeout = \"300ms\"\ntls = { ca = \"there\", cert = \"there\", key = \"there\" }";
    let tls = with("timeout = \"300ms\"", tls);
    for text in [&format!("{MACHINE}\n{bus}"), &matrix, &network, &tls] {
        for content in [
            SECRET,
            &format!("VERSION \"\"\n{SECRET}"),
            &format!("\"{SECRET}\""),
            &format!("BU_:\n\n{SECRET}"),
        ] {
            let home = Home::new(text);
            file(home.home.path(), "there", content);
            let mut program = Running::start(isotherm(home.home.path()).arg("check").arg(&home.profile));
            program.ends_within(SOON);
            let said = program.said.join("\n");
            assert!(!said.contains("nobody") && !said.contains("20228"), "{said}");
        }
    }
}

fn mode(path: &Path) -> u32 {
    path.metadata().unwrap().permissions().mode() & 0o7777
}

#[test]
fn directories_and_files_have_their_modes_whatever_the_umask() {
    for umask in ["0000", "0077", "0777"] {
        let mut home = Home::new(MACHINE);
        home.state = home.path("new");
        let run = home.run();
        let mut shell = Command::new("sh");
        shell.envs(run.get_envs().filter_map(|(name, value)| Some((name, value?))));
        shell.args(["-c", &format!("umask {umask}; exec \"$0\" \"$@\"")]).arg(run.get_program());
        let mut program = Running::start(shell.args(run.get_args()));
        program.receives("the gateway runs");
        program.signal("TERM");
        program.ends_within(SOON);
        assert_eq!(mode(&home.state), 0o750, "umask {umask}");
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&home.state).unwrap() {
            let path = entry.unwrap().path();
            assert_eq!(mode(&path), 0o640, "{} with umask {umask}", path.display());
            names.push(path.file_name().unwrap().to_str().unwrap().to_owned());
        }
        assert!(names.iter().any(|name| name.ends_with("state.json")), "{names:?}");
        assert!(names.iter().any(|name| name.ends_with(".number")), "{names:?}");
    }
}

#[test]
fn what_others_may_write_is_refused_with_the_remedy() {
    let home = Home::new(MACHINE);
    home.runs_and_ends();
    let paths =
        [home.state.clone(), home.state.join("interop.state.json"), home.state.join("interop.number")];
    for path in paths {
        let before = std::fs::metadata(&path).unwrap().permissions();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode(&path) | 0o002)).unwrap();
        home.refuses(1, &["every user may write to", &format!("chmod o-w {}", path.display())]);
        std::fs::set_permissions(&path, before).unwrap();
    }
    home.runs_and_ends();
}

#[test]
fn what_a_later_version_has_written_is_refused_and_left_as_it_is() {
    let home = Home::new(MACHINE);
    home.runs_and_ends();
    let name = "interop.state.json";
    let path = home.state.join(name);
    std::fs::write(&path, "{ \"version\": 77, \"content\": 5 }").unwrap();
    home.refuses(1, &["a later version of this program", "layout 77", name, "Run that version, or move"]);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "{ \"version\": 77, \"content\": 5 }");
}
