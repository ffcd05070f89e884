//! Writes that something on the way holds, denies or loses: the gateway over real sockets against a control of our own,
//! which keeps every value that really came to stand in its register.
#![allow(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::{Command, Source, Status};
use isotherm::profile;
use isotherm::quantity::Moment;

const PROFILE: &str = r#"
[machine]
name = "held"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "60ms"
late = "LATE"
[device.cnc]
bus = "cell"
unit = 1
every = "100ms"
[signal.bed]
device = "cnc"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "3s"
[axis.z]
limit = 40.0
step = 1.0
rate = 100.0
every = "100ms"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "one"
kind = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 20.0 } ]
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:10"
type = "i16"
scale = 0.1
"#;

/// Counts of a step: 1 µm in tenths.
const STEP: i16 = 10;

/// What happens to a write.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    /// It is carried out and answered.
    Done,
    /// It is carried out when so much time has passed, and its answer finds nobody.
    Held(Duration),
    /// It is carried out, and this is answered instead.
    DoneAndDenied(u8),
    /// It is carried out, and five bytes that are no answer come back.
    DoneAndGarbled,
    /// It is carried out, and its answer is lost.
    DoneAndSilent,
    /// It never arrives.
    Lost,
    /// It is carried out, its answer is lost, and before anything else is answered the operator adds so much.
    DoneAndEdited(i16),
}

/// The control.
struct Control {
    words: [u16; 20],
    /// Every value that stood in the offset's register, in order; and in the register beside it.
    stood: Vec<i16>,
    beside: Vec<i16>,
    writes: usize,
    /// What is applied of the offset stands in register 15; this control applies it at once, or never.
    applies: bool,
    /// What the operator adds while nothing is answered, and when that is over.
    edit: Option<(i16, Moment)>,
    fate: Box<dyn Fn(usize) -> Fate + Send>,
}

impl Control {
    fn of(fate: impl Fn(usize) -> Fate + Send + 'static) -> Arc<Mutex<Control>> {
        let mut words = [0; 20];
        words[0] = 250;
        Arc::new(Mutex::new(Control {
            words,
            stood: vec![0],
            beside: vec![0],
            writes: 0,
            applies: true,
            edit: None,
            fate: Box::new(fate),
        }))
    }

    fn put(&mut self, register: u16, words: &[u16]) {
        for (register, word) in (register..).zip(words) {
            self.words[usize::from(register)] = *word;
            let value = i16::from_be_bytes(word.to_be_bytes());
            let stood = match register {
                10 => &mut self.stood,
                11 => &mut self.beside,
                _ => continue,
            };
            if stood.last() != Some(&value) {
                stood.push(value);
            }
        }
        self.apply();
    }

    fn apply(&mut self) {
        if self.applies {
            self.words[15] = self.words[10];
        }
    }

    /// The operator changes what stands there by so much. That is no jump of ours.
    fn edits(&mut self, change: i16) {
        let value = self.offset() + change;
        self.words[10] = u16::from_be_bytes(value.to_be_bytes());
        self.stood = self.stood.iter().map(|stood| stood + change).collect();
    }

    fn offset(&self) -> i16 {
        *self.stood.last().unwrap()
    }

    fn never_jumped(&self) {
        for stood in [&self.stood, &self.beside] {
            let jumps = stood.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > STEP);
            assert_eq!(jumps.count(), 0, "{stood:?}");
        }
    }
}

fn serve(control: &Arc<Mutex<Control>>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let control = control.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let control = control.clone();
            std::thread::spawn(move || answer(stream.unwrap(), &control));
        }
    });
    address
}

