//! Tests with late, lost and garbled answers, which must never become values.
//!
//! A busy computer may delay a device that should be in time. The device therefore measures the time of each answer. A
//! poll is timely if its answer was in the port within half a timeout, and only timely polls must succeed. An answer
//! that arrives after [`GRACE`] may be taken for the next one; that poll is void. A line is polled until enough polls
//! were timely, or the computer is clearly too busy. In that case only wrong values fail.

use std::cell::RefCell;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::line::GRACE;
use isotherm::fieldbus::wire::Answer;
use isotherm_profile::DeviceId;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use tokio::sync::watch;

use crate::serial::port::{self, Plug, answer, bus, framed, line, read, word};
use crate::support::frames::Frames;
use crate::support::tell;

const LINES: u64 = 8;
/// Minimum and maximum number of polls of a line.
const POLLS: u32 = 1250;
const MOST: u32 = 4 * POLLS;
/// Minimum number of timely polls. `LATE` is the minimum number of answers that the device delayed.
const TIMELY: u32 = 1000;
const LATE: u32 = 13;
const TIMEOUT: Duration = Duration::from_millis(30);
/// Longest intended delay: a little less than the four timeouts during which a late answer is expected.
const LATEST: Duration = Duration::from_millis(100);

/// Results of the polls, and actions of the devices.
#[derive(Debug, Default)]
struct Count {
    polls: u32,
    good: u32,
    wrong: u32,
    failed: u32,
    timely: u32,
    /// Timely polls that failed.
    missed: u32,
    /// Answers of another poll that the device sent after the line had stopped waiting for them.
    void: u32,
    late: Arc<AtomicU32>,
    lost: u32,
    garbled: u32,
    /// Whether the answer to the present poll was in the port in time.
    is_timely: bool,
    /// Whether an answer since the last good poll was so late that it may be taken for another.
    is_spoilt: Arc<AtomicBool>,
}

impl Count {
    /// Returns whether enough polls were made, or more would be useless.
    fn is_enough(&self) -> bool {
        let has_seen = self.timely >= TIMELY && self.late.load(Ordering::Relaxed) >= LATE;
        self.polls >= if has_seen { POLLS } else { MOST }
    }
}

/// Answers requests endlessly, one in twelve wrongly. `asked` is the time of the last request.
async fn answers_badly(
    frames: Frames,
    plug: Arc<Plug>,
    mut random: Pcg32,
    asked: watch::Receiver<Instant>,
    count: &RefCell<Count>,
) -> Infallible {
    let is_spoilt = count.borrow().is_spoilt.clone();
    loop {
        let question = plug.asked().await;
        let since = *asked.borrow();
        let honest = frames.encode(answer(question));
        let at = random.random_range(0..honest.len());
        match random.random_range(0..120) {
            0..4 => {
                let (plug, late, is_spoilt) = (plug.clone(), count.borrow().late.clone(), is_spoilt.clone());
                let delay = random.random_range(TIMEOUT..LATEST);
                tokio::spawn(async move {
                    tokio::time::sleep(delay.saturating_sub(since.elapsed())).await;
                    // A busy computer must not delay the answer beyond the limit.
                    if since.elapsed() < LATEST {
                        say(&plug, &honest, since, &is_spoilt);
                        late.fetch_add(1, Ordering::Relaxed);
                    }
                });
                continue;
            }
            4..6 => {
                count.borrow_mut().lost += 1;
                continue;
            }
            garbled @ 6..10 => {
                count.borrow_mut().garbled += 1;
                let mut bytes = honest;
                match garbled {
                    6 => bytes[at] ^= random.random_range(1..=255u8),
                    7 => bytes.truncate(at),
                    8 => drop(bytes.remove(at)),
                    _ => {
                        let rtu = answer(question);
                        bytes = frames.encode(framed(question.0 % 3 + 1, &rtu[1..rtu.len() - 2]));
                    }
                }
                say(&plug, &bytes, since, &is_spoilt);
                continue;
            }
            10..20 => {
                // No wait follows the last piece, because the answer is complete then.
                let (pieces, last) = honest.split_at((honest.len() - 1) / 3 * 3);
                for piece in pieces.chunks(3) {
                    say(&plug, piece, since, &is_spoilt);
                    tokio::time::sleep(Duration::from_micros(200)).await;
                }
                say(&plug, last, since, &is_spoilt);
            }
            20..25 => say(&plug, &[&[0x00, 0xff], honest.as_slice()].concat(), since, &is_spoilt),
            _ => say(&plug, &honest, since, &is_spoilt),
        }
        count.borrow_mut().is_timely = since.elapsed() < TIMEOUT / 2;
    }
}

