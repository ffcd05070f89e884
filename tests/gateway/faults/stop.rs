//! End of a gateway: by a request, by an internal panic, by a line that takes no turns any more. Also how the next run
//! continues.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::kinds::modbus::wire::ModbusWire;
use isotherm::fieldbus::send_guard::SendGuard;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::{Answer, Boxed, Request, Wire};
use isotherm::gateway::Dialer;
use isotherm::virtual_machine::{FaultScript, PlantSpec};
use isotherm_profile::Bus;

use crate::faults::law;
use crate::faults::rig::{BENCH, GRINDER, Sample, Trace, World, bench, block_on, profile, run};

const MINUTE: Duration = Duration::from_secs(60);
const RAMP: &str = "on_fault = { action = \"ramp\", after = \"30s\" }";

fn last_write(trace: &Trace) -> f64 {
    trace.writes("cnc_z").last().unwrap().1
}

fn took(trace: &Trace) -> Duration {
    trace.stopped.1.since(trace.stopped.0)
}

/// Deadline that the gateway has reported for its stop.
fn deadline(trace: &Trace) -> Duration {
    let line = trace.events.iter().find(|event| event.kind == "stopping").unwrap();
    let (_, span) = line.text.split_once("at most ").unwrap();
    humantime::parse_duration(span).unwrap() + Duration::from_secs(1)
}

#[test]
fn asked_to_stop_it_ramps_to_zero_and_ends_within_its_deadline() {
    let trace = bench("", MINUTE);
    law::holds(&trace);
    assert!(trace.outcome.rested && !trace.outcome.failed, "{:?}", trace.outcome);
    assert!(
        last_write(&trace).abs() < 1e-9 && trace.outcome.left.contains("cnc_z holds 0.0"),
        "{:?}",
        trace.outcome
    );
    assert!(took(&trace) <= deadline(&trace), "{:?}", took(&trace));
    assert!(took(&trace) >= Duration::from_secs(14), "a ramp, no jump: {:?}", took(&trace));
    assert_eq!((trace.reported("stopping"), trace.reported("stopped")), (1, 1));
}

#[test]
fn asked_to_stop_it_holds_where_the_profile_says_hold() {
    let trace = run(&BENCH.replace(RAMP, "on_fault = { action = \"hold\" }"), "", MINUTE);
    law::holds(&trace);
    assert!(trace.outcome.rested && last_write(&trace) > 5.0, "{:?}", trace.outcome);
    assert!(took(&trace) <= deadline(&trace), "{:?}", took(&trace));
}

#[test]
fn asked_to_stop_it_goes_to_zero_in_whole_steps_where_the_profile_says_zero() {
    let trace = run(&BENCH.replace(RAMP, "on_fault = { action = \"zero\" }"), "", MINUTE);
    law::holds(&trace);
    assert!(trace.outcome.rested && last_write(&trace).abs() < 1e-9, "{:?}", trace.outcome);
    assert!(took(&trace) <= deadline(&trace), "{:?}", took(&trace));
}

/// Bench with a stop that moves nothing.
fn keeping(text: &str) -> String {
    text.replace("arm  = \"auto\"", "arm  = \"auto\"\non_stop = \"hold\"")
}

