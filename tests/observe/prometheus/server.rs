//! Prometheus and promtool from the Debian package.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::Value;

use crate::prometheus::process::{Running, free_port, until};

/// A directory of the packaging files.
pub(crate) fn packaging(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("packaging").join(name)
}

/// Chapter of the manual about Prometheus.
pub(crate) fn chapter() -> String {
    std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/prometheus.md")).unwrap()
}

/// Program that `tests/run tools` has unpacked, or the one on the path.
fn program(name: &str) -> Command {
    let tools = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().join("tools");
    let unpacked = tools.join("prometheus/usr/bin").join(name);
    Command::new(if unpacked.is_file() { unpacked } else { name.into() })
}

/// Runs promtool in the directory of the rules, with this standard input. Returns its exit code and its output.
pub(crate) fn promtool(arguments: &[&str], stdin: &str) -> (i32, String) {
    let mut command = program("promtool");
    command.args(arguments).current_dir(packaging("prometheus"));
    let begun = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut begun =
        begun.unwrap_or_else(|error| panic!("no promtool ({error}): `tests/run tools` unpacks it"));
    // promtool may end before it has read all.
    let _ = begun.stdin.take().unwrap().write_all(stdin.as_bytes());
    let ended = begun.wait_with_output().unwrap();
    let said = [ended.stdout, ended.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (ended.status.code().unwrap(), said)
}

/// A running Prometheus.
pub(crate) struct Prometheus {
    _running: Running,
    port: u16,
}

impl Prometheus {
    /// Starts Prometheus with this configuration, and with its data in this directory.
    pub(crate) fn start(configuration: &Path, home: &Path) -> Prometheus {
        let port = free_port();
        let mut command = program("prometheus");
        command
            .arg(format!("--config.file={}", configuration.display()))
            .arg(format!("--storage.tsdb.path={}", home.join("data").display()))
            .arg(format!("--web.listen-address=127.0.0.1:{port}"))
            .arg("--log.level=warn")
            .current_dir(home);
        let started = Prometheus { _running: Running::start(&mut command), port };
        until("Prometheus is ready", || match started.get("/-/ready") {
            Some((200, _)) => Ok(()),
            other => Err(format!("{other:?}")),
        });
        started
    }

    /// Sends a request. Returns status code and body; `None` while Prometheus does not listen yet.
    fn get(&self, path: &str) -> Option<(u16, String)> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).ok()?;
        // HTTP/1.0 has no chunked encoding.
        write!(stream, "GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n").ok()?;
        let mut text = String::new();
        stream.read_to_string(&mut text).ok()?;
        let (head, body) = text.split_once("\r\n\r\n")?;
        Some((head.split(' ').nth(1)?.parse().ok()?, body.to_owned()))
    }

    fn data(&self, path: &str) -> Value {
        let (code, body) = self.get(path).unwrap();
        let mut answer: Value = serde_json::from_str(&body).unwrap_or_else(|error| panic!("{error}: {body}"));
        assert_eq!((code, answer["status"].as_str()), (200, Some("success")), "{path}: {body}");
        answer["data"].take()
    }

    /// Current values of a query.
    pub(crate) fn values(&self, query: &str) -> Vec<f64> {
        let data =
            self.data(&format!("/api/v1/query?query={}", utf8_percent_encode(query, NON_ALPHANUMERIC)));
        let found = data["result"].as_array().unwrap().iter();
        found.map(|found| found["value"][1].as_str().unwrap().parse().unwrap()).collect()
    }

    /// Health and last scrape error of every target.
    pub(crate) fn targets(&self) -> Vec<(String, String)> {
        let data = self.data("/api/v1/targets");
        let of = |target: &Value, key: &str| target[key].as_str().unwrap().to_owned();
        let targets = data["activeTargets"].as_array().unwrap().iter();
        targets.map(|target| (of(target, "health"), of(target, "lastError"))).collect()
    }

    /// Name, evaluation health and state of every alarm.
    pub(crate) fn alarms(&self) -> Vec<[String; 3]> {
        let data = self.data("/api/v1/rules");
        let groups = data["groups"].as_array().unwrap().iter();
        let rules = groups.flat_map(|group| group["rules"].as_array().unwrap());
        rules
            .map(|rule| ["name", "health", "state"].map(|key| rule[key].as_str().unwrap().to_owned()))
            .collect()
    }
}
