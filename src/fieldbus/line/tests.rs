use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::*;
use crate::clock::{BootClock, TimeOfDay};
use crate::fieldbus::kinds::modbus::wire::ModbusWire;
use crate::fieldbus::kinds::opcua::fault::OpcUaFault;
use crate::fieldbus::wire::{Boxed, ModbusRequest, Wire};
use isotherm_core::codec::{Register, Table};
use isotherm_profile::{BusId, Functions, Quirks, ReadBy};

mod connections;
mod gateway;
mod order;

/// Result of one request or one attempt to connect.
#[derive(Clone, Debug)]
enum Turn {
    Gives(Result<Answer, Fault>),
    /// Valid answer after this time.
    Takes(Duration),
    /// Exception of a gateway for a missing answer, after this time.
    Misses(Duration),
    NeverEnds,
}

#[derive(Debug, Default)]
struct Script {
    dials: VecDeque<Turn>,
    answers: VecDeque<Turn>,
    dialled: u32,
    /// Requests that were sent: unit, function, and milliseconds since the start of the test.
    asked: Vec<(u8, u8, u128)>,
    /// Whether `listen` waits for the whole time, as on a serial line.
    is_received: bool,
    began: Option<tokio_time::Instant>,
}

#[allow(clippy::disallowed_types, reason = "the paused clock of the test itself")]
mod tokio_time {
    pub(super) type Instant = tokio::time::Instant;
}

type Shared = Arc<Mutex<Script>>;

struct Scripted(Shared);

impl Dial for Scripted {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async {
            let turn = {
                let mut script = self.0.lock().unwrap();
                script.dialled += 1;
                script.dials.pop_front()
            };
            match turn {
                Some(Turn::NeverEnds) => std::future::pending().await,
                Some(Turn::Gives(Err(fault))) => Err(fault),
                _ => Ok(Connection::Modbus(Box::new(Scripted(self.0.clone())))),
            }
        })
    }
}

impl Wire for Scripted {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(async move {
            send_guard.leave()?;
            let turn = {
                let mut script = self.0.lock().unwrap();
                let began = *script.began.get_or_insert_with(tokio_time::Instant::now);
                script.asked.push((unit, request.function(), began.elapsed().as_millis()));
                script.answers.pop_front()
            };
            match turn {
                Some(Turn::NeverEnds) => std::future::pending().await,
                Some(Turn::Gives(answer)) => answer,
                Some(Turn::Takes(span)) => {
                    tokio::time::sleep(span).await;
                    Ok(good())
                }
                Some(Turn::Misses(span)) => {
                    tokio::time::sleep(span).await;
                    Err(Fault::Exception(11))
                }
                None => Ok(good()),
            }
        })
    }
}

impl ModbusWire for Scripted {
    fn listen(&mut self, _unit: u8, span: Duration, quiet: Duration) -> Boxed<'_, Result<(), Fault>> {
        let is_received = self.0.lock().unwrap().is_received;
        Box::pin(async move {
            if is_received {
                tokio::time::sleep(span + quiet).await;
            }
            Ok(())
        })
    }
}

fn good() -> Answer {
    Answer::Registers(vec![7])
}

const READ: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 1 }, 1);
const WRITE: Request<'static> = Request::Modbus(ModbusRequest::WriteSingle { at: 1, value: 9 });

/// Line with a clock that the test sets.
struct Rig {
    line: DeviceLine,
    begun: Moment,
    time: Arc<Mutex<Duration>>,
}

impl Rig {
    /// Sends a request at this time in milliseconds.
    async fn ask(&mut self, device: usize, request: Request<'_>, at: u64) -> Result<Answer, Fault> {
        self.ask_by(device, request, at, SendDeadline::None).await
    }

    async fn ask_by(
        &mut self,
        device: usize,
        request: Request<'_>,
        at: u64,
        leave: SendDeadline,
    ) -> Result<Answer, Fault> {
        self.goes_to(at);
        self.line.sample();
        self.line.request(DeviceId(device), request, leave).await.map(|answered| answered.answer)
    }

    fn goes_to(&self, at: u64) {
        *self.time.lock().unwrap() = Duration::from_millis(at);
    }

    fn is_backing_off(&self, device: usize, at: u64) -> bool {
        self.line.is_backing_off(DeviceId(device), self.begun.after(Duration::from_millis(at)))
    }
}

