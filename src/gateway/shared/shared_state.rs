//! State that the bus lines, the web page and the commands share. Its lock is held for microseconds, and never while a
//! task waits.
//!
//! A line accesses the state through its [`LineHandle`](super::line_handle::LineHandle), web page and commands through
//! the [`ApiBackend`](crate::gateway::api::api_backend::ApiBackend).

use std::ops::Range;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use tokio::sync::Notify;

use super::lock::StateGuard;
use super::rates::Rates;
use super::state::GatewayState;
use crate::clock::{Clock, Wakeup};
use crate::gateway::state::dependents::{Dependents, RunConfig};
use crate::gateway::store::ledger::Ledger;
use crate::observe::events::{Event, Journal};
use crate::observe::status::{BrokerFigures, ProfileChanges};
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, Profile};

/// Work that the bus lines may do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) enum LineWork {
    /// All work: reads, steps and outputs.
    #[default]
    All,
    /// Reads, heartbeats and corrected positions. No output changes its state or its entry in the register ledger.
    WithoutOutputs,
    /// Reads, heartbeats and corrected positions. In addition, each line closes its connection to an OPC UA server,
    /// because the server would keep its state of the connection.
    Leave,
}

/// State of the gateway, shared by its tasks.
pub(crate) struct Shared {
    pub(crate) profile: Arc<Profile>,
    pub(crate) clock: Clock,
    pub(crate) journal: Arc<Journal>,
    pub(crate) dry_run: bool,
    pub(crate) started: Moment,
    pub(in crate::gateway) ledger: Ledger,
    pub(in crate::gateway) dependents: Arc<Dependents>,
    wakeups: Mutex<Vec<Wakeup>>,
    /// For each bus: the number of wakeups of its line. `turns`: the number of actions of its line task.
    news: Vec<AtomicU64>,
    turns: Vec<AtomicU64>,
    core: Mutex<GatewayState>,
    /// Notification that another program shall replace this one.
    pub(in crate::gateway) replaced: Notify,
    line_work: Mutex<LineWork>,
    /// Number of lines that have finished all exchanges of their outputs, and begin no others.
    resting: AtomicUsize,
    /// Time of the last command for each subject and verb.
    rates: Mutex<Rates>,
    /// Figures about publishing to an MQTT broker; `None` without a broker.
    pub(in crate::gateway) broker: Option<Arc<BrokerFigures>>,
    /// Files of the profile that have changed on disk.
    pub(in crate::gateway) profile_changes: Arc<ProfileChanges>,
}

impl Shared {
    pub(in crate::gateway) fn new(
        profile: Arc<Profile>,
        clock: Clock,
        journal: Arc<Journal>,
        dry_run: bool,
        ledger: Ledger,
        wakeups: Vec<Wakeup>,
        core: impl FnOnce(RunConfig) -> GatewayState,
    ) -> Shared {
        let dependents = Arc::new(Dependents::new(&profile));
        let given = RunConfig { profile: profile.clone(), dependents: dependents.clone(), dry_run };
        let counts = || profile.buses.iter().map(|_| AtomicU64::default()).collect();
        Shared {
            started: clock.now(),
            journal,
            dry_run,
            ledger,
            dependents,
            wakeups: Mutex::new(wakeups),
            news: counts(),
            turns: counts(),
            core: Mutex::new(core(given)),
            replaced: Notify::new(),
            line_work: Mutex::default(),
            resting: AtomicUsize::new(0),
            rates: Mutex::default(),
            broker: None,
            profile_changes: Arc::default(),
            clock,
            profile,
        }
    }

    /// Adds the figures about publishing to an MQTT broker, and the changed files of the profile.
    pub(in crate::gateway) fn showing(
        self,
        broker: Option<Arc<BrokerFigures>>,
        profile_changes: Arc<ProfileChanges>,
    ) -> Shared {
        Shared { broker, profile_changes, ..self }
    }

