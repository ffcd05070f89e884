//! Handshakes: written, strobed, acknowledged, dropped. Also the reaction if one of these steps fails.

use std::sync::Arc;
use std::time::Duration;

use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::kinds::modbus::wire::ModbusWire;
use isotherm::fieldbus::send_guard::SendGuard;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::{Answer, Boxed, ModbusRequest, Request, Wire};
use isotherm::gateway::Dialer;
use isotherm::observe::status::Command;
use isotherm::virtual_machine::SeenRequest;
use isotherm_core::codec::{Register, Table};
use isotherm_profile::Bus;

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on, run};

const MINUTE: Duration = Duration::from_secs(60);
const SECOND: Duration = Duration::from_secs(1);
const STROBE: Register = Register { table: Table::Coil, offset: 20 };
const ACKNOWLEDGE: Register = Register { table: Table::Discrete, offset: 20 };

fn shaken() -> String {
    let keys = "handshake = { strobe = \"coil:20\", acknowledge = \"discrete:20\", timeout = \"500ms\" }";
    BENCH.replace("refresh = \"10s\"", &format!("refresh = \"10s\"\n{keys}"))
}

fn cnc(kind: &str, at: u64, seconds: u64) -> String {
    let keys = format!("kind = \"{kind}\"\nat = \"{at}s\"\nfor_time = \"{seconds}s\"\n");
    format!("[[fault]]\ndevice = \"cnc\"\n{keys}")
}

fn holds(trace: &Trace) {
    law::holds(trace);
    law::nothing_taken_jumps(trace);
    strobes_are_short(trace);
}

/// Checks that no strobe stays up: each is dropped soon, also by a gateway that ends.
fn strobes_are_short(trace: &Trace) {
    let mut up = None;
    for seen in trace.wire.iter().filter(|seen| seen.is_write() && seen.address == STROBE.into()) {
        up = (seen.wanted == [1]).then_some(seen.at);
        let since = up.map_or(seen.at, |up| up);
        assert!(seen.at.since(since) <= Duration::from_millis(700), "{seen:?}\n{}", trace.lines());
    }
    assert_eq!(up, None, "the strobe stays up\n{}", trace.lines());
}

/// Requests to the control, in order: `v` value written, `S` strobe up, `s` strobe down, `A` and `a` acknowledge seen
/// up and down, `r` register read.
fn story(trace: &Trace, from: f64, to: f64) -> String {
    let word = |seen: &SeenRequest| match (seen.is_write(), seen.address.register().unwrap()) {
        (true, STROBE) if seen.wanted == [1] => "S",
        (true, STROBE) => "s",
        (false, ACKNOWLEDGE) if seen.after == [1] => "A",
        (false, ACKNOWLEDGE) => "a",
        (true, Register { table: Table::Holding, offset: 104 }) => "v",
        (false, Register { table: Table::Holding, offset: 104 }) => "r",
        _ => "",
    };
    let seen = trace.wire.iter().filter(|seen| (from..=to).contains(&trace.seconds(seen.at)));
    let control = trace.profile.devices.iter().position(|device| device.name == "cnc").unwrap();
    let mut story: Vec<&str> = seen.filter(|seen| seen.device.0 == control).map(word).collect();
    story.dedup();
    story.concat()
}

