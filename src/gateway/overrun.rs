//! More is asked of a line than it can carry: counted, and told once.

use std::time::Duration;

use super::shared::{BusCount, Shared};
use crate::observe::events::Event;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, OutputId};

/// What has been quick enough for so long, and is late again, is told again.
const TOLD_AGAIN: Duration = Duration::from_secs(600);

impl BusCount {
    /// So many more times something was late. Whether that is to be told.
    pub(super) fn overrun(&mut self, count: u64, now: Moment) -> bool {
        if count == 0 {
            return false;
        }
        self.overruns += count;
        let before = self.overrun_at.replace(now);
        before.is_none_or(|before| now.since(before) >= TOLD_AGAIN)
    }
}

impl Shared {
    /// The line of an output came to it so late that what was decided rests on readings which are too old by now.
    pub(super) fn order_lapsed(&self, id: OutputId, not_after: Moment) {
        // Nobody is late where nothing from before is to be used.
        if not_after == Moment::default() {
            return;
        }
        let output = self.profile.output(id);
        let bus = self.profile.device(output.device).bus;
        let now = self.clock.now();
        if self.core().buses[bus.0].overrun(1, now) {
            self.tell_overrun(bus, format!("a change of output {}", output.name), now.since(not_after));
        }
    }

    pub(super) fn tell_overrun(&self, bus: BusId, what: String, late: Duration) {
        let bus = self.profile.bus(bus).name.clone();
        self.tell(&Event::Overrun { bus, what, late });
    }
}
