//! Observer of the requests of a line.

use std::time::Duration;

use super::Attribution;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::Request;
use isotherm_core::continuity::Break;
use isotherm_profile::DeviceId;

/// Receives the result of each request that was not rejected at once.
pub trait RequestObserver: Send + Sync {
    /// A request was answered or failed. `refusals` has the failed attempts to connect in a row, and the last fault.
    fn note(
        &self,
        device: DeviceId,
        request: Request<'_>,
        outcome: Result<(), Fault>,
        refusals: (u32, Fault),
    );

    /// The device has answered with at least a part of the requested data.
    fn delivers(&self, _device: DeviceId) {}

    /// Contact with a device was broken, or with each device on the line (`None`): another device may answer next.
    fn breaks(&self, _device: Option<DeviceId>, _cause: Break) {}

    /// Returns whether the device has passed its checks since contact was last broken.
    fn is_verified(&self, _device: DeviceId) -> bool {
        true
    }

    /// The line sends one request at a time from now on, because of this fault of two requests.
    fn gives_up_pipeline(&self, _fault: Fault) {}

    /// News about the subscription of a device.
    fn subscribes(&self, _device: DeviceId, _what: String) {}

    /// Another master was detected on the line, or a new form of its answers. `attribute` returns, for a unit and a
    /// request, whether the answer could be an answer to the other master.
    fn shares_line(&self, _attribute: &dyn Fn(u8, Request<'_>) -> Attribution) {}

    /// No other master was detected for ten minutes. `frames` frames came before, during `within`.
    fn has_line_alone(&self, _frames: u64, _within: Duration) {}
}
