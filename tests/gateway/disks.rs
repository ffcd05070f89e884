//! Disks that are full, read-only, missing or cut off by a power failure. What is stored is complete, the rest is
//! reported, and the gateway continues.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::process;

use process::{PATIENCE, Running, file, free_port, isotherm, until};

const MACHINE: &str = include_str!("../interop/machine.toml");

/// Machine with its devices, and a directory for its state.
struct Home {
    home: tempfile::TempDir,
    profile: PathBuf,
    state: PathBuf,
    _devices: Running,
}

impl Home {
    fn new() -> Home {
        let home = tempfile::tempdir().unwrap();
        let address = format!("127.0.0.1:{}", free_port());
        let text = MACHINE.replace("127.0.0.1:1\"", &format!("{address}\""));
        let profile = file(home.path(), "machine.toml", &text);
        let state = home.path().join("state");
        std::fs::create_dir(&state).unwrap();
        let mut devices = Running::start(isotherm(home.path()).arg("virtual").arg(&profile));
        devices.receives("stop with Ctrl-C");
        Home { profile, state, home, _devices: devices }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn run(&self) -> Command {
        let mut run = isotherm(self.home.path());
        run.arg("run").arg(&self.profile).arg("--state").arg(&self.state);
        run
    }

    /// Command that runs the gateway in a shell after these words.
    fn run_after(&self, words: &str) -> Command {
        let run = self.run();
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("{words}; exec \"$0\" \"$@\"")]).arg(run.get_program());
        shell.args(run.get_args());
        shell.envs(run.get_envs().filter_map(|(name, value)| Some((name, value?))));
        shell
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.state).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    fn logs(&self) -> Vec<String> {
        self.names().into_iter().filter(|name| name.ends_with(".csv")).collect()
    }

    /// Waits until there are this many logs with rows in each of them.
    #[track_caller]
    fn has_rows_in(&self, logs: usize) {
        until("there are rows in every log", || {
            let has_rows = |name: &&String| {
                let text = std::fs::read_to_string(self.state.join(name)).unwrap_or_default();
                text.matches('\n').count() > 1
            };
            let names = self.logs();
            let full = names.iter().filter(has_rows).count();
            if names.len() == logs && full == logs { Ok(()) } else { Err(format!("{full} of {names:?}")) }
        });
    }

    /// Checks that every log gives its decisions and its actions again. Returns the number of logs.
    #[track_caller]
    fn replays(&self) -> usize {
        let logs = self.logs();
        for name in &logs {
            let mut replay = isotherm(self.home.path());
            let replay = replay.arg("replay").arg(&self.profile).arg(self.state.join(name)).output().unwrap();
            let said = String::from_utf8([replay.stdout, replay.stderr].concat()).unwrap();
            assert!(replay.status.success(), "{name}: {said}");
            assert!(said.contains("bit for bit") || said.contains("of the log again"), "{name}: {said}");
        }
        logs.len()
    }
}

fn mode(path: &Path) -> u32 {
    path.metadata().unwrap().permissions().mode() & 0o7777
}

#[track_caller]
fn is_there(path: &Path) {
    until(&format!("{} is there", path.display()), || path.exists().then_some(()).ok_or_else(String::new));
}

#[test]
fn a_full_disk_is_reported_and_when_there_is_room_again_everything_goes_on_whole() {
    let home = Home::new();
    // Limit of the file size. A row beyond it is written in part, as on a full disk. The kernel sends SIGXFSZ.
    let mut program = Running::start(&mut home.run_after("ulimit -S -f 3"));
    program.receives("axis z: armed");
    let said = program.receives("the log cannot be saved");
    assert!(said.contains("a file has reached the largest size") && said.contains("LimitFSIZE"), "{said}");
    let before = home.logs().len();
    std::thread::sleep(std::time::Duration::from_secs(3));
    assert_eq!(home.logs().len(), before, "no file is begun again and again: {:?}", home.names());
    let all = ["--fsize=unlimited:unlimited", "--pid"];
    assert!(Command::new("prlimit").args(all).arg(program.id().to_string()).status().unwrap().success());
    program.receives("the log is saved again");
    std::thread::sleep(std::time::Duration::from_secs(3));
    program.signal("TERM");
    assert!(program.ends_within(PATIENCE).success());
    assert!(home.replays() >= 2);
    let mut again = Running::start(&mut home.run());
    again.receives("axis z: armed");
    assert!(!again.said.join("\n").contains("is rejected"));
}

#[test]
fn cut_off_by_the_power_in_the_middle_of_a_row_each_log_is_read_and_gone_on_with() {
    let home = Home::new();
    let mut program = Running::start(&mut home.run());
    program.receives("axis z: armed");
    home.has_rows_in(2);
    std::thread::sleep(std::time::Duration::from_secs(2));
    program.killed();
    let logs = home.logs();
    assert_eq!(logs.len(), 2);
    for name in &logs {
        let path = home.state.join(name);
        let whole = std::fs::read(&path).unwrap();
        let rows = whole[..whole.len() - 1].iter().rposition(|byte| *byte == b'\n').unwrap() + 1;
        for cut in (rows..whole.len()).step_by(17) {
            std::fs::write(&path, &whole[..cut]).unwrap();
            home.replays();
        }
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
    }
    let mut program = Running::start(&mut home.run());
    program.receives("axis z: armed");
    home.has_rows_in(4);
    std::thread::sleep(std::time::Duration::from_secs(2));
    program.signal("TERM");
    assert!(program.ends_within(PATIENCE).success());
    assert_eq!(home.replays(), 4, "{:?}", home.names());
}

