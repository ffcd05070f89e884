use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::*;

const SECOND: Duration = Duration::from_secs(1);

fn noon() -> Moment {
    Moment::from_nanos(1_000_000_000_000)
}

#[tokio::test]
async fn ten_virtual_hours_pass_as_soon_as_everybody_sleeps() {
    let clock = Clock::simulated(noon(), None);
    let mut sleeper = clock.join();
    sleeper.sleep(Duration::from_secs(36_000)).await;
    assert_eq!(clock.now().since(noon()), Duration::from_secs(36_000));
}

#[tokio::test]
async fn simultaneous_sleepers_wake_one_at_a_time_in_the_order_in_which_they_joined() {
    let clock = Clock::simulated(noon(), None);
    let diary = Arc::new(Mutex::new(Vec::new()));
    let hold = clock.hold();
    let tasks: Vec<_> = ["plant", "line", "watch"]
        .into_iter()
        .map(|name| {
            let (mut sleeper, diary) = (clock.join(), diary.clone());
            tokio::spawn(async move {
                for tick in 1..=3u32 {
                    sleeper.sleep_until(noon().after(SECOND * tick)).await;
                    diary.lock().unwrap().push((tick, name, "wakes"));
                    // A real wait must not let the other sleepers overtake.
                    tokio::time::sleep(Duration::from_millis(2)).await;
                    diary.lock().unwrap().push((tick, name, "sleeps"));
                }
            })
        })
        .collect();
    drop(hold);
    for task in tasks {
        task.await.unwrap();
    }
    let mut expected = Vec::new();
    for tick in 1..=3 {
        for name in ["plant", "line", "watch"] {
            expected.extend([(tick, name, "wakes"), (tick, name, "sleeps")]);
        }
    }
    assert_eq!(*diary.lock().unwrap(), expected);
}

#[tokio::test]
async fn the_clock_stands_still_while_a_task_waits_for_something_real() {
    let clock = Clock::simulated(noon(), None);
    let _busy = clock.hold();
    let mut sleeper = clock.join();
    let slept = tokio::time::timeout(Duration::from_millis(30), sleeper.sleep(SECOND)).await;
    assert!(slept.is_err());
    assert_eq!(clock.now(), noon());
}

#[tokio::test]
async fn a_bell_wakes_a_sleeper_before_its_time_and_is_remembered_when_it_rang_early() {
    for clock in [Clock::wall(), Clock::simulated(noon(), None)] {
        let _busy = clock.hold();
        let mut sleeper = clock.join();
        let wakeup = sleeper.wakeup();
        wakeup.wake();
        let begun = clock.now();
        sleeper.sleep(SECOND * 3600).await;
        let task = tokio::spawn(async move { sleeper.sleep(SECOND * 3600).await });
        tokio::time::sleep(Duration::from_millis(5)).await;
        wakeup.wake();
        task.await.unwrap();
        assert!(clock.now().since(begun) < SECOND * 60);
    }
}

#[tokio::test]
async fn a_task_that_ends_lets_the_others_go_on() {
    let clock = Clock::simulated(noon(), None);
    let gone = clock.join();
    let mut sleeper = clock.join();
    let task = tokio::spawn(async move { sleeper.sleep(SECOND).await });
    tokio::time::sleep(Duration::from_millis(5)).await;
    drop(gone);
    task.await.unwrap();
    assert_eq!(clock.now().since(noon()), SECOND);
}

#[tokio::test]
async fn a_speed_paces_the_virtual_time() {
    let wall = Clock::wall();
    let begun = wall.now();
    let clock = Clock::simulated(noon(), Some(1000.0));
    let mut sleeper = clock.join();
    for _ in 0..10 {
        sleeper.sleep(SECOND * 5).await;
    }
    assert_eq!(clock.now().since(noon()), SECOND * 50);
    assert!(wall.now().since(begun) >= Duration::from_millis(45));
}

#[tokio::test]
async fn a_skipped_hour_wakes_every_sleeper_once() {
    let clock = Clock::simulated(noon(), None);
    let mut sleeper = clock.join();
    sleeper.sleep(SECOND).await;
    clock.skip(SECOND * 3600);
    sleeper.sleep_until(noon().after(SECOND * 2)).await;
    assert_eq!(clock.now().since(noon()), SECOND * 3601);
}

#[tokio::test]
async fn patience_ends_also_with_a_future_that_is_ready_again_and_again() {
    let (mut reader, mut writer) = tokio::io::duplex(1024);
    let talks = async { while tokio::io::AsyncWriteExt::write_all(&mut writer, &[0; 512]).await.is_ok() {} };
    let receives = async {
        let mut bytes = [0; 64];
        while tokio::io::AsyncReadExt::read(&mut reader, &mut bytes).await.is_ok() {
            // A read that never waits.
            tokio::task::coop::consume_budget().await;
        }
    };
    let both = async { tokio::join!(talks, receives) };
    assert!(WallTimeout::new().within(Duration::from_millis(20), both).await.is_none());
}

