//! Network path to the device that is cut between a read and a write, and restored. Writes that the gateway has given
//! up meanwhile must never arrive. By default, the kernel would deliver them seconds later, after newer writes.
//!
//! The tests need network namespaces: tests/netns/run.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Dialer, Gateway, Options};

use crate::support::device;
mod lingering;
mod unanswered;
mod way;

use device::{Device, STEP, Seen, State, Times, What};
use way::Way;

/// Times of the profile. After the shortest cut, the gateway usually writes on a new connection before the kernel
/// retransmits the given-up write. The kernel doubles the interval of its retransmissions. The first one after this cut
/// follows 12.6 s after the first transmission.
const CUTS: [u64; 3] = [8, 20, 40];
/// Times of the profile. After the shortest cut, the gateway usually writes on a new connection before the kernel
/// retransmits the given-up write. The kernel doubles its interval each time; the interval is 12.6 s after the first
/// cut.
const TIMES: Times = Times {
    timeout: Duration::from_millis(700),
    every: Duration::from_millis(800),
    max_age: Duration::from_secs(2),
};
/// Timeout of a test.
const PATIENCE: Duration = Duration::from_secs(60);
/// Target of the axis, which it does not reach.
const FAR: i16 = 20_000;
/// Number of steps before the cut, and at the end.
const STEPS: usize = 5;

/// Errors in the writes that arrived.
#[derive(Debug, Default)]
struct Found {
    /// Ages of readings that were too old when the write that depends on them arrived, s.
    late: Vec<f64>,
    /// Number of writes that arrived after writes of a newer connection, or returned to an older value.
    disordered: usize,
    /// Changes of the register by more than a step, µm.
    jumps: Vec<f64>,
    /// Number of all writes that arrived.
    writes: usize,
}

impl Found {
    fn in_what(seen: &[Seen]) -> Found {
        let mut found = Found::default();
        let mut newest = 0;
        for (place, one) in seen.iter().enumerate() {
            let What::Wrote { from, to } = one.what else { continue };
            found.writes += 1;
            // The gateway has one connection at a time. A write depends at most on the reads before the next
            // connection.
            let readings = seen[..place].iter().filter(|seen| matches!(seen.what, What::Asked { .. }));
            let reading = readings.filter(|seen| seen.connection <= one.connection).map(|seen| seen.at).max();
            let age = reading.map_or(Duration::MAX, |asked| one.at.since(asked));
            // A write of the current value depends on no reading.
            if to != from && age > TIMES.max_age + TIMES.timeout {
                found.late.push(age.as_secs_f64());
            }
            found.disordered += usize::from(one.connection < newest || to < from);
            newest = newest.max(one.connection);
            if (to - from).abs() > STEP {
                found.jumps.push(f64::from(to - from) * 0.1);
            }
        }
        found
    }

    fn is_nothing(&self) -> bool {
        self.late.is_empty() && self.disordered == 0 && self.jumps.is_empty()
    }
}

/// A gateway and its device at the ends of a path.
struct Lane {
    name: String,
    way: Way,
    device: Device,
}

impl Lane {
    fn new(number: u8, name: String) -> Lane {
        let way = Way::lay(number);
        let device = Device::listen(way.listen(), Duration::ZERO);
        device.asks(FAR);
        Lane { name, way, device }
    }