fn line(change: impl Fn(&mut Device)) -> (Rig, Shared) {
    line_of(Duration::from_millis(300), change)
}

fn line_of(timeout: Duration, change: impl Fn(&mut Device)) -> (Rig, Shared) {
    let bus = Bus {
        name: "cell".to_owned(),
        transport: isotherm_profile::Transport::Tcp,
        address: String::new(),
        tls: None,
        opcua: None,
        timeout,
        late: Duration::from_secs(30),
        pipeline: 1,
        quirks: Quirks::default(),
        sync: None,
    };
    let device = |unit| {
        let mut device = Device {
            label: String::new(),
            name: format!("unit{unit}"),
            bus: BusId(0),
            unit,
            every: Duration::from_secs(1),
            functions: Functions::ALL,
            verify: Vec::new(),
            template: None,
            can: None,
            source_time: None,
            is_pc: false,
            read: ReadBy::Poll,
            quirks: Quirks::default(),
        };
        change(&mut device);
        device
    };
    let (one, two) = (device(1), device(2));
    let script = Shared::default();
    let time = Arc::new(Mutex::new(Duration::ZERO));
    let passed = time.clone();
    let clock = Clock::wall_by(BootClock::by(move || *passed.lock().unwrap()), TimeOfDay::default());
    let devices = [(DeviceId(0), &one), (DeviceId(1), &two)];
    let line = DeviceLine::new(&bus, &devices, Box::new(Scripted(script.clone())), &clock);
    (Rig { line, begun: clock.now(), time }, script)
}

fn answers(script: &Shared, turns: &[Turn]) {
    script.lock().unwrap().answers.extend(turns.iter().cloned());
}

#[tokio::test(start_paused = true)]
async fn a_silent_unit_is_left_alone_for_a_pause_and_the_other_one_is_served() {
    let (mut line, script) = line(|_| {});
    answers(&script, &[Turn::NeverEnds]);
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Timeout));
    assert!(line.is_backing_off(0, 1000) && !line.is_backing_off(1, 0));
    assert_eq!(line.ask(0, READ, 400).await, Err(Fault::Timeout), "at once, with its last fault");
    assert_eq!(line.ask(1, READ, 400).await, Ok(good()));
    assert_eq!(script.lock().unwrap().asked.len(), 2, "the resting unit was not asked");
    assert!(!line.is_backing_off(0, 1300), "the pause begins when the timeout is over");
    assert_eq!(line.ask(0, READ, 1300).await, Ok(good()));
}

#[tokio::test(start_paused = true)]
async fn after_a_timeout_and_after_a_wrong_answer_the_connection_is_a_new_one() {
    let (mut line, script) = line(|_| {});
    answers(
        &script,
        &[Turn::NeverEnds, Turn::Gives(Err(Fault::Peer(crate::fieldbus::error::PeerFault::Foreign)))],
    );
    for now in [0, 2000, 4000] {
        let _ = line.ask(0, READ, now).await;
    }
    assert_eq!(script.lock().unwrap().dialled, 3);
}

#[tokio::test(start_paused = true)]
async fn an_exception_is_an_answer_and_keeps_the_connection() {
    let (mut line, script) = line(|_| {});
    answers(&script, &[Turn::Gives(Err(Fault::Exception(4)))]);
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Exception(4)));
    assert_eq!(line.ask(0, READ, 1).await, Ok(good()));
    assert_eq!(script.lock().unwrap().dialled, 1);
}

#[tokio::test(start_paused = true)]
async fn a_read_on_a_connection_that_broke_while_idle_is_asked_once_more() {
    let (mut line, script) = line(|_| {});
    answers(&script, &[Turn::Gives(Ok(good())), Turn::Gives(Err(Fault::BROKEN))]);
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    assert_eq!(line.ask(0, READ, 1000).await, Ok(good()));
    let script = script.lock().unwrap();
    assert_eq!((script.dialled, script.asked.len()), (2, 3));
}

#[tokio::test(start_paused = true)]
async fn a_write_on_a_connection_that_broke_is_never_repeated() {
    let (mut line, script) = line(|_| {});
    answers(&script, &[Turn::Gives(Ok(good())), Turn::Gives(Err(Fault::BROKEN))]);
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    assert_eq!(line.ask(0, WRITE, 1000).await, Err(Fault::BROKEN));
    let script = script.lock().unwrap();
    let writes = script.asked.iter().filter(|(_, function, _)| *function == 6).count();
    assert_eq!((script.dialled, writes), (2, 1));
}

