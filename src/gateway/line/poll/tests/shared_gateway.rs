//! Polls of a healthy unit that shares a Modbus gateway with dead ones, or whose server closes connections. A whole
//! gateway runs in paused time, against a Modbus gateway that works like common ones.

use super::*;
use crate::fieldbus::error::LinkFault;
use crate::fieldbus::kinds::modbus::tcp::ModbusTcp;
use crate::observe::status::Status;

const SECOND: Duration = Duration::from_secs(1);
/// Unit number of the healthy unit. The other ones are dead.
const HEALTHY: u8 = 1;
const DEAD: [u8; 2] = [2, 3];
/// Largest part of the time in which the healthy unit may be not good.
const MOST: f64 = 0.02;

/// Answer of the Modbus gateway when it gives up a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GivesUp {
    WithException,
    Silently,
}

/// Behaviour of a Modbus gateway. It has one request at a time on its serial line, whatever happens to its clients.
#[derive(Clone, Copy, Debug)]
struct Behaviour {
    /// Own timeout for a silent unit.
    own: Duration,
    gives_up: GivesUp,
    /// Time after the end of a connection until the next client is accepted; `None`: any number of clients.
    frees_after: Option<Duration>,
    /// Whether each connection is closed after one answer.
    closes: bool,
    /// Time for which each new connection ignores requests.
    deaf_for: Duration,
    /// Time at which the dead units fail, and time at which they answer again.
    dead: (Duration, Duration),
    /// Answer time of the dead units, if they are only slow.
    slow: Option<Duration>,
    /// Whether each answer gets the transaction and unit of the newest request on its connection.
    stamps: bool,
    /// Whether an answer of a slow unit is kept, and sent as the answer to the next request on its connection.
    keeps: bool,
}

const USUAL: Behaviour = Behaviour {
    own: SECOND,
    gives_up: GivesUp::WithException,
    frees_after: None,
    closes: false,
    deaf_for: Duration::ZERO,
    dead: (Duration::ZERO, Duration::MAX),
    slow: None,
    stamps: false,
    keeps: false,
};

/// Modbus gateway with a healthy unit and two dead ones.
struct Peer {
    behaviour: Behaviour,
    begun: tokio_time::Instant,
    serial: tokio::sync::Mutex<()>,
    /// Unit of each request, in the order of their arrival.
    asked: Mutex<Vec<u8>>,
    /// Number of connections, and the time at which the next one is accepted. `None`: the place is taken.
    dialled: AtomicU64,
    free_at: Mutex<Option<Duration>>,
}

impl Peer {
    fn new(behaviour: Behaviour) -> Arc<Peer> {
        Arc::new(Peer {
            behaviour,
            begun: tokio_time::Instant::now(),
            serial: tokio::sync::Mutex::new(()),
            asked: Mutex::default(),
            dialled: AtomicU64::new(0),
            free_at: Mutex::new(Some(Duration::ZERO)),
        })
    }

    fn is_dead(&self, unit: u8) -> bool {
        let (from, until) = self.behaviour.dead;
        unit != HEALTHY && (from..until).contains(&self.begun.elapsed())
    }

    /// Takes the only place, if it is free. Returns whether the connection is accepted.
    fn accepts(&self) -> bool {
        self.dialled.fetch_add(1, Ordering::Relaxed);
        if self.behaviour.frees_after.is_none() {
            return true;
        }
        let mut free_at = self.free_at.lock().unwrap();
        let is_free = free_at.is_some_and(|moment| self.begun.elapsed() >= moment);
        if is_free {
            *free_at = None;
        }
        is_free
    }

    /// Returns the answer of the serial line, or of the Modbus gateway that gives up; `None` if there is none.
    async fn passes(&self, question: &[u8; 12]) -> Option<Vec<u8>> {
        let Behaviour { own, gives_up, slow, .. } = self.behaviour;
        let (unit, function) = (question[6], question[7]);
        let _line = self.serial.lock().await;
        let takes = if self.is_dead(unit) { slow.unwrap_or(Duration::MAX) } else { TAKES };
        tokio::time::sleep(takes.min(own)).await;
        match takes <= own {
            true => Some(vec![function, 2, 0, 200 + unit]),
            false => (gives_up == GivesUp::WithException).then(|| vec![function | 0x80, 11]),
        }
    }

