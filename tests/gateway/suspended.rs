//! A computer that is suspended for a minute and wakes. Its monotonic clock, on which every timer depends, did not
//! advance, and the machine became warmer. The gateway continues, reports it once, and does nothing that is based on
//! earlier readings.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::{BootClock, Clock, TimeOfDay};
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::GatewayApi;

use crate::support::device;
use crate::support::starved::Starved;
use crate::support::tell;

use device::{Device, STEP, State, Times};

const SUSPENDED: Duration = Duration::from_secs(60);
const PATIENCE: Duration = Duration::from_secs(60);
const MAX_AGE: Duration = Duration::from_secs(1);
/// Longest wait of a thread for a processor with which the age of a reading is known.
const KEPT_WAITING: Duration = Duration::from_millis(100);
const TIMES: Times =
    Times { timeout: Duration::from_millis(200), every: Duration::from_millis(500), max_age: MAX_AGE };

/// Computer with a gateway and its device.
struct Computer {
    device: Device,
    source: Arc<dyn GatewayApi>,
    /// Time for which the computer was suspended, ms.
    slept: Arc<AtomicU64>,
    starved: Starved,
}

impl Computer {
    /// Runs a gateway in parallel with a script. The end of the script stops it.
    fn beside(script: impl FnOnce(&Computer) + Send + 'static) {
        let slept = Arc::new(AtomicU64::new(0));
        let counted = slept.clone();
        let passing = BootClock::default();
        let passing =
            BootClock::by(move || passing.passed() + Duration::from_millis(counted.load(Ordering::SeqCst)));
        let clock = Clock::wall_by(passing, TimeOfDay::default());
        let device = Device::by(clock.clone(), TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        let text = device::profile(device.address(), TIMES);
        let loaded = isotherm_profile::parse(Path::new("walker.toml"), &text, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let gateway = Gateway::new(profile, &clock, Options::default());
            let starved = Starved::of(std::process::id());
            let computer = Computer { device, source: gateway.source(), slept, starved };
            let done = tokio::task::spawn_blocking(move || script(&computer));
            let (sender, receiver) = tokio::sync::oneshot::channel();
            let stop = async move { drop(sender.send(done.await)) };
            gateway.run(stop, std::future::ready(())).await;
            receiver.await.unwrap().unwrap();
        });
    }

    fn is_suspended(&self) {
        self.slept.fetch_add(u64::try_from(SUSPENDED.as_millis()).unwrap(), Ordering::SeqCst);
    }

    #[track_caller]
    fn arrives(&self, at: i16) {
        self.device.asks(at);
        let arrived = self.device.wait(PATIENCE, |state: &State| (state.offset() == at).then_some(()));
        let reported: Vec<_> = self.source.status().events.into_iter().map(|event| event.text).collect();
        assert!(arrived.is_some(), "stands at {} and not at {at}: {reported:#?}", self.device.offset());
    }

    /// Checks the state after waking: no earlier reading was used, the pause was reported once, and the axis reaches
    /// its target.
    #[track_caller]
    fn resumes(&self) {
        std::thread::sleep(MAX_AGE);
        let standing = self.device.offset();
        self.arrives(standing + 3 * STEP);
        self.arrives(standing);
        let wrong = device::acted_wrongly(&self.device.state().seen, MAX_AGE);
        // A gateway may have to wait for a processor between its last clock sample and the write.
        let is_old = |text: &String| text.contains("rests on a reading");
        let is_void = self.starved.longest() >= KEPT_WAITING && wrong.iter().all(is_old);
        assert!(is_void || wrong.is_empty(), "{wrong:#?}");
        if !wrong.is_empty() {
            tell(&format!("a suspended computer: void, it was too busy: {wrong:?}"));
        }
        let status = self.source.status();
        // A busy computer pauses as well, for seconds.
        let reported = status.events.iter().filter(|event| event.text.contains("stood still for 6"));
        assert_eq!(reported.count(), 1, "{:?}", status.events);
    }
}

#[test]
fn an_answer_that_came_before_the_computer_was_suspended_is_of_before_when_it_is_found() {
    Computer::beside(|computer| {
        let device = &computer.device;
        computer.arrives(5 * STEP);
        device.hold();
        assert!(device.wait(PATIENCE, |state| (state.held > 0).then_some(())).is_some());
        device.asks(-5 * STEP);
        computer.is_suspended();
        device.release();
        device.wait(PATIENCE, |state| (state.held == 0).then_some(()));
        device.asks(5 * STEP);
        computer.resumes();
    });
}

#[test]
fn what_was_decided_before_the_computer_was_suspended_is_not_written_when_it_wakes() {
    Computer::beside(|computer| {
        let device = &computer.device;
        computer.arrives(5 * STEP);
        device.asks(25 * STEP);
        let decided = |state: &State| state.is_about_to_write().then_some(());
        assert!(device.wait(PATIENCE, decided).is_some());
        computer.is_suspended();
        device.asks(device.offset());
        computer.resumes();
    });
}
