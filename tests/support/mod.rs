//! Counterparts and helpers that several tests share.

#![allow(dead_code, unused_imports, reason = "each test program uses its part")]

pub(crate) mod calculix;
pub(crate) mod certificates;
pub(crate) mod device;
pub(crate) mod encode;
pub(crate) mod fake;
pub(crate) mod frames;
pub(crate) mod process;
pub(crate) mod starved;
pub(crate) mod tree;

use std::io::Write;

/// Prints a line that `tests/run` adds to its summary. Other output of a test is lost if the test passes.
pub(crate) fn tell(line: &str) {
    println!("{line}");
    if let Some(path) = std::env::var_os("TEST_TELLS") {
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(path).unwrap();
        writeln!(file, "{line}").unwrap();
    }
}
