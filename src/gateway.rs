//! The gateway: connects the bus lines, axes and outputs of one profile, and runs them.
//!
//! Each bus line has one task that owns it. The task reads signals, calculates Cz (the compensation value) of
//! the axes whose inputs it has just read, and writes the results to the outputs. One lock protects the state
//! that the tasks share; a task holds it for microseconds. Events, web page, log and state file work with
//! copies, so the tasks never wait for them.

use std::collections::HashMap;
use std::future::Future;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Notify;
use tokio::task::{Id, JoinError, JoinSet};

use crate::clock::{Clock, Sleeper};
use crate::fieldbus::connection::Dial;
use crate::fieldbus::kinds;
use crate::fieldbus::line::DeviceLine;
use crate::observe::events::{Event, Journal, file};
use crate::observe::status::GatewayApi;
use isotherm_core::border::panic_message;
use isotherm_core::quantity::Moment;
use isotherm_profile::{AxisId, BusId, OnStop, Profile, stop};

mod api;
pub mod claims;
mod lifecycle;
mod line;
mod line_names;
mod output;
mod shared;
mod state;
mod store;

use api::api_backend::ApiBackend;
use lifecycle::learner::Learner;
use lifecycle::recovered_state::{self, RecoveredState};
use lifecycle::watchdog::Watchdog;
use lifecycle::{shutdown, systemd};
use line::can::CanListener;
use line::poll::LineTask;
use shared::line_handle::LineHandle;
use shared::releasing;
use shared::shared_state::{LineWork, Shared};
use shared::state::GatewayState;
use store::ledger::{Ledger, LedgerRun};
use store::storage::Storage;

pub use api::control;
pub use lifecycle::handover::{
    Arrival, Handover, KeptProfile, Prepared, answer_of_check, digest_path, memory_for_profile,
};
pub use lifecycle::learner::{LearnCommand, LearnTimes};
pub use lifecycle::options::{Dialer, Options, Pace};
pub use lifecycle::recovered_state::{may_start, moved_since, preferences_in, superseded_in, with_releases};
pub use lifecycle::successor::{CHECK_ONLY, Checked, Program, Successor};
#[cfg(feature = "opcua")]
pub use line::certificates;
pub use line::wire_log::WireLog;
pub use state::causes::how_to_find_a_model;
pub(crate) use state::causes::why_by_decision;
#[cfg(feature = "identify")]
pub(crate) use state::learning::change as model_change;
pub use state::sign::{is_at_zero, sign_expectation};
pub use store::disk::{Disk, Files, make_directory};
pub use store::{backup, candidates, log, templates};

/// Reason shown for an axis that stays off because the saved state was rejected, or was restored from a backup.
const IN_QUESTION: &str = "the saved state was rejected (see the events) or was restored from a backup, and \
                           the operator has not armed since";
/// Maximum time for which the gateway waits at its end until the saved state is on disk.
const LAST_PATIENCE: Duration = Duration::from_secs(5);

/// Interval of the messages to the service manager (systemd) about the remaining time of a stop.
const TOLD_EVERY: Duration = Duration::from_secs(1);
/// Interval of the checks whether all axes have completed their fault actions (`on_fault` in the profile). The
/// gateway makes these checks when it stops with fault actions.
const ENDED_EVERY: Duration = Duration::from_millis(100);
/// Interval of the checks whether all exchanges with registers have ended, when the gateway stops without fault
/// actions. The interval is short, because no axis is corrected during such a stop.
const SETTLED_EVERY: Duration = Duration::from_millis(5);

/// Maximum number of events from before the start that the gateway still shows.
const RECALLED: usize = 100;

/// Gateway of one profile. [`Gateway::new`] creates it, and [`Gateway::run`] runs it.
pub struct Gateway {
    shared: Arc<Shared>,
    options: Options,
    sleepers: Vec<Sleeper>,
    wire_log: WireLog,
}

/// Result of a run of the gateway, from [`Gateway::run`].
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Whether a task of the gateway failed. The events contain the cause.
    pub failed: bool,
    /// Whether all axes completed their fault actions within the time limit. Also true if the gateway stopped without
    /// fault actions.
    pub rested: bool,
    /// Sentence about the values that stay in the registers after the run.
    pub left: String,
    /// State for the program that replaces this gateway. `None` if the run ended for another reason than a
    /// replacement. The registers keep their values during a replacement.
    pub handover: Option<Handover>,
}

