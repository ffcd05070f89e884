//! Simulated gateway behind the real listener, and a client that speaks HTTP/1.1 by hand.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a helper of tests")]
#![allow(dead_code, reason = "each of the tests uses its part")]

use std::collections::BTreeMap;
use std::fs::Permissions;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use isotherm::observe::events::file::FileItem;
use isotherm::observe::events::{Entry, Event, Level};
use isotherm::observe::http::{Admission, TokenFile, serve};
use isotherm::observe::requester::Requester;
use isotherm::observe::status::{
    Answer, ArmingStatus, AxisStatus, BusStatus, CandidateStatus, Command, DeviceStatus, GainStatus,
    GatewayApi, LearnedStatus, OutputStatus, ProbeStatus, ProbedStatus, ReleaseRequest, SignalStatus, Status,
};
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::display::Display;
use isotherm_core::quantity::Moment;
use isotherm_profile::Commands;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

pub(crate) struct Fake {
    status: Mutex<Status>,
    commands: Mutex<Vec<Command>>,
    measured: Mutex<Vec<(String, Option<MeasuredReport>)>>,
    askers: Mutex<Vec<String>>,
    asked: AtomicUsize,
    logs: Mutex<Option<Vec<PathBuf>>>,
    /// Lock of the disk. Reading hangs while a test holds it.
    pub(crate) disk: Mutex<()>,
}

impl Default for Fake {
    fn default() -> Fake {
        Fake {
            status: Mutex::new(status()),
            commands: Mutex::default(),
            measured: Mutex::default(),
            askers: Mutex::default(),
            asked: AtomicUsize::new(0),
            logs: Mutex::default(),
            disk: Mutex::default(),
        }
    }
}

impl GatewayApi for Fake {
    fn status(&self) -> Status {
        self.asked.fetch_add(1, Ordering::Relaxed);
        self.status.lock().unwrap().clone()
    }

    fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String> {
        self.commands.lock().unwrap().push(command);
        self.askers.lock().unwrap().push(format!("{requester:?} {}", axis.unwrap_or("all")));
        match command {
            Command::Arm if axis == Some("slow") => {
                Ok(Answer::Waits("slow: waiting to arm: bed: stale".into()))
            }
            Command::Arm => Ok(Answer::Done("axis z armed".into())),
            Command::Disarm => Ok(Answer::Done("axis z is off".into())),
            Command::Zero => Err("axis z moves".into()),
            Command::Cancel => Ok(Answer::Done("z: the request to arm is cancelled".into())),
            Command::Sign | Command::Signed(_) => Ok(Answer::Done("z: as you say".into())),
            Command::Adopt | Command::AdoptBack => Ok(Answer::Done("axis z follows another model".into())),
        }
    }

    fn arming(&self, _: Option<&str>) -> Result<Answer, String> {
        Err("axis z is not armed".into())
    }

    fn signing(&self, axis: Option<&str>) -> Result<Answer, String> {
        self.arming(axis)
    }

    fn confirm(&self, device: &str, requester: &Requester) -> Result<Answer, String> {
        self.askers.lock().unwrap().push(format!("{requester:?} has confirmed {device}"));
        Ok(Answer::Done(format!("device {device} is confirmed")))
    }

    fn release(
        &self,
        output: &str,
        wish: ReleaseRequest<'_>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        self.askers.lock().unwrap().push(format!("{requester:?} has asked for {output}: {wish:?}"));
        Ok(Answer::Done(format!("output {output} is released")))
    }

    fn acknowledge(&self, alarm: Option<&str>, requester: &Requester) -> Result<Answer, String> {
        self.askers.lock().unwrap().push(format!("{requester:?} has seen {}", alarm.unwrap_or("all")));
        match alarm {
            Some("nothing") => Err("there is no such alarm".into()),
            _ => Ok(Answer::Done("one alarm acknowledged".into())),
        }
    }

    fn logs(&self, _: Moment, _: Moment) -> Option<Vec<PathBuf>> {
        drop(self.disk.lock());
        self.logs.lock().unwrap().clone()
    }

    fn turned_away(&self, command: &str, requester: &Requester, why: &str) {
        self.askers.lock().unwrap().push(format!("{requester:?} {command} turned away: {why}"));
    }

    fn report(&self, event: &Event) {
        self.askers.lock().unwrap().push(format!("{event:?}"));
    }

    fn events(&self, since: Moment, found: &mut dyn FnMut(FileItem) -> bool) -> io::Result<()> {
        drop(self.disk.lock());
        let mut entry = self.status.lock().unwrap().events[0].clone();
        entry.at = since.to_string();
        let _ = found(FileItem::Event(entry));
        let _ = found(FileItem::Damage("m.jsonl, line 3: it was changed".into()));
        Ok(())
    }

