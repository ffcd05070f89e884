//! `isotherm restart --keep` while the new program checks its profile, and after the check. The old gateway runs until
//! then, and the checked profile is the one that runs.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::os::unix::fs::{FileExt, MetadataExt, PermissionsExt};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use isotherm::gateway::control::{self, Failure};
use serde_json::Value;

use crate::service::process::{file, isotherm, until};
use crate::service::rig::Service;

const PROGRAM: &str = env!("CARGO_BIN_EXE_isotherm");
const GAIN: &str = "gain = 1.0";
/// Matrix, network and template next to the profile, for an axis and a device without outputs.
const WITH_FILES: &str = r#"
[device.own]
template = "ours"
bus = "cell"
unit = 2
[signal.own]
device = "own"
channel = 0
max_age = "2s"
[axis.y]
limit = 20.0
step = 1.0
rate = 10.0
every = "1s"
on_fault = { action = "hold" }
[[axis.y.model]]
name = "net"
kind = "network"
file = "n.json"
inputs = ["bed"]
"#;
const TEMPLATE: &str = "title = \"ours\"\nsource = \"measured by ourselves\"\n[channel.t]\nname = \"{n}\"\ncount = 2\n\
                        register = \"holding:40\"\ntype = \"i16\"\nscale = 0.5\n";
const NETWORK: &str = r#"{ "format": "isotherm-network", "version": 1, "type": "bp",
  "inputs": { "names": ["a"], "mean": [20], "scale": [4] }, "output": { "mean": 0, "scale": 1 },
  "layers": [{ "weights": [[0.5]], "bias": [0], "activation": "tanh" }] }"#;
const HEARTBEAT: &str = "[heartbeat]\ndevice = \"cnc\"\nregister = \"holding:20\"\nevery = \"100ms\"\n";

