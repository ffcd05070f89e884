//! Observer of the requests of a line.

use std::time::Duration;

use super::Attribution;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::Request;
use isotherm_core::continuity::Break;
use isotherm_profile::DeviceId;

/// Hears what became of each request that was not refused at once.
pub trait Witness: Send + Sync {
    /// It was answered, or failed; the attempts to connect that have failed in a row, and why the last did.
    fn note(
        &self,
        device: DeviceId,
        request: Request<'_>,
        outcome: Result<(), Fault>,
        refusals: (u32, Fault),
    );

    /// The device has answered with what was asked for, and not with a refusal of all of it.
    fn delivers(&self, _device: DeviceId) {}

    /// Contact with a device, or with each on the line (`None`), was broken: another one may answer next.
    fn breaks(&self, _device: Option<DeviceId>, _cause: Break) {}

    /// Returns whether the device has passed its checks since contact was last broken.
    fn is_verified(&self, _device: DeviceId) -> bool {
        true
    }

    /// Questions go out one at a time from now on, because this came of two.
    fn gives_up_pipeline(&self, _fault: Fault) {}

    /// This is to be said of a device's subscription.
    fn subscribes(&self, _device: DeviceId, _what: String) {}

    /// Another master was received on the line, or a new form of its answers. `attribute` says of a unit and a request whether
    /// the answer could be that to a question of the other master.
    fn shares_line(&self, _attribute: &dyn Fn(u8, Request<'_>) -> Attribution) {}

    /// No other master was received for ten minutes: so many frames came before, in that time.
    fn has_line_alone(&self, _frames: u64, _within: Duration) {}
}
