//! State that the bus lines, the web page and the commands share. Its lock is held for microseconds, and never while a
//! task waits.
//!
//! A line task uses the state through its [`LineHandle`](super::line_handle::LineHandle). Web page and commands use
//! the state through the [`ApiBackend`](crate::gateway::api::api_backend::ApiBackend).

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

/// Work that the tasks of the bus lines may do. At the end of a run, the gateway limits this work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) enum LineWork {
    /// All work: reads, steps (calculations) of the axes, and outputs.
    #[default]
    All,
    /// Reads, heartbeats and corrected positions. No output changes its state or its entry in the register ledger.
    WithoutOutputs,
    /// Reads, heartbeats and corrected positions. Each line also closes its connection to an OPC UA server, because
    /// the server would otherwise keep the state of the connection.
    Leave,
}

/// State of the gateway that its tasks share.
pub(crate) struct Shared {
    pub(crate) profile: Arc<Profile>,
    pub(crate) clock: Clock,
    pub(crate) journal: Arc<Journal>,
    pub(crate) dry_run: bool,
    pub(crate) started: Moment,
    pub(in crate::gateway) ledger: Ledger,
    pub(in crate::gateway) dependents: Arc<Dependents>,
    wakeups: Mutex<Vec<Wakeup>>,
    /// Number of wakeups of each bus line (`news`), and number of actions of each line task (`turns`).
    news: Vec<AtomicU64>,
    turns: Vec<AtomicU64>,
    core: Mutex<GatewayState>,
    /// Notification that another program replaces this program.
    pub(in crate::gateway) replaced: Notify,
    line_work: Mutex<LineWork>,
    /// Number of bus lines whose outputs are idle: all their exchanges have ended, and no exchange may begin.
    resting: AtomicUsize,
    /// Limiter of the commands: the time of the last command for each subject and verb.
    rates: Mutex<Rates>,
    /// Figures about the messages that are published to an MQTT broker; `None` without a broker.
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

    /// Adds the figures about the messages to an MQTT broker, and the list of changed files of the profile.
    pub(in crate::gateway) fn showing(
        self,
        broker: Option<Arc<BrokerFigures>>,
        profile_changes: Arc<ProfileChanges>,
    ) -> Shared {
        Shared { broker, profile_changes, ..self }
    }

    /// Locks the state until the returned lock guard is dropped. If a task has panicked while it held the lock, the
    /// gateway is stopping. The state is returned nevertheless, because the fault actions need it.
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

    /// Wakes the tasks of all bus lines except that of `bus`, which is the caller.
    pub(in crate::gateway) fn wake_others(&self, bus: BusId) {
        self.wake_where(|place| place != bus.0);
    }

    /// Wakes the other bus lines that may have to write, or check for a restart of the control, after a step of the
    /// axes. The line of `bus` is the caller.
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

    /// Returns how often the line of a bus has been woken so far. A line task that never sleeps compares this number
    /// to detect a wakeup.
    pub(in crate::gateway) fn news(&self, bus: BusId) -> u64 {
        self.news[bus.0].load(Ordering::Relaxed)
    }

    /// Replaces the wakeup (handle that wakes the task) of a bus line, because its task was started again.
    pub(in crate::gateway) fn register_wakeup(&self, bus: BusId, wakeup: Wakeup) {
        let mut wakeups = self.wakeups.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = wakeups.get_mut(bus.0) {
            *place = wakeup;
        }
    }

    /// Limits the work that the bus lines may do to `work`.
    pub(in crate::gateway) fn limit_lines(&self, work: LineWork) {
        *self.line_work.lock().unwrap_or_else(PoisonError::into_inner) = work;
        self.wake();
    }

    pub(in crate::gateway) fn line_work(&self) -> LineWork {
        *self.line_work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records that the outputs of one more bus line are idle: no exchange is running.
    pub(in crate::gateway) fn outputs_idle(&self) {
        self.resting.fetch_add(1, Ordering::Release);
    }

    /// Returns the number of bus lines whose outputs are idle.
    pub(in crate::gateway) fn resting_lines(&self) -> usize {
        self.resting.load(Ordering::Acquire)
    }

    pub(in crate::gateway) fn pauses(&self) -> u64 {
        self.core().pauses.count()
    }

    /// Handles a pause of the computer that began at `since`. Each task detects the pause and calls this function,
    /// but only the first call reports the pause.
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