    fn measured(&self, axis: &str, report: Option<MeasuredReport>, _: &Requester) -> Result<Answer, String> {
        self.measured.lock().unwrap().push((axis.into(), report.clone()));
        match report {
            Some(report) if report.error_um.abs() > 25.0 => Err("z: not learned from".into()),
            _ => Ok(Answer::Done("z: as you say".into())),
        }
    }
}

/// Status of a probe that has learned once and refused once.
fn probe() -> ProbeStatus {
    ProbeStatus {
        correction_um: -1.5,
        limit_um: 10.0,
        warn_um: Some(4.0),
        max_error_um: 25.0,
        last: Some(ProbedStatus {
            at: "2026-07-02T11:58:00Z".into(),
            error_um: 40.0,
            acting_um: 12.5,
            residual_um: Some(40.0),
            refused: Some("the model would be wrong by 40.0 µm".into()),
        }),
        history: vec![("2026-07-02T10:58:00Z".into(), 3.0)],
        gains: vec![GainStatus { model: "a".into(), signal: "t1".into(), change: 0.05 }],
        worse: None,
    }
}

/// Status of a machine with trouble. Its name must be escaped everywhere.
pub(crate) fn status() -> Status {
    let signal = |name: &str, value, quality, reason: &str, age_s| SignalStatus {
        name: name.into(),
        label: if name == "t2" { "床温 <t2>" } else { "" }.into(),
        device: "rtd".into(),
        value,
        unit: "degC",
        quality,
        reason: reason.into(),
        hint: None,
        remedy: None,
        age_s,
    };
    Status {
        machine: "Grinder \"3\" <west>\n\\x".into(),
        label: "研削盤 \"3\"".into(),
        description: String::new(),
        version: "1.2.3",
        now: "2026-07-02T12:00:00Z".into(),
        zone: "Europe/Berlin".into(),
        clock: "synchronised",
        uptime_s: 61.0,
        machine_on_s: None,
        language: None,
        overridden: Vec::new(),
        profile_changed: Vec::new(),
        dry_run: false,
        stopping: false,
        ready: false,
        axes: vec![AxisStatus {
            shown: Display::Active,
            truth: None,
            has_model: true,
            sign: None,
            sign_checked: None,
            name: "z".into(),
            label: String::new(),
            state: "holding",
            why: "t1: stale".into(),
            waiting: None,
            model: None,
            raw_um: None,
            expected_um: Some(2.1),
            expected_touches: 24,
            cz_um: 12.5,
            verified_um: Some(12.5),
            verified_age_s: Some(2.0),
            acted: vec!["limit"],
            limit_um: 60.0,
            warn_um: Some(12.0),
            warned: true,
            error_um: None,
            tripped: false,
            arming: ArmingStatus { armed: true, left_off: false, release: false },
            probe: Some(probe()),
            learned: Some(LearnedStatus {
                adopted: Some("learned-2026-06-20-91c0".into()),
                before: Some(String::new()),
                waiting: None,
                auto: false,
                candidate: Some(CandidateStatus {
                    model: "learned-2026-07-01-3fa2".into(),
                    runs: 9,
                    since: Some("2026-06-26".into()),
                    days: 5,
                    touches: 40,
                    in_use_um: Some(6.9),
                    candidate_um: Some(3.8),
                    better: true,
                }),
            }),
            extrapolating: None,
            stood_in: None,
            excess: Some(-0.2),
        }],
        signals: vec![
            signal("t1", None, "stale", "stale", None),
            signal("t2", Some(21.25), "good", "", Some(0.5)),
            signal("t3", Some(f64::NAN), "not-a-number", "not a number", Some(f64::INFINITY)),
        ],
        buses: vec![BusStatus {
            name: "cell".into(),
            address: "192.0.2.9:502".into(),
            connected: true,
            cycles: 31,
            overruns: 2,
            jitter_ms: vec![(1.0, 20), (5.0, 10), (f64::INFINITY, 1)],
        }],
        devices: vec![DeviceStatus {
            name: "rtd".into(),
            label: String::new(),
            bus: "cell".into(),
            unit: 1,
            at: " (unit 1)".into(),
            state: "lost",
            fault: "no answer in time".into(),
            hint: None,
            requests: 40,
            failures: BTreeMap::from([("timeout", 7)]),
        }],
        outputs: vec![OutputStatus {
            name: "z_offset".into(),
            axis: "z".into(),
            device: "cnc".into(),
            register: "40101 (holding 100)".into(),
            writes: "offset",
            state: "verified",
            handshake: String::new(),
            value: Some(12.5),
            shares: None,
            applied: None,
            note: String::new(),
            waits_s: None,
            writes_done: 9,
            age_s: Some(2.0),
        }],
        alarms: Vec::new(),
        events: vec![Entry {
            at: "2026-07-02T11:59:00Z".into(),
            kind: "signal-bad".into(),
            level: Level::Warning,
            data: serde_json::Value::Null,
            text: "signal t1: stale".into(),
        }],
        left: Vec::new(),
        log_dropped: 3,
        mqtt: None,
        event_counts: BTreeMap::from([("signal-bad", 4)]),
        lock_held: Vec::new(),
    }
}