/// Replaces the program file by a script: `check` runs instead of a check, with `$real` as the program, and `run`
/// before each run.
fn replace(service: &Service, check: &str, run: &str) {
    let text = format!(
        "#!/bin/sh\nreal={PROGRAM}\ncase \"$*\" in\n*--check-only*)\n{check}\nexit 0;;\nesac\n{run}\nexec \"$real\" \"$@\"\n"
    );
    let new = file(service.home.path(), "new", &text);
    std::fs::set_permissions(&new, std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::rename(&new, &service.program).unwrap();
}

/// Writes these files next to the profile.
fn write(service: &Service, files: &[(&str, &str)]) {
    for (name, text) in files {
        let path = service.home.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
}

/// Waits for the event about changed files. Returns the files that it names.
fn differences(service: &mut Service) -> Vec<String> {
    service.gateway.receives("changed after the new program had checked the profile");
    let events = service.events("profile-differs");
    let [event] = events.as_slice() else { panic!("{events:#?}") };
    let text = event["text"].as_str().unwrap();
    assert!(text.contains("isotherm restart") && text.contains("walker.toml --keep"), "{text}");
    let files = event["data"]["files"].as_array().unwrap();
    files.iter().map(|name| name.as_str().unwrap().to_owned()).collect()
}

#[test]
fn what_was_checked_runs_when_its_files_are_spoiled_before_the_new_program_starts() {
    let mut service = Service::start(|text| text);
    service.walks_to(30);
    let local = ("walker.local.toml", "[machine]\ndescription = \"in the corner\"\n");
    let files = [local, ("devices/ours.toml", TEMPLATE), ("n.json", NETWORK)];
    write(&service, &files);
    service.rewrite(|text| text.replace(GAIN, "gain = 2.0") + WITH_FILES);
    let checked = std::fs::read_to_string(&service.profile).unwrap();
    let spoil = "\"$real\" \"$@\" || exit $?\n\
                 for name in walker.toml walker.local.toml devices/ours.toml n.json; do echo spoiled > \"$HOME/$name\"; done";
    replace(&service, spoil, "");
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    service.device.asks(40);
    until("it follows by the gain that was checked", || match service.device.offset() {
        80 => Ok(()),
        found => Err(found.to_string()),
    });
    let unreadable = service.verb(&["status"]);
    assert_eq!(unreadable.status.code(), Some(64), "the file on disk is spoiled");
    write(&service, &files);
    std::fs::write(&service.profile, &checked).unwrap();
    assert_eq!(
        differences(&mut service),
        ["devices/ours.toml", "n.json", "walker.local.toml", "walker.toml"]
    );
    // The second restart finds everything as it was checked.
    let (code, said) = service.restart(&[]);
    assert_eq!((code, service.events("profile-differs").len()), (Some(0), 1), "{said}");
    assert!(service.events("handover-refused").is_empty());
}

#[test]
fn what_was_checked_runs_when_its_files_say_something_else_by_then() {
    let mut service = Service::start(|text| text);
    service.rewrite(|text| text.replace(GAIN, "gain = 2.0"));
    let change = "\"$real\" \"$@\" || exit $?\n\
                  sed -i 's/gain = 2.0/gain = 3.0/' \"$HOME/walker.toml\"\n\
                  echo '[axis.z]' > \"$HOME/walker.local.toml\"; echo 'limit = 1.0' >> \"$HOME/walker.local.toml\"";
    replace(&service, change, "");
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    service.device.asks(20);
    until("it follows by the gain that was checked", || match service.device.offset() {
        40 => Ok(()),
        found => Err(found.to_string()),
    });
    assert_eq!(differences(&mut service), ["walker.local.toml", "walker.toml"]);
    // The next restart uses the present files.
    std::fs::remove_file(service.home.path().join("walker.local.toml")).unwrap();
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    until("it follows by the gain on disk", || match service.device.offset() {
        60 => Ok(()),
        found => Err(found.to_string()),
    });
}

#[test]
fn a_program_that_cannot_be_started_any_more_leaves_the_old_one_with_the_profile_that_it_ran() {
    let mut service = Service::start(|text| text);
    service.walks_to(30);
    for _ in 0..2 {
        service.rewrite(|text| text.replace(GAIN, "gain = 2.0"));
        // It is still the same file, but no user may execute it.
        replace(&service, "\"$real\" \"$@\" || exit $?\nchmod a-x \"$0\"", "");
        let (code, said) = service.restart(&[]);
        assert_eq!(code, Some(0), "{said}");
        let reported = service.gateway.receives("the previous program continues");
        assert!(reported.contains("cannot be started"), "{reported}");
        service.walks_to(service.device.offset() + 20);
        service.gateway.receives("changed after the new program had checked the profile");
    }
    let armed = service.events("armed");
    assert!(
        armed.len() == 3 && armed[1..].iter().all(|event| event["data"]["way"] == "restart"),
        "{armed:#?}"
    );
    assert_eq!(service.events("profile-differs").len(), 2);
}

#[test]
fn a_page_whose_token_is_gone_keeps_no_new_program_from_running_and_comes_when_it_is_there() {
    let mut service = Service::start(|text| text);
    service.walks_to(30);
    let token = service.home.path().join("page.token");
    std::fs::write(&token, "0123456789abcdef0123\n").unwrap();
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
    service.rewrite(|text| text + "[web]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"page.token\"\n");
    replace(&service, "\"$real\" \"$@\" || exit $?\nmv \"$HOME/page.token\" \"$HOME/away\"", "");
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    service.walks_to(60);
    let closed = service.gateway.receives("the web page");
    assert!(closed.contains("page.token"), "{closed}");
    std::fs::rename(service.home.path().join("away"), &token).unwrap();
    service.gateway.receives("page http://127.0.0.1:");
    assert_eq!((service.events("page-closed").len(), service.events("page-open").len()), (1, 1));
}

#[test]
fn a_program_of_an_older_version_reads_its_profile_from_disk_and_is_given_what_it_knows() {
    let service = Service::start(|text| text);
    service.walks_to(30);
    service.rewrite(|text| text.replace(GAIN, "gain = 2.0"));
    // It writes nothing for the program that runs its check.
    let check =
        "\"$real\" \"$@\" > /dev/null || exit $?\nsed -i 's/gain = 2.0/gain = 3.0/' \"$HOME/walker.toml\"";
    replace(&service, check, "cat /proc/self/fd/0 > \"$HOME/handed\"");
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    let handed = std::fs::read(service.home.path().join("handed")).unwrap();
    let document: Value = serde_json::from_slice(&handed).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(
        (keys(&document), keys(&document["handover"])),
        (
            vec!["handover".to_owned(), "process".to_owned()],
            vec!["armed".to_owned(), "by".to_owned(), "off".to_owned()],
        )
    );
    until("it follows by the gain on disk", || match service.device.offset() {
        90 => Ok(()),
        found => Err(found.to_string()),
    });
    let armed = service.events("armed");
    assert!(armed.len() == 2 && armed[1]["data"]["way"] == "restart", "{armed:#?}");
    assert!(service.events("handover-refused").is_empty() && service.events("profile-differs").is_empty());
}

#[test]
fn a_program_of_a_newer_version_gets_back_what_it_has_written_whatever_that_is() {
    let mut service = Service::start(|text| text);
    service.walks_to(30);
    let answer = "isotherm-sources 99\nin a form of its own\n";
    let check =
        "\"$real\" \"$@\" > /dev/null || exit $?\nprintf 'isotherm-sources 99\\nin a form of its own\\n'";
    replace(&service, check, "cat /proc/self/fd/0 > \"$HOME/handed\"");
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    let handed = std::fs::File::open(service.home.path().join("handed")).unwrap();
    let size = handed.metadata().unwrap().len();
    let read = |place: u64, length: u64| {
        let mut bytes = vec![0; usize::try_from(length).unwrap()];
        handed.read_exact_at(&mut bytes, place).unwrap();
        bytes
    };
    let before = answer.len() as u64;
    assert_eq!(read(0, before), answer.as_bytes());
    let document: Value = serde_json::from_slice(&read(before, size - 8 - before)).unwrap();
    let seal = &document["sources"];
    assert_eq!(
        (&seal["length"], &seal["sha256"]),
        (&Value::from(before), &Value::from(isotherm_profile::sha256(answer.as_bytes())))
    );
    // This version does not know that form. It reads the file, and the axes resume as they were.
    service.gateway.receives("is read from disk");
    service.walks_to(60);
    let armed = service.events("armed");
    assert!(armed.len() == 2 && armed[1]["data"]["way"] == "restart", "{armed:#?}");
}

#[test]
fn a_program_that_is_replaced_after_its_check_does_not_take_over() {
    let service = Service::start(|text| text);
    service.walks_to(30);
    for change in ["rm \"$0\"", "echo >> \"$0\"", "cp \"$0\" \"$0.2\"; mv \"$0.2\" \"$0\""] {
        replace(&service, &format!("\"$real\" \"$@\" || exit $?\n{change}"), "");
        let (code, said) = service.restart(&[]);
        let words = "was replaced after it had checked the profile: restart once more; the gateway continues \
                     as before";
        assert_eq!((code, said.contains(words)), (Some(1), true), "{change}: {said}");
    }
    service.walks_to(60);
    assert_eq!(service.events("started").len(), 1);
}

/// A large machine needs more than ten seconds.
#[test]
fn a_check_has_the_time_that_the_verb_names() {
    let service = Service::start(|text| text);
    replace(&service, "sleep 1000", "exit 3");
    let socket = control::path(&service.home.path().join("state"), "walker");
    for seconds in [1, 11] {
        let said = control::restart(&socket, Duration::from_secs(seconds), |_| ());
        let Err(Failure::Refused(why)) = said else { panic!("{said:?}") };
        assert!(
            why.contains(&format!("has not checked the profile within {seconds} s; the gateway")),
            "{why}"
        );
    }
    service.walks_to(30);
}

/// Begins a restart, and returns while the new program checks the profile.
fn checking(service: &Service) -> Child {
    let mut restart = isotherm(service.home.path());
    restart.arg("restart").arg(&service.profile).args(["--keep", "--state"]);
    restart.arg(service.home.path().join("state")).stdout(Stdio::piped()).stderr(Stdio::piped());
    let restart = restart.spawn().unwrap();
    let begun = service.home.path().join("checking");
    until("the check has begun", || begun.exists().then_some(()).ok_or_else(String::new));
    std::fs::remove_file(begun).unwrap();
    restart
}

fn said(restart: Child) -> (Option<i32>, String) {
    let output = restart.wait_with_output().unwrap();
    let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (output.status.code(), said)
}

/// Checks that the gateway still polls, compensates, sends heartbeats and answers, with its previous state.
fn runs_on(service: &mut Service, offset: i16) {
    let beats = service.device.state().beats.len();
    service.walks_to(offset);
    let most = Duration::from_secs(60);
    let more = service.device.wait(most, |state| (state.beats.len() > beats + 3).then_some(()));
    assert!(more.is_some(), "it beats");
    let status = service.verb(&["status"]);
    assert_eq!(status.status.code(), Some(0), "{status:?}");
    let reported = service.manager.rest();
    assert!(
        reported.iter().all(|reported| !reported.contains("RELOADING") && !reported.contains("STOPPING")),
        "{reported:?}"
    );
}

#[test]
fn however_a_check_fails_and_however_long_it_takes_the_old_gateway_runs_on() {
    let mut service = Service::start(|text| text + HEARTBEAT);
    let waits =
        "touch \"$HOME/checking\"; while [ ! -e \"$HOME/go\" ]; do sleep 0.05; done; rm \"$HOME/go\"\n";
    let failures = [
        ("exit 1", "ended with exit status: 1"),
        ("echo wrong >&2; exit 64", "the profile is wrong: wrong"),
        ("kill -9 $$", "ended with signal: 9"),
        ("head -c 300000 /dev/zero | tr '\\0' x >&2; exit 1", "xxxx"),
        ("head -c 300000000 /dev/zero; exit 0", "no more than 256 MB can be handed over"),
    ];
    for (round, (failure, words)) in failures.into_iter().enumerate() {
        replace(&service, &format!("{waits}{failure}"), "exit 3");
        let restart = checking(&service);
        runs_on(&mut service, 20 + 10 * i16::try_from(round).unwrap());
        write(&service, &[("go", "")]);
        let (code, said) = said(restart);
        assert!(
            code != Some(0) && said.contains(words),
            "{failure}: {code:?} {}",
            &said[..said.len().min(2000)]
        );
        assert!(said.contains("the gateway continues as before"), "{failure}");
    }
    runs_on(&mut service, 80);
    assert_eq!(service.events("started").len(), 1);
    assert_eq!(service.events("command-refused").len(), 5);
}

#[test]
fn a_check_that_leaves_processes_behind_is_judged_by_its_own_end_and_one_that_hangs_is_ended_with_them() {
    let mut service = Service::start(|text| text + HEARTBEAT);
    replace(&service, "sleep 20 &\nexit 7", "exit 3");
    let (code, said) = service.restart(&[]);
    assert_eq!((code, said.contains("ended with exit status: 7")), (Some(1), true), "{said}");
    let waits = "touch \"$HOME/checking\"; sleep 1000 & echo $! > \"$HOME/left\"; sleep 1000";
    replace(&service, waits, "exit 3");
    let restart = checking(&service);
    runs_on(&mut service, 20);
    let (code, said) = self::said(restart);
    let words = "has not checked the profile within 10 s; the gateway continues as before";
    assert_eq!((code, said.contains(words)), (Some(1), true), "{said}");
    let left = std::fs::read_to_string(service.home.path().join("left")).unwrap();
    let process = format!("/proc/{}/stat", left.trim());
    until("what the check has started is gone", || match std::fs::read_to_string(&process) {
        Err(_) => Ok(()),
        Ok(stat) if stat.contains(") Z ") => Ok(()),
        Ok(stat) => Err(stat),
    });
    runs_on(&mut service, 40);
}

#[test]
fn a_machine_of_five_hundred_axes_with_a_large_model_restarts_as_it_was_checked() {
    let mut service = Service::start(|text| text);
    service.walks_to(30);
    // A network may contain any number of blanks.
    let large = format!("{NETWORK}{}", " ".repeat(6_000_000));
    write(&service, &[("devices/ours.toml", TEMPLATE), ("n.json", &large)]);
    let many = |mut text: String| {
        for axis in 0..500 {
            write!(
                text,
                "[axis.a{axis}]\nlimit = 20.0\nstep = 1.0\nrate = 10.0\nevery = \"10s\"\non_fault = {{ action = \"hold\" }}\n\
                 [[axis.a{axis}.model]]\nname = \"bed\"\nkind = \"linear\"\n\
                 terms = [{{ signal = \"bed\", gain = 0.1, reference = 0.0 }}]\n"
            )
            .unwrap();
        }
        text + WITH_FILES
    };
    service.rewrite(many);
    replace(&service, "\"$real\" \"$@\" || exit $?\necho spoiled > \"$HOME/n.json\"", "");
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{}", &said[..said.len().min(2000)]);
    assert_eq!(service.device.offset(), 30);
    service.walks_to(60);
    write(&service, &[("n.json", &large)]);
    assert_eq!(differences(&mut service), ["n.json"]);
    assert!(service.events("handover-refused").is_empty());
    assert_eq!(service.events("armed").iter().filter(|event| event["data"]["way"] == "restart").count(), 1);
}

/// The output of a script around a check is no part of its answer.
#[test]
fn a_script_that_prints_something_around_the_check_is_no_older_version_and_spoils_nothing() {
    let mut service = Service::start(|text| text);
    service.walks_to(30);
    let check = "echo starting\n\"$real\" \"$@\" || exit $?\necho spoiled > \"$HOME/walker.toml\"\necho done";
    replace(&service, check, "echo starting");
    let whole = std::fs::read_to_string(&service.profile).unwrap();
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    service.walks_to(60);
    std::fs::write(&service.profile, whole).unwrap();
    assert_eq!(differences(&mut service), ["walker.toml"]);
}

/// The environment variables are a layer as well.
#[test]
fn a_layer_that_a_script_takes_from_the_environment_is_the_one_that_was_checked() {
    let mut service = Service::start(|text| text);
    let set = "export ISOTHERM__AXIS__Z__LIMIT=";
    replace(&service, &format!("{set}5.0\n\"$real\" \"$@\" || exit $?"), &format!("{set}1.0"));
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    // The limit is 5 µm.
    service.device.asks(300);
    until("it is at the limit that was checked", || match service.device.offset() {
        50 => Ok(()),
        found => Err(found.to_string()),
    });
    assert_eq!(differences(&mut service), ["environment ISOTHERM__AXIS__Z__LIMIT"]);
}

/// A running gateway keeps its profile in memory that only its own process can open.
#[test]
fn the_profile_that_runs_is_kept_in_sealed_memory_of_its_owner() {
    let service = Service::start(|text| text);
    for _ in 0..2 {
        let fds = std::fs::read_dir(format!("/proc/{}/fd", service.gateway.id())).unwrap();
        let kept: Vec<_> = fds
            .filter_map(|entry| {
                let path = entry.ok()?.path();
                let link = std::fs::read_link(&path).ok()?;
                link.to_string_lossy().contains("memfd").then_some((path, link))
            })
            .collect();
        assert!(!kept.is_empty());
        // The comparisons with the files on disk have their own descriptors of the same memory.
        let mut memories = BTreeSet::new();
        for (path, link) in &kept {
            assert_eq!(link, Path::new("/memfd:isotherm-profile (deleted)"));
            // A comparison may have ended since.
            let Ok(metadata) = std::fs::metadata(path) else { continue };
            memories.insert(metadata.ino());
            assert_eq!(metadata.permissions().mode() & 0o7777, 0o400);
            let written =
                std::fs::OpenOptions::new().write(true).open(path).and_then(|file| file.write_at(b"x", 0));
            assert!(written.is_err());
        }
        assert_eq!(memories.len(), 1, "{kept:?}");
        let (code, said) = service.restart(&[]);
        assert_eq!(code, Some(0), "{said}");
    }
}
