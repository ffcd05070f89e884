//! Runs the program on a file while a gateway compensates a machine. Measures what the program uses, and whether the
//! gateway is on time.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::rig::{Beside, Machine};

/// A directory for the files of one attack. A machine must be compensated on time while it exists.
pub(crate) struct Home {
    _beside: Beside,
    files: tempfile::TempDir,
}

/// Result of a run.
pub(crate) struct Seen {
    pub(crate) code: i64,
    pub(crate) seconds: f64,
    /// Seconds until its first output, or until its end without any.
    pub(crate) silent: f64,
    /// Peak memory in MB.
    pub(crate) peak: f64,
    pub(crate) said: String,
}

/// Memory in MB that the program may use in addition to ten times its input.
const BESIDE: f64 = 200.0;
/// Longest run in seconds. It is 10 s for an optimised program on an idle computer; neither applies here.
const LONGEST: f64 = 60.0;
/// Longest time in seconds without output.
const LONGEST_SILENT: f64 = 10.0;
/// Maximum output, in bytes.
const MOST_SAID: usize = 100_000;
/// Longest line of output, in characters: a quotation of 200 with its sentence, or a list.
const LONGEST_LINE: usize = 2_100;

/// Runs a program, and prints its result, duration and memory. A limit of 6 GB protects the computer.
const MEASURED: &str = "
import json, resource, subprocess, sys, threading, time
def bounded():
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
def read(pipe, said):
    while part := pipe.read1(65536):
        firsts.append(time.monotonic())
        said.append(part)
begun, firsts, said, out = time.monotonic(), [], [], []
done = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                        preexec_fn=bounded)
stops = threading.Timer(300, done.kill)
stops.start()
readers = [threading.Thread(target=read, args=of) for of in [(done.stdout, out), (done.stderr, said)]]
[reader.start() for reader in readers]
[reader.join() for reader in readers]
code, ended = done.wait(), time.monotonic()
stops.cancel()
print(json.dumps({
    'code': code,
    'seconds': ended - begun,
    'silent': min(firsts + [ended]) - begun,
    'peak': resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1000,
    'said': b''.join(said + out).decode(errors='replace'),
}))
";

impl Home {
    pub(crate) fn new() -> Home {
        Home { _beside: Machine::beside(), files: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.files.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, content).unwrap();
        path
    }
}

/// Runs a verb with a file as its last argument.
pub(crate) fn isotherm(arguments: &[&str], file: &Path) -> Seen {
    let output = Command::new("python3")
        .args(["-c", MEASURED, env!("CARGO_BIN_EXE_isotherm")])
        .args(arguments)
        .arg(file)
        .env("LC_ALL", "C.UTF-8")
        .output()
        .unwrap();
    let document: serde_json::Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|why| panic!("{why}: {}", String::from_utf8_lossy(&output.stderr)));
    Seen {
        code: document["code"].as_i64().unwrap(),
        seconds: document["seconds"].as_f64().unwrap(),
        silent: document["silent"].as_f64().unwrap(),
        peak: document["peak"].as_f64().unwrap(),
        said: document["said"].as_str().unwrap().to_owned(),
    }
}

impl Seen {
    /// Asserts that the run stayed within the limits for this file, regardless of its result. `input` is the size of
    /// the file in bytes.
    pub(crate) fn is_within(&self, input: u64) -> &Seen {
        let beginning: String = self.said.chars().take(2000).collect();
        let most = 10.0 * input as f64 / 1e6 + BESIDE;
        assert!(self.peak <= most, "{} MB of at most {most}: {beginning}", self.peak);
        assert!(self.seconds <= LONGEST, "{} s: {beginning}", self.seconds);
        assert!(self.silent <= LONGEST_SILENT, "not a word for {} s: {beginning}", self.silent);
        assert!(self.said.len() <= MOST_SAID, "{} bytes: {beginning}", self.said.len());
        let longest = self.said.lines().map(|line| line.chars().count()).max().unwrap_or_default();
        assert!(longest <= LONGEST_LINE, "a line of {longest} characters: {beginning}");
        assert!(!self.said.contains("panicked"), "{beginning}");
        self
    }

    /// Asserts that the file was rejected with a sentence that contains these words.
    pub(crate) fn is_refused(&self, input: u64, words: &[&str]) {
        let beginning: String = self.is_within(input).said.chars().take(2000).collect();
        assert!([1, 64].contains(&self.code), "exit code {}: {beginning}", self.code);
        for word in words {
            assert!(self.said.contains(word), "`{word}` is not in: {beginning}");
        }
    }
}

/// Size of a file in bytes.
pub(crate) fn size(file: &Path) -> u64 {
    std::fs::metadata(file).unwrap().len()
}
