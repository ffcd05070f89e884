//! Virtual clock. It wakes one task at a time. Each registered task has a [`SleepingTask`] in the [`Table`]. A separate
//! thread, the pacer, waits if virtual time must not pass faster than a multiple of wall-clock time.

#![allow(clippy::disallowed_types, reason = "pacing needs wall-clock time")]

use std::collections::BTreeMap;
use std::future::Future;
use std::os::fd::OwnedFd;
use std::pin::Pin;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use super::socket_gate::has_come;
use isotherm_core::quantity::Moment;

#[derive(Debug)]
pub(super) struct Simulated {
    table: Mutex<Table>,
    /// Condition variable that wakes the pacer thread: a sleeper waits for wall-clock time, or the clock was dropped.
    pacing: Condvar,
    start: Moment,
    started: Instant,
    speed: Option<f64>,
}

#[derive(Debug)]
struct Table {
    now: Moment,
    seats: BTreeMap<u64, SleepingTask>,
    next_seat: u64,
    /// Sockets that may contain an unread message.
    inflows: BTreeMap<u64, SocketState>,
    /// Whether every sleeper sleeps, and wall-clock time has not reached the next deadline yet.
    waits_for_wall: bool,
    closed: bool,
}

#[derive(Debug, Default)]
struct SleepingTask {
    /// Deadline of the sleep; `None` while the task is awake.
    until: Option<Moment>,
    waker: Option<Waker>,
    is_woken: bool,
}

#[derive(Debug)]
struct SocketState {
    from: OwnedFd,
    /// Whether a task is reading from this socket now.
    is_taken: bool,
}

/// Registration of one sleeper. Dropping it removes the sleeper, so the clock no longer waits for it.
#[derive(Debug)]
pub(super) struct Membership {
    clock: Arc<Simulated>,
    number: u64,
}

#[derive(Clone, Debug)]
pub(super) struct Wakeup {
    clock: Weak<Simulated>,
    number: u64,
}

impl Simulated {
    pub(super) fn start(start: Moment, speed: Option<f64>) -> Arc<Simulated> {
        let table = Table {
            now: start,
            seats: BTreeMap::new(),
            next_seat: 0,
            inflows: BTreeMap::new(),
            waits_for_wall: false,
            closed: false,
        };
        let speed = speed.filter(|speed| speed.is_finite() && *speed > 0.0);
        let clock = Arc::new(Simulated {
            table: Mutex::new(table),
            pacing: Condvar::new(),
            start,
            started: Instant::now(),
            speed,
        });
        if speed.is_some() {
            let pacer = Arc::downgrade(&clock);
            std::thread::spawn(move || pace(&pacer));
        }
        clock
    }

    pub(super) fn now(&self) -> Moment {
        self.table().now
    }

    pub(super) fn skip(&self, span: Duration) {
        let mut table = self.table();
        table.now = table.now.after(span);
    }

    pub(super) fn sit_down(self: &Arc<Simulated>) -> Membership {
        let mut table = self.table();
        let number = table.next_seat;
        table.next_seat += 1;
        table.seats.insert(number, SleepingTask::default());
        Membership { clock: self.clone(), number }
    }

    /// Registers a socket that the clock checks before it advances. Returns the number of the socket.
    pub(super) fn watch(&self, from: OwnedFd) -> u64 {
        let mut table = self.table();
        let number = table.next_seat;
        table.next_seat += 1;
        table.inflows.insert(number, SocketState { from, is_taken: false });
        number
    }

    /// Records whether a task is reading from the socket with this number. While a task reads, virtual time does not
    /// advance.
    pub(super) fn take_from(&self, number: u64, is_taken: bool) {
        let mut table = self.table();
        if let Some(inflow) = table.inflows.get_mut(&number) {
            inflow.is_taken = is_taken;
        }
        self.advance(&mut table);
    }

    pub(super) fn forget(&self, number: u64) {
        let mut table = self.table();
        table.inflows.remove(&number);
        self.advance(&mut table);
    }

    /// Locks the table. The lock is also used after another thread has panicked, because every change is a single
    /// assignment.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns how much wall-clock time must pass before virtual time may reach `deadline`.
    fn wall_wait(&self, deadline: Moment) -> Duration {
        let Some(speed) = self.speed else { return Duration::ZERO };
        let due = Duration::try_from_secs_f64(deadline.since(self.start).as_secs_f64() / speed);
        due.unwrap_or(Duration::MAX).saturating_sub(self.started.elapsed())
    }