    async fn lives(self: Arc<Peer>, end: DuplexStream) {
        let accepted = self.begun.elapsed();
        let (mut reads, mut writes) = tokio::io::split(end);
        let (queue, mut queued) = tokio::sync::mpsc::unbounded_channel();
        let newest = Arc::new(Mutex::new([0_u8; 12]));
        let stored = newest.clone();
        let reader = tokio::spawn(async move {
            let mut question = [0; 12];
            while reads.read_exact(&mut question).await.is_ok() {
                *stored.lock().unwrap() = question;
                if queue.send(question).is_err() {
                    return;
                }
            }
        });
        let mut kept = None;
        while let Some(question) = queued.recv().await {
            if self.begun.elapsed() < accepted + self.behaviour.deaf_for {
                continue;
            }
            self.asked.lock().unwrap().push(question[6]);
            let Some(pdu) = self.passes(&question).await else { continue };
            let pdu = match kept.take() {
                Some(before) => {
                    kept = Some(pdu);
                    before
                }
                None if self.behaviour.keeps && self.is_dead(question[6]) => {
                    kept = Some(pdu);
                    continue;
                }
                None => pdu,
            };
            let head = if self.behaviour.stamps { *newest.lock().unwrap() } else { question };
            let length = u8::try_from(pdu.len() + 1).unwrap();
            let frame = [&head[..2], &[0, 0, 0, length, head[6]], pdu.as_slice()].concat();
            if writes.write_all(&frame).await.is_err() || self.behaviour.closes {
                break;
            }
        }
        // The stream ends with its second half.
        reader.abort();
        if let Some(span) = self.behaviour.frees_after {
            *self.free_at.lock().unwrap() = Some(self.begun.elapsed() + span);
        }
    }
}

impl Dial for Arc<Peer> {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        if !self.accepts() {
            return Box::pin(std::future::ready(Err(Fault::Link(LinkFault::Refused))));
        }
        let (ours, theirs) = duplex(1024);
        tokio::spawn(self.clone().lives(theirs));
        Box::pin(std::future::ready(Ok(Connection::ModbusTcp(ModbusTcp::new(ours, tap)))))
    }
}

