//! Log of a gateway whose standard error is the journal.

use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::Stdio;

use crate::service::process::{file, isotherm};

const WRONG: &str = "[machine]\nname = \"walker\"\nnane = \"walker\"\n";

/// Output of a run with a wrong profile. The journal is the file that it gets, or another stream.
fn said(directory: &Path, is_the_journal: bool) -> String {
    let profile = file(directory, "wrong.toml", WRONG);
    let path = directory.join("stderr");
    let stderr = File::create(&path).unwrap();
    let about = stderr.metadata().unwrap();
    let inode = about.ino() + u64::from(!is_the_journal);
    let mut command = isotherm(directory);
    command.env("JOURNAL_STREAM", format!("{}:{inode}", about.dev())).arg("--log").arg("debug");
    let status = command.arg("run").arg(profile).stderr(Stdio::from(stderr)).status().unwrap();
    assert_eq!(status.code(), Some(64));
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn in_the_journal_every_line_begins_with_its_priority() {
    let home = tempfile::tempdir().unwrap();
    let text = said(home.path(), true);
    assert!(text.contains("nane"), "{text}");
    assert!(text.lines().all(|line| line.starts_with("<3>")), "{text}");
}

#[test]
fn in_a_file_that_is_not_the_journal_none_does() {
    let home = tempfile::tempdir().unwrap();
    let text = said(home.path(), false);
    assert!(text.contains("nane") && !text.contains('<'), "{text}");
}

#[test]
fn a_gateway_logs_with_priorities_and_without_times() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("stderr");
    let stderr = File::create(&path).unwrap();
    let about = stderr.metadata().unwrap();
    let text = crate::service::device::profile(
        std::net::SocketAddr::from(([127, 0, 0, 1], crate::service::process::free_port())),
        crate::service::device::Times {
            timeout: std::time::Duration::from_millis(200),
            every: std::time::Duration::from_millis(500),
            max_age: std::time::Duration::from_secs(2),
        },
    );
    let profile = file(home.path(), "walker.toml", &text);
    let mut command = isotherm(home.path());
    command.env("JOURNAL_STREAM", format!("{}:{}", about.dev(), about.ino())).arg("run").arg(profile);
    let mut gateway = command.stdout(Stdio::null()).stderr(Stdio::from(stderr)).spawn().unwrap();
    let said = || std::fs::read_to_string(&path).unwrap();
    crate::service::process::until("the line that is down is logged", || match said() {
        text if text.contains("<4>bus cell") && text.contains("<6>walker: the gateway runs") => Ok(()),
        text => Err(text),
    });
    gateway.kill().unwrap();
    gateway.wait().unwrap();
    assert!(said().lines().all(|line| line.starts_with("<4>") || line.starts_with("<6>")), "{}", said());
}