/// Listener, open on a free port.
pub(crate) struct Door {
    pub(crate) address: SocketAddr,
    fake: Arc<Fake>,
    stop: Option<oneshot::Sender<()>>,
    serving: JoinHandle<io::Result<()>>,
    _tokens: tempfile::TempDir,
}

/// Token of viewers, at each listener that has one.
pub(crate) const VIEWER: &str = "looks-and-no-more";

/// File with a token, with the required permissions.
pub(crate) fn token_file(path: &Path, token: &str) -> TokenFile {
    std::fs::write(path, token).unwrap();
    std::fs::set_permissions(path, Permissions::from_mode(0o600)).unwrap();
    TokenFile::read(path).unwrap()
}

impl Door {
    /// Opens a listener. Without a token, this computer may send commands. With the operator's token, its holder may,
    /// and the viewer's token only reads.
    pub(crate) async fn open(token: Option<&str>) -> Door {
        let tokens = tempfile::tempdir().unwrap();
        let file = |name: &str, token| Some(token_file(&tokens.path().join(name), token));
        let admission = match token {
            Some(token) => Admission {
                operator: file("operator", token),
                viewer: file("viewer", VIEWER),
                ..Admission::default()
            },
            None => Admission { commands: Commands::Local, ..Admission::default() },
        };
        Door::open_at("127.0.0.1:0", admission, tokens).await
    }

    pub(crate) async fn open_at(address: &str, admission: Admission, tokens: tempfile::TempDir) -> Door {
        let listener = TcpListener::bind(address).await.unwrap();
        let address = listener.local_addr().unwrap();
        let fake = Arc::new(Fake::default());
        let (stop, stopped) = oneshot::channel::<()>();
        let shutdown = async { drop(stopped.await) };
        let source = Arc::clone(&fake) as Arc<dyn GatewayApi>;
        let serving = tokio::spawn(serve(listener, source, admission, shutdown));
        Door { address, fake, stop: Some(stop), serving, _tokens: tokens }
    }

    pub(crate) fn seen_from(mut self, address: IpAddr) -> Door {
        self.address.set_ip(address);
        self
    }

    pub(crate) fn commands(&self) -> Vec<Command> {
        self.fake.commands.lock().unwrap().clone()
    }

    pub(crate) fn measured(&self) -> Vec<(String, Option<MeasuredReport>)> {
        self.fake.measured.lock().unwrap().clone()
    }

    pub(crate) fn asked(&self) -> usize {
        self.fake.asked.load(Ordering::Relaxed)
    }

    pub(crate) fn change(&self, change: impl FnOnce(&mut Status)) {
        change(&mut self.fake.status.lock().unwrap());
    }

    pub(crate) fn keeps(&self, logs: Vec<PathBuf>) {
        *self.fake.logs.lock().unwrap() = Some(logs);
    }

    pub(crate) fn askers(&self) -> Vec<String> {
        self.fake.askers.lock().unwrap().clone()
    }

    pub(crate) async fn shut(&mut self) -> io::Result<()> {
        drop(self.stop.take());
        (&mut self.serving).await.unwrap()
    }

    pub(crate) async fn connect(&self) -> Line {
        Line { socket: TcpStream::connect(self.address).await.unwrap(), unread: String::new() }
    }

    pub(crate) async fn get(&self, path: &str) -> Reply {
        self.send("GET", path, &[], "").await
    }

    pub(crate) async fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> Reply {
        let mut line = self.connect().await;
        line.write(&self.request(method, path, headers, body)).await;
        Reply::parse(&line.rest().await)
    }

    /// Opens a stream, and reads to the end of its headers.
    pub(crate) async fn stream(&self, path: &str) -> Line {
        let mut line = self.connect().await;
        line.write(&self.request("GET", path, &[], "")).await;
        let head = line.until("\r\n\r\n").await;
        assert!(head.contains("text/event-stream"), "{head}");
        line
    }