/// Profile with these units in this order, each read with this period, and an axis that depends on the healthy unit.
fn cell(units: &[u8], every: Duration) -> isotherm_profile::Profile {
    let (every, max_age) = (every.as_millis(), (2 * every).max(5 * SECOND).as_millis());
    let mut text = "[machine]\nname = \"cell\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"gateway:502\"\ntimeout = \"500ms\"\n"
        .to_owned();
    for (place, unit) in units.iter().enumerate() {
        text += &format!(
            "[device.d{place}]\nbus = \"cell\"\nunit = {unit}\nevery = \"{every}ms\"\n\
             [signal.t{unit}]\ndevice = \"d{place}\"\nregister = \"input:0\"\ntype = \"i16\"\nscale = 0.1\n\
             unit = \"degC\"\nmax_age = \"{max_age}ms\"\n"
        );
    }
    text += &format!(
        "[axis.z]\nlimit = 40.0\nstep = 1.0\nrate = 1.0\nevery = \"1s\"\non_fault = {{ action = \"hold\" }}\n\
         [[axis.z.model]]\nname = \"one\"\nkind = \"linear\"\n\
         terms = [{{ signal = \"t{HEALTHY}\", gain = 1.0, reference = 20.0 }}]\n"
    );
    let loaded = isotherm_profile::parse(Path::new("cell.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Result of a run.
struct Run {
    /// Part of the time in which the healthy unit was not good, from the start and from its first good reading.
    bad: f64,
    bad_after_first: f64,
    /// Answered and failed requests to the healthy unit.
    answered: u64,
    failed: u64,
    asked: Vec<u8>,
    dialled: u64,
    /// Values that are not those of their unit.
    wrong: Vec<(String, f64)>,
    status: Status,
}

impl Run {
    fn quality(&self, unit: u8) -> &str {
        let name = format!("t{unit}");
        self.status.signals.iter().find(|signal| signal.name == name).unwrap().quality
    }

    fn reported(&self, event: &str) -> u64 {
        self.status.event_counts.get(event).copied().unwrap_or_default()
    }
}

fn run(units: &[u8], behaviour: Behaviour, span: Duration) -> Run {
    run_every(SECOND, units, behaviour, span)
}

fn run_every(every: Duration, units: &[u8], behaviour: Behaviour, span: Duration) -> Run {
    paused().block_on(async {
        let (begun, clock) = clock();
        let peer = Peer::new(behaviour);
        let dialled = peer.clone();
        let options = Options {
            has_threads: false,
            dialer: Arc::new(move |_| Some(Box::new(dialled.clone()) as Box<dyn Dial>)),
            ..Options::default()
        };
        let gateway = Gateway::new(cell(units, every), &clock, options);
        let source = gateway.source();
        let watched = source.clone();
        let watches = async move {
            let (mut bad, mut after_first, mut all) = (0_u32, None::<u32>, 0_u32);
            let mut wrong = Vec::new();
            while begun.elapsed() < span {
                tokio::time::sleep(Duration::from_millis(100)).await;
                let status = watched.status();
                let is_good = status.signals.iter().any(|one| one.name == "t1" && one.quality == "good");
                for (signal, value) in status.signals.iter().filter_map(|one| Some((one, one.value?))) {
                    let unit: f64 = signal.name[1..].parse().unwrap();
                    if (value - 20.0 - unit / 10.0).abs() > 0.01 {
                        wrong.push((signal.name.clone(), value));
                    }
                }
                all += 1;
                bad += u32::from(!is_good);
                after_first = match after_first {
                    None if !is_good => None,
                    seen => Some(seen.unwrap_or_default() + u32::from(!is_good)),
                };
            }
            let all = f64::from(all);
            (f64::from(bad) / all, after_first.map_or(1.0, |bad| f64::from(bad) / all), wrong)
        };
        let watching = tokio::spawn(watches);
        gateway.run(tokio::time::sleep(span + SECOND), std::future::ready(())).await;
        let (bad, bad_after_first, wrong) = watching.await.unwrap();
        let status = source.status();
        let place = units.iter().position(|unit| *unit == HEALTHY).unwrap();
        let device = status.devices.iter().find(|device| device.name == format!("d{place}")).unwrap();
        let failed = device.failures.values().sum::<u64>();
        let answered = device.requests - failed;
        let asked = peer.asked.lock().unwrap().clone();
        let dialled = peer.dialled.load(Ordering::Relaxed);
        println!(
            "{behaviour:?}, units {units:?}: not good {:.1} %, {:.1} % after the first good reading; {answered} polls \
             answered, {failed} failed; {dialled} connections",
            100.0 * bad,
            100.0 * bad_after_first
        );
        Run { bad, bad_after_first, answered, failed, asked, dialled, wrong, status }
    })
}

const FIRST: [u8; 3] = [HEALTHY, DEAD[0], DEAD[1]];
const LAST: [u8; 3] = [DEAD[0], DEAD[1], HEALTHY];
const MINUTE: Duration = Duration::from_secs(60);

/// Rows: own timeouts of the Modbus gateway, and times until a Modbus gateway for one client accepts the next client.
/// Before, the healthy unit was not good for up to 92 % of the time with an own timeout of 3 s. With one client, it was
/// not good for 10 % or 72 % of the time.
const ROWS: [(u64, Option<u64>); 6] =
    [(1, None), (3, None), (1, Some(3)), (1, Some(10)), (3, Some(3)), (3, Some(10))];

fn row((own, frees_after): (u64, Option<u64>)) -> Behaviour {
    Behaviour { own: Duration::from_secs(own), frees_after: frees_after.map(Duration::from_secs), ..USUAL }
}

#[test]
fn two_dead_units_cost_a_healthy_one_at_most_two_percent_of_its_time() {
    for behaviour in ROWS.map(row) {
        let run = run(&FIRST, behaviour, MINUTE);
        assert!(run.bad <= MOST, "{behaviour:?}: {}", run.bad);
        assert_eq!((run.failed, run.dialled), (0, 1), "{behaviour:?}");
        let is_dead = |unit: &u8| DEAD.contains(unit);
        let in_a_row = run.asked.windows(2).filter(|pair| pair.iter().all(is_dead)).count();
        assert_eq!(in_a_row, 0, "{behaviour:?}: {:?}", run.asked);
        for unit in DEAD {
            let asked = run.asked.iter().filter(|asked| **asked == unit).count();
            assert!((2..10).contains(&asked), "{behaviour:?}: unit {unit} was asked {asked} times");
        }
        assert_eq!((run.reported("gateway-timeout"), run.reported("overrun")), (1, 0), "{behaviour:?}");
    }
}

#[test]
fn dead_units_that_are_asked_first_delay_only_the_first_reading() {
    for behaviour in ROWS.map(row) {
        let run = run(&LAST, behaviour, MINUTE);
        assert!(run.bad_after_first <= MOST, "{behaviour:?}: {}", run.bad_after_first);
        assert_eq!(run.dialled, 1, "{behaviour:?}");
    }
}

#[test]
fn two_units_that_die_together_cost_a_healthy_one_at_most_two_percent_of_its_time() {
    let dead = (Duration::from_millis(10_500), Duration::MAX);
    for behaviour in ROWS.map(row) {
        for units in [FIRST, LAST] {
            let run = run(&units, Behaviour { dead, ..behaviour }, MINUTE);
            assert!(run.bad_after_first <= MOST, "{behaviour:?}, {units:?}: {}", run.bad_after_first);
            assert_eq!((run.failed, run.dialled), (0, 1), "{behaviour:?}, {units:?}");
        }
    }
}

#[test]
fn a_modbus_gateway_that_gives_up_silently_costs_no_more() {
    for own in [1, 3] {
        let behaviour = Behaviour { gives_up: GivesUp::Silently, ..row((own, None)) };
        let run = run(&FIRST, behaviour, MINUTE);
        assert!(run.bad <= MOST, "{behaviour:?}: {}", run.bad);
        // The Modbus gateway could keep the answer of the dead unit for the next request on the same connection.
        let dead = run.asked.iter().filter(|unit| DEAD.contains(*unit)).count();
        let most = u64::try_from(dead).unwrap() + 1;
        assert!(run.dialled <= most, "{behaviour:?}: {} connections", run.dialled);
    }
}

/// The only place is free again after 10 s. The line must learn that another connection costs as much.
#[test]
fn a_modbus_gateway_with_one_client_that_gives_up_silently_refuses_one_connection_and_not_each() {
    let behaviour = Behaviour { gives_up: GivesUp::Silently, ..row((1, Some(10))) };
    let run = run(&FIRST, behaviour, 20 * MINUTE);
    assert!(run.bad <= MOST, "{}", run.bad);
}

/// The late exceptions arrive while the line is idle, so that the time of their arrival is not known.
#[test]
fn the_own_timeout_of_a_modbus_gateway_is_not_learnt_from_an_idle_line() {
    let run = run_every(5 * SECOND, &FIRST, USUAL, 2 * MINUTE);
    assert!(run.bad <= MOST, "{}", run.bad);
    assert_eq!((run.failed, run.dialled, run.reported("gateway-timeout")), (0, 1, 0));
}

#[test]
fn dead_units_that_return_are_read_again() {
    for own in [1, 3] {
        let behaviour = Behaviour { dead: (SECOND * 5, SECOND * 30), ..row((own, None)) };
        let run = run(&FIRST, behaviour, 2 * MINUTE);
        assert!(run.bad <= MOST, "{behaviour:?}: {}", run.bad);
        for unit in FIRST {
            assert_eq!(run.quality(unit), "good", "{behaviour:?}: unit {unit}");
        }
    }
}

/// The units answer only after `timeout`. Their answers have the form of those of the healthy unit.
#[test]
fn a_late_answer_of_another_unit_is_no_reading_though_the_modbus_gateway_stamps_it_with_the_newest_request() {
    let slow = Duration::from_millis(800);
    for (own, stamps) in [(1, false), (1, true), (3, true)] {
        let behaviour = Behaviour { slow: Some(slow), stamps, ..row((own, None)) };
        for units in [FIRST, LAST] {
            let run = run(&units, behaviour, MINUTE);
            assert_eq!(run.wrong, [], "{behaviour:?}, {units:?}");
            assert!(run.bad_after_first <= MOST, "{behaviour:?}, {units:?}: {}", run.bad_after_first);
            assert_eq!(run.dialled, 1, "{behaviour:?}, {units:?}");
        }
    }
}

/// The units answer only after `timeout`. Each unit has one read, so that there are no control questions.
#[test]
fn a_late_answer_that_the_modbus_gateway_keeps_for_the_next_request_is_no_reading_of_another_unit() {
    for own in [1, 3] {
        let behaviour = Behaviour { slow: Some(Duration::from_millis(800)), keeps: true, ..row((own, None)) };
        for units in [FIRST, LAST] {
            let run = run(&units, behaviour, 2 * MINUTE);
            assert_eq!(run.wrong, [], "{behaviour:?}, {units:?}");
            assert!(run.bad_after_first <= MOST, "{behaviour:?}, {units:?}: {}", run.bad_after_first);
        }
    }
}

#[test]
fn a_server_that_closes_after_each_answer_costs_one_connection_each_and_nothing_else() {
    let run = run(&[HEALTHY], Behaviour { closes: true, ..USUAL }, MINUTE);
    assert!(run.bad <= MOST, "{}", run.bad);
    assert!(run.answered >= 60, "{} of 61 polls", run.answered);
    // On each of the first connections, one request may find the connection closed.
    assert!(run.failed <= 3, "{}", run.failed);
    assert!(run.dialled <= run.answered + 3, "{} connections for {} polls", run.dialled, run.answered);
}

#[test]
fn a_server_that_is_deaf_after_connecting_loses_one_poll_and_not_each() {
    let run = run(&[HEALTHY], Behaviour { deaf_for: SECOND, ..USUAL }, MINUTE);
    assert!(run.bad_after_first <= MOST, "{}", run.bad_after_first);
    assert!(run.answered >= 55 && run.dialled <= 2, "{} polls, {} connections", run.answered, run.dialled);
}
