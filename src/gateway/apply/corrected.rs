//! Corrected positions: D' = D + Cz, as soon as D has been read.

use super::{Order, Writer};
use crate::fieldbus::line::Line;
use crate::gateway::shared::Shared;
use crate::gateway::words::cz_factor;
use crate::profile::Output;
use crate::quantity::{Micron, Moment};
use crate::reading::SignalId;

impl Writer {
    /// Writes position + Cz as soon as a new position has been read.
    pub(in crate::gateway) async fn corrected(
        &mut self,
        line: &mut Line,
        shared: &Shared,
        position: SignalId,
        now: Moment,
    ) {
        let taken = shared.core().board.taken(position);
        if taken == self.applied {
            return;
        }
        let output = shared.profile.output(self.id);
        let order = self.order(shared, now);
        if order.off || shared.dry_run {
            (self.corrected, self.sent) = (None, None);
            self.applied = taken;
            return;
        }
        if line.is_resting(output.device, now) {
            return;
        }
        self.applied = taken;
        let Some(position) = order.position else { return };
        if self.holds_back(shared, output, &order) {
            return;
        }
        let cz = self.share(shared, output, &order);
        let factor = cz_factor(&shared.profile, output);
        let target = self.encode(shared, output, position + cz.get() * factor / 1000.0);
        let is_written = self.write(line, shared, output, target, now).await;
        self.sent = self.uncertain.map(|_| cz);
        if is_written {
            self.corrected = Some((cz, order.decided));
            self.settle_as(shared, cz, output.encoding.decode(target.words()).ok(), now, true);
        }
    }

    /// Cz as it goes into a position: one step nearer to the axis's at each of its decisions. The axis's own may jump,
    /// where it takes over what a restarted CNC holds.
    pub(super) fn share(&self, shared: &Shared, output: &Output, order: &Order) -> Micron {
        if let Some(sent) = self.sent {
            return sent;
        }
        let Some((last, decided)) = self.corrected else { return order.cz };
        let step = shared.profile.axis(output.axis).settings.guard.step;
        if decided == order.decided { last } else { last + (order.cz - last).clamp_to(step) }
    }
}