/// Waits at most 100 ms for a device in the same process. The device answers 1 ms after the process was blocked for 300
/// ms.
async fn waits_over_a_stall(mut patience: WallTimeout) -> Option<()> {
    let (answer, answered) = tokio::sync::oneshot::channel();
    let device = async {
        std::thread::sleep(Duration::from_millis(300));
        tokio::time::sleep(Duration::from_millis(1)).await;
        answer.send(()).unwrap();
        std::future::pending::<()>().await;
    };
    let waits = patience.within(Duration::from_millis(100), answered);
    tokio::select! {
        biased;
        waited = waits => waited.map(Result::unwrap),
        () = device => None,
    }
}

#[tokio::test]
async fn a_timeout_beside_a_virtual_clock_does_not_depend_on_a_computer_that_stands_still() {
    assert_eq!(waits_over_a_stall(WallTimeout::new()).await, None);
    assert_eq!(waits_over_a_stall(WallTimeout::by(&Clock::simulated(noon(), None))).await, Some(()));
    let wall = Clock::wall();
    let begun = wall.now();
    let mut silent = WallTimeout::by(&Clock::simulated(noon(), None));
    assert_eq!(silent.within(Duration::from_millis(100), std::future::pending::<()>()).await, None);
    assert!(wall.now().since(begun) >= Duration::from_millis(95));
}

#[tokio::test(start_paused = true)]
async fn the_timer_of_a_question_that_was_answered_wakes_nobody_who_rests() {
    const MILLI: Duration = Duration::from_millis(1);
    let mut patience = WallTimeout::new();
    assert!(patience.within(90 * MILLI, tokio::time::sleep(5 * MILLI)).await.is_some());
    patience.put_off((95 + 90) * MILLI);
    let mut wakes = 0;
    let mut rest = Box::pin(tokio::time::sleep(95 * MILLI));
    std::future::poll_fn(|context| {
        wakes += 1;
        rest.as_mut().poll(context)
    })
    .await;
    assert_eq!(wakes, 2, "once to begin, once at its end");
    let given_up = patience.within(90 * MILLI, std::future::pending::<()>());
    assert_eq!(tokio::time::timeout(92 * MILLI, given_up).await, Ok(None));
}

#[tokio::test(start_paused = true)]
async fn a_timer_that_was_moved_ends_the_next_timeout_in_time() {
    const MILLI: Duration = Duration::from_millis(1);
    let mut patience = WallTimeout::new();
    for _ in 0..3 {
        assert!(patience.within(90 * MILLI, tokio::time::sleep(5 * MILLI)).await.is_some());
        patience.move_by((95 + 90) * MILLI);
        tokio::time::sleep(95 * MILLI).await;
    }
    let given_up = patience.within(90 * MILLI, std::future::pending::<()>());
    assert_eq!(tokio::time::timeout(92 * MILLI, given_up).await, Ok(None));
}

#[tokio::test]
async fn a_line_that_rests_for_long_wakes_the_computer_once() {
    const MILLI: Duration = Duration::from_millis(1);
    let (mut sleeper, mut patience) = (Clock::wall().join(), WallTimeout::new());
    let parked = || tokio::runtime::Handle::current().metrics().worker_park_count(0);
    for _ in 0..3 {
        assert!(patience.within(90 * MILLI, tokio::time::sleep(5 * MILLI)).await.is_some());
        patience.put_off((250 + 90) * MILLI);
        let (begun, before) = (sleeper.now(), parked());
        let woken = sleeper.sleep(250 * MILLI).await;
        assert_eq!(parked() - before, 1);
        assert!(woken.since(begun) >= 250 * MILLI);
    }
    let given_up = patience.within(90 * MILLI, std::future::pending::<()>());
    assert_eq!(tokio::time::timeout(SECOND, given_up).await, Ok(None));
}

#[tokio::test]
async fn a_hundred_sleepers_open_no_hundred_files() {
    let files = || std::fs::read_dir("/proc/self/fd").unwrap().count();
    let (clock, before) = (Clock::wall(), files());
    assert!(!clock.is_busy());
    let mut sleepers: Vec<_> = (0..100).map(|_| clock.join()).collect();
    for sleeper in &mut sleepers {
        sleeper.wakeup().wake();
        sleeper.sleep(SECOND).await;
    }
    // Other tests open files as well.
    assert!(files() < before + 50);
    assert!(clock.is_busy());
    sleepers.clear();
    assert!(!clock.is_busy());
}

#[tokio::test]
async fn a_sleeper_that_is_woken_early_sleeps_the_next_time_for_as_long_as_it_is_told() {
    const MILLI: Duration = Duration::from_millis(1);
    let clock = Clock::wall();
    let mut sleeper = clock.join();
    let wakeup = sleeper.wakeup();
    // Deadlines for the kernel timer, and for the timer of tokio.
    for first in [70, 70, 70, 20, 20, 20] {
        // The wakeup comes when the sleeper does not wait for it any more.
        let begun = clock.now();
        tokio::join!(sleeper.sleep(first * MILLI), async { wakeup.wake() });
        tokio::time::sleep((first + 5) * MILLI).await;
        sleeper.sleep((first + 10) * MILLI).await;
        assert!(clock.now().since(begun) >= (2 * first + 15) * MILLI);
    }
}

