//! One gateway with many lines of one kind, each with the same device, and the values that it accepts.

use std::fmt::Write;
use std::future::Future;
use std::io;
use std::path::Path;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, Once, OnceLock};
use std::time::{Duration, Instant};

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::{GatewayApi, Status};
use tokio::net::TcpListener;

use crate::wrong_replies::peer::{Peer, Plug};
use crate::wrong_replies::question::{Kind, Question, TRUTH};

/// Lines of a gateway; `TEST_WRONG_LINES=34` makes a hundred attempts.
const LINES: u32 = 8;
/// Attempts on each line.
const TRIES: u32 = 3;
/// Attempts on each line that a busy computer may spoil, and that are repeated. Further spoiled ones count as made. The
/// summary reports the number of attempts with an unknown result.
const SPOILED: u32 = 2 * TRIES;
/// Number of cases in parallel. More would delay good answers too much.
const AT_A_TIME: usize = 21;
/// Largest delay of threads at which another case begins, for the same reason.
const LATEST: Duration = Duration::from_millis(25);
/// Turns of a gateway's thread, 5 ms or more each, until its devices must have been tried. A gateway with little
/// processor time has fewer turns in the same time.
const PATIENCE: u32 = 20_000;
/// Turns until good devices must be accepted. A device that was wrong for long may back off for half a minute.
const FORGIVEN: u32 = 20_000;
/// Correct answers until a good device must be accepted. A busy computer may delay any one of them beyond the timeout.
const CHANCES: u32 = 12;
/// Correct answers to writes after which one of them must have been accepted.
const CHANCES_OF_WRITES: u32 = 3;

/// Counts of a lane when its device begins to behave correctly.
#[derive(Clone, Copy)]
struct Since {
    read: u32,
    written: u32,
    /// Number of writes that the gateway counts as done.
    writes_done: u64,
}

pub(crate) type Life = Arc<dyn Fn(Peer) -> Living + Send + Sync>;
pub(crate) type Living = Pin<Box<dyn Future<Output = io::Result<()>> + Send>>;

/// Device and its wrong behaviour.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    /// Function with which the gateway also writes to the device.
    pub(crate) writes: Option<u8>,
    /// Length of the repeated stops of the gateway's computer.
    pub(crate) stands_still: Option<Duration>,
    pub(crate) life: Life,
}

/// One line and its device.
pub(crate) struct Lane {
    pub(crate) kind: Kind,
    source: OnceLock<Arc<dyn GatewayApi>>,
    /// Number of turns of the gateway's thread.
    turned: Arc<AtomicU32>,
    /// Attempts so far.
    tried: AtomicU32,
    /// Whether an attempt was made whose effect was not checked yet.
    is_open: AtomicBool,
    /// Attempts whose value was shown at the next request. `refusals` counts accepted refusals. `surplus` counts
    /// accepted echoes in addition to the correct ones.
    shown: AtomicU32,
    refusals: AtomicU32,
    surplus: AtomicU32,
    names: [String; 3],
    /// Correct answers to reads and to writes.
    read: AtomicU32,
    written: AtomicU32,
    behaves: AtomicBool,
    turns: AtomicU32,
    /// Correct answers until a voided attempt has no effect any more.
    void: AtomicU32,
    /// Attempts that the busy computer has spoiled.
    spoiled: AtomicU32,
    /// Whether it is unknown if the last attempt counts.
    is_unsettled: AtomicBool,
    /// Answer that the device has kept.
    owed: Mutex<Option<Vec<u8>>>,
    wrong: Arc<Mutex<Vec<String>>>,
}

struct Verdict {
    name: String,
    kind: Kind,
    tried: u32,
    /// Spoiled attempts among them, whose results are unknown.
    spoiled: u32,
    accepted: u32,
    wrong: Vec<String>,
}

impl Lane {
    /// Returns whether the device must behave correctly from now on.
    pub(crate) fn behaves(&self) -> bool {
        self.behaves.load(Ordering::SeqCst)
    }

    pub(crate) fn turned(&self) -> u32 {
        self.turned.load(Ordering::SeqCst)
    }

    /// Counts another attempt, and returns its number.
    pub(crate) fn tries(&self) -> u32 {
        self.is_open.store(true, Ordering::SeqCst);
        self.tried.fetch_add(1, Ordering::SeqCst)
    }

