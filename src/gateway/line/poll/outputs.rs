//! Outputs of one bus line, and the times at which they are due. A turn of an output is the work of the line task on
//! it.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::gateway::output::{LineTurn, Position, Set, Single};
use crate::gateway::shared::line_handle::LineHandle;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId, OutputId, SetId};

/// Minimum time between two turns of an output (work of the line task on it). Without this time, an output of a
/// device that backs off would keep the line busy.
const SOON: Duration = Duration::from_millis(100);

/// Work of a line task on one output, or on an output set (outputs that are written together).
pub(super) struct OutputTask {
    /// Time of the next turn of the output (work of the line task on it). If the time is in the past, the output has
    /// waited since then.
    pub(super) due: Moment,
    /// Time at which the output was due, if the line task came too late to send the last decision; otherwise `None`.
    /// The next decision then has priority, because the output counts as due since this time.
    waits_since: Option<Moment>,
    work: Work,
    /// Device from which the gateway reads the position that the output corrects. `None` for another kind of output.
    /// An output that corrects a position has priority over reads, checks and other outputs.
    pub(super) corrects: Option<DeviceId>,
}

enum Work {
    Single(Box<Single>),
    Position(Box<Position>),
    Set(Box<Set>),
}

pub(super) fn jobs(shared: &LineHandle, bus: BusId, start: Moment) -> Vec<OutputTask> {
    let profile = &shared.profile;
    let here = || shared.dependents.outputs_on.of(bus.0).map(OutputId);
    let ones = here().filter(|id| profile.output(*id).set.is_none()).map(|id| {
        let position = profile.output(id).writes.position();
        let work = match position {
            Some(position) => Work::Position(Box::new(Position::new(shared, id, position))),
            None => Work::Single(Box::new(Single::new(shared, id, start))),
        };
        let corrects = position.map(|position| profile.signal(position).device);
        OutputTask { due: start, waits_since: None, work, corrects }
    });
    // All outputs of a set are on one device.
    let sets: BTreeSet<SetId> = here().filter_map(|id| profile.output(id).set).collect();
    let sets = sets.into_iter().map(|id| {
        let set = Box::new(Set::new(shared, id, start));
        OutputTask { due: start, waits_since: None, work: Work::Set(set), corrects: None }
    });
    ones.chain(sets).collect()
}

impl OutputTask {
    /// Makes the output due now, because the gateway may have to write or check its register.
    pub(super) fn wake(&mut self, now: Moment) {
        self.due = self.due.min(self.waits_since.unwrap_or(now));
    }

    /// Executes one turn of the output (work of the line task on it): at most one verified write.
    pub(super) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let (wants, asks, is_late) = match &mut self.work {
            Work::Single(single) => {
                single.turn(turn).await;
                (Some(single.due), None, single.is_late())
            }
            Work::Position(position) => {
                position.turn(turn).await;
                (None, None, false)
            }
            Work::Set(set) => {
                set.turn(turn).await;
                (Some(set.due), set.next_read(), set.is_late())
            }
        };
        self.waits_since = is_late.then(|| self.waits_since.unwrap_or(self.due));
        let soon = turn.line.last_sample().after(SOON);
        let due = wants.map(|due| due.max(soon)).into_iter().chain(asks).min();
        self.due = due.unwrap_or(Moment::END);
    }
}