    /// Locks the state until the returned lock guard is dropped. If a task has panicked with the lock, the gateway is
    /// stopping already, but the fault actions still need the state.
    pub(in crate::gateway) fn core(&self) -> StateGuard<'_> {
        StateGuard::new(self.core.lock().unwrap_or_else(PoisonError::into_inner), self)
    }

    pub(in crate::gateway) fn rates(&self) -> MutexGuard<'_, Rates> {
        self.rates.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(in crate::gateway) fn is_free(&self) -> bool {
        !matches!(self.core.try_lock(), Err(TryLockError::WouldBlock))
    }

    pub(crate) fn report(&self, event: &Event) {
        self.journal.report(self.clock.now(), event);
    }

    pub(in crate::gateway) fn wake(&self) {
        self.wake_where(|_| true);
    }

    /// Wakes the lines of all other buses. The line of `bus` is awake.
    pub(in crate::gateway) fn wake_others(&self, bus: BusId) {
        self.wake_where(|place| place != bus.0);
    }

    /// Wakes the lines of all other buses that may have something to write or to check after a step of the axes.
    pub(in crate::gateway) fn wake_followers(&self, bus: BusId) {
        self.wake_where(|place| place != bus.0 && self.dependents.follows_steps[place]);
    }

    pub(in crate::gateway) fn wake_line(&self, bus: BusId) {
        self.wake_at(bus.0..bus.0 + 1, |_| true);
    }

    fn wake_where(&self, chosen: impl Fn(usize) -> bool) {
        self.wake_at(0..self.news.len(), chosen);
    }

    fn wake_at(&self, places: Range<usize>, chosen: impl Fn(usize) -> bool) {
        let wakeups = self.wakeups.lock().unwrap_or_else(PoisonError::into_inner);
        for place in places.filter(|place| chosen(*place)) {
            if let (Some(wakeup), Some(news)) = (wakeups.get(place), self.news.get(place)) {
                news.fetch_add(1, Ordering::Relaxed);
                wakeup.wake();
            }
        }
    }

    pub(in crate::gateway) fn turned(&self, bus: BusId) {
        self.turns[bus.0].fetch_add(1, Ordering::Relaxed);
    }

    pub(in crate::gateway) fn turns(&self, bus: BusId) -> u64 {
        self.turns[bus.0].load(Ordering::Relaxed)
    }

    /// Returns the number of wakeups of a line so far. A line that never sleeps compares this number to notice a
    /// wakeup.
    pub(in crate::gateway) fn news(&self, bus: BusId) -> u64 {
        self.news[bus.0].load(Ordering::Relaxed)
    }

    /// Replaces the wakeup (handle that wakes the task) of a line whose task was started again.
    pub(in crate::gateway) fn register_wakeup(&self, bus: BusId, wakeup: Wakeup) {
        let mut wakeups = self.wakeups.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = wakeups.get_mut(bus.0) {
            *place = wakeup;
        }
    }

    /// Limits the work of the lines from now on.
    pub(in crate::gateway) fn limit_lines(&self, work: LineWork) {
        *self.line_work.lock().unwrap_or_else(PoisonError::into_inner) = work;
        self.wake();
    }

    pub(in crate::gateway) fn line_work(&self) -> LineWork {
        *self.line_work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts one more line on which no exchange of an output is running.
    pub(in crate::gateway) fn outputs_idle(&self) {
        self.resting.fetch_add(1, Ordering::Release);
    }

    /// Returns the number of lines on which no exchange of an output is running.
    pub(in crate::gateway) fn resting_lines(&self) -> usize {
        self.resting.load(Ordering::Acquire)
    }

    pub(in crate::gateway) fn pauses(&self) -> u64 {
        self.core().pauses.count()
    }

    /// Handles a pause of the computer since the moment `since`. Each task detects the pause by itself; only the first
    /// call reports it.
    pub(in crate::gateway) fn stalled_at(&self, since: Moment) {
        let now = self.clock.now();
        let mut core = self.core();
        if !core.pauses.begins(since, now) {
            return;
        }
        core.board.forget();
        core.devices.all_break(Break::Pause, now);
        core.not_after.fill(Moment::default());
        core.events.push(Event::StoodStill { span: now.since(since) });
        drop(core);
        self.wake();
    }
}
