//! Corrected positions: D' = D + Cz, as soon as D has been read.

use std::time::Duration;

use super::register::send_cells;
use super::{Order, Writer};
use crate::compensation::AxisState;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::line::DeviceLine;
use crate::gateway::shared::Shared;
use crate::gateway::words::cz_factor;
use crate::profile::{Arm, Output, Shown};
use crate::quantity::{Micron, Moment};
use crate::reading::SignalId;

/// How often dashes are written again.
const DASHES_AGAIN: Duration = Duration::from_secs(10);

impl Writer {
    /// Writes position + Cz as soon as a new position has been read.
    pub(in crate::gateway) async fn corrected(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        position: SignalId,
        now: Moment,
    ) {
        let output = shared.profile.output(self.id);
        let has_dashes = output.display.stale.is_some();
        let (taken, order) = {
            let core = shared.core();
            let taken = core.board.taken(position);
            if taken == self.applied && !has_dashes {
                return;
            }
            (taken, self.order(shared, &core, now))
        };
        if has_dashes && (order.off || order.position.is_none()) {
            self.show_nothing(line, shared, now).await;
        }
        if taken == self.applied {
            return;
        }
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
        let is_written = self.write(line, shared, output, target, (now, order.not_after)).await;
        self.sent = self.uncertain.map(|_| cz);
        if is_written {
            self.dashes_at = None;
            self.corrected = Some((cz, order.decided));
            self.settle_as(shared, cz, output.encoding.decode(target.words()).ok(), now, true);
        }
    }

    /// Dashes instead of a number that nobody corrects any more: when that begins, and again after each pause, because a
    /// display that was switched off and on shows something else.
    async fn show_nothing(&mut self, line: &mut DeviceLine, shared: &Shared, now: Moment) {
        let output = shared.profile.output(self.id);
        let Some(stale) = &output.display.stale else { return };
        let is_fresh = self.dashes_at.is_some_and(|at| now < at.after(DASHES_AGAIN));
        if is_fresh || shared.dry_run || !self.has_shown(shared) || line.is_resting(output.device, now) {
            return;
        }
        let text = (stale.register..).zip(stale.words.iter().copied());
        let beside = output.display.beside.iter().map(|beside| (beside.register, beside.word(Shown::Fault)));
        // What fails is told where every request fails, and tried again.
        if send_cells(line, shared, output, beside.collect(), Leave::Whenever).await.is_ok()
            && send_cells(line, shared, output, text.collect(), Leave::Whenever).await.is_ok()
        {
            (self.dashes_at, self.corrected, self.sent) = (Some(now), None, None);
        }
    }

    /// Whether the display is ours by now: where a person arms, nothing is written before that.
    fn has_shown(&self, shared: &Shared) -> bool {
        shared.profile.arm == Arm::Auto || shared.core().was_armed
    }

    /// How the axis does, for a display.
    pub(super) fn shown(&self, shared: &Shared, output: &Output) -> Shown {
        let state = shared.core().compensation.decision(output.axis.0).map(|decision| decision.state);
        match state {
            Some(AxisState::Active) => Shown::Good,
            Some(AxisState::Degraded) => Shown::Degraded,
            _ => Shown::Fault,
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