impl Gateway {
    /// Creates the gateway of a profile. The function registers one sleeper (timer of a task) with the clock for each
    /// bus, in the order of the profile.
    pub fn new(mut profile: Profile, clock: &Clock, options: Options) -> Gateway {
        if let Some(Pace { polls, axes }) = options.pace {
            profile.devices.iter_mut().for_each(|device| device.every = polls);
            profile.axes.iter_mut().for_each(|axis| axis.settings.every = axes);
        }
        let journal =
            Arc::new(Journal::by(clock).heard_by(options.listener.clone()).logging(options.logged_text));
        if let Some(directory) = options.directory.as_deref().filter(|_| options.has_threads) {
            journal.recall(file::last(directory, &profile.name, RECALLED));
        }
        if let Err(why) = &options.handover {
            journal.report(clock.now(), &Event::HandoverRefused { why: why.clone() });
        }
        let mut left = RecoveredState::open(&options, &profile, (&journal, clock));
        let releases = left.extend(&mut profile, &options);
        let profile = Arc::new(profile);
        let RecoveredState { mut restored, correction, opened, places, is_lost } = left;
        let remembers = |output: &str| restored.verified_um.contains_key(output);
        let (ledger, writer) = match opened {
            None => (Ledger::of_nothing(&profile, (&journal, clock)), None),
            Some(opened) => {
                let run = LedgerRun { dry_run: options.dry_run, has_threads: options.has_threads };
                let (ledger, writer) =
                    Ledger::open(&profile, run, opened, remembers, (journal.clone(), clock));
                (ledger, Some(writer))
            }
        };
        let is_in_question = writer.as_ref().is_some_and(|writer| writer.question().is_open());
        let storage = match (options.directory.as_deref(), writer) {
            (Some(directory), Some(writer)) if options.has_threads => {
                let (kept, dry_run) = ((directory, writer), options.dry_run);
                Storage::start(&profile, kept, dry_run, journal.clone(), (clock, correction))
            }
            (_, Some(writer)) => Storage::without_log(writer, clock),
            (_, None) => Storage::default(),
        };
        let sleepers: Vec<Sleeper> = profile.buses.iter().map(|_| clock.join()).collect();
        let wakeups = sleepers.iter().map(Sleeper::wakeup).collect();
        let mut was_driven = vec![false; profile.axes.len()];
        for output in profile.outputs.iter().filter(|output| output.writes.is_cz()) {
            was_driven[output.axis.0] |= remembers(&output.name);
        }
        let core = |given| {
            let remembered = std::mem::take(&mut restored.remembered);
            let mut core = GatewayState::new(given, remembered, storage, clock.now());
            core.was_driven = was_driven;
            core.storage.signs = std::mem::take(&mut restored.signs);
            core.releases = releases;
            recovered_state::begin(&mut core, (places, is_lost), restored, clock.now());
            if let Ok(Some(handover)) = &options.handover {
                handover.go_on(&mut core, clock.now());
            }
            if is_in_question {
                (0..core.arming.len()).for_each(|axis| core.disarm(AxisId(axis), IN_QUESTION));
            }
            for (axis, why) in core.places.barred(&core.given.profile) {
                // An axis that was off before keeps its reason, also for the next program.
                if is_in_question || !core.arming[axis.0].is_latched() {
                    core.disarm(axis, why);
                }
            }
            releasing::begin(&mut core, clock.now());
            core
        };
        let shared = Shared::new(profile, clock.clone(), journal, options.dry_run, ledger, wakeups, core);
        let shared = Arc::new(shared.showing(options.broker.clone(), options.profile_changes.clone()));
        let wire_log = WireLog::new(&shared.profile);
        Gateway { shared, options, sleepers, wire_log }
    }

    /// Returns the log of the exchanges with the devices, for use in any thread.
    pub fn wire_log(&self) -> WireLog {
        self.wire_log.clone()
    }

    /// Returns the interface that reads the state and accepts commands, for use in any thread.
    pub fn source(&self) -> Arc<dyn GatewayApi> {
        let directory = self.options.directory.clone().filter(|_| self.options.has_threads);
        Arc::new(ApiBackend::new(self.shared.clone(), directory))
    }

