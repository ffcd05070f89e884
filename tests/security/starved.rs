//! Clients that only connect and send nothing can use only the page's share of the resources.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use isotherm_core::quantity::Moment;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::on_time;
use crate::process::until;
use crate::rig::{Machine, ask, get};
use crate::support::starved::Starved;

/// Open sockets that send nothing. A closed one is opened again a second later.
struct Silent {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<usize>>,
}

impl Silent {
    fn attack(page: SocketAddr, count: usize) -> Silent {
        let limit = getrlimit(Resource::Nofile);
        setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit }).unwrap();
        let ends = Arc::new(AtomicBool::new(false));
        let until = Arc::clone(&ends);
        let thread = std::thread::spawn(move || {
            let mut sockets: Vec<Option<TcpStream>> = (0..count).map(|_| None).collect();
            let mut opened = 0;
            while !until.load(Ordering::Relaxed) {
                for socket in &mut sockets {
                    if socket.as_mut().is_none_or(is_closed) {
                        *socket = TcpStream::connect_timeout(&page, Duration::from_millis(100)).ok();
                        if let Some(socket) = socket {
                            socket.set_nonblocking(true).unwrap();
                            opened += 1;
                        }
                    }
                    if until.load(Ordering::Relaxed) {
                        break;
                    }
                }
                std::thread::sleep(Duration::from_secs(1));
            }
            opened
        });
        Silent { ends, thread: Some(thread) }
    }

    /// Number of connections that were made.
    fn end(mut self) -> usize {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap()
    }
}

fn is_closed(socket: &mut TcpStream) -> bool {
    match socket.read(&mut [0; 256]) {
        Ok(count) => count == 0,
        Err(error) => error.kind() != ErrorKind::WouldBlock,
    }
}

/// Size in bytes of the largest file of the gateway with this suffix.
fn kept(machine: &Machine, end: &str) -> u64 {
    let entries = std::fs::read_dir(machine.home.path()).unwrap().map(|entry| entry.unwrap());
    let sizes = entries.filter(|entry| entry.file_name().to_string_lossy().ends_with(end));
    sizes.map(|entry| entry.metadata().unwrap().len()).max().unwrap_or(0)
}

/// State that is kept for the next start.
fn state_kept(machine: &Machine) -> String {
    std::fs::read_to_string(machine.home.path().join("walker.state.json")).unwrap_or_default()
}

/// Duration of a verb on this computer without an attack.
fn a_verb_takes(machine: &Machine) -> Duration {
    let begun = machine.device.now();
    let status = machine.verb("status").output().unwrap();
    assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
    machine.device.now().since(begun)
}

const HEARTBEAT: &str = "[heartbeat]\ndevice = \"cnc\"\nregister = \"holding:20\"\nevery = \"200ms\"\n";

/// Asserts that at least two of five heartbeats in a second arrive, apart from delays of the computer itself.
fn beats(machine: &Machine, from: Moment) {
    let now = machine.device.now();
    let excused = 2 * on_time::excused(from, now);
    let came = machine.device.state().beats.iter().filter(|beat| **beat >= from).count();
    let least = (now.since(from).saturating_sub(excused).as_secs_f64() * 2.0).floor();
    assert!(came as f64 >= least, "{came} heartbeats within {:?}", now.since(from));
}