    /// Runs the gateway in parallel to `script`, until the script ends.
    fn beside<T: Send + 'static>(self, dialer: Dialer, script: impl FnOnce(Lane) -> T + Send + 'static) -> T {
        let text = device::profile(self.device.address(), TIMES);
        let loaded = isotherm_profile::parse(Path::new("walker.toml"), &text, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let gateway = Gateway::new(profile, &Clock::wall(), Options { dialer, ..Options::default() });
            let done = tokio::task::spawn_blocking(move || script(self));
            let (tell, reported) = tokio::sync::oneshot::channel();
            let stop = async move { drop(tell.send(done.await)) };
            gateway.run(stop, std::future::pending()).await;
            reported.await.unwrap().unwrap()
        })
    }

    /// Waits until the offset was written this number of times from now on.
    #[track_caller]
    fn walks(&self, steps: usize) {
        let wanted = self.device.state().writes() + steps;
        let walked = self.device.wait(PATIENCE, |state| (state.writes() >= wanted).then_some(()));
        assert!(walked.is_some(), "{}: the axis does not walk", self.name);
    }

    /// Cuts the path while the gateway prepares a write. Returns the last request that passed before it.
    fn cut_before_a_write(&self) -> Seen {
        for _ in 0..100 {
            let about = |state: &State| state.is_about_to_write().then_some(state.seen.len());
            let seen = self.device.wait(PATIENCE, about);
            let seen = seen.unwrap_or_else(|| panic!("{}: nothing is about to be written", self.name));
            self.way.cut();
            std::thread::sleep(Duration::from_millis(50));
            let now = self.device.state().seen.clone();
            if now.len() == seen {
                return now[seen - 1];
            }
            // The cut came too late for this write.
            self.way.restore();
            self.walks(1);
        }
        panic!("{}: the way was never cut in time", self.name);
    }

    /// Walks, cuts the path for this time, and restores it. Returns the last request that passed before the cut.
    fn is_cut_for(&self, span: Duration) -> Seen {
        self.walks(STEPS);
        let last = self.cut_before_a_write();
        std::thread::sleep(span);
        self.way.restore();
        last
    }

    /// Errors in all writes that arrived.
    fn found(&self) -> Found {
        let seen = self.device.state().seen.clone();
        let found = Found::in_what(&seen);
        println!("{}: {found:.1?}", self.name);
        found
    }
}

/// Runs the gateway with late delivery by the kernel, until a given-up write has arrived. If it arrived after newer
/// writes, the axis may not continue.
fn lingering(number: u8, span: Duration, tell: Sender<()>) -> Found {
    let lane = Lane::new(number, format!("cut for {} s, lingering", span.as_secs()));
    lane.beside(lingering::dialer(), move |lane| {
        let last = lane.is_cut_for(span);
        let given_up = |seen: &Seen| {
            let is_write = matches!(seen.what, What::Wrote { .. });
            is_write && seen.at > last.at && seen.connection <= last.connection
        };
        let arrived = lane.device.wait(PATIENCE, |state| state.seen.iter().any(given_up).then_some(()));
        assert!(arrived.is_some(), "{}: nothing that was given up arrives", lane.name);
        drop(tell);
        lane.found()
    })
}

/// Runs the normal gateway, until its counterexample has received the write, and until the axis walks again.
fn as_it_is(number: u8, span: Duration, twin: Receiver<()>) -> Found {
    let lane = Lane::new(number, format!("cut for {} s", span.as_secs()));
    lane.beside(Options::default().dialer, move |lane| {
        let last = lane.is_cut_for(span);
        let _ = twin.recv();
        std::thread::sleep(Duration::from_secs(1));
        let found = lane.found();
        lane.walks(STEPS);
        let newest = lane.device.state().seen.iter().map(|seen| seen.connection).max();
        assert!(newest > Some(last.connection), "{}: its connection was not given up", lane.name);
        // These writes include those of the new connection.
        if found.is_nothing() { lane.found() } else { found }
    })
}

#[test]
fn what_was_given_up_while_the_way_was_cut_never_arrives_though_the_kernel_would_deliver_it() {
    let lanes: Vec<_> = (0u8..)
        .zip(CUTS)
        .map(|(place, seconds)| {
            let (span, (tell, reported)) = (Duration::from_secs(seconds), channel());
            let twin = std::thread::spawn(move || lingering(2 * place, span, tell));
            (seconds, std::thread::spawn(move || as_it_is(2 * place + 1, span, reported)), twin)
        })
        .collect();
    let found: Vec<_> = lanes
        .into_iter()
        .map(|(seconds, lane, twin)| (seconds, lane.join().unwrap(), twin.join().unwrap()))
        .collect();
    for (seconds, _, twin) in &found {
        assert!(
            !twin.late.is_empty(),
            "a cut of {seconds} s shows nothing where the kernel lingers: {twin:?}"
        );
    }
    let wrong: Vec<_> = found.iter().filter(|(_, found, _)| !found.is_nothing()).collect();
    assert!(wrong.is_empty(), "given up, and it arrived: {wrong:#.1?}");
}
