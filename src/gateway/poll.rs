//! The task of one line: writes, reads, steps, and writes again what was just decided, in one bus cycle.

use std::sync::Arc;
use std::time::Duration;

pub(super) use self::call::call;
use self::captures::Captures;
use super::apply::{SetWriter, Writer};
use super::can::{Can, Ear};
use super::commissioning::Inspector;
use super::shared::{BusCount, JITTER_MS, Shared};
use crate::clock::Sleeper;
use crate::compensation::model::Evaluate;
use crate::fieldbus::line::Line;
use crate::fieldbus::plan::{ReadRequest, plan};
use crate::fieldbus::wire::Request;
use crate::observe::events::Event;
use crate::profile::{Arm, BusId, DeviceId, OutputId, Profile, SetId, Writes};
use crate::quantity::Moment;
use crate::reading::SignalId;

mod call;
mod captures;
mod read;
mod urgent;

/// Owns one line and everything that is read and written on it.
pub(super) struct LineTask {
    shared: Arc<Shared>,
    bus: BusId,
    line: Line,
    can: Option<Arc<Can>>,
    inspector: Inspector,
    polls: Vec<Poll>,
    writers: Vec<Writer>,
    sets: Vec<SetWriter>,
    pulse: Option<Pulse>,
    /// Inputs of an axis are read here, so its steps are made here, right after them.
    steps_axes: bool,
    /// A position read here is corrected on another line.
    feeds_others: bool,
    /// When what must not wait was last looked at.
    passed: Moment,
    /// Everything here has been asked for once.
    has_been_round: bool,
}

/// One device's reads.
struct Poll {
    device: DeviceId,
    every: Duration,
    due: Moment,
    /// A position that is corrected is among them.
    reads_position: bool,
    captures: Captures,
    requests: Vec<ReadRequest>,
}

/// The heartbeat.
struct Pulse {
    device: DeviceId,
    register: u16,
    every: Duration,
    due: Moment,
    count: u16,
}

impl LineTask {
    pub(super) fn new(shared: Arc<Shared>, bus: BusId, line: Line, start: Moment) -> LineTask {
        let profile = &shared.profile;
        let here = |device: DeviceId| profile.device(device).bus == bus;
        let positions: Vec<(SignalId, DeviceId)> = profile
            .outputs
            .iter()
            .filter_map(|output| match output.writes {
                Writes::Corrected { position } => Some((position, output.device)),
                _ => None,
            })
            .collect();
        let reads_position = |device: DeviceId| {
            positions.iter().any(|(position, _)| profile.signal(*position).device == device)
        };
        let mut polls: Vec<Poll> = devices_of(profile, bus)
            .map(|device| Poll {
                device,
                every: profile.device(device).every,
                due: start,
                reads_position: reads_position(device),
                captures: Captures::new(signals_of(profile, device).filter_map(|(_, signal)| signal.capture)),
                requests: plan(profile.device(device), signals_of(profile, device)),
            })
            .filter(|poll| !poll.requests.is_empty())
            .collect();
        // Positions are read last, so that nothing stands between reading and correcting one.
        polls.sort_by_key(|poll| poll.reads_position);
        let writers = (0..profile.outputs.len())
            .map(OutputId)
            .filter(|id| here(profile.output(*id).device) && profile.output(*id).set.is_none())
            .map(Writer::new);
        let writers = writers.collect();
        let sets = (0..profile.sets.len()).map(SetId).filter(|id| here(profile.set(*id).device));
        let sets = sets.map(|id| SetWriter::new(&shared, id)).collect();
        let pulse =
            profile.heartbeat.as_ref().filter(|heartbeat| here(heartbeat.device)).map(|heartbeat| Pulse {
                device: heartbeat.device,
                register: heartbeat.address.offset,
                every: heartbeat.every,
                due: start,
                count: 0,
            });
        let steps_axes = home_lines(profile).contains(&bus);
        let probed = profile.axes.iter().filter_map(|axis| axis.probe_input);
        let mut probed = probed.flat_map(|input| [Some(input.signal), input.trigger]).flatten();
        let feeds_others = positions
            .iter()
            .any(|(position, device)| here(profile.signal(*position).device) && !here(*device))
            || (!steps_axes && probed.any(|signal| here(profile.signal(signal).device)));
        let inspector = Inspector::new(profile, devices_of(profile, bus), start);
        let (passed, has_been_round) = (start, false);
        LineTask {
            bus,
            line,
            can: None,
            inspector,
            polls,
            writers,
            sets,
            pulse,
            steps_axes,
            feeds_others,
            passed,
            has_been_round,
            shared,
        }
    }