#[test]
fn a_stop_with_hold_leaves_the_register_and_the_next_run_goes_on_from_it() {
    let shared = BENCH.replace("refresh = \"10s\"", "share = \"ledger\"");
    for text in [BENCH.to_owned(), shared] {
        let directory = tempfile::tempdir().unwrap();
        let state = Some(directory.path().to_owned());
        let (first, second) = block_on(async {
            let mut world = World::new(&keeping(&text), "").await;
            let first = world.gateway().options(|options| options.directory = state.clone());
            let first = first.run(MINUTE).await;
            let second = world.gateway().options(|options| options.directory = state.clone());
            (first, second.run(MINUTE).await)
        });
        law::holds(&first);
        law::holds(&second);
        assert!(first.outcome.rested && !first.outcome.failed, "{:?}", first.outcome);
        assert!(took(&first) < Duration::from_secs(2), "{:?}", took(&first));
        assert!(first.lines().contains("the registers keep their values"), "{}", first.lines());
        let (begun, _) = first.stopped;
        assert!(first.writes("cnc_z").iter().all(|(at, _)| *at <= begun), "nothing is written by a stop");
        let stays = last_write(&first);
        assert!(stays.abs() > 5.0, "it had a way to go: {stays}");
        assert_eq!(first.states().last(), Some(&"active"), "its axis does not change for it");
        let armed = second.events.iter().find(|event| event.kind == "armed").unwrap();
        assert!(armed.text.contains(&format!("starting from {stays:.1}")), "{}", armed.text);
        let writes = second.writes("cnc_z");
        let walk: Vec<f64> = std::iter::once(stays).chain(writes.iter().map(|(_, cz)| *cz)).collect();
        assert!(walk.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 1.0 + 1e-9), "{walk:?}");
        assert!(!second.lines().contains("waiting for a late write"), "it was in order: {}", second.lines());
    }
}

#[test]
fn a_stop_with_hold_runs_the_fault_actions_where_something_fails_inside() {
    let trace = block_on(async {
        let mut world = World::new(&keeping(BENCH), "").await;
        let mishap = grief("sensors", 150, Mishap::Panic);
        let trial = world.gateway().options(|options| options.dialer = mishap);
        trial.run(10 * MINUTE).await
    });
    law::holds(&trace);
    assert!(trace.outcome.failed && last_write(&trace).abs() < 1e-9, "{:?}", trace.outcome);
}

#[test]
fn a_cnc_that_is_gone_does_not_keep_it_from_ending_within_its_deadline() {
    let faults = "[[fault]]\ndevice = \"cnc\"\nkind = \"refuse\"\nat = \"60s\"";
    let trace = bench(faults, 70 * Duration::from_secs(1));
    law::holds(&trace);
    assert!(!trace.outcome.rested && !trace.outcome.failed, "{:?}", trace.outcome);
    assert!(took(&trace) <= deadline(&trace) + Duration::from_secs(1), "{:?}", took(&trace));
    assert!(trace.outcome.left.contains("when it was last verified"), "{:?}", trace.outcome);
}

#[test]
fn an_axis_that_was_never_armed_ends_at_once() {
    let trace = run(&BENCH.replace("arm  = \"auto\"", "arm  = \"manual\""), "", MINUTE);
    law::holds(&trace);
    assert!(trace.outcome.rested && took(&trace) < Duration::from_secs(3), "{:?}", took(&trace));
}

