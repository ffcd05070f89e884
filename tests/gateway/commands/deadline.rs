//! A command is executed within its deadline or never, even if the gateway pauses.
//!
//! `TEST_COMMANDS=100` sets the number of commands, which is otherwise ten; `tests/run long` does so.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::commands::bench::{Bench, answer};
use crate::commands::process::{PATIENCE, Running, until};

/// Number of benches in parallel.
const LANES: usize = 5;

/// Kind of client.
#[derive(Clone, Copy, Debug)]
enum Asks {
    Arm,
    ArmAndLeave,
    Disarm,
    Zero,
    /// Interrupted before it gives up by itself.
    Interrupted,
    /// A browser that gives up.
    Page,
    /// Programs that never give up and name no deadline.
    PatientApi,
    PatientSocket,
}

use Asks::{Arm, ArmAndLeave, Disarm, Interrupted, Page, PatientApi, PatientSocket, Zero};

const ALL: [Asks; 8] = [Arm, Disarm, PatientApi, Interrupted, ArmAndLeave, Page, PatientSocket, Zero];

#[test]
fn what_is_asked_of_a_gateway_that_stands_still_is_never_done_later() {
    let count: usize = std::env::var("TEST_COMMANDS").map_or(10, |count| count.parse().unwrap());
    let lanes: Vec<_> = (0..LANES)
        .map(|lane| {
            std::thread::spawn(move || {
                let bench = Bench::manual();
                let mut random = Pcg32::seed_from_u64(lane as u64);
                for one in (lane..count).step_by(LANES) {
                    let span = Duration::from_millis(random.random_range(5600..9000));
                    never_done(&bench, ALL[one % ALL.len()], span);
                }
            })
        })
        .collect();
    lanes.into_iter().for_each(|lane| lane.join().unwrap());
}

fn never_done(bench: &Bench, asks: Asks, span: Duration) {
    let is_armed = matches!(asks, Disarm);
    bench.ask(&[if is_armed { "arm" } else { "disarm" }]);
    until("it is as it shall be", || match bench.axis()["armed"] == is_armed {
        true => Ok(()),
        false => Err(format!("{asks:?}")),
    });
    let count = |kind: &str| bench.count(kind);
    let before = (count("command"), count("command-dropped"));
    bench.gateway.stands_still();
    let tick = Duration::from_millis(100);
    let rest = ask(bench, asks, span);
    bench.gateway.resumes();
    std::thread::sleep(tick * 15);
    drop(rest);
    until("it is reported", || match count("command-dropped") {
        dropped if dropped == before.1 + 1 => Ok(()),
        dropped => Err(format!("{asks:?}: {dropped} dropped, {} before", before.1)),
    });
    assert_eq!(count("command"), before.0, "{asks:?}");
    assert_eq!(bench.axis()["armed"], is_armed, "{asks:?} was carried out");
}

/// Sends a command while the gateway pauses for this long, and checks what the client prints. Returns what stays open.
fn ask(bench: &Bench, asks: Asks, span: Duration) -> Vec<Box<dyn std::any::Any>> {
    let program = |words: &[&str]| {
        let mut requester = Running::start(&mut bench.verb(words));
        std::thread::sleep(span);
        let code = requester.ends_within(PATIENCE).code();
        let said = requester.so_far().join("\n");
        assert!(
            said.contains("no answer within 5 s; it is not known whether the command was carried out"),
            "{asks:?}: {said}"
        );
        assert_eq!(code, Some(3), "{asks:?}: {said}");
    };
    match asks {
        Arm => program(&["arm"]),
        ArmAndLeave => program(&["arm", "--no-wait"]),
        Disarm => program(&["disarm"]),
        Zero => program(&["zero"]),
        Interrupted => {
            let mut requester = Running::start(&mut bench.verb(&["arm"]));
            // On a busy computer it takes seconds until the request is sent.
            std::thread::sleep(Duration::from_millis(3500));
            requester.signal("INT");
            requester.ends_within(PATIENCE);
        }
        Page => {
            let request = bench.begin_http("POST", "/api/arm", "isotherm-way: page\r\nContent-Length: 0\r\n");
            std::thread::sleep(Duration::from_secs(5));
            drop(request);
        }
        PatientApi => {
            let request = bench.begin_http("POST", "/api/arm", "Content-Length: 0\r\n");
            std::thread::sleep(span);
            return vec![Box::new(request)];
        }
        PatientSocket => {
            let mut socket = UnixStream::connect(bench.home.path().join("state/walker.sock")).unwrap();
            socket.write_all(b"arm\n").unwrap();
            std::thread::sleep(span);
            return vec![Box::new(socket)];
        }
    }
    Vec::new()
}

#[test]
fn what_is_asked_of_a_gateway_that_stands_still_for_a_moment_is_done() {
    let bench = Bench::manual();
    bench.gateway.stands_still();
    let mut requester = Running::start(&mut bench.verb(&["arm"]));
    let request = bench.begin_http("POST", "/api/zero", "Content-Length: 0\r\n");
    // On a busy computer much of the five seconds has passed already.
    std::thread::sleep(Duration::from_millis(1500));
    bench.gateway.resumes();
    requester.receives("z: armed");
    assert_eq!(requester.ends_within(PATIENCE).code(), Some(0));
    assert_eq!(answer(request).0, 200);
}

#[test]
fn where_no_gateway_runs_that_is_what_is_said() {
    let mut bench = Bench::manual();
    bench.gateway.signal("KILL");
    bench.gateway.ends_within(PATIENCE);
    for verb in ["arm", "disarm", "zero"] {
        let (code, said) = bench.ask(&[verb]);
        assert_eq!((code, said.contains("no gateway of this machine is running here")), (1, true), "{said}");
    }
}

#[test]
fn a_request_that_waits_while_the_gateway_stops_for_long_is_reported_and_ended() {
    let bench = Bench::manual();
    bench.device.asks(crate::commands::bench::OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    let mut requester = Running::start(&mut bench.verb(&["arm"]));
    requester.receives("waiting to arm");
    bench.gateway.stands_still();
    bench.device.asks(0);
    assert_eq!(requester.ends_within(PATIENCE).code(), Some(3));
    bench.gateway.resumes();
    until("it is reported", || match bench.reported("arm-ended").len() {
        1 => Ok(()),
        _ => Err("nothing is reported".to_owned()),
    });
    assert_eq!(bench.axis()["armed"], false);
}
