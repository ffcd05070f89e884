//! Program `isotherm` with the verb `run`, as it runs on a machine.

use std::fs::File;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;

use super::process::Process;

pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_isotherm");

/// Profile in a new directory, which exists until this value is dropped.
pub(crate) struct Written {
    directory: TempDir,
    pub(crate) path: PathBuf,
}

impl Written {
    pub(crate) fn new(profile: &str) -> Written {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("bench.toml");
        std::fs::write(&path, profile).unwrap();
        Written { directory, path }
    }
}

/// Running gateway with a web page. Its state and its log are in the directory of its profile.
pub(crate) struct Running {
    pub(crate) process: Process,
    /// Address of the web page.
    page: String,
    profile: Written,
}

impl Running {
    pub(crate) fn start(profile: &str) -> Running {
        let profile = Written::new(profile);
        let page = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
        let log = File::create(profile.directory.path().join("log")).unwrap();
        let mut command = Command::new(PROGRAM);
        command.arg("run").arg(&profile.path).arg("--state").arg(profile.directory.path());
        command.arg("--listen").arg(&page);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        Running { process: Process::start(&mut command), page, profile }
    }

    /// Requests a path of the web page, and returns the answer with its head. The answer of a stream ends with its first
    /// event.
    pub(crate) fn get(&self, path: &str) -> Vec<u8> {
        let mut stream = TcpStream::connect(&self.page).unwrap();
        let host = &self.page;
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let (mut answer, mut bytes) = (Vec::new(), vec![0; 1 << 16]);
        loop {
            let count = stream.read(&mut bytes).unwrap();
            answer.extend_from_slice(&bytes[..count]);
            // Two line breaks end an event, and one more its chunk.
            if count == 0 || answer.ends_with(b"\n\n\r\n") {
                break;
            }
        }
        assert!(answer.starts_with(b"HTTP/1.1 200"), "{path}: {}", String::from_utf8_lossy(&answer));
        answer
    }

    /// Returns the state of the gateway.
    pub(crate) fn status(&self) -> Value {
        let answer = self.get("/api/status");
        let head = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap();
        serde_json::from_slice(&answer[head + 4..]).unwrap()
    }

    /// Returns the last lines of the log, for the message of a failed benchmark.
    pub(crate) fn log(&self) -> String {
        let text = std::fs::read_to_string(self.profile.directory.path().join("log")).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(10)..].join("\n")
    }
}
