//! Gateway of one axis, its device, and its clients.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Command, Output};
use std::time::Duration;

use serde_json::Value;

use crate::commands::device::{Device, Times, profile};
use crate::commands::process::{Running, file, isotherm, until};

/// Times of the bench. The device is in this process and answers late on a busy computer, which is not its fault.
const TIMES: Times = Times {
    timeout: Duration::from_secs(2),
    every: Duration::from_millis(500),
    max_age: Duration::from_secs(5),
};
/// Raw value of the device for a broken thermocouple.
pub(crate) const OPEN_CIRCUIT: i16 = -999;

pub(crate) struct Bench {
    pub(crate) home: tempfile::TempDir,
    pub(crate) device: Device,
    pub(crate) profile: PathBuf,
    pub(crate) gateway: Running,
    pub(crate) page: String,
}

impl Bench {
    /// Bench whose axis is off until an operator arms it.
    pub(crate) fn manual() -> Bench {
        Bench::of(|text| text.replace("arm = \"auto\"", "arm = \"manual\"\narm_timeout = \"2min\""))
    }

    pub(crate) fn of(change: impl FnOnce(String) -> String) -> Bench {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        let home = tempfile::tempdir().unwrap();
        let bad = "unit = \"degC\"\nbad = [{ raw = -999, means = \"open circuit\" }]";
        let text =
            profile(device.address(), TIMES).replacen("unit = \"degC\"", bad, 1).replace("100ms", "5ms");
        // The buttons of the page work for every user of this computer.
        let text = change(text) + "\n[web]\ncommands = \"local\"\n";
        let profile = file(home.path(), "walker.toml", &text);
        let (gateway, page) = start(&home, &profile);
        let bench = Bench { home, device, profile, gateway, page };
        bench.axis();
        bench
    }

    /// Stops the gateway in order, and starts another one.
    pub(crate) fn restart(&mut self) {
        self.gateway.signal("TERM");
        self.gateway.ends_within(Duration::from_secs(60));
        (self.gateway, self.page) = start(&self.home, &self.profile);
    }

    /// Starts another gateway after one was killed.
    pub(crate) fn restart_killed(&mut self) {
        (self.gateway, self.page) = start(&self.home, &self.profile);
    }

    /// Output of `isotherm events`, with its warnings.
    pub(crate) fn events_and_warnings(&self) -> String {
        let mut said = String::new();
        until("the last start is reported", || {
            said = self.ask(&["events", "--json"]).1;
            let starts = said.matches("\"kind\":\"started\"").count();
            if starts > 2 { Ok(()) } else { Err(said.clone()) }
        });
        said
    }

    /// Command line of a verb for this machine.
    pub(crate) fn verb(&self, words: &[&str]) -> Command {
        let mut command = isotherm(self.home.path());
        let (verb, options) = words.split_first().unwrap();
        command.arg(verb).arg(&self.profile).args(options).arg("--state").arg(self.home.path().join("state"));
        command
    }

    /// Runs a verb, as soon as the rate limit allows it. Returns its exit code and its output.
    pub(crate) fn ask(&self, words: &[&str]) -> (i32, String) {
        loop {
            let Output { status, stdout, stderr } = self.verb(words).output().unwrap();
            let said = [stdout, stderr].map(|said| String::from_utf8(said).unwrap()).concat();
            if !said.contains("less than a second ago") {
                return (status.code().unwrap(), said);
            }
        }
    }

    /// Events that `isotherm events` prints with these options, up to the last one on the page. An event is in the file
    /// shortly after it is on the page.
    pub(crate) fn events(&self, options: &[&str]) -> Vec<Value> {
        let read = |options: &[&str]| -> Vec<Value> {
            let (code, said) = self.ask(&[&["events", "--json"], options].concat());
            assert_eq!(code, 0, "{said}");
            said.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("{line}"))).collect()
        };
        let status = self.status();
        let last = status["events"].as_array().unwrap().last();
        let is_last = |event: &Value| {
            ["at", "kind", "text"].iter().all(|of| Some(&event[of]) == last.map(|last| &last[of]))
        };
        until("it is in the file of events", || match read(&[]) {
            events if last.is_none() || events.iter().any(is_last) => Ok(()),
            events => Err(format!("{last:?} is not among {events:#?}")),
        });
        read(options)
    }

    /// Texts of the events of a kind.
    pub(crate) fn reported(&self, kind: &str) -> Vec<String> {
        let events = self.events(&[]).into_iter().filter(|event| event["kind"] == kind);
        events.map(|event| event["text"].as_str().unwrap().to_owned()).collect()
    }

    pub(crate) fn status(&self) -> Value {
        let (code, body) = self.http("GET", "/api/status", "");
        assert_eq!(code, 200, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    pub(crate) fn axis(&self) -> Value {
        self.status()["axes"][0].clone()
    }

    /// Number of events of a kind since the start.
    pub(crate) fn count(&self, kind: &str) -> u64 {
        self.status()["event_counts"][kind].as_u64().unwrap_or_default()
    }

    /// Waits until the axis is in this state.
    #[track_caller]
    pub(crate) fn is_in_state(&self, state: &str) -> Value {
        until(state, || match self.axis() {
            axis if axis["state"] == state => Ok(()),
            axis => Err(axis.to_string()),
        });
        self.axis()
    }

    /// Waits until the axis waits for this condition.
    #[track_caller]
    pub(crate) fn why(&self, why: &str) {
        until(why, || match self.axis() {
            axis if axis["why"].as_str().unwrap().contains(why) => Ok(()),
            axis => Err(axis.to_string()),
        });
    }

    /// Request of a program, or of the page with its header, as soon as the rate limit allows it.
    pub(crate) fn http(&self, method: &str, path: &str, headers: &str) -> (u16, String) {
        loop {
            match answer(self.begin_http(method, path, headers)) {
                (429, _) => std::thread::sleep(Duration::from_millis(50)),
                answered => return answered,
            }
        }
    }

    pub(crate) fn begin_http(&self, method: &str, path: &str, headers: &str) -> TcpStream {
        let mut stream = TcpStream::connect(&self.page).unwrap();
        let host = &self.page;
        let head = format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{headers}\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        stream
    }
}

pub(crate) fn answer(mut stream: TcpStream) -> (u16, String) {
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap();
    let code = head.split(' ').nth(1).unwrap().parse().unwrap();
    let is_chunked = head.to_ascii_lowercase().contains("transfer-encoding: chunked");
    assert!(!is_chunked, "{head}");
    (code, body.to_owned())
}

fn start(home: &tempfile::TempDir, profile: &PathBuf) -> (Running, String) {
    let mut command = isotherm(home.path());
    command.arg("run").arg(profile).arg("--state").arg(home.path().join("state"));
    let mut gateway = Running::start(command.args(["--listen", "127.0.0.1:0"]));
    let page = gateway.receives("page http://").replace("page http://", "");
    (gateway, page)
}
