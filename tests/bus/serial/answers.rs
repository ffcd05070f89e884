//! Answers that are late, lost or garbled, and what is never made of them.

use std::cell::RefCell;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::wire::Answer;
use isotherm_profile::DeviceId;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use tokio::sync::watch;

use crate::serial::port::{self, Plug, answer, bus, framed, line, read, serial, word};

const LINES: u64 = 8;
const POLLS: u32 = 1250;
const TIMEOUT: Duration = Duration::from_millis(10);
/// Nothing is later than this: a little less than the four timeouts that a late answer is given.
const LATEST: Duration = Duration::from_millis(33);

/// What came of the polls, and what the devices did.
#[derive(Debug, Default)]
struct Count {
    good: u32,
    wrong: u32,
    failed: u32,
    late: Arc<AtomicU32>,
    lost: u32,
    garbled: u32,
}

/// Answers for ever, one in twelve badly. `asked` is when the last question was put.
async fn answers_badly(
    plug: Arc<Plug>,
    mut random: Pcg32,
    asked: watch::Receiver<Instant>,
    count: &RefCell<Count>,
) -> Infallible {
    loop {
        let question = plug.asked().await;
        let since = *asked.borrow();
        let honest = answer(question);
        let at = random.random_range(0..honest.len());
        match random.random_range(0..120) {
            0..4 => {
                let (plug, late) = (plug.clone(), count.borrow().late.clone());
                let delay = random.random_range(TIMEOUT..LATEST);
                tokio::spawn(async move {
                    tokio::time::sleep(delay.saturating_sub(since.elapsed())).await;
                    // A computer that was busy meanwhile must not make it later than a device can be.
                    if since.elapsed() < LATEST {
                        plug.say(&honest);
                        late.fetch_add(1, Ordering::Relaxed);
                    }
                });
            }
            4..6 => count.borrow_mut().lost += 1,
            garbled @ 6..10 => {
                count.borrow_mut().garbled += 1;
                let mut bytes = honest;
                match garbled {
                    6 => bytes[at] ^= random.random_range(1..=255u8),
                    7 => bytes.truncate(at),
                    8 => drop(bytes.remove(at)),
                    _ => bytes = framed(question.0 % 3 + 1, &bytes[1..bytes.len() - 2]),
                }
                plug.say(&bytes);
            }
            10..20 => {
                for byte in honest.chunks(3) {
                    plug.say(byte);
                    tokio::time::sleep(Duration::from_micros(200)).await;
                }
            }
            20..25 => plug.say(&[&[0x00, 0xff], honest.as_slice()].concat()),
            _ => plug.say(&honest),
        }
    }
}

/// Polls three units of one line, and holds what comes against what stands there.
async fn polls(seed: u64) -> Count {
    let mut random = Pcg32::seed_from_u64(seed);
    let plug = Arc::new(Plug::new());
    let (tell, asked) = watch::channel(Instant::now());
    let count = RefCell::new(Count::default());
    let bus = bus(serial(115_200), plug.path.to_str().unwrap(), TIMEOUT);
    let polls = async {
        let mut line = line(&bus, 3);
        for _ in 0..POLLS {
            let (unit, from, words) =
                (random.random_range(1..=3), random.random_range(0..400), random.random_range(1..4));
            tell.send(Instant::now()).unwrap();
            // For the pauses of the breakers it is a minute later; the silence that is owed stays.
            line.revive(None);
            let expected = (from..from + words).map(|register| word(unit, register)).collect();
            let answer = port::asked(&mut line, DeviceId(usize::from(unit) - 1), read(from, words)).await;
            let mut count = count.borrow_mut();
            match answer {
                Ok(answer) if answer == Answer::Registers(expected) => count.good += 1,
                Ok(answer) => {
                    eprintln!("unit {unit}, {words} from {from}: {answer:x?}");
                    count.wrong += 1;
                }
                Err(Fault::Timeout | Fault::Peer(_)) => count.failed += 1,
                Err(fault) => panic!("{fault}"),
            }
        }
    };
    tokio::select! {
        () = polls => {}
        never = answers_badly(plug.clone(), Pcg32::seed_from_u64(seed + 1000), asked, &count) => match never {},
    }
    count.into_inner()
}

/// Takes longer than other tests: ten thousand polls at the pace of a line, eight lines side by side.
#[test]
fn ten_thousand_polls_with_late_lost_and_garbled_answers_bring_no_wrong_value() {
    let begun = Instant::now();
    let lines: Vec<_> = (0..LINES)
        .map(|seed| {
            std::thread::spawn(move || {
                let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
                runtime.block_on(polls(seed))
            })
        })
        .collect();
    let mut total = Count::default();
    for line in lines {
        let count = line.join().unwrap();
        total.good += count.good;
        total.wrong += count.wrong;
        total.failed += count.failed;
        total.late.fetch_add(count.late.load(Ordering::Relaxed), Ordering::Relaxed);
        total.lost += count.lost;
        total.garbled += count.garbled;
    }
    println!("{total:?} in {:.1} s", begun.elapsed().as_secs_f64());
    assert_eq!(total.wrong, 0, "{total:?}");
    assert_eq!(u64::from(total.good + total.failed), LINES * u64::from(POLLS));
    assert!(total.good > 8000 && total.late.load(Ordering::Relaxed) > 100, "{total:?}");
}