    /// Read requests of one round.
    pub(super) fn requests(&self) -> usize {
        self.polls.iter().map(|poll| poll.requests.len()).sum()
    }

    /// Cycles until the gateway has stopped; with an ear, listens as well.
    pub(super) async fn run(mut self, sleeper: Sleeper, ear: Option<(Arc<Can>, Ear)>) {
        match ear {
            None => self.cycles(sleeper).await,
            Some((can, ear)) => {
                self.can = Some(can);
                tokio::join!(ear.listen(), self.cycles(sleeper));
            }
        }
    }

    async fn cycles(mut self, mut sleeper: Sleeper) {
        let mut ended = sleeper.now();
        let mut due = ended;
        loop {
            let began = sleeper.sleep_from(ended, due).await;
            self.cycle(began).await;
            // A line that is always late must not keep the others from their turn.
            tokio::task::coop::consume_budget().await;
            ended = sleeper.now();
            due = self.account(due, began, ended);
        }
    }

    /// One round of what is due at `now`.
    pub(super) async fn cycle(&mut self, now: Moment) {
        for revived in self.can.iter().flat_map(|can| can.revived()) {
            self.line.revive(revived);
        }
        self.write(now).await;
        self.beat(now).await;
        self.inspector.inspect(&mut self.line, &self.shared, self.can.as_deref()).await;
        let mut polled = false;
        self.passed = now;
        // What was written took its time: the line's, or the disk's, where an account is kept first.
        let mut at = self.shared.clock.now();
        let last = self.polls.iter().rposition(|poll| now >= poll.due);
        for place in 0..self.polls.len() {
            if now >= self.polls[place].due {
                at = self.poll(place, now, at, Some(place) == last).await;
                polled = true;
            }
        }
        self.has_been_round = true;
        // Not the beginning of the cycle: readings have aged since, and another line may have stepped.
        let now = at;
        if polled || self.can.is_some() {
            self.shared.look_for_restarts(now);
        }
        if self.steps_axes {
            self.shared.advance(self.bus, now);
        }
        if polled && self.feeds_others {
            self.shared.ring_others(self.bus);
        }
        self.write(now).await;
    }

    /// Everything that is decided and not yet written.
    async fn write(&mut self, begun: Moment) {
        for (place, writer) in self.writers.iter_mut().enumerate() {
            // The one before it may have waited for its device.
            let now = if place == 0 { begun } else { self.shared.clock.now() };
            match writer.position(&self.shared.profile) {
                None => writer.offset(&mut self.line, &self.shared, now).await,
                Some(position) => writer.corrected(&mut self.line, &self.shared, position, now).await,
            }
        }
        for set in &mut self.sets {
            set.advance(&mut self.line, &self.shared, self.shared.clock.now()).await;
        }
    }