fn cut(fault: &str) -> Trace {
    let trace = run(&shaken(), fault, 3 * MINUTE);
    holds(&trace);
    assert_eq!(trace.states_between(150, 180), ["active"], "{}", trace.lines());
    assert!(trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
    trace
}

fn texts(trace: &Trace, kind: &str) -> Vec<String> {
    trace.events.iter().filter(|event| event.kind == kind).map(|event| event.text.clone()).collect()
}

#[test]
fn a_value_is_written_strobed_acknowledged_and_only_then_believed() {
    let trace = cut("");
    let story = story(&trace, 12.0, 170.0);
    let exchanges: Vec<&str> = story.split_inclusive("sAar").collect();
    assert!(exchanges.len() > 10, "{story}");
    for exchange in &exchanges[1..exchanges.len() - 1] {
        // The register is also read in between.
        let exchange = exchange.trim_start_matches('r');
        assert!(exchange.starts_with("ar") && exchange.contains("rvrS"), "{exchange} in {story}");
    }
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    assert!(trace.taken.len() > 15, "{}", trace.taken.len());
    let last = trace.writes("cnc_z").last().unwrap().1;
    assert!(last.abs() < 1e-9 && trace.outcome.left.contains("cnc_z holds 0.0"), "{:?}", trace.outcome);
}

#[test]
fn an_acknowledge_that_does_not_come_is_reported_and_the_axis_holds_until_it_does() {
    let trace = cut(&cnc("no-acknowledge", 60, 20));
    let reported = texts(&trace, "acknowledge-missing");
    assert_eq!(
        reported,
        ["acknowledge signal of output cnc_z did not come within 500 ms (discrete:20); check that \
             the control's program runs and reads this strobe signal. If it does, raise `timeout` of the handshake"],
        "{}",
        trace.lines()
    );
    assert_eq!(trace.reported("verified"), 1, "{}", trace.lines());
    assert_eq!(trace.states_between(55, 120), ["active", "holding", "active"], "{}", trace.lines());
    let mut tried: Vec<String> = trace
        .writes("cnc_z")
        .iter()
        .filter(|(at, _)| (70.0..80.0).contains(&trace.seconds(*at)))
        .map(|(_, value)| format!("{value:.1}"))
        .collect();
    assert!((4..=12).contains(&tried.len()), "{tried:?}");
    tried.dedup();
    assert_eq!(tried.len(), 1, "the same value again: {tried:?}");
    let stuck = trace
        .between(72, 78)
        .all(|sample| sample.status.outputs[1].handshake == "the acknowledge signal did not come");
    assert!(stuck, "the page says where it is stuck");
    assert!(trace.samples.last().unwrap().status.outputs[1].handshake.is_empty());
}

/// The acknowledge is lost while Cz approaches its target. It returns before or after the fault action has begun to
/// move Cz to zero. The control resumes in steps from the value that it took, the register from its own value.
#[test]
fn an_acknowledge_that_is_lost_on_the_way_in_costs_no_step_when_it_comes_back() {
    for at in [6, 7, 8, 9] {
        for seconds in [10, 60] {
            let trace = cut(&cnc("no-acknowledge", at, seconds));
            assert_eq!(trace.reported("acknowledge-missing"), 1, "{}", trace.lines());
            assert_eq!(trace.states().contains(&"ramping"), seconds == 60, "{}", trace.lines());
        }
    }
}

#[test]
fn an_acknowledge_that_does_not_drop_is_reported_and_nothing_is_written_while_it_is_up() {
    let trace = cut(&cnc("stuck-acknowledge", 60, 20));
    let reported = texts(&trace, "acknowledge-stuck");
    assert_eq!(
        reported,
        ["acknowledge signal of output cnc_z did not drop within 500 ms after the strobe signal \
             (discrete:20); check that the \
             control's program drops the acknowledge signal when the strobe signal drops"],
        "{}",
        trace.lines()
    );
    let early = texts(&trace, "acknowledge-early");
    assert_eq!(
        early,
        ["acknowledge signal of output cnc_z was set before the strobe signal and did not drop within 500 \
             ms (discrete:20); \
             check that the control's program drops the acknowledge signal when the strobe signal drops"],
        "{}",
        trace.lines()
    );
    assert!(!story(&trace, 72.0, 79.9).contains(['v', 'S']), "{}", story(&trace, 72.0, 79.9));
    assert!(trace.states_between(55, 120).contains(&"holding"), "{}", trace.lines());
}

/// A device on the way kept the strobe until the gateway had given it up and dropped it.
#[test]
fn a_strobe_that_rises_late_is_dropped_and_the_axis_follows_again() {
    let late = "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nat = \"61s\"\n\
                register = \"coil:20\"\nwords = [1]\n";
    let trace = cut(late);
    assert_eq!(texts(&trace, "acknowledge-early").len(), 1, "{}", trace.lines());
    assert_eq!(trace.states_between(90, 180), ["active"], "{}", trace.lines());
}

#[test]
fn a_slow_acknowledge_inside_the_timeout_is_waited_for_and_one_beyond_is_not() {
    let late = |delay: &str| cnc("late-acknowledge", 30, 60) + &format!("delay = \"{delay}\"\n");
    let trace = cut(&late("400ms"));
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    assert_eq!(trace.reported("acknowledge-missing"), 0, "{}", trace.lines());
    let trace = cut(&late("900ms"));
    assert_eq!(trace.reported("acknowledge-missing"), 1, "{}", trace.lines());
    assert!(trace.states_between(30, 90).contains(&"holding"), "{}", trace.lines());
}

/// While a handshake waits, the line serves the other devices. Each acknowledge takes 400 ms, and a module on the line
/// is read every 200 ms.
#[test]
fn the_line_serves_other_devices_while_it_waits() {
    let module = "[device.thermocouples]\nbus = \"sensors\"\nunit = 1\nevery = \"1s\"";
    let beside = "[device.thermocouples]\nbus = \"control\"\nunit = 2\nevery = \"200ms\"";
    assert!(BENCH.contains(module));
    let late = cnc("late-acknowledge", 0, 120) + "delay = \"400ms\"\n";
    let trace = run(&shaken().replace(module, beside), &late, MINUTE);
    holds(&trace);
    assert_eq!(trace.reported("acknowledge-missing") + trace.reported("overrun"), 0, "{}", trace.lines());
    let read: Vec<f64> =
        (trace.wire.iter().filter(|seen| seen.address.register().unwrap().table == Table::Input))
            .map(|seen| trace.seconds(seen.at))
            .collect();
    let widest = read.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!(read.len() > 280 && widest <= 0.25, "{} reads, {widest} s apart", read.len());
}

/// Refuses requests of one kind with an exception, `times` times, from the nth on.
#[derive(Clone)]
struct Refusing {
    bus: Bus,
    counted: Arc<std::sync::Mutex<u32>>,
    from: u32,
    times: u32,
    kind: fn(&Request<'_>) -> bool,
    /// Panics instead of refusing.
    panics: bool,
}

struct RefusingWire {
    wire: Connection,
    by: Refusing,
}

impl Dial for Refusing {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async {
            let wire = isotherm::fieldbus::dial(&self.bus).unwrap().dial(tap).await?;
            Ok(Connection::Modbus(Box::new(RefusingWire { wire, by: self.clone() })))
        })
    }
}