/// Wakes a sleeper for every message, on a separate thread, until an empty message comes.
async fn hear_and_ring(reader: tokio::net::UnixDatagram, gate: SocketGate, wakeup: Wakeup) {
    while reader.readable().await.is_ok() {
        let _taking = gate.taking();
        let mut bytes = [0; 8];
        while let Ok(length) = reader.try_recv(&mut bytes) {
            if length == 0 {
                return;
            }
            wakeup.wake();
        }
    }
}

#[tokio::test]
async fn the_clock_does_not_overtake_a_message_that_lies_in_a_socket() {
    let clock = Clock::simulated(noon(), None);
    let hold = clock.hold();
    let (mut sends, mut receives) = (clock.join(), clock.join());
    let wakeup = receives.wakeup();
    let (sender, reader) = std::os::unix::net::UnixDatagram::pair().unwrap();
    reader.set_nonblocking(true).unwrap();
    let gate = clock.gate(&reader).unwrap();
    let reading = std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
        runtime.block_on(async {
            let reader = tokio::net::UnixDatagram::from_std(reader).unwrap();
            hear_and_ring(reader, gate, wakeup).await;
        });
    });
    let sending = tokio::spawn(async move {
        for _ in 0..500 {
            sends.sleep(SECOND).await;
            sender.send(b"frame").unwrap();
        }
        sends.sleep(SECOND).await;
        sender.send(b"").unwrap();
    });
    drop(hold);
    let mut heard = Vec::new();
    for _ in 0..500 {
        heard.push(receives.sleep(SECOND * 3600).await.since(noon()).as_secs());
    }
    drop(receives);
    assert_eq!(heard, (1..=500).collect::<Vec<_>>(), "each at the moment at which it was sent");
    sending.await.unwrap();
    reading.join().unwrap();
}

#[tokio::test]
async fn an_inlet_that_is_gone_holds_nobody_up() {
    let clock = Clock::simulated(noon(), None);
    let (sender, reader) = tokio::net::UnixDatagram::pair().unwrap();
    let gate = clock.gate(&reader).unwrap();
    sender.send(b"frame").await.unwrap();
    let mut sleeper = clock.join();
    let task = tokio::spawn(async move { sleeper.sleep(SECOND).await });
    tokio::time::sleep(Duration::from_millis(20)).await;
    assert_eq!(clock.now(), noon());
    drop(gate);
    task.await.unwrap();
    assert_eq!(clock.now().since(noon()), SECOND);
}

/// Clock of a computer whose elapsed time and time of day are set by the test, in nanoseconds.
fn computer() -> (Clock, Arc<AtomicU64>, Arc<AtomicU64>) {
    let (passed, day) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(noon_today())));
    let (counted, said) = (passed.clone(), day.clone());
    let boot_clock = BootClock::by(move || Duration::from_nanos(counted.load(Ordering::Relaxed)));
    let time_of_day = TimeOfDay::by(move || Moment::from_nanos(said.load(Ordering::Relaxed)));
    (Clock::wall_by(boot_clock, time_of_day), passed, day)
}

/// Noon of 2026-01-31, in nanoseconds since 1970.
const fn noon_today() -> u64 {
    1_769_860_800_000_000_000
}

#[test]
fn a_rate_that_is_five_hundred_millionths_off_is_followed_without_a_word() {
    for rate in [999_500_000, 1_000_500_000] {
        let (clock, passed, day) = computer();
        for _ in 0..86_400 {
            passed.fetch_add(1_000_000_000, Ordering::Relaxed);
            day.fetch_add(rate, Ordering::Relaxed);
            assert_eq!(clock.check_time_of_day(), None);
        }
        assert_eq!(clock.now().since(Moment::from_nanos(noon_today())), Duration::from_secs(86_400));
        assert_eq!(clock.time_of_day(), Moment::from_nanos(day.load(Ordering::Relaxed)));
    }
}

#[test]
fn while_the_monotonic_clock_stands_still_no_time_is_counted_and_stamps_follow_the_day() {
    let (clock, _, day) = computer();
    let before = clock.now();
    day.fetch_add(60_000_000_000, Ordering::Relaxed);
    let correction = clock.check_time_of_day().unwrap();
    assert_eq!(correction.to.since(correction.from), Duration::from_secs(60));
    assert_eq!((clock.now(), clock.check_time_of_day()), (before, None));
    assert_eq!(clock.time_of_day(), before.after(Duration::from_secs(60)));
}

#[test]
fn a_computer_that_starts_in_1970_counts_from_a_later_year_and_says_1970() {
    let day = Moment::from_nanos(30_000_000_000);
    let clock = Clock::wall_by(BootClock::by(|| Duration::ZERO), TimeOfDay::by(move || day));
    assert!(clock.now() > Moment::from_nanos(1_500_000_000_000_000_000));
    assert_eq!((clock.time_of_day(), clock.check_time_of_day()), (day, None));
}
