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
use isotherm::observe::status::{Source, Status};
use isotherm::profile;

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
}

/// The control.
struct Control {
    words: [u16; 20],
    /// Every value that stood in the offset's register, in order.
    stood: Vec<i16>,
    writes: usize,
    fate: Box<dyn Fn(usize) -> Fate + Send>,
}

impl Control {
    fn of(fate: impl Fn(usize) -> Fate + Send + 'static) -> Arc<Mutex<Control>> {
        let mut words = [0; 20];
        words[0] = 250;
        Arc::new(Mutex::new(Control { words, stood: vec![0], writes: 0, fate: Box::new(fate) }))
    }

    fn put(&mut self, register: u16, word: u16) {
        self.words[usize::from(register)] = word;
        let value = i16::from_be_bytes(word.to_be_bytes());
        if register == 10 && self.stood.last() != Some(&value) {
            self.stood.push(value);
        }
    }

    fn offset(&self) -> i16 {
        *self.stood.last().unwrap()
    }

    fn never_jumped(&self) {
        let jumps = self.stood.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > STEP);
        assert_eq!(jumps.count(), 0, "{:?}", self.stood);
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
    let mut request = [0u8; 12];
    while stream.read_exact(&mut request).is_ok() {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (from, second) = (word(8), word(10));
        let mut reply = request[..8].to_vec();
        let mut control = shared.lock().unwrap();
        if request[7] == 3 {
            reply.push(u8::try_from(2 * second).unwrap());
            let (from, count) = (usize::from(from), usize::from(second));
            reply.extend(control.words[from..from + count].iter().flat_map(|word| word.to_be_bytes()));
        } else {
            let fate = (control.fate)(control.writes);
            control.writes += 1;
            reply.extend_from_slice(&request[8..12]);
            if let Fate::Held(span) = fate {
                let shared = shared.clone();
                std::thread::spawn(move || {
                    std::thread::sleep(span);
                    shared.lock().unwrap().put(from, second);
                });
                continue;
            }
            control.put(from, second);
            match fate {
                Fate::DoneAndDenied(code) => {
                    reply.truncate(7);
                    reply.extend([request[7] | 0x80, code]);
                }
                Fate::DoneAndGarbled => reply = vec![1, 2, 3, 4, 5],
                Fate::DoneAndSilent => continue,
                Fate::Done | Fate::Held(_) => {}
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
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), Options::default());
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
    for more in ["", "refresh = \"1s\"\n"] {
        let (control, status) = held("4s", Duration::from_millis(2500), more);
        control.lock().unwrap().never_jumped();
        assert_eq!(told(&status, "foreign-change"), 0, "{:#?}", events(&status));
        assert_eq!(told(&status, "disarmed"), 0, "{:#?}", events(&status));
    }
}

#[test]
fn a_write_that_is_done_and_denied_is_looked_for_and_found() {
    let denials: Vec<Fate> = [4, 5, 6, 11, 200].map(Fate::DoneAndDenied).to_vec();
    for fate in denials.into_iter().chain([Fate::DoneAndGarbled, Fate::DoneAndSilent]) {
        let control = Control::of(move |write| if write % 2 == 1 { fate } else { Fate::Done });
        let text = profile_of(&control, "4s", "");
        let seen = control.clone();
        let status = beside(&text, move |source| {
            wait_until(source, "it arrives", |_| seen.lock().unwrap().offset() == 50);
        });
        control.lock().unwrap().never_jumped();
        assert_eq!(told(&status, "foreign-change"), 0, "{fate:?} {:#?}", events(&status));
        assert_eq!(told(&status, "disarmed"), 0, "{fate:?} {:#?}", events(&status));
    }
}