impl ModbusWire for RefusingWire {}

impl Wire for RefusingWire {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        if (self.by.kind)(&request) {
            let mut counted = self.by.counted.lock().unwrap();
            *counted += 1;
            if (self.by.from..self.by.from + self.by.times).contains(&*counted) {
                drop(counted);
                assert!(!self.by.panics, "the wire is hot");
                return Box::pin(async { Err(Fault::Exception(4)) });
            }
        }
        Box::pin(self.wire.exchange(unit, request, send_guard))
    }
}

fn refusing(from: u32, times: u32, kind: fn(&Request<'_>) -> bool) -> Trace {
    let counted = Arc::new(std::sync::Mutex::new(0));
    let dialer: Dialer = Arc::new(move |bus: &Bus| {
        let (bus, counted) = (bus.clone(), counted.clone());
        Some(Box::new(Refusing { bus, counted, from, times, kind, panics: false }))
    });
    let trace = block_on(async {
        let mut world = World::new(&shaken(), "").await;
        world.gateway().options(|options| options.dialer = dialer).run(3 * MINUTE).await
    });
    holds(&trace);
    assert_eq!(trace.states_between(150, 180), ["active"], "{}", trace.lines());
    assert!(trace.states().contains(&"holding"), "{}", trace.lines());
    trace
}

#[test]
fn a_strobe_that_cannot_be_raised_is_reported() {
    let trace = refusing(5, 5, |request| {
        matches!(request, Request::Modbus(ModbusRequest::WriteCoil { value: true, .. }))
    });
    let reported = texts(&trace, "strobe-not-written");
    assert_eq!(reported.len(), 1, "{}", trace.lines());
    assert!(
        reported[0].starts_with("strobe signal of output cnc_z could not be written (coil:20): "),
        "{reported:?}"
    );
}

#[test]
fn a_strobe_that_cannot_be_dropped_is_reported_and_dropped_as_soon_as_that_is_possible() {
    let counted = Arc::new(std::sync::Mutex::new(0));
    let kind: fn(&Request<'_>) -> bool =
        |request| matches!(request, Request::Modbus(ModbusRequest::WriteCoil { value: false, .. }));
    let dialer: Dialer = Arc::new(move |bus: &Bus| {
        let (bus, counted) = (bus.clone(), counted.clone());
        Some(Box::new(Refusing { bus, counted, from: 6, times: 5, kind, panics: false }))
    });
    let trace = block_on(async {
        let mut world = World::new(&shaken(), "").await;
        world.gateway().options(|options| options.dialer = dialer).run(3 * MINUTE).await
    });
    law::holds(&trace);
    law::nothing_taken_jumps(&trace);
    let reported = texts(&trace, "strobe-not-dropped");
    assert_eq!(reported.len(), 1, "{}", trace.lines());
    assert!(
        reported[0].starts_with("strobe signal of output cnc_z could not be reset (coil:20): "),
        "{reported:?}"
    );
    assert_eq!(trace.states_between(150, 180), ["active"], "{}", trace.lines());
    let last = trace.wire.iter().rfind(|seen| seen.is_write() && seen.address == STROBE.into()).unwrap();
    assert_eq!(last.wanted, [0]);
}

#[test]
fn an_acknowledge_that_cannot_be_read_is_reported() {
    let asks = |request: &Request<'_>| {
        matches!(request, Request::Modbus(ModbusRequest::Read { from: ACKNOWLEDGE, .. }))
    };
    let trace = refusing(30, 6, asks);
    let reported = texts(&trace, "acknowledge-not-read");
    assert_eq!(reported.len(), 1, "{}", trace.lines());
    assert!(
        reported[0].starts_with("acknowledge signal of output cnc_z could not be read (discrete:20): "),
        "{reported:?}"
    );
}

#[test]
fn a_cnc_that_dies_in_the_middle_of_a_handshake_is_taken_up_again_without_a_jump() {
    for place in 0..8 {
        let at = 20_000 + 37 * place;
        let silent =
            format!("[[fault]]\ndevice = \"cnc\"\nkind = \"silent\"\nat = \"{at}ms\"\nfor_time = \"10s\"\n");
        let late = cnc("late-acknowledge", 0, 600) + "delay = \"300ms\"\n";
        let trace = run(&shaken(), &(late + &silent), 2 * MINUTE);
        law::holds(&trace);
        law::nothing_taken_jumps(&trace);
        assert_eq!(trace.states_between(90, 120), ["active"], "{}", trace.lines());
        assert_eq!(trace.reported("foreign-change") + trace.reported("disarmed"), 0, "{}", trace.lines());
    }
}

#[test]
fn asked_to_stop_in_the_middle_of_a_handshake_it_ends_with_the_strobe_dropped() {
    let late = cnc("late-acknowledge", 0, 600) + "delay = \"400ms\"\n";
    for place in 0..8u32 {
        for action in ["{ action = \"ramp\", after = \"30s\" }", "{ action = \"hold\" }"] {
            let text = shaken().replace("{ action = \"ramp\", after = \"30s\" }", action);
            let trace = run(&text, &late, 20 * SECOND + place * Duration::from_millis(130));
            holds(&trace);
            assert!(trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
        }
    }
}

#[test]
fn asked_to_stop_while_no_acknowledge_comes_it_ends_with_the_strobe_dropped() {
    for place in 0..4u32 {
        let text = shaken().replace("{ action = \"ramp\", after = \"30s\" }", "{ action = \"hold\" }");
        let trace =
            run(&text, &cnc("no-acknowledge", 20, 6000), 40 * SECOND + place * Duration::from_millis(170));
        holds(&trace);
        assert!(!trace.outcome.rested, "{:?}", trace.outcome);
    }
}

#[test]
fn switched_off_in_the_middle_of_a_handshake_the_strobe_goes_down_all_the_same() {
    let late = cnc("late-acknowledge", 0, 600) + "delay = \"400ms\"\n";
    for place in 0..5u32 {
        let trace = block_on(async {
            let mut world = World::new(&shaken(), &late).await;
            let trial = world.gateway().command(20 * SECOND + place * SECOND, Command::Disarm);
            trial.run(MINUTE).await
        });
        holds(&trace);
        assert_eq!(trace.states_between(30, 60), ["off"], "{}", trace.lines());
    }
}

#[test]
fn a_panic_in_the_middle_of_a_handshake_leaves_no_strobe_up() {
    for from in 20..26 {
        for action in ["{ action = \"ramp\", after = \"30s\" }", "{ action = \"hold\" }"] {
            let text = shaken().replace("{ action = \"ramp\", after = \"30s\" }", action);
            let counted = Arc::new(std::sync::Mutex::new(0));
            let asks: fn(&Request<'_>) -> bool =
                |request| matches!(request, Request::Modbus(ModbusRequest::Read { from: ACKNOWLEDGE, .. }));
            let dialer: Dialer = Arc::new(move |bus: &Bus| {
                let (bus, counted) = (bus.clone(), counted.clone());
                Some(Box::new(Refusing { bus, counted, from, times: 1, kind: asks, panics: true }))
            });
            let trace = block_on(async {
                let mut world = World::new(&text, "").await;
                world.gateway().options(|options| options.dialer = dialer).run(MINUTE).await
            });
            holds(&trace);
            assert_eq!(trace.reported("task-failed"), 1, "{}", trace.lines());
            assert!(trace.outcome.failed && trace.outcome.rested, "{:?}\n{}", trace.outcome, trace.lines());
        }
    }
}

#[test]
fn a_strobe_that_an_earlier_gateway_left_up_is_dropped_before_anything_is_written() {
    let up = "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"coil:20\"\nwords = [1]\n";
    let trace = run(&shaken(), up, 2 * MINUTE);
    holds(&trace);
    let story = story(&trace, 0.0, 20.0);
    let (first, value) = (story.find('s').unwrap(), story.find('v').unwrap());
    assert!(first < value, "{story}");
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let manual = shaken().replace("arm  = \"auto\"", "arm  = \"manual\"");
    let trace = run(&manual, up, MINUTE);
    assert_eq!(trace.wire.iter().filter(|seen| seen.is_write()).count(), 0, "nothing before a person arms");
}

#[test]
fn a_dry_run_raises_no_strobe() {
    let trace = block_on(async {
        let mut world = World::new(&shaken(), "").await;
        world.gateway().options(|options| options.dry_run = true).run(MINUTE).await
    });
    holds(&trace);
    assert_eq!(trace.wire.iter().filter(|seen| seen.is_write()).count(), 0);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
}

#[test]
fn a_strobe_and_an_acknowledge_may_be_bits_of_registers() {
    let text = shaken().replace("coil:20", "holding:120.3").replace("discrete:20", "input:16.1");
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    law::nothing_taken_jumps(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    assert!(trace.taken.len() > 10, "{}", trace.taken.len());
    let mut strobes: Vec<u16> = trace
        .wire
        .iter()
        .filter(|seen| seen.is_write() && seen.address.register().unwrap().offset == 120)
        .map(|seen| seen.wanted[0])
        .collect();
    strobes.dedup();
    assert!(
        strobes.chunks(2).skip(1).all(|pair| pair == [8, 0] || pair == [0, 8] || pair == [0]),
        "{strobes:?}"
    );
}