#[tokio::test(start_paused = true)]
async fn what_goes_by_what_was_read_leaves_on_no_other_connection() {
    let (mut line, script) = line(|_| {});
    let here = SendDeadline::OnConnection(Moment::END);
    assert_eq!(line.ask_by(0, WRITE, 0, here).await, Err(Fault::CLOSED), "nothing has been read yet");
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    assert_eq!(line.ask_by(0, WRITE, 100, here).await, Ok(good()));
    // The fault of the other device closes the connection for both.
    answers(&script, &[Turn::Gives(Err(Fault::Peer(PeerFault::Malformed)))]);
    assert_eq!(line.ask(1, READ, 200).await, Err(Fault::Peer(PeerFault::Malformed)));
    assert_eq!(line.ask_by(0, WRITE, 300, here).await, Err(Fault::CLOSED));
    assert!(!line.is_backing_off(0, 300), "the device has done nothing wrong");
    assert_eq!(line.ask(0, READ, 300).await, Ok(good()));
    assert_eq!(line.ask_by(0, WRITE, 300, here).await, Ok(good()));
    let script = script.lock().unwrap();
    let writes = script.asked.iter().filter(|(_, function, _)| *function == 6).count();
    assert_eq!((script.dialled, writes), (2, 2));
}

#[tokio::test(start_paused = true)]
async fn a_write_that_was_sent_is_never_reported_as_not_done_though_the_line_gives_way() {
    let (mut line, script) = line(|_| {});
    for second in 0..4 {
        assert_eq!(line.ask(0, READ, 10_000 * second).await, Ok(good()));
        answers(&script, &[Turn::Gives(Err(Fault::BROKEN))]);
        let written = line.ask(0, WRITE, 10_000 * second + 300).await;
        assert_eq!(written, Err(Fault::BROKEN));
        assert_eq!(Fault::BROKEN.outcome(), crate::fieldbus::error::Outcome::Unknown);
        // The new connection breaks as soon as the first one.
        answers(&script, &[Turn::Gives(Err(Fault::BROKEN))]);
        assert_eq!(line.ask(0, WRITE, 10_000 * second + 600).await, Err(Fault::BROKEN));
        script.lock().unwrap().answers.clear();
        line.line.revive(None);
    }
}

#[tokio::test(start_paused = true)]
async fn a_connection_that_breaks_at_once_again_is_not_tried_for_ever() {
    let (mut line, script) = line(|_| {});
    answers(
        &script,
        &[Turn::Gives(Ok(good())), Turn::Gives(Err(Fault::BROKEN)), Turn::Gives(Err(Fault::BROKEN))],
    );
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    assert_eq!(line.ask(0, READ, 1000).await, Err(Fault::Link(LinkFault::TurnedAway)));
    assert!(line.is_backing_off(0, 1001));
    assert_eq!(script.lock().unwrap().asked.len(), 3);
}

#[tokio::test(start_paused = true)]
async fn while_nobody_listens_requests_fail_at_once_and_one_attempt_is_made_per_pause() {
    let (mut line, script) = line(|_| {});
    let refused = Fault::Link(LinkFault::Refused);
    script.lock().unwrap().dials.extend([Turn::Gives(Err(refused)), Turn::Gives(Err(refused))]);
    assert_eq!(line.ask(0, READ, 0).await, Err(refused));
    assert_eq!(line.ask(1, READ, 1).await, Err(Fault::Link(LinkFault::Down)));
    assert_eq!(line.ask(1, READ, 1000).await, Err(refused));
    assert_eq!(line.line.refusals(), (2, refused));
    assert_eq!(line.ask(0, READ, 3000).await, Ok(good()), "no unit rests for the line's fault");
    assert_eq!(script.lock().unwrap().dialled, 3);
}

#[tokio::test(start_paused = true)]
async fn a_host_that_never_answers_the_dial_costs_one_timeout() {
    let (mut line, script) = line(|_| {});
    script.lock().unwrap().dials.push_back(Turn::NeverEnds);
    let began = tokio_time::Instant::now();
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Link(LinkFault::Unreachable)));
    let took = began.elapsed().as_millis();
    assert!((300..310).contains(&took), "{took} ms");
}