#[test]
fn an_open_interlock_does_not_keep_it_from_ending() {
    let faults =
        "[[fault]]\ndevice = \"cnc\"\nkind = \"value\"\nsignal = \"cnc_on\"\nvalue = 0\nat = \"40s\"";
    let trace = bench(faults, MINUTE);
    law::holds(&trace);
    assert!(trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
    assert!(took(&trace) <= deadline(&trace), "{:?}", took(&trace));
}

#[test]
fn a_second_run_goes_on_from_the_references_and_the_machine_time_of_the_first() {
    let directory = tempfile::tempdir().unwrap();
    let state = Some(directory.path().to_owned());
    let (first, second) = block_on(async {
        let mut world = World::new(GRINDER, "").await;
        let first = world.gateway().options(|options| options.directory = state.clone());
        let first = first.run(40 * MINUTE).await;
        let second = world.gateway().options(|options| options.directory = state.clone());
        (first, second.run(5 * MINUTE).await)
    });
    law::holds(&first);
    law::holds(&second);
    let on = |trace: &Trace, place: usize| trace.samples[place].status.machine_on_s;
    let (before, after) = (on(&first, first.samples.len() - 1).unwrap(), on(&second, 1).unwrap());
    assert!(after >= before && after < before + 120.0, "{before} {after}");
    assert_eq!(second.states_between(15, 300), ["active"], "no settling again\n{}", second.lines());
    assert_eq!(second.reported("machine-started"), 0, "{}", second.lines());
}

/// Machine whose only temperature rises by 0.001 °C per second, and an axis that follows it with a lag.
async fn drifting() -> World {
    const PROFILE: &str = "
        [machine]
        name = \"bench\"
        arm = \"auto\"
        [bus.cell]
        type = \"modbus-tcp\"
        address = \"127.0.0.1:1502\"
        timeout = \"300ms\"
        [device.module]
        bus = \"cell\"
        unit = 1
        every = \"1s\"
        [signal.bearing]
        device = \"module\"
        register = \"input:0\"
        type = \"f64\"
        word_order = \"msw-first\"
        unit = \"degC\"
        max_age = \"5s\"
        max_rate = \"none\"
        [axis.z]
        limit = 40.0
        step = 0.5
        rate = 0.5
        every = \"2s\"
        on_fault = { action = \"hold\" }
        [[axis.z.model]]
        name = \"bearing\"
        kind = \"linear\"
        terms = [{ signal = \"bearing\", expansion = 11.5e-6, length = 300.0, reference = \"start\", lag = \"30min\" }]
        [output.cnc_z]
        axis = \"z\"
        device = \"module\"
        writes = \"offset\"
        register = \"holding:104\"
        type = \"f64\"
        word_order = \"msw-first\"";
    const PLANT: &str = "
        start = \"2026-01-05T06:00:00Z\"
        soak = \"0s\"
        link = []
        [ambient]
        mean = 20.0
        amplitude = 0.0
        peak_hour = 15.0
        drift_per_day = 0.0
        weather = 0.0
        [duty]
        on_after = [\"0s\", \"0s\"]
        work = [\"1h\", \"1h\"]
        pause = [\"1h\", \"1h\"]
        [node.bearing]
        capacity = 1e6
        initial = 20.0
        [source.friction]
        node = \"bearing\"
        watts = 1000.0
        when = \"always\"
        [sensor.bearing]
        node = \"bearing\"
        lag = \"0s\"
        resolution = 0.0
        noise = 0.0";
    let plant = PlantSpec::parse(PLANT).unwrap_or_else(|error| panic!("{error}"));
    let profile = profile(PROFILE);
    let faults = FaultScript::parse("", &profile).unwrap_or_else(|error| panic!("{error}"));
    World::with(plant, profile, faults, None).await
}

#[test]
fn an_hour_without_the_gateway_changes_nothing_that_lags() {
    let directory = tempfile::tempdir().unwrap();
    let state = Some(directory.path().to_owned());
    let whole = block_on(async { drifting().await.gateway().run(180 * MINUTE).await });
    let (first, second) = block_on(async {
        let mut world = drifting().await;
        let first = world.gateway().options(|options| options.directory = state.clone());
        let first = first.run(60 * MINUTE).await;
        world.wait(60 * MINUTE).await;
        let second = world.gateway().options(|options| options.directory = state.clone());
        (first, second.run(59 * MINUTE).await)
    });
    for trace in [&whole, &first, &second] {
        law::holds(trace);
    }
    assert!(second.begin.since(first.begin) >= 120 * MINUTE);

    // Expected value: K·L·r·(t − C·(1 − e^(−t/C))) with r = 0.001 °C/s.
    let by_hand = |t: f64| 3.45e-3 * (t - 1800.0 * (1.0 - (-t / 1800.0).exp()));
    let raw = |sample: &Sample| sample.status.axes[0].raw_um;
    let (mut compared, mut following) = (0, 0);
    for sample in &second.samples {
        let Some(there) = whole.samples.iter().rfind(|other| other.at <= sample.at) else { continue };
        let (Some(found), Some(wanted)) = (raw(sample), raw(there)) else { continue };
        assert!((found - wanted).abs() < 0.05, "{} s: {found} {wanted}", whole.seconds(sample.at));
        assert!((found - by_hand(whole.seconds(sample.at))).abs() < 0.05);
        compared += 1;
        // The axis moves from the register value by the change of one hour, and then follows like the other one.
        if second.seconds(sample.at) > 90.0 && sample.at <= second.stopped.0 {
            let (found, wanted) = (sample.status.axes[0].cz_um, there.status.axes[0].cz_um);
            assert!((found - wanted).abs() < 0.05, "{} s: {found} {wanted}", whole.seconds(sample.at));
            following += 1;
        }
    }
    assert!(compared > 3400 && following > 3300, "{compared} {following}");
    let missed = by_hand(7200.0) - by_hand(3600.0);
    assert!(missed > 10.0, "the hour was worth {missed} µm");

    let writes: Vec<f64> =
        [&first, &second].iter().flat_map(|trace| trace.writes("cnc_z")).map(|(_, cz)| cz).collect();
    assert!(
        writes.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 0.5 + 1e-9),
        "never a step above `step`"
    );
}

/// Fault of the thread at one request.
#[derive(Clone, Copy)]
enum Mishap {
    Panic,
    Block(Duration),
}

/// Dialer whose wires fail once, at the nth request on the bus of this name.
fn grief(bus: &'static str, nth: u32, mishap: Mishap) -> Dialer {
    let calls = Arc::new(AtomicU32::new(0));
    Arc::new(move |settings: &Bus| {
        let dial = isotherm::fieldbus::dial(settings)?;
        if settings.name != bus {
            return Some(dial);
        }
        Some(Box::new(BadDial { dial, calls: calls.clone(), nth, mishap }))
    })
}

struct BadDial {
    dial: Box<dyn Dial>,
    calls: Arc<AtomicU32>,
    nth: u32,
    mishap: Mishap,
}

struct BadWire {
    wire: Connection,
    calls: Arc<AtomicU32>,
    nth: u32,
    mishap: Mishap,
}

impl Dial for BadDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async {
            let wire = self.dial.dial(tap).await?;
            let (calls, nth, mishap) = (self.calls.clone(), self.nth, self.mishap);
            Ok(Connection::Modbus(Box::new(BadWire { wire, calls, nth, mishap })))
        })
    }
}

impl ModbusWire for BadWire {}

impl Wire for BadWire {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        if self.calls.fetch_add(1, Ordering::Relaxed) == self.nth {
            match self.mishap {
                Mishap::Panic => panic!("the wire is hot"),
                Mishap::Block(span) => std::thread::sleep(span),
            }
        }
        Box::pin(self.wire.exchange(unit, request, send_guard))
    }
}

fn panicking(bus: &'static str) -> Trace {
    let trace = block_on(async {
        let mut world = World::new(BENCH, "").await;
        let trial = world.gateway().options(|options| options.dialer = grief(bus, 150, Mishap::Panic));
        trial.run(10 * MINUTE).await
    });
    law::holds(&trace);
    assert!(trace.outcome.failed && trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
    assert_eq!(trace.reported("task-failed"), 1, "{}", trace.lines());
    assert!(trace.lines().contains("the wire is hot"), "{}", trace.lines());
    assert!(last_write(&trace).abs() < 1e-9, "the fault action ran: {}", last_write(&trace));
    trace
}

#[test]
fn a_panic_in_the_task_of_the_sensors_leads_to_the_fault_action() {
    panicking("sensors");
}

#[test]
fn a_panic_in_the_task_of_the_cnc_leads_to_the_fault_action() {
    panicking("control");
}

#[test]
fn a_line_that_no_longer_cycles_leads_to_the_fault_action() {
    let text = BENCH
        .replace(RAMP, "on_fault = { action = \"zero\" }")
        .replace("every = \"1s\"", "every = \"200ms\"");
    let text =
        text.replace("step = 1.0", "step = 4.0").replace("rate = 0.5", "rate = 20.0").replace("2s", "500ms");
    let trace = block_on(async {
        let mut world = World::start(profile(&text), FaultScript::default(), Some(Clock::wall())).await;
        let block = Mishap::Block(Duration::from_millis(2500));
        let trial = world.gateway().options(|options| {
            options.dialer = grief("sensors", 20, block);
            options.watch = Some(Duration::from_secs(1));
        });
        trial.run(MINUTE).await
    });
    assert!(trace.outcome.failed && trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
    assert!(trace.lines().contains("has stopped running"), "{}", trace.lines());
    assert!(last_write(&trace).abs() < 1e-9, "the fault action ran: {}", last_write(&trace));
}