    /// Returns the handle by which `program` can replace this gateway. `socket` is the path of the gateway's command
    /// socket.
    pub fn successor(&self, program: Program, socket: PathBuf) -> Successor {
        Successor::new(self.shared.clone(), program, socket)
    }

    /// Runs the gateway until `shutdown` is ready, a task fails, or another program takes over. After a shutdown, the
    /// axes run their fault actions, or the registers keep their values, as the profile requires. When `hurry` is
    /// ready, the gateway no longer waits for the fault actions.
    pub async fn run(
        mut self,
        shutdown: impl Future<Output = ()>,
        hurry: impl Future<Output = ()>,
    ) -> Outcome {
        let stop = Arc::new(Notify::new());
        let mut tasks = JoinSet::new();
        let mut lines = HashMap::new();
        let requests = self.start_lines(&mut tasks, &mut lines);
        let machine = self.shared.profile.name.clone();
        self.shared.report(&Event::Started { machine, bus_requests: requests });
        self.report_templates();
        #[cfg(feature = "opcua")]
        if certificates::has_some(&self.shared.profile) {
            tasks.spawn(certificates::watch(self.shared.clone(), self.shared.clock.join()));
        }
        let _watch = self.options.has_threads.then(|| self.watch(&stop));
        let _learner = self.learn();
        let (mut shutdown, on_stop) = (pin!(shutdown), self.shared.profile.on_stop);
        let asked = tokio::select! {
            biased;
            () = &mut shutdown => Some(on_stop),
            () = stop.notified() => self.failed(),
            Some(ended) = tasks.join_next_with_id() => {
                self.line_failed(ended.map(|(id, ())| id), &mut tasks, &mut lines);
                self.failed()
            }
            () = self.shared.replaced.notified() => None,
        };
        let asked = match asked {
            // A stop is accepted while the registers settle for another program, too.
            None => tokio::select! {
                biased;
                () = &mut shutdown => Some(on_stop),
                () = self.settle() => None,
            },
            asked => asked,
        };
        let rested = match asked {
            None => true,
            Some(how) => tokio::select! {
                biased;
                rested = self.stop(how) => rested,
                () = hurry => false,
            },
        };
        self.release_strobes().await;
        // The lines continue to poll and to write heartbeats while the disk stores the state for the next program.
        let kept = match asked {
            None if self.outputs_idle(lines.len()).await => Some(self.keep().await),
            _ => None,
        };
        self.take_leave(&mut tasks, &lines).await;
        // The clock is held until tasks and disk have ended.
        let _hold = self.shared.clock.hold();
        tasks.shutdown().await;
        let (left, failed) = match kept {
            Some(kept) => kept,
            None => self.keep().await,
        };
        let handover = asked.is_none().then(|| self.handover());
        Outcome { failed, rested, left, handover }
    }

    /// Stores saved state, register ledger (record of the values written to the registers), logs and events on disk.
    /// Returns a sentence about the values that stay in the registers, and whether a task failed.
    async fn keep(&self) -> (String, bool) {
        let left = shutdown::what_is_left(&self.shared);
        self.shared.report(&Event::Stopped { left: left.clone() });
        shutdown::end_registers(&self.shared);
        let failed = self.save_last().await;
        self.shared.ledger.finish(LAST_PATIENCE).await;
        (left, failed)
    }

    /// Forbids new exchanges of the outputs, and waits until the running exchanges of all `lines` (number of bus
    /// lines) have ended. Returns `false` if they do not end in time.
    async fn outputs_idle(&self, lines: usize) -> bool {
        self.shared.limit_lines(LineWork::WithoutOutputs);
        let within = stop::hold(&self.shared.profile);
        self.wait_until((within, SETTLED_EVERY), |shared| shared.resting_lines() >= lines).await
    }

    /// Reports each device template that has changed since the last run. The cause is a newer version of the
    /// program, which contains the changed template. Each change is reported once.
    fn report_templates(&self) {
        let Some(directory) = self.options.directory.as_deref().filter(|_| self.options.has_threads) else {
            return;
        };
        for (template, changes) in templates::changed(directory, &self.shared.profile) {
            self.shared.report(&Event::TemplateChanged { template, changes });
        }
        if !self.options.dry_run {
            templates::keep(directory, &self.shared.profile);
        }
    }

