//! Plan of the requests that read a device: the fewest read requests for its signals. The calculation has no side
//! effects.
//!
//! Registers that are close to each other in one table share a request, even if a few registers in between are not
//! needed. Each request costs a round trip, but each register only two bytes. A device that rejects requests with
//! unused registers needs `max_gap = 0`. If a device returns a wrong value when a register is read together with
//! others, the signal needs `merge = false`.
//!
//! The scale of a value may be in another register. It is read with the value in one request, if the limit and the gap
//! of the device allow that.
//!
//! Other kinds of devices are planned as follows:
//! - Each CANopen object has its own request.
//! - Values in CAN frames arrive without a request.
//! - All nodes of an OPC UA server share one request or subscription.
//! - All sensors of this computer in one device are read at the same time.

use crate::kinds::KINDS;
use crate::{Device, DeviceId, Profile, Signal};
use isotherm_core::reading::SignalId;

mod request;

pub(crate) use request::numbered;
pub use request::{Field, FieldContent, ReadRequest, ReadTarget, Subscription, summary};

/// Plans the fewest requests that read these signals of one device, in the order of register tables and addresses. A
/// request for a scale comes last if the value of the signal is in another request.
///
/// A value in several registers is never split into two requests, even if the device accepts fewer registers in one
/// request.
pub fn plan<'a>(
    device: &Device,
    signals: impl IntoIterator<Item = (SignalId, &'a Signal)>,
) -> Vec<ReadRequest> {
    let signals: Vec<(SignalId, &Signal)> = signals.into_iter().collect();
    let requests = KINDS.iter().flat_map(|kind| (kind.requests)(device, &signals));
    let mut requests: Vec<ReadRequest> = requests.collect();
    // A scale follows a value of another request, so that the value waits for it as briefly as possible.
    requests.sort_by_key(|request| {
        (request.values().next().is_none(), request.has_scale_of_another(), request.rank())
    });
    requests
}

impl Profile {
    /// Returns the read requests of one poll of a device.
    pub fn requests(&self, device: DeviceId) -> Vec<ReadRequest> {
        plan(self.device(device), self.signals_of(device))
    }

    /// Returns the read requests of one poll of a device, without the requests for CANopen objects.
    pub fn register_requests(&self, device: DeviceId) -> Vec<ReadRequest> {
        let is_object = |request: &ReadRequest| matches!(request.asks, ReadTarget::Object(_));
        self.requests(device).into_iter().filter(|request| !is_object(request)).collect()
    }
}

#[cfg(test)]
mod tests;
