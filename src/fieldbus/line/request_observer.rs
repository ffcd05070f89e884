//! Observer of the requests of a line. It receives their results, and news about the devices and the line.

use std::time::Duration;

use super::Attribution;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::Request;
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// Receives the result of each request that was sent or failed on the line, and news about the devices and the line.
pub trait RequestObserver: Send + Sync {
    /// Reports that a request was answered or failed. `refusals`: number of failed attempts to connect since the last
    /// success, and the fault of the last attempt.
    fn note(
        &self,
        device: DeviceId,
        request: Request<'_>,
        outcome: Result<(), Fault>,
        refusals: (u32, Fault),
    );

    /// Reports that the device has answered a request with at least a part of the requested data. `_at`: time of the
    /// answer. The default implementation only calls [`RequestObserver::note`].
    fn note_delivery(&self, device: DeviceId, request: Request<'_>, refusals: (u32, Fault), _at: Moment) {
        self.note(device, request, Ok(()), refusals);
    }

    /// Reports that contact with a device was lost, so that another device may answer the next request. `None`: contact
    /// with every device on the line was lost.
    fn breaks(&self, _device: Option<DeviceId>, _cause: Break) {}

    /// Returns whether the device has passed its checks (comparisons with expected values) since the last loss of
    /// contact.
    fn is_verified(&self, _device: DeviceId) -> bool {
        true
    }

    /// Reports that the line sends one request at a time from now on, because this fault occurred while two requests
    /// were open.
    fn gives_up_pipeline(&self, _fault: Fault) {}

    /// Reports how long the Modbus gateway on the line waits for a silent unit. This time is longer than the timeout of
    /// the line.
    fn waits_for_gateway(&self, _own_timeout: Duration) {}

    /// Reports news about the OPC UA subscription of a device, as a sentence.
    fn subscribes(&self, _device: DeviceId, _what: String) {}

    /// Reports that another master was detected on the line, or that answers with a new function or length were sent to
    /// this master. `attribute` returns, for a unit and a request, whether the answer may be an answer to that master.
    fn shares_line(&self, _attribute: &dyn Fn(u8, Request<'_>) -> Attribution) {}

    /// Reports that no frame of another master has arrived for ten minutes. Before that, the line received `frames`
    /// such frames during the time `within`.
    fn has_line_alone(&self, _frames: u64, _within: Duration) {}
}
