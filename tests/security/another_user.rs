//! Attacks by a user of this computer who is neither the gateway's user nor in its group.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::on_time::OnTime;
use crate::process::{Running, file, isotherm};
use crate::rig::{EVERY, walker};

/// Copies the program to a place where any user may start it.
fn program(open: &Path) -> PathBuf {
    let program = open.join("isotherm");
    let built = env!("CARGO_BIN_EXE_isotherm");
    std::fs::hard_link(built, &program).or_else(|_| std::fs::copy(built, &program).map(drop)).unwrap();
    program
}

fn mode(path: &Path, mode: u32) {
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
}

#[test]
fn who_may_not_command_a_gateway_that_runs_reads_that_it_runs_and_who_may() {
    let (home, open) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    mode(home.path(), 0o755);
    mode(open.path(), 0o755);
    let (device, text) = walker();
    let text = text.replacen("name = \"walker\"", "name = \"of-another-user\"", 1);
    let profile = file(home.path(), "machine.toml", &text);
    let state = home.path().join("state");
    let mut run = isotherm(home.path());
    run.arg("run").arg(&profile).args(["--listen", "127.0.0.1:0", "--state"]).arg(&state);
    let mut gateway = Running::start(&mut run);
    gateway.receives("the gateway runs");
    let _on_time = OnTime::from_now(&device, EVERY, gateway.id());
    let is_root = rustix::process::geteuid().is_root();
    let another = |verb: &str, more: &[&Path]| {
        let mut command = if is_root {
            let mut command = Command::new("setpriv");
            command
                .args(["--reuid", "65534", "--regid", "65534", "--clear-groups"])
                .arg(program(open.path()));
            command
        } else {
            Command::new(env!("CARGO_BIN_EXE_isotherm"))
        };
        command.env_clear().env("HOME", "/nonexistent").env("PATH", std::env::var_os("PATH").unwrap());
        let ended = command.arg(verb).arg(&profile).args(more).output().unwrap();
        let _ = std::fs::remove_file(open.path().join("isotherm"));
        (ended.status.code(), String::from_utf8_lossy(&ended.stderr).into_owned())
    };
    if !is_root {
        // Without another user, the test uses a socket that its own user may not use.
        mode(&state.join("of-another-user.sock"), 0o000);
    }
    for more in [&[][..], &[Path::new("--state"), &state]] {
        for verb in ["disarm", "arm", "status"] {
            let (code, said) = another(verb, more);
            assert_eq!(code, Some(1), "{verb}: {said}");
            assert!(said.contains("the gateway runs, but you may not command it"), "{verb}: {said}");
            assert!(said.contains("run this as user ") && said.contains("member of group "), "{said}");
            assert!(!said.contains("no gateway"), "{said}");
        }
    }
    let (code, said) =
        another("run", &[Path::new("--listen"), Path::new("127.0.0.1:0"), Path::new("--state"), &state]);
    assert_eq!(code, Some(1), "{said}");
    assert!(!gateway.has_ended(), "{:?}", gateway.so_far());
}