    /// Wakes the sleeper with the earliest deadline, if every sleeper sleeps. If wall-clock time must pass first, the
    /// pacer thread wakes it later.
    fn advance(&self, table: &mut Table) {
        table.waits_for_wall = false;
        let Some((number, deadline)) = table.next() else { return };
        if self.wall_wait(deadline).is_zero() {
            table.wake(number, deadline);
        } else {
            table.waits_for_wall = true;
            self.pacing.notify_one();
        }
    }
}

impl Table {
    /// Returns the number and deadline of the next sleeper to wake. Returns `None` while a sleeper is awake or a socket
    /// has unread data.
    fn next(&self) -> Option<(u64, Moment)> {
        let mut earliest = None;
        for (number, guest) in &self.seats {
            let until = guest.until?;
            if earliest.is_none_or(|(_, first)| until < first) {
                earliest = Some((*number, until));
            }
        }
        let is_taken = |inflow: &SocketState| inflow.is_taken || has_come(&inflow.from);
        if self.inflows.values().any(is_taken) { None } else { earliest }
    }

    fn wake(&mut self, number: u64, deadline: Moment) {
        self.now = self.now.max(deadline);
        self.waits_for_wall = false;
        if let Some(guest) = self.seats.get_mut(&number) {
            guest.until = None;
            if let Some(waker) = guest.waker.take() {
                waker.wake();
            }
        }
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        self.table().closed = true;
        self.pacing.notify_all();
    }
}

/// Runs the pacer thread. Whenever every sleeper sleeps, the thread waits for wall-clock time, and then wakes the next
/// sleeper.
fn pace(clock: &Weak<Simulated>) {
    while let Some(clock) = clock.upgrade() {
        let mut table = clock.table();
        if table.closed {
            return;
        }
        let wait = match table.next().filter(|_| table.waits_for_wall) {
            Some((number, deadline)) => {
                let wait = clock.wall_wait(deadline);
                if wait.is_zero() {
                    table.wake(number, deadline);
                    continue;
                }
                wait
            }
            None => Duration::from_millis(20),
        };
        // Short waits let the thread end soon after the last user has dropped the clock.
        let wait = wait.min(Duration::from_millis(20));
        drop(clock.pacing.wait_timeout(table, wait));
    }
}

impl Membership {
    pub(super) fn wakeup(&self) -> Wakeup {
        Wakeup { clock: Arc::downgrade(&self.clock), number: self.number }
    }

    pub(super) fn sleep_until(&mut self, deadline: Moment) -> SimulatedSleep<'_> {
        SimulatedSleep { membership: self, deadline, asleep: false }
    }
}

impl Drop for Membership {
    fn drop(&mut self) {
        let mut table = self.clock.table();
        table.seats.remove(&self.number);
        self.clock.advance(&mut table);
    }
}

impl Wakeup {
    pub(super) fn pull(&self) {
        let Some(clock) = self.clock.upgrade() else { return };
        let mut table = clock.table();
        let now = table.now;
        if let Some(guest) = table.seats.get_mut(&self.number) {
            if guest.until.is_some() {
                table.wake(self.number, now);
            } else {
                guest.is_woken = true;
            }
        }
    }
}

/// Future of one sleep. If the future is dropped before the sleep ends, the sleeper counts as awake.
pub(super) struct SimulatedSleep<'a> {
    membership: &'a mut Membership,
    deadline: Moment,
    asleep: bool,
}

impl Future for SimulatedSleep<'_> {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        let clock = self.membership.clock.clone();
        let mut table = clock.table();
        let now = table.now;
        let Some(guest) = table.seats.get_mut(&self.membership.number) else { return Poll::Ready(()) };
        if self.asleep && guest.until.is_none() {
            self.asleep = false;
            return Poll::Ready(());
        }
        guest.waker = Some(context.waker().clone());
        if self.asleep {
            return Poll::Pending;
        }
        if std::mem::take(&mut guest.is_woken) {
            return Poll::Ready(());
        }
        guest.until = Some(self.deadline.max(now));
        self.asleep = true;
        clock.advance(&mut table);
        Poll::Pending
    }
}

impl Drop for SimulatedSleep<'_> {
    fn drop(&mut self) {
        if self.asleep
            && let Some(guest) = self.membership.clock.table().seats.get_mut(&self.membership.number)
        {
            guest.until = None;
            guest.waker = None;
        }
    }
}