fn answer(mut stream: TcpStream, shared: &Arc<Mutex<Control>>) {
    let mut header = [0u8; 7];
    while stream.read_exact(&mut header).is_ok() {
        let mut pdu = vec![0; usize::from(u16::from_be_bytes([header[4], header[5]])) - 1];
        if stream.read_exact(&mut pdu).is_err() {
            return;
        }
        let word = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let (function, from, second) = (pdu[0], word(1), word(3));
        let mut reply = header.to_vec();
        let mut control = shared.lock().unwrap();
        if let Some((change, until)) = control.edit {
            if Clock::wall().now() < until {
                continue;
            }
            control.edit = None;
            control.edits(change);
        }
        if function == 3 {
            reply.extend([3, u8::try_from(2 * second).unwrap()]);
            let (from, count) = (usize::from(from), usize::from(second));
            reply.extend(control.words[from..from + count].iter().flat_map(|word| word.to_be_bytes()));
        } else {
            let words: Vec<u16> = match function {
                6 => vec![second],
                _ => (0..usize::from(second)).map(|place| word(6 + 2 * place)).collect(),
            };
            let fate = (control.fate)(control.writes);
            control.writes += 1;
            reply.extend_from_slice(&pdu[..5]);
            if fate == Fate::Lost {
                continue;
            }
            if let Fate::Held(span) = fate {
                let shared = shared.clone();
                std::thread::spawn(move || {
                    std::thread::sleep(span);
                    shared.lock().unwrap().put(from, &words);
                });
                continue;
            }
            control.put(from, &words);
            match fate {
                Fate::DoneAndDenied(code) => {
                    reply.truncate(7);
                    reply.extend([function | 0x80, code]);
                }
                Fate::DoneAndGarbled => reply = vec![1, 2, 3, 4, 5],
                Fate::DoneAndSilent => continue,
                Fate::DoneAndEdited(change) => {
                    control.edit = Some((change, Clock::wall().now().after(Duration::from_millis(300))));
                    continue;
                }
                Fate::Done | Fate::Held(_) | Fate::Lost => {}
            }
        }
        drop(control);
        if reply.len() > 6 {
            let length = u16::try_from(reply.len() - 6).unwrap();
            reply[4..6].copy_from_slice(&length.to_be_bytes());
        }
        if stream.write_all(&reply).is_err() {
            return;
        }
    }
}

/// Runs the gateway beside what `script` does with its state; the script's end stops it. What it told.
fn beside(text: &str, script: impl FnOnce(&dyn Source) + Send + 'static) -> Status {
    let loaded = profile::parse(Path::new("held.toml"), text, &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let directory = tempfile::tempdir().unwrap();
    let options = Options { directory: Some(directory.path().to_owned()), ..Options::default() };
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), options);
        let source = gateway.source();
        let seen = source.clone();
        let done = tokio::task::spawn_blocking(move || script(seen.as_ref()));
        let (tell, told) = tokio::sync::oneshot::channel();
        let stop = async move { drop(tell.send(done.await)) };
        gateway.run(stop, std::future::pending()).await;
        told.await.unwrap().unwrap();
        source.status()
    })
}

fn profile_of(control: &Arc<Mutex<Control>>, late: &str, more: &str) -> String {
    let text = PROFILE.replace("ADDRESS", &serve(control).to_string()).replace("LATE", late);
    text + more
}

