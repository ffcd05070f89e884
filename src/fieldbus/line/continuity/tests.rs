//! Tests of the rule alone, and of each end of a connection over real sockets.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use socket2::SockRef;

use super::*;
use crate::clock::Clock;
use crate::fieldbus::dial;
use crate::fieldbus::error::PeerFault;
use crate::fieldbus::line::{CheckedAnswer, RequestObserver};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{ModbusRequest, Request};
use isotherm_core::codec::{Register, Table};
use isotherm_profile::{DeviceId, Profile, parse};

fn at(seconds: u64) -> Moment {
    Moment::default().after(Duration::from_secs(seconds))
}

/// Returns the result for a connection with this number of answers and an orderly close at this second.
fn closes(line: &mut Evidence, answers: u32, second: u64) -> BrokenContact {
    line.connected();
    (0..answers).for_each(|_| line.answered());
    line.ends(Fault::CLOSED, Ending::Closed, at(second), at(second))
}

#[test]
fn a_connection_that_is_reset_is_a_possible_exchange_and_one_that_the_server_keeps_is_not() {
    let mut line = Evidence::default();
    line.answered();
    for fault in [Fault::BROKEN, Fault::CLOSED] {
        assert_eq!(line.ends(fault, Ending::Lost, at(9), at(9)), BrokenContact::All);
        assert_eq!(line.ends(fault, Ending::Kept, at(9), at(9)), BrokenContact::None);
    }
}

#[test]
fn a_server_that_closes_after_each_answer_is_never_exchanged_by_that() {
    let mut line = Evidence::default();
    assert!((0..99).all(|hour| closes(&mut line, 1, hour * 7200) == BrokenContact::None));
}

#[test]
fn a_server_that_closes_idle_connections_is_a_possible_exchange_once_and_one_that_rarely_closes_each_time() {
    let mut often = Evidence::default();
    let found: Vec<_> = (0..4).map(|minute| closes(&mut often, 5, minute * 60)).collect();
    assert_eq!(found, [BrokenContact::All, BrokenContact::None, BrokenContact::None, BrokenContact::None]);
    let mut rarely = Evidence::default();
    assert!((0..4).all(|day| closes(&mut rarely, 5, day * 86_400) == BrokenContact::All));
}

#[test]
fn a_connection_that_is_closed_before_its_first_answer_is_a_possible_exchange() {
    let mut line = Evidence::default();
    assert!((0..4).all(|second| closes(&mut line, 0, second) == BrokenContact::All));
}

#[test]
fn one_lost_answer_is_no_exchange_and_a_long_silence_is() {
    let mut line = Evidence::default();
    assert_eq!(line.ends(Fault::Timeout, Ending::Lost, at(10), at(12)), BrokenContact::None);
    assert_eq!(line.ends(Fault::Timeout, Ending::Lost, at(10), at(20)), BrokenContact::Unit);
    let wrong = Fault::Peer(PeerFault::Foreign);
    assert_eq!(line.ends(wrong, Ending::Lost, at(10), at(20)), BrokenContact::None, "it answers");
}

/// Reaction of a device to one request. [`serve`] answers the requests after the end of a connection's list.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Does {
    Answers,
    /// Sends no answer.
    Ignores,
    /// Closes in order instead of an answer.
    Closes,
    /// Resets the connection instead of an answer.
    Resets,
    /// Closes in the middle of an answer.
    Breaks,
    /// Answers, then closes in order.
    AnswersAndCloses,
    /// Answers, then resets the connection.
    AnswersAndResets,
}

fn question(stream: &mut TcpStream) -> Option<[u8; 12]> {
    let mut question = [0; 12];
    stream.read_exact(&mut question).ok().map(|()| question)
}

fn resets(stream: TcpStream) {
    SockRef::from(&stream).set_linger(Some(Duration::ZERO)).unwrap();
}