    /// Records that a task failed. Returns [`OnStop::FaultAction`]: the axes run their fault actions, even if the
    /// profile sets that the registers keep their values at a stop.
    fn failed(&self) -> Option<OnStop> {
        self.shared.core().failed = true;
        Some(OnStop::FaultAction)
    }

    /// Stops the axes, with or without fault actions. Returns whether the fault actions ended in time; `true` without
    /// fault actions.
    async fn stop(&self, how: OnStop) -> bool {
        let within = shutdown::begin_stop(&self.shared, how);
        let holds = how == OnStop::Hold;
        self.shared.report(&Event::Stopping { holds, within });
        let does = match how {
            OnStop::FaultAction => "stopping: the fault actions run",
            OnStop::Hold => "stopping: the registers keep their values",
        };
        systemd::stopping(does, within);
        match how {
            OnStop::FaultAction => self.wait_until((within, ENDED_EVERY), shutdown::is_idle).await,
            OnStop::Hold => {
                self.settled(within).await;
                true
            }
        }
    }

    /// Stops the corrections of all axes, and waits for running exchanges, because another program takes over.
    async fn settle(&self) {
        let within = shutdown::begin_stop(&self.shared, OnStop::Hold);
        self.shared.report(&Event::Stopping { holds: true, within });
        systemd::reloading("another program takes over; the registers keep their values");
        self.settled(within).await;
    }

    /// Waits until no exchange with a register is running, at most for `within`. A timeout is not an error: the next
    /// run waits until the writes of this run can no longer arrive.
    async fn settled(&self, within: Duration) {
        let _ = self.wait_until((within, SETTLED_EVERY), shutdown::has_settled).await;
    }

    fn handover(&self) -> Handover {
        let core = self.shared.core();
        Handover::of(&core, core.replaced_by.clone())
    }

    /// Stores the final state on disk. Returns whether a task of the run failed.
    async fn save_last(&self) -> bool {
        let mut core = self.shared.core();
        let mut storage = std::mem::take(&mut core.storage);
        let now = self.shared.clock.now();
        storage.outputs.count_for_the_last_time(now);
        let of_profile = (&self.shared.profile, &core.places.places);
        let seen = (&core.board, core.outputs.states());
        storage.remember((now, true), &core.compensation, of_profile, seen);
        let failed = core.failed;
        drop(core);
        // A blocking thread waits for the disk, because the lines may still be polled here.
        let mut finish = move || storage.finish();
        match self.options.has_threads {
            true => drop(tokio::task::spawn_blocking(finish).await),
            false => finish(),
        }
        failed
    }

    fn start_lines(&mut self, tasks: &mut JoinSet<()>, lines: &mut HashMap<Id, BusId>) -> usize {
        let start = self.shared.clock.now();
        let sleepers = std::mem::take(&mut self.sleepers);
        let mut requests = 0;
        for (place, sleeper) in sleepers.into_iter().enumerate() {
            let Some((task, listener)) = self.line_task(BusId(place), sleeper, start) else { continue };
            requests += task.requests();
            lines.insert(tasks.spawn(task.run(listener)).id(), BusId(place));
        }
        requests
    }

    /// Creates the task of a bus line. A CAN line also has a listener. Returns `None` if no connection exists for this
    /// kind of bus.
    fn line_task(
        &self,
        bus: BusId,
        sleeper: Sleeper,
        start: Moment,
    ) -> Option<(Box<LineTask>, Option<Box<CanListener>>)> {
        let profile = &self.shared.profile;
        let devices: Vec<_> = profile.devices_on(bus).collect();
        let settings = profile.bus(bus);
        let handle = LineHandle::new(self.shared.clone(), bus);
        let (can, listener) = CanListener::of(&handle, bus, self.wire_log.tap(bus)).unzip();
        let dial: Box<dyn Dial> = match &can {
            Some(can) => Box::new(can.dial(settings)),
            None => (self.options.dialer)(settings)?,
        };
        if let Some(table) = dial.namespaces() {
            let mut core = self.shared.core();
            table.begin_with(core.places.namespaces(&settings.address));
            core.devices.set_namespaces(bus, table);
        }
        let line = DeviceLine::new(settings, &devices, dial, &self.shared.clock)
            .tapped(self.wire_log.tap(bus))
            .witnessed(Arc::new(handle.clone()))
            .aged(self.shared.dependents.shortest_age)
            .with_ages(|device| profile.shortest_age_of(device));
        let line = if self.options.is_unchecked { line.unchecked() } else { line };
        let task = LineTask::new(handle, bus, (line, sleeper), can, start);
        Some((Box::new(task), listener.map(Box::new)))
    }

