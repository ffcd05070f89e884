//! Plan of the requests that read a device: from its signals to the fewest read requests. Pure.
//!
//! Each kind of bus plans the requests for its own signals.

use crate::kinds::KINDS;
use crate::{Device, Signal};
use isotherm_core::reading::SignalId;

mod request;

pub(crate) use request::numbered;
pub use request::{Field, ReadRequest, ReadTarget, Subscription, summary};

/// Plans the fewest requests that read these signals of one device, in the order of tables and addresses.
///
/// A value of several registers is never split, even if it is longer than the device's limit.
pub fn plan<'a>(
    device: &Device,
    signals: impl IntoIterator<Item = (SignalId, &'a Signal)>,
) -> Vec<ReadRequest> {
    let signals: Vec<(SignalId, &Signal)> = signals.into_iter().collect();
    let requests = KINDS.iter().flat_map(|kind| (kind.requests)(device, &signals));
    let mut requests: Vec<ReadRequest> = requests.collect();
    requests.sort_by_key(ReadRequest::rank);
    requests
}

#[cfg(test)]
mod tests;
