//! Backup of a machine to one file while its gateway runs, and restore: to another place, and never over newer data.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::commands::bench::Bench;
use crate::commands::process::{Running, isotherm, until};

fn said(command: &mut Command) -> (i32, String) {
    let output = command.output().unwrap();
    let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (output.status.code().unwrap(), said)
}

/// Machine with this name. A restore is refused while a gateway of the same name runs, also in another test.
fn named(name: &str) -> Bench {
    Bench::of(|text| text.replace("name = \"walker\"", &format!("name = \"{name}\"")))
}

fn restore(bench: &Bench, file: &Path, to: &Path, state: &Path) -> (i32, String) {
    let mut command = isotherm(bench.home.path());
    said(command.arg("restore").arg(file).arg("--to").arg(to).arg("--state").arg(state))
}

fn backup(bench: &Bench, name: &str, options: &[&str]) -> std::path::PathBuf {
    let file = bench.home.path().join(name);
    let words = [&["backup", file.to_str().unwrap()], options].concat();
    let (code, said) = bench.ask(&words);
    assert_eq!(code, 0, "{said}");
    file
}

fn stop(bench: &mut Bench) {
    bench.gateway.signal("TERM");
    bench.gateway.ends_within(Duration::from_secs(20));
}

#[test]
fn a_backup_of_a_running_gateway_goes_on_elsewhere_and_moves_nothing_before_a_person_arms() {
    let mut bench = named("goes-on");
    until("the axis is armed", || match bench.axis()["state"].as_str() {
        Some("active") => Ok(()),
        other => Err(format!("{other:?}")),
    });
    until("the state is kept", || match bench.home.path().join("state/goes-on.state.json").exists() {
        true => Ok(()),
        false => Err("no state yet".to_owned()),
    });
    let file = backup(&bench, "walker.tar", &[]);
    let elsewhere = bench.home.path().join("elsewhere");
    let (code, said_beside) = restore(&bench, &file, &elsewhere, &elsewhere.join("state"));
    assert!(
        code == 1 && said_beside.contains("the gateway of goes-on runs on this computer: stop it"),
        "{said_beside}"
    );
    assert!(!elsewhere.exists());

    stop(&mut bench);
    let (code, reported) = restore(&bench, &file, &elsewhere, &elsewhere.join("state"));
    assert!(code == 0 && reported.contains("Every axis is off until an operator arms it"), "{reported}");
    let same = |name: &str| std::fs::read(elsewhere.join(name)).unwrap();
    assert_eq!(same("walker.toml"), std::fs::read(&bench.profile).unwrap());

    let mut next = isotherm(bench.home.path());
    next.arg("run").arg(elsewhere.join("walker.toml")).arg("--state").arg(elsewhere.join("state"));
    let mut gateway = Running::start(next.args(["--listen", "127.0.0.1:0"]));
    gateway.receives("http://");
    let status = || {
        let mut command = isotherm(bench.home.path());
        command.arg("status").arg(elsewhere.join("walker.toml")).arg("--json");
        said(command.arg("--state").arg(elsewhere.join("state")))
    };
    until("it says why it is off", || match status() {
        (0, text) if text.contains("from a backup") => Ok(()),
        (_, text) => Err(text),
    });
    gateway.signal("TERM");
    gateway.ends_within(Duration::from_secs(20));
}