#[track_caller]
fn wait_until(source: &dyn Source, what: &str, found: impl Fn(&Status) -> bool) {
    let clock = Clock::wall();
    let begun = clock.now();
    loop {
        let status = source.status();
        if found(&status) {
            return;
        }
        assert!(clock.now().since(begun) < Duration::from_secs(60), "{what}: {:#?}", events(&status));
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn events(status: &Status) -> Vec<&str> {
    status.events.iter().map(|event| event.text.as_str()).collect()
}

fn told(status: &Status, kind: &str) -> u64 {
    status.event_counts.get(kind).copied().unwrap_or_default()
}

const LEDGER: &str = "share = \"ledger\"\n";
/// Two of them in one request, with a heartbeat, a control word and a sequence.
const SET: &str = r#"set = "block"
refresh = "500ms"
[axis.y]
limit = 40.0
step = 1.0
rate = 100.0
every = "100ms"
on_fault = { action = "hold" }
[[axis.y.model]]
name = "one"
kind = "linear"
terms = [ { signal = "bed", gain = -1.0, reference = 20.0 } ]
[output.cnc_y]
axis = "y"
device = "cnc"
writes = "offset"
register = "holding:11"
type = "i16"
scale = 0.1
set = "block"
[set.block]
heartbeat = "holding:12"
control = "holding:13"
sequence = "holding:14"
"#;

#[track_caller]
fn nobody_is_blamed(control: &Arc<Mutex<Control>>, status: &Status, what: &str) {
    control.lock().unwrap().never_jumped();
    for kind in ["foreign-change", "disarmed", "operator-change", "ledger-doubt"] {
        assert_eq!(told(status, kind), 0, "{what} {:#?}", events(status));
    }
}

/// Warms the bed until 5 µm are asked for, cools it to −2 µm while the write is held, and lets it arrive.
fn held(late: &str, span: Duration, more: &str) -> (Arc<Mutex<Control>>, Status) {
    let control = Control::of(move |write| if write == 3 { Fate::Held(span) } else { Fate::Done });
    let text = profile_of(&control, late, more);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "the write is held", |_| seen.lock().unwrap().writes >= 4);
        seen.lock().unwrap().words[0] = 180;
        std::thread::sleep(span + Duration::from_millis(500));
        wait_until(source, "it follows", |status| {
            seen.lock().unwrap().offset() == -20 && status.axes[0].state == "active"
        });
    });
    (control, status)
}

#[test]
fn a_write_that_is_held_and_comes_late_moves_the_register_by_a_step_at_most_and_is_known_as_ours() {
    let kinds = ["", "refresh = \"1s\"\n", LEDGER, SET];
    all_at_once(kinds.into_iter().map(|more| {
        move || {
            let (control, status) = held("4s", Duration::from_millis(2500), more);
            nobody_is_blamed(&control, &status, more);
        }
    }));
}

#[test]
fn a_write_that_is_done_and_denied_or_lost_is_looked_for_and_the_axis_goes_on() {
    let denials: Vec<Fate> = [4, 5, 6, 11, 200].map(Fate::DoneAndDenied).to_vec();
    let fates = denials.into_iter().chain([Fate::DoneAndGarbled, Fate::DoneAndSilent, Fate::Lost]);
    let cases = fates.flat_map(|fate| [(fate, ""), (fate, LEDGER), (fate, SET)]);
    all_at_once(cases.map(|(fate, more)| move || denied(fate, more)));
}

/// Every other write meets this fate; of those that are lost every third, because what follows one is the same again.
fn denied(fate: Fate, more: &str) {
    let each = if fate == Fate::Lost { 3 } else { 2 };
    let control = Control::of(move |write| if write % each == 1 { fate } else { Fate::Done });
    let text = profile_of(&control, "2s", more);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 50);
    });
    nobody_is_blamed(&control, &status, &format!("{fate:?} {more}"));
}

/// Each on a thread of its own: they wait more than they work.
fn all_at_once(tests: impl Iterator<Item = impl FnOnce() + Send + 'static>) {
    let threads: Vec<_> = tests.map(std::thread::spawn).collect();
    threads.into_iter().for_each(|thread| thread.join().unwrap());
}

/// Each write is done and denied, by a control whose register an operator shares: what ran away without end.
#[test]
fn a_shared_register_never_runs_away_and_the_operator_keeps_what_is_his() {
    all_at_once([6, 11].into_iter().map(|code| move || denied_beside_an_operator(code)));
}

fn denied_beside_an_operator(code: u8) {
    let control = Control::of(move |_| Fate::DoneAndDenied(code));
    control.lock().unwrap().edits(1200);
    let text = profile_of(&control, "4s", LEDGER);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "a person is asked", |status| told(status, "first-account") == 1);
        source.command(Command::Arm).unwrap();
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 1250);
        std::thread::sleep(Duration::from_secs(1));
        let shares = source.status().outputs[0].shares.unwrap();
        assert!((shares.base - 120.0).abs() < 0.01 && (shares.share - 5.0).abs() < 0.01, "{shares:?}");
    });
    nobody_is_blamed(&control, &status, &format!("{code}"));
    assert_eq!(told(&status, "operator-change"), 0, "{:#?}", events(&status));
}