    /// Voids the last attempt. Its effect is gone after the next correct answers. Another attempt is made instead, unless
    /// the device already behaves correctly.
    pub(crate) fn voids(&self) {
        self.void.store(3, Ordering::SeqCst);
        self.is_open.store(false, Ordering::SeqCst);
        if self.behaves() {
            return;
        }
        let _ = self.tried.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |tried| tried.checked_sub(1));
    }

    /// Voids the last attempt because the busy computer has spoiled it. Beyond [`SPOILED`] of them, it counts as made.
    pub(crate) fn spoils(&self) {
        self.voids();
        if self.spoiled.fetch_add(1, Ordering::SeqCst) >= SPOILED {
            self.tried.fetch_add(1, Ordering::SeqCst);
        }
    }

    pub(crate) fn is_void(&self) -> bool {
        self.void.load(Ordering::SeqCst) > 0
    }

    /// Sets whether it is unknown if the present attempt counts. If it counts, its effect is still shown later.
    pub(crate) fn leaves_open(&self, is_open: bool) {
        self.is_unsettled.store(is_open, Ordering::SeqCst);
    }

    /// Returns `true` at every second call, beginning with the first.
    pub(crate) fn is_next(&self) -> bool {
        self.turns.fetch_add(1, Ordering::SeqCst).is_multiple_of(2)
    }

    pub(crate) fn owes(&self, answer: Vec<u8>) {
        *self.owed.lock().unwrap() = Some(answer);
    }

    pub(crate) fn take_owed(&self) -> Option<Vec<u8>> {
        self.owed.lock().unwrap().take()
    }

    pub(crate) fn is_answered(&self, asked: &Question) {
        let count = if asked.is_read() { &self.read } else { &self.written };
        count.fetch_add(1, Ordering::SeqCst);
        if self.is_void() && self.source.get().is_some_and(|source| self.lie(&source.status()).is_some()) {
            return;
        }
        let _ = self.void.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
    }

    /// Checks after an attempt what the gateway shows of this line.
    pub(crate) fn look(&self) {
        if let Some(source) = self.source.get()
            && self.is_open.swap(false, Ordering::SeqCst)
            && self.assess(&source.status())
        {
            self.shown.fetch_add(1, Ordering::SeqCst);
        }
    }

    /// Records the effects of attempts. Returns whether a reading without a correct answer is shown.
    fn assess(&self, status: &Status) -> bool {
        let [_, output, device] = &self.names;
        let device = status.devices.iter().find(|one| one.name == *device).unwrap();
        let refusals = device.failures.get("exception").copied().unwrap_or_default();
        self.refusals.fetch_max(u32::try_from(refusals).unwrap(), Ordering::SeqCst);
        // Correct writes are counted before they are answered, so that the count is never too small.
        let done = status.outputs.iter().find(|one| one.name == *output).map_or(0, |one| one.writes_done);
        let surplus = done.saturating_sub(u64::from(self.written.load(Ordering::SeqCst)));
        self.surplus.fetch_max(u32::try_from(surplus).unwrap(), Ordering::SeqCst);
        let is_to_be_judged = |_: &String| !self.is_void() && !self.is_unsettled.load(Ordering::SeqCst);
        let Some(found) = self.lie(status).filter(is_to_be_judged) else { return false };
        let mut wrong = self.wrong.lock().unwrap();
        if !wrong.contains(&found) && wrong.len() < 5 {
            wrong.push(found);
        }
        true
    }

    /// Returns a description of the shown reading, if no correct answer has its value.
    fn lie(&self, status: &Status) -> Option<String> {
        let signal = status.signals.iter().find(|one| one.name == self.names[0]).unwrap();
        let value = signal.value.filter(|value| (value - f64::from(TRUTH) / 10.0).abs() >= 0.01)?;
        Some(format!("{value} is {}", signal.quality))
    }

    /// Returns the number of accepted attempts.
    fn accepted(&self) -> u32 {
        [&self.shown, &self.refusals, &self.surplus].into_iter().map(|one| one.load(Ordering::SeqCst)).sum()
    }

    /// Returns whether the device has sent so many correct answers since then that one of them must be accepted. On a
    /// busy computer, many reads may be answered before the first write is due.
    fn had_its_chances(&self, status: &Status, since: Since) -> bool {
        let has_output = status.outputs.iter().any(|one| one.name == self.names[1]);
        self.read.load(Ordering::SeqCst) >= since.read + CHANCES
            && (!has_output || self.written.load(Ordering::SeqCst) >= since.written + CHANCES_OF_WRITES)
    }

    /// Returns whether the gateway has accepted correct answers since the device behaves correctly.
    fn is_accepted(&self, status: &Status, since: Since) -> bool {
        let signal = status.signals.iter().find(|one| one.name == self.names[0]).unwrap();
        let written = status.outputs.iter().find(|one| one.name == self.names[1]);
        signal.quality == "good"
            && self.read.load(Ordering::SeqCst) >= since.read + 2
            && written.is_none_or(|output| output.writes_done > since.writes_done)
    }
}