#[test]
fn a_restored_machine_keeps_what_it_learned() {
    let mut bench = named("learned-much");
    until("the state is kept", || match bench.home.path().join("state/learned-much.state.json").exists() {
        true => Ok(()),
        false => Err("no state yet".to_owned()),
    });
    let products = bench.home.path().join("state/learned-much.products");
    std::fs::create_dir(&products).unwrap();
    let saved = ["z.learning.json", "z.candidate.json", "z@2026-01-05T06:00:00Z.products.json"];
    for name in [&saved[..], &["notes.txt"]].concat() {
        std::fs::write(products.join(name), name).unwrap();
    }
    let file = bench.home.path().join("walker.tar");
    let (code, reported) = bench.ask(&["backup", file.to_str().unwrap()]);
    assert!(code == 0 && reported.contains("3 of them with learned data"), "{reported}");
    stop(&mut bench);
    let elsewhere = bench.home.path().join("elsewhere");
    let (code, reported) = restore(&bench, &file, &elsewhere, &elsewhere.join("state"));
    assert!(code == 0 && reported.contains("learned from touches: 3 files"), "{reported}");
    let restored = elsewhere.join("state/learned-much.products");
    for name in saved {
        assert_eq!(std::fs::read_to_string(restored.join(name)).unwrap(), name);
    }
    assert_eq!(std::fs::read_dir(&restored).unwrap().count(), saved.len());

    // What was learned after the backup is not replaced.
    std::fs::remove_dir_all(&elsewhere).unwrap();
    std::fs::create_dir_all(&restored).unwrap();
    std::fs::write(restored.join("z.learning.json"), "newer").unwrap();
    let (code, reported) = restore(&bench, &file, &elsewhere, &elsewhere.join("state"));
    assert!(code == 1 && reported.contains("z.learning.json is newer than the backup"), "{reported}");
    assert!(reported.contains("--state DIR"), "{reported}");
    assert!(!elsewhere.join("walker.toml").exists());
}

#[test]
fn a_restore_over_a_newer_state_or_a_newer_profile_is_refused_and_nothing_is_written() {
    let mut bench = named("newer");
    until("the state is kept", || match bench.home.path().join("state/newer.state.json").exists() {
        true => Ok(()),
        false => Err("no state yet".to_owned()),
    });
    let file = backup(&bench, "walker.tar", &[]);
    stop(&mut bench);
    let state = bench.home.path().join("state");
    let (code, reported) = restore(&bench, &file, bench.home.path(), &state);
    assert!(code == 1 && reported.contains("newer"), "{reported}");

    let text = std::fs::read_to_string(&bench.profile).unwrap();
    std::thread::sleep(Duration::from_millis(20));
    std::fs::write(&bench.profile, format!("{text}# changed since\n")).unwrap();
    let empty = bench.home.path().join("empty");
    let (code, reported) = restore(&bench, &file, bench.home.path(), &empty);
    assert!(code == 1 && reported.contains("walker.toml is newer than the backup"), "{reported}");
    assert!(!empty.exists() && std::fs::read_to_string(&bench.profile).unwrap().contains("changed since"));
}

#[test]
fn a_token_is_in_a_backup_only_with_secrets_and_then_nobody_else_may_read_it() {
    let mut bench = named("secret");
    stop(&mut bench);
    let tokens = ["operator.token", "scrape.token", "hook.token"].map(|name| bench.home.path().join(name));
    for token in &tokens {
        let (code, reported) = said(isotherm(bench.home.path()).args(["token", "--out"]).arg(token));
        assert_eq!(code, 0, "{reported}");
    }
    let text = std::fs::read_to_string(&bench.profile).unwrap();
    let text = text.replace(
        "commands = \"local\"",
        "token_file = \"operator.token\"\nscrape_token_file = \"scrape.token\"",
    );
    let posts = "[[notify]]\nurl = \"https://hooks.example/{token}\"\non = [\"alarm\"]\ntoken_file = \"hook.token\"\n";
    std::fs::write(&bench.profile, text + posts).unwrap();
    let secrets = tokens.map(|token| std::fs::read(token).unwrap());
    let holds = |file: &Path| {
        let bytes = std::fs::read(file).unwrap();
        secrets.each_ref().map(|secret| bytes.windows(secret.len()).any(|part| part == secret))
    };
    let mode = |file: &Path| std::fs::metadata(file).unwrap().permissions().mode() & 0o777;

    let without = backup(&bench, "without.tar", &[]);
    assert_eq!(holds(&without), [false; 3]);
    let with = backup(&bench, "with.tar", &["--secrets"]);
    assert_eq!(holds(&with), [true; 3]);
    assert_eq!((mode(&without), mode(&with)), (0o640, 0o600));

    let elsewhere = bench.home.path().join("elsewhere");
    let (code, reported) = restore(&bench, &with, &elsewhere, &elsewhere.join("state"));
    assert_eq!(code, 0, "{reported}");
    for name in ["operator.token", "scrape.token"] {
        assert_eq!(mode(&elsewhere.join(name)), 0o600, "{name}");
    }
    let (code, reported) = bench.ask(&["backup", with.to_str().unwrap()]);
    assert!(
        code == 1 && reported.contains("exists already: give another name"),
        "one that is there is not touched: {reported}"
    );
}