#[tokio::test(start_paused = true)]
async fn a_pause_between_requests_is_kept_and_none_is_made_before_the_first() {
    let (mut line, script) = line(|device| device.quirks.pause_between_requests = Duration::from_millis(50));
    for _ in 0..3 {
        assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    }
    let asked: Vec<u128> = script.lock().unwrap().asked.iter().map(|(_, _, at)| *at).collect();
    assert!(asked[0] == 0 && (50..55).contains(&asked[1]) && (100..110).contains(&asked[2]), "{asked:?}");
}

#[tokio::test(start_paused = true)]
async fn a_pause_after_connecting_is_a_device_s_own_and_no_part_of_the_timeout() {
    let (mut line, script) = line(|device| {
        device.quirks.pause_after_connect = Duration::from_secs(if device.unit == 2 { 2 } else { 0 });
    });
    let began = tokio_time::Instant::now();
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()), "though its timeout is 300 ms");
    assert_eq!(line.ask(1, READ, 2000).await, Ok(good()));
    let took = began.elapsed().as_millis();
    assert!((2000..2010).contains(&took), "once, {took} ms");
    assert_eq!(script.lock().unwrap().dialled, 1);
}

#[tokio::test(start_paused = true)]
async fn what_the_profile_does_not_list_and_what_does_not_fit_never_leaves_the_house() {
    let (mut line, script) = line(|device| device.functions.write_single = false);
    let refused = Err(Fault::Caller(CallerFault::Function));
    assert_eq!(line.ask(0, WRITE, 0).await, refused);
    let too_far = Request::read_registers(Register { table: Table::Holding, offset: 65535 }, 2);
    assert_eq!(line.ask(0, too_far, 0).await, Err(Fault::Caller(CallerFault::Extent)));
    let too_many = Request::read_registers(Register { table: Table::Holding, offset: 0 }, 126);
    assert_eq!(line.ask(0, too_many, 0).await, Err(Fault::Caller(CallerFault::Extent)));
    assert_eq!(line.ask(9, READ, 0).await, Err(Fault::Caller(CallerFault::Extent)));
    let script = script.lock().unwrap();
    assert!(script.asked.is_empty() && script.dialled == 0);
}

const REJECTED: Fault = Fault::Link(LinkFault::OpcUa(OpcUaFault::UserRefused));

/// Scripted device whose server rejects logins.
struct Rejecting(Scripted);

impl Dial for Rejecting {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        self.0.dial(tap)
    }

    fn pause_after(&self, fault: Fault) -> Duration {
        if fault == REJECTED { Duration::from_mins(5) } else { Duration::ZERO }
    }
}

#[tokio::test(start_paused = true)]
async fn after_a_fault_with_a_pause_of_its_own_no_attempt_is_made_for_that_time() {
    let (mut line, script) = line(|_| {});
    line.line.dial = Box::new(Rejecting(Scripted(script.clone())));
    let refused = Fault::Link(LinkFault::Refused);
    let turns = [REJECTED, refused].map(|fault| Turn::Gives(Err(fault)));
    script.lock().unwrap().dials.extend(turns);
    assert_eq!(line.ask(0, READ, 0).await, Err(REJECTED));
    for at in [1000, 60_000, 299_000] {
        assert_eq!(line.ask(0, READ, at).await, Err(Fault::Link(LinkFault::Down)), "{at}");
    }
    assert_eq!(line.line.refusals(), (1, REJECTED));
    assert_eq!(line.ask(0, READ, 301_000).await, Err(refused));
    assert_eq!(line.ask(0, READ, 304_000).await, Ok(good()), "other faults have the usual pause");
    assert_eq!(script.lock().unwrap().dialled, 3);
}

/// Scripted device on a line without transaction numbers.
struct Nameless(Scripted);

impl Dial for Nameless {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async {
            self.0.dial(tap).await?;
            Ok(Connection::Modbus(Box::new(Nameless(Scripted(self.0.0.clone())))))
        })
    }
}

impl Wire for Nameless {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        self.0.exchange(unit, request, send_guard)
    }
}

impl ModbusWire for Nameless {
    fn has_transaction_id(&self) -> bool {
        false
    }