/// Serves a connection. Requests after the end of the list are answered.
fn serve(mut stream: TcpStream, does: &[Does]) {
    for step in does.iter().copied().chain(std::iter::repeat(Does::Answers)) {
        let Some(question) = question(&mut stream) else { return };
        let answer = [question[0], question[1], 0, 0, 0, 5, question[6], question[7], 2, 0, 7];
        let sent = match step {
            Does::Ignores => Ok(()),
            Does::Closes => return,
            Does::Resets => return resets(stream),
            Does::Breaks => {
                let _ = stream.write_all(&answer[..9]);
                return;
            }
            _ => stream.write_all(&answer),
        };
        match step {
            Does::AnswersAndCloses => return,
            Does::AnswersAndResets => return resets(stream),
            _ => sent.unwrap(),
        }
    }
}

/// Observer that records the reports about devices, and says whether their checks have passed.
#[derive(Default)]
struct Seen {
    exchanged: Vec<Option<DeviceId>>,
    is_verified: bool,
}

#[derive(Clone, Default)]
struct Sees(Arc<Mutex<Seen>>);

impl RequestObserver for Sees {
    fn note(&self, _: DeviceId, _: Request<'_>, _: Result<(), Fault>, _: (u32, Fault)) {}

    fn breaks(&self, device: Option<DeviceId>, _: Break) {
        let mut seen = self.0.lock().unwrap();
        seen.exchanged.push(device);
        seen.is_verified = false;
    }

    fn is_verified(&self, _: DeviceId) -> bool {
        self.0.lock().unwrap().is_verified
    }
}

/// Name of the thread that simulates the other end.
const PEER: &str = "peer";

/// Waits until the other end waits as well. All that it sent has arrived then.
async fn settles() {
    tokio::time::sleep(Duration::from_millis(50)).await;
    while is_busy() {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

/// Returns whether the other end is running or ready to run. On a busy computer this lasts longer than any pause.
fn is_busy() -> bool {
    let threads = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let status = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("status")).ok());
    status.into_iter().any(|status| {
        let line = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("").trim();
        line("Name:") == PEER && line("State:").starts_with('R')
    })
}

const READ: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 1 }, 1);
const WRITE: Request<'static> = Request::Modbus(ModbusRequest::WriteSingle { at: 1, value: 7 });

/// Line to a device that behaves as listed on its connections. After the last of them, no program listens.
struct Rig {
    line: DeviceLine,
    sees: Sees,
}