#[cfg(feature = "opcua")]
#[test]
fn passwords_and_keys_of_every_kind_of_line_are_secret_and_what_is_put_back_is_its_directory_s_owner_s() {
    use std::os::unix::fs::MetadataExt;

    let mut bench = named("sealed-lines");
    stop(&mut bench);
    let home = bench.home.path();
    std::fs::create_dir(home.join("trusted")).unwrap();
    std::fs::write(home.join("opcua.password"), "a password that nobody has\n").unwrap();
    let line = |name: &str, user: &str| {
        format!(
            "[bus.{name}]\ntype = \"opcua\"\naddress = \"opc.tcp://127.0.0.1:1\"\nsecurity = \"sign-and-encrypt\"\n\
             cert = \"own.der\"\nkey = \"own.pem\"\ntrusted = \"trusted\"\nuser = {{ {user} }}\n[device.{name}]\nbus = \"{name}\"\n\
             [signal.{name}]\ndevice = \"{name}\"\nnode = \"ns=2;s=bed\"\nunit = \"degC\"\n"
        )
    };
    let profile = |lines: &str| {
        let text = std::fs::read_to_string(&bench.profile).unwrap();
        std::fs::write(&bench.profile, text + lines).unwrap();
    };
    profile(&line("by-name", "name = \"isotherm\", password_file = \"opcua.password\""));
    let (code, reported) = said(isotherm(home).args(["opcua", "certificate"]).arg(&bench.profile));
    assert_eq!(code, 0, "{reported}");
    for (from, to) in [("own.der", "user.der"), ("own.der", "trusted/server.der"), ("own.pem", "user.pem")] {
        std::fs::copy(home.join(from), home.join(to)).unwrap();
    }
    profile(&line("by-certificate", "cert = \"user.der\", key = \"user.pem\""));

    let without = backup(&bench, "without.tar", &[]);
    let secret = ["opcua.password", "own.pem", "user.pem"];
    let holds = |file: &Path, name: &str| {
        let held = std::fs::read(home.join(name)).unwrap();
        std::fs::read(file).unwrap().windows(held.len()).any(|part| part == held)
    };
    assert!(secret.iter().all(|name| !holds(&without, name)) && holds(&without, "trusted/server.der"));

    let with = backup(&bench, "with.tar", &["--secrets"]);
    assert!(secret.iter().all(|name| holds(&with, name)));
    let elsewhere = home.join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    // Root restores for another user; other users restore for themselves.
    let owner =
        if rustix::process::geteuid().is_root() { 65534 } else { rustix::process::geteuid().as_raw() };
    std::os::unix::fs::chown(&elsewhere, Some(owner), None).unwrap();
    let (code, reported) = restore(&bench, &with, &elsewhere, &elsewhere.join("state"));
    assert_eq!(code, 0, "{reported}");
    let found = |name: &str| std::fs::metadata(elsewhere.join(name)).unwrap();
    for name in secret {
        assert_eq!((found(name).mode() & 0o777, found(name).uid()), (0o600, owner), "{name}");
    }
    let found = found(bench.profile.file_name().unwrap().to_str().unwrap());
    assert_eq!((found.mode() & 0o777, found.uid()), (0o644, owner));
}