fn lines() -> u32 {
    let Ok(text) = std::env::var("TEST_WRONG_LINES") else { return LINES };
    text.parse().unwrap_or_else(|_| panic!("TEST_WRONG_LINES={text}: say 34"))
}

/// Runs all cases in parallel. No wrong reply may be accepted, and each device must be accepted when it behaves
/// correctly.
pub(crate) fn none_is_believed(cases: Vec<Case>) {
    let begun = Instant::now();
    let (waiting, verdicts, running) = (Mutex::new(cases), Mutex::new(Vec::new()), AtomicU32::new(0));
    std::thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(|| {
                loop {
                    let Some(case) = next(&waiting, &running) else { return };
                    let verdict = case.run();
                    running.fetch_sub(1, Ordering::SeqCst);
                    verdicts.lock().unwrap().push(verdict);
                }
            });
        }
    });
    let verdicts: Vec<Verdict> = verdicts.into_inner().unwrap();
    for Verdict { name, kind, tried, spoiled, accepted, wrong } in &verdicts {
        let wrong = wrong.join("; ");
        println!("{kind:?}, {name}: {accepted} of {tried} believed {wrong}");
        if *spoiled > 0 {
            crate::support::tell(&format!(
                "{kind:?}, {name}: {spoiled} of {tried} attempts are void: the computer was too busy"
            ));
        }
    }
    println!("{} cases in {:.1} s", verdicts.len(), begun.elapsed().as_secs_f64());
    let failed = verdicts
        .iter()
        .filter(|one| one.accepted > 0 || !one.wrong.is_empty() || one.tried < lines() * TRIES);
    let failed: Vec<String> = failed
        .map(|one| format!("{:?}, {}: {} of {} {:?}", one.kind, one.name, one.accepted, one.tried, one.wrong))
        .collect();
    assert!(failed.is_empty(), "{} of {} cases:\n{}", failed.len(), verdicts.len(), failed.join("\n"));
}

/// Returns the next case as soon as the computer has time for it. At least one case always runs.
fn next(waiting: &Mutex<Vec<Case>>, running: &AtomicU32) -> Option<Case> {
    let mut waiting = waiting.lock().unwrap();
    while !waiting.is_empty() && running.load(Ordering::SeqCst) > 0 && behind() > LATEST {
        std::thread::sleep(Duration::from_millis(20));
    }
    let case = waiting.pop()?;
    running.fetch_add(1, Ordering::SeqCst);
    // The load of this case is measured before the next one begins.
    std::thread::sleep(Duration::from_millis(50));
    Some(case)
}

/// Returns the delay of threads in this process, as measured by an idle thread. The measured value decays within a
/// second.
fn behind() -> Duration {
    const TICK: Duration = Duration::from_millis(5);
    static MEASURED: Once = Once::new();
    static BEHIND_US: AtomicU32 = AtomicU32::new(0);
    MEASURED.call_once(|| {
        std::thread::spawn(|| {
            loop {
                let begun = Instant::now();
                std::thread::sleep(TICK);
                let late = begun.elapsed().saturating_sub(TICK).as_micros();
                let fading = BEHIND_US.load(Ordering::Relaxed) / 100 * 97;
                BEHIND_US.store(fading.max(u32::try_from(late).unwrap_or(u32::MAX)), Ordering::Relaxed);
            }
        });
    });
    Duration::from_micros(BEHIND_US.load(Ordering::Relaxed).into())
}

