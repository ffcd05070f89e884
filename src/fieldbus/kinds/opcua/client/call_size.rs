//! Maximum number of nodes in one call, as learned from refusals of the server.
//!
//! A server may accept fewer nodes in one call than it states, or state no limit. It then refuses the whole
//! call, because the call has too many nodes, or because the request or its answer is too long. The gateway
//! halves the number of nodes in the call. It uses the smaller size for all later calls, also on later
//! connections.

use std::sync::{Arc, Mutex, PoisonError};

use ::opcua::types::{Error, StatusCode};

/// Service of OPC UA whose calls contain several nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Service {
    /// Read of values or attributes.
    Read,
    /// Creation of the monitored items (nodes) of a subscription.
    Monitor,
    /// Messages of a subscription. The size is the number of notifications (new values) in one message.
    Publish,
}

/// Refusal of a call because the call is too large for the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SizeRefusal {
    /// The server has refused the call with this status, or the library has refused to send the call. The connection
    /// can still be used.
    Answered(StatusCode),
    /// The server has closed the connection instead of answering the call.
    Closed,
}

/// Returns the kind of refusal, if the call was refused because of its size; `None` if the error has another cause.
pub(super) fn size_refusal(error: &Error) -> Option<SizeRefusal> {
    match error.status() {
        status @ (StatusCode::BadTooManyOperations
        | StatusCode::BadRequestTooLarge
        | StatusCode::BadResponseTooLarge
        | StatusCode::BadEncodingLimitsExceeded) => Some(SizeRefusal::Answered(status)),
        // The library reports a request with more chunks than the server accepts as a communication error. Only an
        // error of an encoder has a context. The request was not sent.
        StatusCode::BadCommunicationError if error.full_context().is_some() => {
            Some(SizeRefusal::Answered(StatusCode::BadRequestTooLarge))
        }
        StatusCode::BadTcpMessageTooLarge => Some(SizeRefusal::Closed),
        _ => None,
    }
}

/// Maximum number of nodes in one call of each service, learned from refusals of the server. Clones share their
/// content.
#[derive(Clone, Debug, Default)]
pub(super) struct CallSizes(Arc<Mutex<Learnt>>);

#[derive(Clone, Copy, Debug, Default)]
struct Learnt {
    read: Option<usize>,
    monitor: Option<usize>,
    publish: Option<usize>,
}

impl Learnt {
    const fn of(&mut self, service: Service) -> &mut Option<usize> {
        match service {
            Service::Read => &mut self.read,
            Service::Monitor => &mut self.monitor,
            Service::Publish => &mut self.publish,
        }
    }
}

impl CallSizes {
    /// Returns the maximum number of nodes in one call; `None` if the server has not refused any call because of its
    /// size.
    pub(super) fn most(&self, service: Service) -> Option<usize> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner).of(service)
    }

    /// Returns the number of nodes for the next call: `count`, or less if the server has refused larger calls.
    pub(super) fn next(&self, service: Service, count: usize) -> usize {
        self.most(service).map_or(count, |most| most.min(count))
    }

    /// Records that a call with `count` nodes was refused because of its size. Returns false if the call had only one
    /// node, so that it cannot be smaller.
    pub(super) fn halve(&self, service: Service, count: usize) -> bool {
        if count < 2 {
            return false;
        }
        let half = count.div_ceil(2);
        let mut learnt = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let most = learnt.of(service);
        *most = Some(most.map_or(half, |most| most.min(half)));
        true
    }

    /// Forgets the learned call size of this service, because the refusals had another cause.
    pub(super) fn forget(&self, service: Service) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner).of(service) = None;
    }
}

#[cfg(test)]
mod tests {
    use super::super::session::Session;
    use super::*;
    use crate::fieldbus::error::Fault;
    use isotherm_core::reading::Status;
    use std::time::Duration;