    fn request(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &str) -> String {
        let mut text = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\n");
        if !headers.iter().any(|(name, _)| *name == "Host") {
            text += &format!("Host: {}\r\n", self.address);
        }
        for (name, value) in headers {
            text += &format!("{name}: {value}\r\n");
        }
        text + &format!("Content-Length: {}\r\n\r\n{body}", body.len())
    }
}

/// Connection.
pub(crate) struct Line {
    socket: TcpStream,
    unread: String,
}

impl Line {
    pub(crate) async fn write(&mut self, text: &str) {
        self.socket.write_all(text.as_bytes()).await.unwrap();
    }

    pub(crate) async fn until(&mut self, mark: &str) -> String {
        loop {
            if let Some((before, after)) = self.unread.split_once(mark) {
                let (before, after) = (before.to_owned(), after.to_owned());
                self.unread = after;
                return before;
            }
            let mut bytes = [0; 8192];
            let count = self.socket.read(&mut bytes).await.unwrap();
            assert_ne!(count, 0, "ended before {mark:?}: {}", self.unread);
            self.unread += &String::from_utf8_lossy(&bytes[..count]);
        }
    }

    /// Reads everything to the end. A connection that is reset has ended, too.
    pub(crate) async fn rest(&mut self) -> String {
        let mut bytes = Vec::new();
        let _reset = self.socket.read_to_end(&mut bytes).await;
        std::mem::take(&mut self.unread) + &String::from_utf8_lossy(&bytes)
    }
}

pub(crate) struct Reply {
    pub(crate) code: u16,
    head: String,
    pub(crate) body: String,
}

impl Reply {
    fn parse(text: &str) -> Reply {
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("no answer: {text:?}"));
        let code = head.split(' ').nth(1).unwrap().parse().unwrap();
        Reply { code, head: head.to_owned(), body: body.to_owned() }
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        let pairs = self.head.lines().skip(1).filter_map(|line| line.split_once(": "));
        pairs.clone().find(|(known, _)| known.eq_ignore_ascii_case(name)).map_or("", |(_, value)| value)
    }
}

/// Parses Prometheus text strictly. Every sample comes after the HELP and TYPE of its family, and each family is in one
/// piece. No sample is there twice, and every label value is closed and escaped. Returns the samples by name and
/// labels.
pub(crate) fn exposition(text: &str) -> BTreeMap<String, String> {
    assert!(text.ends_with('\n'));
    let mut samples = BTreeMap::new();
    let mut families = Vec::<String>::new();
    let mut helped = String::new();
    for line in text.lines().filter(|line| !line.is_empty()) {
        if let Some(help) = line.strip_prefix("# HELP ") {
            helped = help.split(' ').next().unwrap().to_owned();
        } else if let Some(kind) = line.strip_prefix("# TYPE ") {
            let (name, kind) = kind.split_once(' ').unwrap();
            assert_eq!(name, helped, "HELP and TYPE stand together");
            assert!(["gauge", "counter", "histogram"].contains(&kind), "{line}");
            assert!(!families.contains(&helped), "{name} stands twice");
            families.push(helped.clone());
        } else {
            let (series, value) = line.rsplit_once(' ').unwrap();
            let (name, labels) = series.split_once('{').unwrap();
            let family = families.last().unwrap();
            let of_histogram = ["_bucket", "_count"].map(|suffix| format!("{family}{suffix}"));
            assert!(name == family || of_histogram.iter().any(|known| known == name), "{line} in {family}");
            assert!(name.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'_'), "{line}");
            check_labels(labels.strip_suffix('}').unwrap());
            value.parse::<f64>().unwrap();
            assert_eq!(samples.insert(series.to_owned(), value.to_owned()), None, "{line} stands twice");
        }
    }
    samples
}

fn check_labels(labels: &str) {
    let mut rest = labels;
    while !rest.is_empty() {
        let (name, value) = rest.split_once("=\"").unwrap();
        assert!(name.bytes().all(|byte| byte.is_ascii_lowercase()), "{labels}");
        let mut letters = value.char_indices();
        let end = loop {
            match letters.next().unwrap() {
                (_, '\\') => assert!(matches!(letters.next(), Some((_, '\\' | '"' | 'n'))), "{labels}"),
                (place, '"') => break place,
                _ => {}
            }
        };
        rest = &value[end + 1..];
        rest = if rest.is_empty() { rest } else { rest.strip_prefix(',').unwrap() };
    }
}