impl Case {
    fn run(self) -> Verdict {
        let wrong = Arc::new(Mutex::new(Vec::new()));
        let turned = Arc::new(AtomicU32::new(0));
        let lane = |number| Lane {
            kind: self.kind,
            source: OnceLock::new(),
            turned: turned.clone(),
            tried: AtomicU32::new(0),
            is_open: AtomicBool::new(false),
            shown: AtomicU32::new(0),
            refusals: AtomicU32::new(0),
            surplus: AtomicU32::new(0),
            names: ["s", "o", "d"].map(|letter| format!("{letter}{number}")),
            read: AtomicU32::new(0),
            written: AtomicU32::new(0),
            behaves: AtomicBool::new(false),
            turns: AtomicU32::new(0),
            void: AtomicU32::new(0),
            spoiled: AtomicU32::new(0),
            is_unsettled: AtomicBool::new(false),
            owed: Mutex::default(),
            wrong: wrong.clone(),
        };
        let lanes: Vec<Arc<Lane>> = (0..lines()).map(|number| Arc::new(lane(number))).collect();
        let (end, ended) = tokio::sync::oneshot::channel();
        let (addresses, server) = serve(&lanes, self.life.clone(), ended);
        beside(self.profile(&addresses), &lanes, self.stands_still, &wrong);
        drop(end);
        server.join().unwrap();
        let tried = lanes.iter().map(|lane| lane.tried.load(Ordering::SeqCst)).sum();
        let beyond = |lane: &Arc<Lane>| lane.spoiled.load(Ordering::SeqCst).saturating_sub(SPOILED);
        let spoiled = lanes.iter().map(beyond).sum();
        let accepted = lanes.iter().map(|lane| lane.accepted()).sum();
        let wrong = wrong.lock().unwrap().clone();
        Verdict { name: self.name, kind: self.kind, tried, spoiled, accepted, wrong }
    }

    fn profile(&self, addresses: &[String]) -> isotherm_profile::Profile {
        let mut text = "[machine]\nname = \"believers\"\narm = \"auto\"\n".to_owned();
        for (number, address) in addresses.iter().enumerate() {
            let line = match self.kind {
                Kind::Tcp => format!("type = \"modbus-tcp\"\naddress = \"{address}\""),
                Kind::RtuOverTcp => format!("type = \"modbus-rtu-over-tcp\"\naddress = \"{address}\""),
                Kind::Port => format!(
                    "type = \"modbus-rtu\"\nport = \"{address}\"\nbaud = 115200\nparity = \"none\"\nstop_bits = 1"
                ),
            };
            let axis = self.writes.map(|function| axis(number, function)).unwrap_or_default();
            // A value that cannot be read is verified by its echo alone.
            let functions = match self.writes {
                None => "\"read-input\"",
                Some(6) => "\"read-input\", \"write-single\"",
                Some(_) => "\"read-input\", \"write-multiple\"",
            };
            write!(
                text,
                "[bus.b{number}]\n{line}\ntimeout = \"{}ms\"\n\
                 [device.d{number}]\nbus = \"b{number}\"\nunit = 1\nevery = \"150ms\"\nfunctions = [{functions}]\n\
                 [signal.s{number}]\ndevice = \"d{number}\"\nregister = \"input:0\"\ntype = \"i32\"\n\
                 word_order = \"msw-first\"\nscale = 0.1\nunit = \"degC\"\nrange = \"none\"\nmax_rate = \"none\"\n\
                 max_age = \"10s\"\n{axis}",
                self.kind.timeout().as_millis()
            )
            .unwrap();
        }
        let loaded = isotherm_profile::parse(Path::new("believers.toml"), &text, &[], &[]);
        loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
    }
}

fn axis(number: usize, function: u8) -> String {
    let form = if function == 6 { "type = \"i16\"" } else { "type = \"i32\"\nword_order = \"msw-first\"" };
    format!(
        "[axis.z{number}]\nlimit = 40.0\nstep = 2.0\nrate = 100.0\nevery = \"200ms\"\n\
         on_fault = {{ action = \"hold\" }}\n[[axis.z{number}.model]]\nname = \"full\"\nkind = \"linear\"\n\
         terms = [{{ signal = \"s{number}\", gain = 1.0, reference = 20.0 }}]\n\
         [output.o{number}]\naxis = \"z{number}\"\ndevice = \"d{number}\"\nwrites = \"offset\"\n\
         register = \"holding:1000\"\n{form}\nscale = 0.1\nverify = \"echo\"\nrefresh = \"200ms\"\n"
    )
}