    /// Starts the thread that learns the models of the axes; `None` if no axis learns.
    fn learn(&self) -> Option<Learner> {
        let directory = self.options.directory.clone().filter(|_| self.options.has_threads)?;
        Learner::start(self.shared.clone(), self.options.learn.clone(), directory)
    }

    fn watch(&self, stop: &Arc<Notify>) -> Watchdog {
        let (stop, give_up) = (stop.clone(), self.options.give_up.clone());
        Watchdog::start(self.shared.clone(), self.options.watch, move || stop.notify_one(), move || give_up())
    }

    /// Reports the failed task of a bus line, and starts it again, so that the axes can run their fault actions.
    fn line_failed(
        &self,
        ended: Result<Id, JoinError>,
        tasks: &mut JoinSet<()>,
        lines: &mut HashMap<Id, BusId>,
    ) {
        let (id, why) = match ended {
            Ok(id) => (id, "it ended".to_owned()),
            Err(error) => {
                let id = error.id();
                let why = error.try_into_panic().map(|panic| panic_message(panic.as_ref()));
                (id, why.unwrap_or_else(|error| error.to_string()))
            }
        };
        let Some(bus) = lines.remove(&id) else { return };
        let task = format!("bus {}", self.shared.profile.bus(bus).name);
        self.shared.report(&Event::TaskFailed { task, why });
        let sleeper = self.shared.clock.join();
        self.shared.register_wakeup(bus, sleeper.wakeup());
        let Some((again, listener)) = self.line_task(bus, sleeper, self.shared.clock.now()) else { return };
        lines.insert(tasks.spawn(again.run(listener)).id(), bus);
    }

    /// Waits until all strobe signals are reset, but not longer than three timeouts of the slowest bus. A strobe
    /// signal tells the control to accept the written values.
    async fn release_strobes(&self) {
        if !shutdown::leave(&self.shared) {
            return;
        }
        let slowest = self.shared.profile.buses.iter().map(|bus| bus.timeout * 3).max();
        let mut sleeper = self.shared.clock.join();
        let deadline = sleeper.now().after(slowest.unwrap_or_default());
        while shutdown::leave(&self.shared) && sleeper.now() < deadline {
            sleeper.sleep(Duration::from_millis(20)).await;
        }
    }

    /// Closes the connections to OPC UA servers, because a server may allow only a few clients. The function waits
    /// for a server that does not answer, but only until the requests time out.
    async fn take_leave(&self, tasks: &mut JoinSet<()>, lines: &HashMap<Id, BusId>) {
        let kept = |bus: BusId| {
            let bus = self.shared.profile.bus(bus);
            kinds::of(bus.transport).is_closed_in_order.then_some(bus)
        };
        let mut open: HashMap<Id, Duration> =
            lines.iter().filter_map(|(id, bus)| Some((*id, kept(*bus)?.timeout))).collect();
        // One request may be running for its timeout. The closing request has its own timeout.
        let Some(longest) = open.values().max().map(|timeout| *timeout * 2) else { return };
        self.shared.limit_lines(LineWork::Leave);
        let closed = async {
            while !open.is_empty()
                && let Some(ended) = tasks.join_next_with_id().await
            {
                open.remove(&ended.map_or_else(|error| error.id(), |(id, ())| id));
            }
        };
        let mut sleeper = self.shared.clock.join();
        tokio::select! {
            () = closed => {}
            _ = sleeper.sleep(longest) => {}
        }
    }

    /// Calls `is_over` at the interval `every` until it returns `true`. Returns `false` if this takes longer than
    /// `within`.
    async fn wait_until(
        &self,
        (within, every): (Duration, Duration),
        is_over: impl Fn(&Shared) -> bool,
    ) -> bool {
        let mut sleeper = self.shared.clock.join();
        let deadline = sleeper.now().after(within);
        let mut told = sleeper.now();
        while !is_over(&self.shared) {
            let now = sleeper.now();
            if now >= deadline {
                return false;
            }
            if now.since(told) >= TOLD_EVERY {
                told = now;
                systemd::takes(deadline.since(now));
            }
            sleeper.sleep(every).await;
        }
        true
    }
}