#[test]
fn an_edit_while_the_fate_of_a_write_is_unknown_is_a_question_and_the_answer_makes_it_right() {
    let control = Control::of(|write| if write == 2 { Fate::DoneAndEdited(900) } else { Fate::Done });
    let text = profile_of(&control, "2s", LEDGER);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "a person is asked", |status| told(status, "ledger-doubt") == 1);
        let writes = seen.lock().unwrap().writes;
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(seen.lock().unwrap().writes, writes, "nothing is written while it is in question");
        // Two steps of ours had arrived when it was verified last, and three stand there: he makes it right.
        seen.lock().unwrap().edits(-10);
        source.command(Command::Arm).unwrap();
        wait_until(source, "it goes on", |status| status.axes[0].state == "active");
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 950);
    });
    control.lock().unwrap().never_jumped();
    assert!(events(&status).iter().any(|text| text.contains("perhaps")), "{:#?}", events(&status));
}

const APPLIED: &str = "read_back = { register = \"holding:15\", tolerance = 0.2, settle = \"200ms\" }\n";

#[test]
fn what_the_control_applies_verifies_a_write_and_what_it_does_not_holds_the_axis() {
    let control = Control::of(|_| Fate::Done);
    let text = profile_of(&control, "2s", APPLIED);
    let seen = control.clone();
    let status = beside(&text, move |source| {
        wait_until(source, "it walks", |_| seen.lock().unwrap().offset() >= 20);
        seen.lock().unwrap().applies = false;
        wait_until(source, "that is told", |status| told(status, "not-applied") == 1);
        wait_until(source, "it holds", |status| status.axes[0].state == "holding");
        let stood = seen.lock().unwrap().offset();
        std::thread::sleep(Duration::from_millis(600));
        assert_eq!(seen.lock().unwrap().offset(), stood, "nothing else is sent");
        let status = source.status();
        let applied = status.outputs[0].applied.unwrap();
        assert!((applied - (f64::from(stood) / 10.0 - 1.0)).abs() < 0.05, "{applied} {stood}");
        seen.lock().unwrap().applies = true;
        seen.lock().unwrap().apply();
        wait_until(source, "it goes on", |_| seen.lock().unwrap().offset() == 50);
    });
    nobody_is_blamed(&control, &status, "applied");
    let texts = events(&status);
    let words = "stand in its register, the control applies";
    assert!(texts.iter().any(|text| text.contains(words) && text.contains("holding:15")), "{texts:#?}");
    assert_eq!((told(&status, "not-applied"), told(&status, "verified")), (1, 1), "{texts:#?}");
}

#[test]
fn a_control_that_is_read_and_whose_writes_are_never_answered_is_told_with_cause_and_count() {
    let control = Control::of(|_| Fate::DoneAndSilent);
    let text = profile_of(&control, "2s", "");
    let status = beside(&text, move |source| {
        wait_until(source, "that is told", |status| told(status, "write-failed") == 1);
        wait_until(source, "the axis says so", |status| status.axes[0].why.contains("times"));
    });
    let texts = events(&status);
    assert!(texts.iter().any(|text| text.contains("no answer in time, 3 times in a row")), "{texts:#?}");
}

#[test]
fn what_somebody_else_wrote_and_where_stands_in_the_reason_of_the_axis() {
    let control = Control::of(|_| Fate::Done);
    let text = profile_of(&control, "2s", "");
    let seen = control.clone();
    beside(&text, move |source| {
        wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 50);
        seen.lock().unwrap().edits(123);
        wait_until(source, "it is off", |status| !status.axes[0].armed);
        wait_until(source, "why", |status| {
            let why = &status.axes[0].why;
            why.contains("17.3 µm") && why.contains("cnc_z") && why.contains("holding:10")
        });
        assert_eq!(source.arming(), None);
    });
}