    fn listen(&mut self, _unit: u8, span: Duration, _quiet: Duration) -> Boxed<'_, Result<(), Fault>> {
        Box::pin(async move {
            tokio::time::sleep(span).await;
            Ok(())
        })
    }
}

fn nameless() -> (Rig, Shared) {
    let (mut line, script) = line(|_| {});
    line.line.dial = Box::new(Nameless(Scripted(script.clone())));
    (line, script)
}

#[tokio::test(start_paused = true)]
async fn without_transactions_a_unit_is_not_asked_again_before_its_late_answer_has_had_its_time() {
    let (mut line, script) = nameless();
    answers(&script, &[Turn::NeverEnds]);
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Timeout));
    assert!(line.is_backing_off(0, 4 * 300 - 1), "three timeouts more, also where the pause is over");
    assert_eq!(line.ask(1, READ, 300).await, Ok(good()), "the other one is asked at once");
    // The clock of the caller may be ahead of wall-clock time. The silence before the next request is wall-clock time.
    assert_eq!(line.ask(0, READ, 2200).await, Ok(good()));
    let script = script.lock().unwrap();
    let asked: Vec<u128> = script.asked.iter().map(|(_, _, at)| *at).collect();
    assert!((300..310).contains(&asked[1]) && (1200..1220).contains(&asked[2]), "{asked:?}");
    assert_eq!(script.dialled, 1, "one miss does not open the port again");
}

#[tokio::test(start_paused = true)]
async fn without_transactions_a_late_answer_is_waited_for_under_every_name_that_its_unit_has() {
    let (mut line, script) = nameless();
    line.line.units.at_mut(1).number = 1;
    answers(&script, &[Turn::NeverEnds]);
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Timeout));
    assert!(line.is_backing_off(1, 4 * 300 - 1), "it is the same unit");
    assert_eq!(line.ask(1, READ, 4 * 300).await, Ok(good()));
    let script = script.lock().unwrap();
    assert!(script.asked[1].2 >= 4 * 300, "{:?}", script.asked);
}

#[tokio::test(start_paused = true)]
async fn without_transactions_the_second_miss_in_a_row_opens_the_line_again() {
    let (mut line, script) = nameless();
    answers(&script, &[Turn::NeverEnds, Turn::Gives(Ok(good())), Turn::NeverEnds, Turn::NeverEnds]);
    for (device, now) in [(0, 0), (1, 300), (0, 5000), (1, 6000), (1, 10_000)] {
        let _ = line.ask(device, READ, now).await;
    }
    assert_eq!(script.lock().unwrap().dialled, 2);
}

#[tokio::test(start_paused = true)]
async fn without_transactions_nothing_that_was_sent_is_repeated_and_what_was_not_sent_is_asked_on_a_new_line()
{
    let (mut line, script) = nameless();
    let closed = Fault::Link(LinkFault::Closed);
    answers(&script, &[Turn::Gives(Ok(good())), Turn::Gives(Err(closed)), Turn::Gives(Ok(Answer::Done))]);
    assert_eq!(line.ask(0, READ, 0).await, Ok(good()));
    assert_eq!(line.ask(0, WRITE, 1000).await, Ok(Answer::Done));
    answers(&script, &[Turn::Gives(Err(Fault::BROKEN))]);
    assert_eq!(line.ask(0, READ, 2000).await, Err(Fault::BROKEN));
    assert!(line.is_backing_off(0, 2001) && !line.is_backing_off(1, 2001));
    assert_eq!(script.lock().unwrap().dialled, 3);
}

#[tokio::test(start_paused = true)]
async fn a_device_that_wants_it_gets_a_connection_for_each_request() {
    let (mut line, script) = line(|device| device.quirks.close_after_each = true);
    for now in [0, 1000] {
        assert_eq!(line.ask(0, READ, now).await, Ok(good()));
        assert!(line.line.is_connected(), "closed by us is not down");
    }
    assert_eq!(script.lock().unwrap().dialled, 2);
}

#[tokio::test(start_paused = true)]
async fn a_device_that_hangs_up_before_its_first_answer_is_said_to_have_another_master() {
    let (mut line, script) = line(|_| {});
    answers(&script, &[Turn::Gives(Err(Fault::BROKEN))]);
    let fault = line.ask(0, READ, 0).await.unwrap_err();
    assert_eq!(fault, Fault::Link(LinkFault::TurnedAway));
    let said = crate::fieldbus::explain::explain(fault);
    assert!(said.contains("is another master connected?"), "{said}");
    assert!(line.is_backing_off(0, 700), "it is not asked again at once");
    assert_eq!(line.ask(0, READ, 1100).await, Ok(good()));
}