/// Starts a device at each line, on a separate thread. Returns the addresses and the thread.
fn serve(
    lanes: &[Arc<Lane>],
    life: Life,
    ended: tokio::sync::oneshot::Receiver<()>,
) -> (Vec<String>, std::thread::JoinHandle<()>) {
    let lanes = lanes.to_vec();
    let (tell, reported) = std::sync::mpsc::channel();
    let thread = std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            for lane in lanes {
                tell.send(settle(lane, life.clone()).await).unwrap();
            }
            drop(tell);
            let _ = ended.await;
        });
    });
    (reported.iter().collect(), thread)
}

async fn settle(lane: Arc<Lane>, life: Life) -> String {
    if lane.kind == Kind::Port {
        let plug = Plug::new();
        let path = plug.path.clone();
        tokio::spawn(async move {
            let (peer, _kept) = plug.peer(lane);
            let _ = life(peer).await;
            std::future::pending::<()>().await;
        });
        return path;
    }
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    tokio::spawn(async move {
        for connection in 0.. {
            let (stream, _) = listener.accept().await.unwrap();
            tokio::spawn(life(Peer::of(stream, lane.clone(), connection)));
        }
    });
    address
}

/// Runs the gateway until every device was tried, and then until every device is accepted again.
fn beside(
    profile: isotherm_profile::Profile,
    lanes: &[Arc<Lane>],
    stands_still: Option<Duration>,
    wrong: &Arc<Mutex<Vec<String>>>,
) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), Options::default());
        let source = gateway.source();
        lanes.iter().for_each(|lane| drop(lane.source.set(source.clone())));
        let turned = lanes[0].turned.clone();
        tokio::spawn(async move {
            loop {
                turned.fetch_add(1, Ordering::SeqCst);
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        });
        let first = lanes[0].clone();
        if let Some(span) = stands_still {
            tokio::spawn(async move {
                while !first.behaves() {
                    tokio::time::sleep(Duration::from_millis(20)).await;
                    std::thread::sleep(span);
                }
            });
        }
        let (lanes, wrong) = (lanes.to_vec(), wrong.clone());
        let done = tokio::task::spawn_blocking(move || watch(source.as_ref(), &lanes, &wrong));
        gateway.run(async { done.await.unwrap() }, std::future::ready(())).await;
    });
}

fn watch(source: &dyn GatewayApi, lanes: &[Arc<Lane>], wrong: &Mutex<Vec<String>>) {
    let turns = |since: u32| lanes[0].turned().wrapping_sub(since);
    let begun = lanes[0].turned();
    let look = |status: &Status| {
        for lane in lanes {
            let _ = lane.assess(status);
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let is_tried = |lane: &Arc<Lane>| lane.tried.load(Ordering::SeqCst) >= TRIES;
    loop {
        while !lanes.iter().all(is_tried) && turns(begun) < PATIENCE {
            look(&source.status());
        }
        // Wait until the last replies can have an effect. Meanwhile, the last attempt may be found void.
        for _ in 0..5 {
            look(&source.status());
        }
        if lanes.iter().all(is_tried) || turns(begun) >= PATIENCE {
            break;
        }
    }
    let status = source.status();
    let since = |lane: &Arc<Lane>| {
        let done = status.outputs.iter().find(|one| one.name == lane.names[1]);
        let count = |counter: &AtomicU32| counter.load(Ordering::SeqCst);
        let writes_done = done.map_or(0, |one| one.writes_done);
        Since { read: count(&lane.read), written: count(&lane.written), writes_done }
    };
    let since: Vec<Since> = lanes.iter().map(since).collect();
    lanes.iter().for_each(|lane| lane.behaves.store(true, Ordering::SeqCst));
    let begun = lanes[0].turned();
    loop {
        let status = source.status();
        look(&status);
        let left = lanes.iter().zip(&since).filter(|(lane, since)| !lane.is_accepted(&status, **since));
        let left: Vec<_> = left.collect();
        if left.is_empty() {
            return;
        }
        let had_its_chances = left.iter().any(|(lane, since)| lane.had_its_chances(&status, **since));
        if turns(begun) > FORGIVEN && (had_its_chances || turns(begun) > 8 * FORGIVEN) {
            let left: Vec<&String> = left.iter().map(|(lane, _)| &lane.names[2]).collect();
            let faults: Vec<_> = status.devices.iter().map(|one| (&one.name, &one.fault)).collect();
            return wrong.lock().unwrap().push(format!("{left:?} behave and are not believed: {faults:?}"));
        }
    }
}