#[test]
fn two_thousand_silent_sockets_take_nothing_from_lines_commands_and_files() {
    let mut machine = Machine::start(Some(64), &["--listen", "127.0.0.1:0"], HEARTBEAT);
    let page = machine.page();
    machine.is_held();
    let usual = a_verb_takes(&machine);
    let on_time = machine.on_time();
    let attack = Silent::attack(page, 2000);
    until("the page is full", || match ask(page, &get(page, "/healthz")) {
        Some(answer) if answer.starts_with("HTTP/1.1 200") => Err(answer),
        _ => Ok(()),
    });
    let full = machine.device.now();
    let (rows, state) = (kept(&machine, ".csv"), state_kept(&machine));
    std::thread::sleep(Duration::from_secs(3));
    beats(&machine, full);
    drop(on_time);

    // The gateway has to connect to the device again.
    machine.device.is_down(true);
    std::thread::sleep(Duration::from_secs(6));
    let returned = machine.comes_back();

    let on_time = machine.on_time();
    let asked = disarms_within_a_second(&machine, usual);
    until("the log goes on", || {
        let now = kept(&machine, ".csv");
        if now > rows { Ok(()) } else { Err(format!("{now} bytes, {rows} before")) }
    });
    until("the state is kept", || {
        let now = state_kept(&machine);
        if now.is_empty() || now == state { Err(now) } else { Ok(()) }
    });
    let events = machine.verb("events").output().unwrap();
    let events = String::from_utf8_lossy(&events.stdout).into_owned();
    assert!(!events.contains("cannot be saved"), "{events}");
    assert!(events.contains("off: "), "{events}");
    beats(&machine, asked);
    let opened = attack.end();
    drop(on_time);
    until("the page is there again", || match ask(page, &get(page, "/healthz")) {
        Some(answer) if answer.starts_with("HTTP/1.1 200") => Ok(()),
        other => Err(format!("{other:?}")),
    });
    println!("{opened} connections; device back after {returned:?}");
    let said = machine.gateway.so_far().join("\n");
    assert_eq!(said.matches("or the limit for one address").count(), 1, "{said}");
}

/// Opens connections to the command socket that send nothing. A closed one is opened again at once.
fn silent_commands(socket: &Path, count: usize, ends: &Arc<AtomicBool>) -> JoinHandle<usize> {
    let (socket, ends) = (socket.to_owned(), Arc::clone(ends));
    let limit = getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, ..limit }).unwrap();
    std::thread::spawn(move || {
        let is_closed = |stream: &mut UnixStream| matches!(stream.read(&mut [0]), Ok(0));
        let mut streams: Vec<Option<UnixStream>> = (0..count).map(|_| None).collect();
        let mut opened = 0;
        while !ends.load(Ordering::Relaxed) {
            for stream in &mut streams {
                if stream.as_mut().is_none_or(is_closed) {
                    *stream = UnixStream::connect(&socket).ok();
                    stream.iter().for_each(|stream| stream.set_nonblocking(true).unwrap());
                    opened += 1;
                }
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        opened
    })
}

#[test]
fn disarm_is_carried_out_within_a_second_beside_six_hundred_silent_commands() {
    let mut machine = Machine::start(Some(64), &["--listen", "127.0.0.1:0"], "");
    let page = machine.page();
    machine.is_held();
    let usual = a_verb_takes(&machine);
    let socket = machine.home.path().join("walker.sock");
    let on_time = machine.on_time();
    let ends = Arc::new(AtomicBool::new(false));
    let silent = silent_commands(&socket, 600, &ends);
    std::thread::sleep(Duration::from_secs(3));
    assert!(ask(page, &get(page, "/healthz")).is_some_and(|answer| answer.starts_with("HTTP/1.1 200")));
    drop(on_time);
    machine.device.is_down(true);
    std::thread::sleep(Duration::from_secs(1));
    machine.comes_back();
    let on_time = machine.on_time();
    disarms_within_a_second(&machine, usual);
    drop(on_time);
    ends.store(true, Ordering::Relaxed);
    println!("{} silent connections", silent.join().unwrap());
}

/// Returns when the machine was disarmed. That takes a second at most, beyond what the verb usually takes and what the computer keeps
/// the verb and the gateway waiting.
fn disarms_within_a_second(machine: &Machine, usual: Duration) -> Moment {
    let gateway = Starved::of(machine.gateway.id());
    let asked = machine.device.now();
    let disarm = machine.verb("disarm").stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let verb = Starved::of(disarm.id());
    let disarm = disarm.wait_with_output().unwrap();
    let answered = machine.device.now();
    assert!(disarm.status.success(), "{}", String::from_utf8_lossy(&disarm.stderr));
    // The verb and the gateway wait for each other, and each of them for a processor.
    let waits = gateway.between(asked, answered) + verb.longest();
    let (took, excused) = (answered.since(asked), on_time::excused(asked, answered).max(waits));
    println!("disarm took {took:?}, the computer {excused:?}, a verb usually {usual:?}");
    assert!(
        took < Duration::from_secs(1) + excused + 4 * usual,
        "disarm took {took:?}, the computer {excused:?}, a verb usually {usual:?}"
    );
    asked
}