#[tokio::test(start_paused = true)]
async fn a_connection_that_another_master_takes_again_and_again_is_not_fought_for() {
    let (mut line, script) = line(|_| {});
    let mut dialled = Vec::new();
    // The other master reconnects 300 ms after each poll of the gateway. Polls come every second, for a minute.
    for second in 0..60 {
        if line.line.is_connected() {
            answers(&script, &[Turn::Gives(Err(Fault::BROKEN))]);
        }
        let before = script.lock().unwrap().dialled;
        let answer = line.ask(0, READ, 1000 * second).await;
        script.lock().unwrap().answers.clear();
        if script.lock().unwrap().dialled > before {
            dialled.push(second);
            assert_eq!(answer, Ok(good()), "second {second}");
        } else {
            assert_eq!(answer, Err(Fault::Link(LinkFault::Contested)), "second {second}");
        }
    }
    let pauses: Vec<u64> = dialled.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(dialled.len() <= 9 && pauses.is_sorted(), "a fight would be 60: {dialled:?}");
    // The other master is gone: a connection of normal length ends the back-off.
    let after = 100_000;
    assert_eq!(line.ask(0, READ, after).await, Ok(good()));
    assert_eq!(line.ask(0, READ, after + 6000).await, Ok(good()));
    answers(&script, &[Turn::Gives(Err(Fault::BROKEN))]);
    assert_eq!(line.ask(0, READ, after + 7000).await, Ok(good()), "asked once more");
}

/// Sends a request every second for half a minute, on a line whose clock follows the test. Returns the detected gaps.
async fn stands_still(
    timeout: Duration,
    change: impl Fn(&mut Device),
    turn: impl Fn(&Shared),
) -> Vec<Moment> {
    let (rig, script) = line_of(timeout, change);
    let begun = tokio_time::Instant::now();
    let clock = Clock::wall_by(BootClock::by(move || begun.elapsed()), TimeOfDay::default());
    let mut line = rig.line;
    line.send_guard = SendGuard::without_deadline(&clock).aged(Duration::from_secs(5));
    let mut gaps = Vec::new();
    for second in 0..30 {
        turn(&script);
        let _ = line.request(DeviceId(second % 2), READ, SendDeadline::None).await;
        gaps.extend(line.send_guard.stalled_at());
        let pause = Duration::from_secs(1);
        line.send_guard.away_for(pause);
        tokio::time::sleep(pause).await;
        line.sample();
        gaps.extend(line.send_guard.stalled_at());
    }
    gaps
}

#[tokio::test(start_paused = true)]
async fn a_line_that_waits_as_long_as_it_may_has_not_stood_still() {
    let (half, two) = (Duration::from_millis(500), Duration::from_secs(2));
    let nothing = |_: &Shared| {};
    let listens = |script: &Shared| script.lock().unwrap().is_received = true;
    assert_eq!(stands_still(half, |_| {}, listens).await, [], "a serial line that is listened to");
    let slow = |device: &mut Device| device.quirks.pause_after_connect = Duration::from_secs(3);
    assert_eq!(
        stands_still(half, slow, nothing).await,
        [],
        "a device that wants a pause after each connection"
    );
    let slow = |device: &mut Device| device.quirks.pause_between_requests = Duration::from_secs(3);
    assert_eq!(stands_still(half, slow, nothing).await, [], "one that wants a pause before each request");
    let answers_late = |script: &Shared| answers(script, &[Turn::Takes(Duration::from_millis(1900))]);
    assert_eq!(stands_still(two, |_| {}, answers_late).await, [], "one that answers at the last moment");
    let is_silent = |script: &Shared| answers(script, &[Turn::NeverEnds]);
    assert_eq!(stands_still(two, |_| {}, is_silent).await, [], "one that never answers");
    let dials = |script: &Shared| script.lock().unwrap().dials.push_back(Turn::NeverEnds);
    assert_eq!(stands_still(two, |_| {}, dials).await, [], "one that cannot be reached");
}