fn profile(kind: &str, address: &str) -> Profile {
    let text = format!(
        "[machine]\nname = \"cell\"\n[bus.cell]\ntype = \"{kind}\"\naddress = \"{address}\"\ntimeout = \"1s\"\n\
         [device.one]\nbus = \"cell\"\nunit = 1\nverify = [{{ register = \"holding:9\", equals = 7 }}]\n\
         [device.two]\nbus = \"cell\"\nunit = 2\n"
    );
    let loaded = parse(std::path::Path::new("cell.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

impl Rig {
    fn new(connections: &'static [&'static [Does]]) -> Rig {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let profile = profile("modbus-tcp", &listener.local_addr().unwrap().to_string());
        let accepts = move || {
            for does in connections {
                serve(listener.accept().unwrap().0, does);
            }
        };
        std::thread::Builder::new().name(PEER.to_owned()).spawn(accepts).unwrap();
        let (bus, sees) = (&profile.buses[0], Sees::default());
        sees.0.lock().unwrap().is_verified = true;
        let devices: Vec<_> =
            profile.devices.iter().enumerate().map(|(id, one)| (DeviceId(id), one)).collect();
        let line = DeviceLine::new(bus, &devices, dial(bus).unwrap(), &Clock::wall());
        Rig { line: line.witnessed(Arc::new(sees.clone())), sees }
    }

    async fn reads(&mut self) -> Result<CheckedAnswer, Fault> {
        settles().await;
        self.line.request(DeviceId(0), READ, SendDeadline::None).await
    }

    /// Returns the reports since the last call.
    fn said(&self) -> Vec<Option<DeviceId>> {
        std::mem::take(&mut self.sees.0.lock().unwrap().exchanged)
    }

    fn passes(&self) {
        self.sees.0.lock().unwrap().is_verified = true;
    }
}

#[tokio::test]
async fn each_end_of_a_connection_but_an_orderly_one_is_a_possible_exchange_and_nothing_more_is_asked() {
    const WAYS: [&[&[Does]]; 4] = [
        &[&[Does::Answers, Does::Answers, Does::Resets], &[]],
        &[&[Does::Answers, Does::Answers, Does::Breaks], &[]],
        &[&[Does::Answers, Does::AnswersAndResets], &[]],
        // The program of the device may have been started again. This is checked once.
        &[&[Does::Answers, Does::Answers, Does::Closes], &[]],
    ];
    for way in WAYS {
        let mut rig = Rig::new(way);
        let mut asked = 0;
        while rig.said().is_empty() {
            asked += 1;
            assert!(asked <= 3, "{way:?}: nothing was said");
            let found = rig.reads().await;
            assert_eq!(found.is_ok(), rig.sees.0.lock().unwrap().is_verified, "{way:?}: {found:?}");
        }
        assert_eq!(rig.reads().await, Err(Fault::UNVERIFIED), "{way:?}");
        assert!(rig.line.request_unverified(DeviceId(0), READ).await.is_ok(), "{way:?}");
        assert!(
            rig.line.request(DeviceId(1), READ, SendDeadline::None).await.is_ok(),
            "{way:?}: without checks"
        );
        rig.passes();
        assert!(rig.reads().await.is_ok() && rig.said().is_empty(), "{way:?}");
    }
}

#[tokio::test]
async fn servers_that_close_after_each_answer_or_again_and_again_when_idle_are_asked_as_ever() {
    let mut each = Rig::new(&[&[Does::AnswersAndCloses], &[Does::AnswersAndCloses], &[]]);
    for _ in 0..3 {
        assert!(each.reads().await.is_ok());
    }
    assert_eq!(each.said(), []);

    const IDLE: &[Does] = &[Does::Answers, Does::AnswersAndCloses];
    let mut idle = Rig::new(&[IDLE, IDLE, &[]]);
    assert!(idle.reads().await.is_ok() && idle.reads().await.is_ok());
    assert!(idle.reads().await.is_err(), "the first time it may be another one");
    assert_eq!(idle.said(), [None]);
    idle.passes();
    for _ in 0..4 {
        assert!(idle.reads().await.is_ok());
    }
    assert_eq!(idle.said(), []);
}

#[tokio::test]
async fn a_write_whose_connection_was_reset_while_idle_does_not_go_to_whoever_answers_next() {
    let mut rig = Rig::new(&[&[Does::Answers, Does::AnswersAndResets], &[]]);
    assert!(rig.reads().await.is_ok() && rig.reads().await.is_ok());
    settles().await;
    let now = rig.line.sample();
    let leave = SendDeadline::By(now.after(Duration::from_secs(60)));
    assert_eq!(rig.line.request(DeviceId(0), WRITE, leave).await.map(drop), Err(Fault::CLOSED));
    assert_eq!(rig.said(), [None]);
    assert_eq!(rig.line.request(DeviceId(0), WRITE, leave).await.map(drop), Err(Fault::UNVERIFIED));
}

#[tokio::test]
async fn a_connection_that_is_refused_or_closed_before_its_first_answer_is_a_possible_exchange() {
    let mut refused = Rig::new(&[&[Does::AnswersAndCloses]]);
    assert!(refused.reads().await.is_ok());
    assert!(refused.reads().await.is_err());
    assert_eq!(refused.said(), [None]);
    let mut turned_away = Rig::new(&[&[Does::AnswersAndCloses], &[Does::Closes], &[]]);
    assert!(turned_away.reads().await.is_ok());
    assert!(turned_away.reads().await.is_err());
    assert!(!turned_away.said().is_empty());
}

#[tokio::test]
async fn one_answer_that_is_lost_is_no_exchange() {
    let mut rig = Rig::new(&[&[Does::Answers, Does::Ignores], &[]]);
    assert!(rig.reads().await.is_ok());
    assert_eq!(rig.reads().await, Err(Fault::Timeout));
    // The unit backs off for a while.
    let mut again = rig.reads().await;
    for _ in 0..100 {
        if again.is_ok() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
        again = rig.reads().await;
    }
    assert!(again.is_ok());
    assert_eq!(rig.said(), []);
}