/// The program as a user who is not root: a copy of it, which every user may start.
fn as_nobody(home: &Home) -> Command {
    let run = home.run();
    let program = home.path("isotherm");
    std::fs::copy(run.get_program(), &program).unwrap();
    let open = |path: &Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    };
    open(home.home.path(), 0o755);
    open(&program, 0o755);
    let mut command = if rustix::process::getuid().is_root() {
        std::os::unix::fs::chown(&home.state, Some(65534), Some(65534)).unwrap();
        let mut command = Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).arg(&program);
        command
    } else {
        Command::new(&program)
    };
    command.envs(run.get_envs().filter_map(|(name, value)| Some((name, value?))));
    command.args(run.get_args());
    command
}

#[test]
fn a_directory_that_becomes_read_only_is_reported_and_what_is_kept_again_too() {
    let home = Home::new();
    let mut program = Running::start(&mut as_nobody(&home));
    program.receives("the gateway runs");
    let state = home.state.join("interop.state.json");
    is_there(&state);
    std::fs::set_permissions(&home.state, std::fs::Permissions::from_mode(0o550)).unwrap();
    let said = program.receives("the state cannot be saved");
    assert!(
        said.contains(home.state.to_str().unwrap()) && said.contains("this user has no permission"),
        "{said}"
    );
    std::fs::set_permissions(&home.state, std::fs::Permissions::from_mode(0o750)).unwrap();
    program.receives("the state is saved again");
    program.signal("TERM");
    program.ends_within(PATIENCE);
}

#[test]
fn a_directory_that_is_deleted_while_running_is_made_again() {
    let home = Home::new();
    let mut program = Running::start(&mut home.run());
    program.receives("axis z: armed");
    let state = home.state.join("interop.state.json");
    is_there(&state);
    // The deletion may meet a file that is just being created.
    until("it is deleted", || std::fs::remove_dir_all(&home.state).map_err(|error| error.to_string()));
    is_there(&state);
    assert_eq!(mode(&home.state), 0o750);
    program.receives("was removed");
    program.receives("the log is saved again");
    let all = ["state.json", ".csv", "interop.sock"];
    until("all is there again", || {
        let names = home.names();
        let has = |end: &&str| names.iter().any(|name| name.ends_with(*end));
        all.iter().all(has).then_some(()).ok_or(format!("{names:?}"))
    });
    let mut disarm = isotherm(home.home.path());
    let disarm = disarm.arg("disarm").arg(&home.profile).arg("--state").arg(&home.state);
    assert!(disarm.status().unwrap().success());
    program.signal("TERM");
    program.ends_within(PATIENCE);
    home.replays();
    let mut again = Running::start(&mut home.run());
    again.receives("axis z: armed");
    assert!(!again.said.join("\n").contains("is rejected"));
}

#[test]
fn new_files_on_a_full_disk_name_the_file_and_what_to_do() {
    let home = Home::new();
    let full = home.path("full");
    std::fs::create_dir(&full).unwrap();
    // A disk of one page, which is full.
    let fill = "mount -t tmpfs -o size=4k none \"$1\" && head -c 4096 /dev/zero >\"$1/taken\" && shift && \"$@\"; code=$?; ls \"$LEFT\" >&2; exit $code";
    let on_it = |words: &[&std::ffi::OsStr]| {
        let isotherm = isotherm(home.home.path());
        let mut command = Command::new("unshare");
        command.args(["--map-root-user", "--mount", "sh", "-c", fill, "sh"]).arg(&full);
        command.arg(isotherm.get_program()).args(words).env("LEFT", &full);
        let ended = command.output().unwrap();
        (ended.status.code(), String::from_utf8([ended.stdout, ended.stderr].concat()).unwrap())
    };
    let (log, new, archive) = (full.join("day.csv"), full.join("new.toml"), full.join("saved.tar"));
    let record = ["record".as_ref(), home.profile.as_os_str(), "--out".as_ref(), log.as_os_str()];
    let options = ["--yes", "--output", "linuxcnc-eoffset", "--control-unit", "2"];
    let options: Vec<&std::ffi::OsStr> = options.iter().map(AsRef::as_ref).collect();
    let init = [&["init".as_ref(), new.as_os_str()], &options[..]].concat();
    let state = home.state.as_os_str();
    let backup =
        ["backup".as_ref(), home.profile.as_os_str(), archive.as_os_str(), "--state".as_ref(), state];
    for (words, file) in [(&record[..], &log), (&init[..], &new), (&backup[..], &archive)] {
        let (code, said) = on_it(words);
        let words =
            format!("{} cannot be written: the disk is full; free space on that disk", file.display());
        assert!(code == Some(1) && said.contains(&words), "{code:?} {said}");
        assert_eq!(said.lines().last(), Some("taken"), "nothing is left behind: {said}");
    }
}