#[test]
fn of_the_backups_in_a_directory_the_newest_are_kept_and_other_files_are_not_touched() {
    let mut bench = named("rotated");
    let home = bench.home.path().to_owned();
    let directory = home.join("backups");
    let rotate = |copies: &str| {
        let mut command = isotherm(&home);
        command.arg("backup").arg(&bench.profile).arg("--rotate").arg(&directory).args(["--copies", copies]);
        said(command.arg("--state").arg(home.join("state")))
    };
    let (code, reported) = rotate("2");
    assert!(code == 1 && reported.contains("does not exist: create it, or mount its drive"), "{reported}");
    std::fs::create_dir(&directory).unwrap();
    until("the state is kept", || match home.join("state/rotated.state.json").exists() {
        true => Ok(()),
        false => Err("no state yet".to_owned()),
    });
    let [first, second, other] =
        ["rotated-2020-01-01T02-15-00Z.tar", "rotated-2020-01-02T02-15-00Z.tar", "rotated-notes.tar"];
    for name in [first, second, other] {
        std::fs::write(directory.join(name), name).unwrap();
    }
    let (code, reported) = rotate("2");
    assert!(
        code == 0 && reported.contains(&format!("removed: {}", directory.join(first).display())),
        "{reported}"
    );
    let names = || {
        let entries = std::fs::read_dir(&directory).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<String> = entries.map(|name| name.into_string().unwrap()).collect();
        names.sort();
        names
    };
    let found = names();
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(found.contains(&second.to_owned()) && found.contains(&other.to_owned()), "{found:?}");
    let new = found.iter().find(|name| *name != second && *name != other).unwrap();
    assert!(new.starts_with("rotated-2") && new.ends_with("Z.tar"), "{new}");
    for wrong in ["0", "-1", "two"] {
        assert_eq!(rotate(wrong).0, 2, "{wrong}");
    }
    let both = said(isotherm(&home).arg("backup").arg(&bench.profile).args(["a.tar", "--rotate", "."]));
    assert_eq!(both.0, 2, "{both:?}");
    let (file, elsewhere) = (directory.join(new), home.join("elsewhere"));
    stop(&mut bench);
    let (code, reported) = restore(&bench, &file, &elsewhere, &elsewhere.join("state"));
    assert_eq!(code, 0, "{reported}");
    // After a wrong --state, a backup without state replaces none that has it.
    let apart = home.join("apart");
    std::fs::create_dir(&apart).unwrap();
    std::fs::write(apart.join(first), first).unwrap();
    let mut stateless = isotherm(&home);
    stateless.arg("backup").arg(&bench.profile).arg("--rotate").arg(&apart).args(["--copies", "1"]);
    let (code, reported) = said(stateless.arg("--state").arg(home.join("no-state")));
    assert!(code == 0 && reported.contains("no older backup is removed"), "{reported}");
    assert!(apart.join(first).exists());
}

#[test]
fn nothing_is_restored_through_a_link() {
    let mut bench = named("linked");
    let file = backup(&bench, "walker.tar", &[]);
    stop(&mut bench);
    let elsewhere = bench.home.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    std::os::unix::fs::symlink(bench.home.path().join("victim"), elsewhere.join("walker.toml")).unwrap();
    let (code, reported) = restore(&bench, &file, &elsewhere, &elsewhere.join("state"));
    assert!(code == 1 && reported.contains("is a link"), "{reported}");
    assert!(!bench.home.path().join("victim").exists());
}

#[test]
fn a_directory_that_cannot_be_made_is_named() {
    let mut bench = named("nowhere");
    let file = backup(&bench, "walker.tar", &[]);
    stop(&mut bench);
    let (elsewhere, below) = (bench.home.path().join("elsewhere"), file.join("below"));
    for (to, state) in [(&below, &elsewhere), (&elsewhere, &below)] {
        let (code, reported) = restore(&bench, &file, to, state);
        assert!(code == 1 && reported.contains(&below.display().to_string()), "{reported}");
    }
}
