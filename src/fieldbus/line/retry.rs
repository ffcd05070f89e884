//! Repetition of a request: at once on a new connection, or later after a timeout.

use super::DeviceLine;
use crate::fieldbus::error::Fault;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

impl DeviceLine {
    /// Returns the earliest time to repeat a request that this device did not answer. Returns `None` on a line with
    /// transaction numbers. On an RTU line, one lost answer does not yet show a fault of the device.
    pub fn again_at(&self, device: DeviceId) -> Option<Moment> {
        let unit = self.units.get(device).filter(|_| self.is_nameless)?;
        let pending = self.units.pending.get(unit.number).and_then(|pending| pending.again_at(self.spans()));
        let rests = unit.breaker.not_before().max(self.redial.not_before());
        Some(pending.max(rests).unwrap_or_default().max(self.last_sample()))
    }

    /// Returns whether the line repeats a request at once on a new connection. Some Modbus gateways close an
    /// idle connection, and this must not cause failed readings. `answer` is the result with which the old
    /// connection was lost. `has_ids`: answers on the line have a transaction number. A write that may have
    /// been sent is not repeated. A write that depends on a value read on the lost connection is not repeated
    /// either.
    pub(super) fn is_repeated(
        request: Request<'_>,
        leave: SendDeadline,
        answer: &Result<Answer, Fault>,
        has_ids: bool,
    ) -> bool {
        let is_free = !matches!(leave, SendDeadline::OnConnection(_));
        request.is_read() && has_ids || *answer == Err(Fault::CLOSED) && is_free
    }
}