/// Writes bytes to the port. They have arrived when this returns.
fn say(plug: &Plug, bytes: &[u8], since: Instant, is_spoilt: &AtomicBool) {
    plug.say(bytes);
    plug.hand_over();
    if since.elapsed() >= (GRACE + 1) * TIMEOUT {
        is_spoilt.store(true, Ordering::Relaxed);
    }
}

/// Polls three units of one line, and compares the answers with the registers.
async fn polls(frames: Frames, seed: u64) -> Count {
    let mut random = Pcg32::seed_from_u64(seed);
    let plug = Arc::new(Plug::with(frames));
    let (tell, asked) = watch::channel(Instant::now());
    let count = RefCell::new(Count::default());
    let bus = bus(frames.on_port(115_200), plug.path.to_str().unwrap(), TIMEOUT);
    let polls = async {
        let mut line = line(&bus, 3);
        while !count.borrow().is_enough() {
            let (unit, from, words) =
                (random.random_range(1..=3), random.random_range(0..400), random.random_range(1..4));
            count.borrow_mut().is_timely = false;
            tell.send(Instant::now()).unwrap();
            // Skip the back-off. The silence after a missing answer remains.
            line.revive(None);
            let expected = (from..from + words).map(|register| word(unit, register)).collect();
            let answer = port::asked(&mut line, DeviceId(usize::from(unit) - 1), read(from, words)).await;
            let mut count = count.borrow_mut();
            count.polls += 1;
            count.timely += u32::from(count.is_timely);
            match answer {
                Ok(answer) if answer == Answer::Registers(expected) => {
                    count.good += 1;
                    count.is_spoilt.store(false, Ordering::Relaxed);
                }
                Ok(_) if count.is_spoilt.swap(false, Ordering::Relaxed) => count.void += 1,
                Ok(answer) => {
                    eprintln!("unit {unit}, {words} from {from}: {answer:x?}");
                    count.wrong += 1;
                }
                Err(Fault::Timeout | Fault::Peer(_)) => {
                    count.failed += 1;
                    count.missed += u32::from(count.is_timely);
                }
                Err(fault) => panic!("{fault}"),
            }
        }
    };
    tokio::select! {
        () = polls => {}
        never = answers_badly(frames, plug.clone(), Pcg32::seed_from_u64(seed + 1000), asked, &count) => match never {},
    }
    count.into_inner()
}

#[test]
fn ten_thousand_polls_with_late_lost_and_garbled_answers_bring_no_wrong_value() {
    no_value_is_wrong(Frames::Rtu);
}

#[test]
fn ten_thousand_polls_of_modbus_ascii_with_late_lost_and_garbled_answers_bring_no_wrong_value() {
    no_value_is_wrong(Frames::Ascii);
}

/// Slower than other tests: ten thousand polls at the speed of a serial line, on eight lines in parallel.
fn no_value_is_wrong(frames: Frames) {
    let begun = Instant::now();
    let lines: Vec<_> = (0..LINES)
        .map(|seed| {
            std::thread::spawn(move || {
                let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
                runtime.block_on(polls(frames, seed))
            })
        })
        .collect();
    let mut total = Count::default();
    for line in lines {
        let count = line.join().unwrap();
        total.polls += count.polls;
        total.good += count.good;
        total.timely += count.timely;
        total.missed += count.missed;
        total.void += count.void;
        total.wrong += count.wrong;
        total.failed += count.failed;
        total.late.fetch_add(count.late.load(Ordering::Relaxed), Ordering::Relaxed);
        total.lost += count.lost;
        total.garbled += count.garbled;
    }
    println!("{total:?} in {:.1} s", begun.elapsed().as_secs_f64());
    assert_eq!(total.wrong, 0, "{total:?}");
    assert_eq!(total.good + total.failed + total.void, total.polls);
    assert!(u64::from(total.polls) >= LINES * u64::from(POLLS), "{total:?}");
    let is_busy = u64::from(total.timely) < LINES * u64::from(TIMELY) || 100 * total.void > total.polls;
    if is_busy {
        return tell(&format!("answers on a port: few were in time, the computer was too busy: {total:?}"));
    }
    assert!(20 * total.missed <= total.timely, "{total:?}");
    assert!(total.late.load(Ordering::Relaxed) > 100, "{total:?}");
}