    /// Returns the sizes of the calls that read `count` nodes from a server that accepts at most `limit` in one call.
    fn calls(sizes: &CallSizes, count: usize, limit: usize) -> Vec<usize> {
        let (mut made, mut left) = (Vec::new(), count);
        while left > 0 {
            let size = sizes.next(Service::Read, left);
            made.push(size);
            match size > limit {
                true => assert!(sizes.halve(Service::Read, size)),
                false => left -= size,
            }
        }
        made
    }

    #[test]
    fn a_refused_call_is_halved_until_the_server_accepts_it_and_the_size_is_kept() {
        let sizes = CallSizes::default();
        assert_eq!(calls(&sizes, 13, 5), [13, 7, 4, 4, 4, 1]);
        assert_eq!(calls(&sizes.clone(), 13, 5), [4, 4, 4, 1], "the size is shared and kept");
        assert_eq!(sizes.most(Service::Monitor), None, "other services have their own size");
        for (count, limit, refused) in [(300, 150, 1), (300, 1, 9), (1, 1, 0), (2, 1, 1), (500, 499, 1)] {
            let sizes = CallSizes::default();
            let made = calls(&sizes, count, limit);
            assert_eq!(made.iter().filter(|size| **size > limit).count(), refused, "{count} {limit}");
            let again = calls(&sizes, count, limit);
            assert!(again.iter().all(|size| *size <= limit) && again.iter().sum::<usize>() == count);
        }
    }

    #[test]
    fn a_call_with_one_node_cannot_be_smaller_and_a_size_never_grows() {
        let sizes = CallSizes::default();
        assert!(!sizes.halve(Service::Publish, 1) && !sizes.halve(Service::Publish, 0));
        assert_eq!(sizes.most(Service::Publish), None);
        assert!(sizes.halve(Service::Publish, 10) && sizes.halve(Service::Publish, 100));
        assert_eq!(sizes.most(Service::Publish), Some(5));
    }

    /// A server that is overloaded for a time may refuse each call as too large.
    #[test]
    fn one_node_that_is_too_many_operations_has_another_cause_and_the_size_is_forgotten() {
        let sizes = CallSizes::default();
        let session = Session::none("urn:test".to_owned(), Duration::from_secs(1), sizes.clone());
        let refused = |count, status| session.smaller(count, &Error::new(status, "said"));
        assert_eq!(refused(2, StatusCode::BadTooManyOperations), Ok(None));
        assert_eq!(sizes.most(Service::Read), Some(1));
        assert!(matches!(refused(1, StatusCode::BadResponseTooLarge), Ok(Some(_))));
        assert_eq!(sizes.most(Service::Read), Some(1), "only this node is too large");
        let fault = Fault::Status(Status::TOO_MANY_OPERATIONS);
        assert_eq!(refused(1, StatusCode::BadTooManyOperations), Err(fault));
        assert_eq!(sizes.most(Service::Read), None);
    }

    #[test]
    fn a_refusal_because_of_the_size_is_distinguished_from_other_errors() {
        let error = |status| Error::new(status, "said");
        let sent = |status| error(status).with_context(Some(7), None);
        let unsent = |status| error(status).with_context(Some(7), Some(9));
        let answered = |status| Some(SizeRefusal::Answered(status));
        let cases = [
            (error(StatusCode::BadTooManyOperations), answered(StatusCode::BadTooManyOperations)),
            (error(StatusCode::BadResponseTooLarge), answered(StatusCode::BadResponseTooLarge)),
            (error(StatusCode::BadEncodingLimitsExceeded), answered(StatusCode::BadEncodingLimitsExceeded)),
            (unsent(StatusCode::BadRequestTooLarge), answered(StatusCode::BadRequestTooLarge)),
            (unsent(StatusCode::BadCommunicationError), answered(StatusCode::BadRequestTooLarge)),
            (sent(StatusCode::BadCommunicationError), None),
            (error(StatusCode::BadCommunicationError), None),
            (error(StatusCode::BadTcpMessageTooLarge), Some(SizeRefusal::Closed)),
            (error(StatusCode::BadNodeIdUnknown), None),
            (error(StatusCode::BadTimeout), None),
        ];
        for (error, expected) in cases {
            assert_eq!(size_refusal(&error), expected, "{error}");
        }
    }
}
