//! The page in a real browser: what a person sees there while the demo runs.
//!
//! Needs chromium and python3; `tests/run page` installs both. Without them this test fails and says so.

use std::process::Command;

mod process;

use process::{Running, isotherm};

#[test]
fn a_browser_shows_the_running_machine() {
    let home = tempfile::tempdir().unwrap();
    let mut demo = isotherm(home.path());
    let mut demo =
        Running::start(demo.args(["demo", "--listen", "127.0.0.1:0", "--speed", "600", "--for", "24h"]));
    let address = demo.hears("page  http://").trim_start_matches("page  ").to_owned();
    // The first word is there once figures have arrived, the last one once the axis is armed.
    let words = ["Axis z", "compensating", "scale_z", "cnc_z", "verified", "holding:104", "armed"];
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let seen = Command::new("python3").arg(look).arg(address).args(words).output();
    let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let text = String::from_utf8_lossy(&seen.stdout);
    let said = String::from_utf8_lossy(&seen.stderr);
    assert!(
        seen.status.success(),
        "the page says:\n{text}\nthe browser says:\n{said}\n(without chromium: `tests/run page`)"
    );
    assert!(text.contains("Not a safety function"), "{text}");
    assert!(!text.contains("This page needs JavaScript"), "{text}");
}