    async fn beat(&mut self, now: Moment) {
        let Some(pulse) = self.pulse.as_mut().filter(|pulse| now >= pulse.due) else { return };
        pulse.due = now.next_tick(pulse.due, pulse.every);
        // Where a person arms, nothing at all is written before; from then on it beats as long as the gateway lives.
        let wanted = self.shared.profile.arm == Arm::Auto || self.shared.core().was_armed;
        if self.shared.dry_run || !wanted {
            return;
        }
        pulse.count = pulse.count.wrapping_add(1);
        let (device, at, word) = (pulse.device, pulse.register, [pulse.count]);
        let single = self.shared.profile.device(device).functions.write_single;
        let request = if single {
            Request::WriteSingle { at, word: word[0] }
        } else {
            Request::WriteMultiple { at, words: &word }
        };
        // A failure is counted and told where every request fails; the next beat is the repetition.
        let now = self.shared.clock.now();
        let _ = call(&mut self.line, &self.shared, device, request, now).await;
    }

    /// Counts a cycle, and tells when there is something to do again.
    fn account(&self, due: Moment, began: Moment, ended: Moment) -> Moment {
        let mut core = self.shared.core();
        let step = if self.steps_axes { core.compensation.next_due() } else { None };
        let count = &mut core.buses[self.bus.0];
        count.cycles += 1;
        count.last_cycle = ended;
        count.connected = match &self.can {
            Some(can) => can.link.fault().is_none(),
            None => self.line.is_connected(),
        };
        count_late(count, began.since(due));
        let poll = self.polls.iter().map(|poll| poll.due).min();
        if let Some(late) = poll.map(|poll| ended.since(poll)).filter(|late| !late.is_zero()) {
            count.overruns += 1;
            // Told at the first, the eighth, the sixty-fourth …
            let told = count.overruns.is_power_of_two() && count.overruns.trailing_zeros().is_multiple_of(3);
            drop(core);
            if told {
                let bus = self.shared.profile.bus(self.bus).name.clone();
                self.shared.tell(&Event::Overrun { bus, late });
            }
        }
        // A writer whose refresh is overdue because its device rests must not make the line spin.
        let soon = ended.after(Duration::from_millis(100));
        let refreshes = self.writers.iter().filter_map(|writer| writer.due(&self.shared.profile));
        let refreshes = refreshes.chain(self.sets.iter().filter_map(|set| set.due(&self.shared.profile)));
        let asks = self.sets.iter().filter_map(SetWriter::asks);
        let pulse = self.pulse.iter().map(|pulse| pulse.due);
        let idle = ended.after(Duration::from_secs(1));
        refreshes
            .map(|due| due.max(soon))
            .chain(poll)
            .chain(pulse)
            .chain(step)
            .chain(asks)
            .min()
            .unwrap_or(idle)
    }
}

fn count_late(count: &mut BusCount, late: Duration) {
    let late_ms = late.as_secs_f64() * 1000.0;
    let bucket = JITTER_MS.iter().position(|bound| late_ms <= *bound).unwrap_or(JITTER_MS.len());
    count.jitter[bucket] += 1;
}

/// The lines on which axes are stepped: where the first input of each is read, or its output is written.
fn home_lines(profile: &Profile) -> Vec<BusId> {
    let homes = profile.axes.iter().enumerate().map(|(axis, settings)| {
        let input = settings.settings.models.iter().flat_map(Evaluate::inputs).next();
        let input = input.map(|signal| profile.signal(signal).device);
        let output = profile.outputs.iter().find(|output| output.axis.0 == axis).map(|output| output.device);
        input.or(output).map_or(BusId(0), |device| profile.device(device).bus)
    });
    homes.collect()
}

fn devices_of(profile: &Profile, bus: BusId) -> impl Iterator<Item = DeviceId> {
    (0..profile.devices.len()).map(DeviceId).filter(move |id| profile.device(*id).bus == bus)
}

fn signals_of(
    profile: &Profile,
    device: DeviceId,
) -> impl Iterator<Item = (SignalId, &crate::profile::Signal)> {
    let signals = profile.signals.iter().enumerate().map(|(place, signal)| (SignalId(place), signal));
    signals.filter(move |(_, signal)| signal.device == device)
}
