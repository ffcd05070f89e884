//! Values that a server sends by subscription, and their age.
//!
//! ```text
//! poll ─► messages since the last poll ─► another Publish request ─► latest values
//! ```
//!
//! - A message answers a Publish request. The values were valid after the gateway had sent this request, so
//!   their age counts from the time of sending. If the server has nothing more to send, a value that is
//!   missing in the message has not changed.
//! - If the age counts from the source time stamps, the server also sends a value if only its time stamp is
//!   new. Otherwise the server sends only changed values, and an unchanged value was last sampled up to one
//!   sampling period ago. The gateway adds this period to the age.
//! - After a missing message, or if the server ends the subscription, its values are discarded. The line then reads the
//!   nodes, and subscribes to them again.

use std::time::Duration;

use ::opcua::client::UARequest;
use ::opcua::client::services::{CreateSubscription, DeleteSubscriptions};
use ::opcua::core::ResponseMessage;
use ::opcua::types::{
    CreateMonitoredItemsRequest, CreateSubscriptionResponse, DataChangeFilter, DataChangeNotification,
    DataChangeTrigger, DataValue, DateTime, Error, ExtensionObject, MonitoredItemCreateRequest,
    MonitoredItemCreateResult, MonitoringMode, MonitoringParameters, NodeId, PublishResponse,
    StatusChangeNotification, StatusCode, TimestampsToReturn,
};
use isotherm_core::quantity::Moment;
use isotherm_profile::plan::Subscription;

use super::call_size::{Service, SizeRefusal, size_refusal};
use super::channel::Link;
use super::session::{Session, header, refused, value_of};
use super::value::{reading, since, without_value};
use crate::fieldbus::kinds::opcua::namespaces::NamespaceTable;
use crate::fieldbus::wire::{NodeReading, Stamped};

/// Maximum number of nodes in one subscribe call. Most servers accept a request of this size.
const AT_ONCE: usize = 100;
/// Time without a Publish request after which a server deletes a subscription.
const LIFETIME: Duration = Duration::from_secs(60);
/// Minimum lifetime of a subscription in publishing intervals, if [`LIFETIME`] is shorter.
const LEAST: u32 = 30;
/// Pause before the line subscribes again, if the server did not have some of the nodes. The server may have them after
/// the pause.
const AGAIN: Duration = Duration::from_secs(60);

/// Subscription that exists at the server, with the latest values of its nodes.
pub(super) struct Subscribed {
    pub(super) id: u32,
    /// Last value of each node; `None` before its first value. A node that the server does not have gets its status
    /// here.
    values: Vec<Option<DataValue>>,
    /// Expected number of the next message with values; `None` before the first message.
    next: Option<u32>,
    /// Last message after which the server had nothing more to send, so that all values were current; `None` before
    /// such a message.
    confirmed: Option<Confirmed>,
    /// Time at which the last message arrived. `made` is the time at which the subscription was created.
    heard: Moment,
    made: Moment,
    /// Whether some of the nodes do not exist at the server.
    pub(super) lacks: bool,
    /// Namespace table of the server, and its number of changes at the time when the subscription was created.
    namespaces: (NamespaceTable, u64),
    /// Longest time that the server has promised between two messages, plus an allowance for the transmission.
    pub(super) patience: Duration,
    /// Sampling period of the server: greatest age of a value that the server reports as unchanged.
    sampling: Duration,
    /// Numbers of the received messages that the gateway has not acknowledged yet.
    received: Vec<u32>,
}

/// Message after which the values of all nodes are current.
#[derive(Clone, Copy)]
struct Confirmed {
    /// Time at which the gateway sent the Publish request that this message answers.
    asked: Moment,
    /// Time at which the server sent the message, by the server's clock. `lay` is the time for which the message waited
    /// at the server before it was sent.
    sent: DateTime,
    lay: Duration,
}

/// State of the values of a subscription after a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ValueState {
    /// The server has nothing more to send: all values are current.
    All,
    /// The server has more values to send at once.
    More,
    /// A message is missing, or the server has ended the subscription with this status.
    Lost(Option<StatusCode>),
}

/// Periods that the server grants, which may differ from the requested ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Revised {
    /// Publishing interval: period at which the server sends messages.
    interval: Duration,
    /// Longest time after which the server sends a message although no value has changed.
    pub(super) alive: Duration,
    /// Longest sampling period among the nodes.
    sampling: Duration,
}

impl Revised {
    fn of(answer: &CreateSubscriptionResponse) -> Revised {
        let interval = milliseconds(answer.revised_publishing_interval);
        let alive = interval.saturating_mul(answer.revised_max_keep_alive_count.max(1));
        Revised { interval, alive, sampling: Duration::ZERO }
    }

    /// Returns a sentence for the user if the server sends or samples more slowly than requested; otherwise `None`.
    pub(super) fn news(&self, asked: &Subscription) -> Option<String> {
        let is_slower = |span: Duration| span > asked.every + asked.every / 10;
        if is_slower(self.interval) {
            return Some(format!("the server sends every {:?}, not every {:?}", self.interval, asked.every));
        }
        is_slower(self.sampling).then(|| {
            format!("the server samples the nodes every {:?}, not every {:?}", self.sampling, asked.every)
        })
    }

    /// Returns the greatest age that a value can reach in normal operation. This age is the sum of the
    /// sampling period, the longest wait for the next message, and two polling periods.
    pub(super) fn oldest(&self, asked: &Subscription) -> Duration {
        let sent = if asked.by_stamp { self.interval } else { self.alive };
        self.sampling + sent + asked.every * 2
    }
}

fn milliseconds(span: f64) -> Duration {
    Duration::try_from_secs_f64(span / 1000.0).unwrap_or(Duration::ZERO)
}

/// Reason why there is no subscription.
pub(super) enum NotSubscribed {
    /// A call was too large. Another subscription can be created with smaller calls.
    TooLarge,
    /// The server does not answer, or refuses the subscription.
    Failed(Error),
}

impl From<Error> for NotSubscribed {
    fn from(error: Error) -> NotSubscribed {
        NotSubscribed::Failed(error)
    }
}

/// Creates a subscription to these nodes. Returns it with the periods that the server grants.
///
/// # Errors
/// The reason why there is no subscription. The server may have created a part of it.
pub(super) async fn subscribe(
    link: &mut Link,
    session: &Session,
    asked: &Subscription,
    (most, now): (usize, Moment),
) -> Result<(Subscribed, Revised), NotSubscribed> {
    let channel = link.channel.clone();
    let lifetime = LIFETIME.as_millis() / asked.every.as_millis().max(1);
    let lifetime = u32::try_from(lifetime).unwrap_or(u32::MAX).max(LEAST);
    let create =
        CreateSubscription::new_manual(0, session.patience(), session.token(), channel.request_handle())
            .publishing_interval(asked.every)
            .max_keep_alive_count(1)
            .max_lifetime_count(lifetime)
            // Zero is no limit.
            .max_notifications_per_publish(session.sizes().most(Service::Publish).map_or(0, number))
            .publishing_enabled(true);
    let made = link.ask(create.send(&channel)).await?;
    session.subscribes(made.subscription_id);
    let mut revised = Revised::of(&made);
    let namespaces = session.namespaces();
    let mut values = Vec::with_capacity(asked.nodes.len());
    let mut known = Vec::with_capacity(asked.nodes.len());
    for (place, node) in asked.nodes.iter().enumerate() {
        let id = namespaces.node_id(&node.id).ok().flatten();
        values.push(id.is_none().then(|| without_value(StatusCode::BadNodeIdUnknown)));
        known.extend(id.map(|id| (place, id)));
    }
    // Counted after the lookups, because the first lookup of an index is a change.
    let changes = namespaces.table().changes();
    let at_once = session.sizes().next(Service::Monitor, most.clamp(1, AT_ONCE));
    for some in known.chunks(at_once) {
        let monitored = monitor(link, session, made.subscription_id, some, asked).await;
        let results = match monitored {
            Ok(results) => results,
            Err(error) => {
                let is_too_large = matches!(size_refusal(&error), Some(SizeRefusal::Answered(_)));
                let is_smaller =
                    size_refusal(&error).is_some() && session.sizes().halve(Service::Monitor, some.len());
                // The server may have created the items, although its answer was too large.
                return Err(match is_too_large && is_smaller {
                    true => NotSubscribed::TooLarge,
                    false => NotSubscribed::Failed(error),
                });
            }
        };
        for ((place, _), made) in some.iter().zip(results) {
            if is_of_the_subscription(made.status_code) {
                return Err(Error::new(made.status_code, "refused").into());
            }
            let is_taken = made.status_code.is_good();
            if is_taken {
                revised.sampling = revised.sampling.max(milliseconds(made.revised_sampling_interval));
            }
            values[*place] = (!is_taken).then(|| without_value(made.status_code));
        }
    }
    let subscribed = Subscribed {
        id: made.subscription_id,
        lacks: values.iter().any(Option::is_some),
        namespaces: (namespaces.table(), changes),
        values,
        next: None,
        confirmed: None,
        heard: now,
        made: now,
        patience: revised.alive + asked.every + session.patience(),
        sampling: revised.sampling,
        received: Vec::new(),
    };
    Ok((subscribed, revised))
}

/// Adds nodes to a subscription. Returns the result for each node.
async fn monitor(
    link: &mut Link,
    session: &Session,
    subscription_id: u32,
    nodes: &[(usize, NodeId)],
    asked: &Subscription,
) -> Result<Vec<MonitoredItemCreateResult>, Error> {
    let channel = link.channel.clone();
    let items = nodes.iter().map(|(place, id)| item(id.clone(), *place, asked));
    let request = CreateMonitoredItemsRequest {
        request_header: header(&session.token(), channel.request_handle(), session.patience()),
        subscription_id,
        timestamps_to_return: TimestampsToReturn::Source,
        items_to_create: items.collect(),
    };
    let results = match link.ask(channel.send(request, session.patience())).await? {
        ResponseMessage::CreateMonitoredItems(made) if made.response_header.service_result.is_good() => {
            made.results.unwrap_or_default()
        }
        ResponseMessage::CreateMonitoredItems(made) => {
            return Err(Error::new(made.response_header.service_result, "refused"));
        }
        other => return Err(refused(&other)),
    };
    match results.len() == nodes.len() {
        true => Ok(results),
        false => Err(Error::new(
            StatusCode::BadUnknownResponse,
            "the answer of the server has another number of nodes than the request",
        )),
    }
}

/// Converts a count to the 32-bit number that OPC UA transmits. A larger count becomes the largest number.
fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Returns whether the server refuses the subscription as a whole. Other refusals concern only one node.
fn is_of_the_subscription(status: StatusCode) -> bool {
    matches!(
        status,
        StatusCode::BadTooManyMonitoredItems
            | StatusCode::BadMonitoredItemFilterInvalid
            | StatusCode::BadMonitoredItemFilterUnsupported
            | StatusCode::BadFilterNotAllowed
            | StatusCode::BadSubscriptionIdInvalid
    )
}

/// Returns the request to monitor one node. The server keeps only the newest value in its queue. `place` is
/// the index of the node, by which the messages of the server identify the node. Returns `None` if the index
/// does not fit into 32 bits.
fn item(node: NodeId, place: usize, asked: &Subscription) -> Option<MonitoredItemCreateRequest> {
    let trigger =
        if asked.by_stamp { DataChangeTrigger::StatusValueTimestamp } else { DataChangeTrigger::StatusValue };
    let filter = DataChangeFilter { trigger, deadband_type: 0, deadband_value: 0.0 };
    Some(MonitoredItemCreateRequest {
        item_to_monitor: value_of(node),
        monitoring_mode: MonitoringMode::Reporting,
        requested_parameters: MonitoringParameters {
            client_handle: u32::try_from(place).ok()?,
            sampling_interval: asked.every.as_secs_f64() * 1000.0,
            filter: ExtensionObject::from_message(filter),
            queue_size: 1,
            discard_oldest: true,
        },
    })
}

/// Deletes subscriptions at the server that are no longer used, for example the subscriptions of an earlier connection.
///
/// # Errors
/// The server does not answer.
pub(super) async fn unsubscribe(link: &mut Link, session: &Session, ids: Vec<u32>) -> Result<(), Error> {
    let channel = link.channel.clone();
    let delete =
        DeleteSubscriptions::new_manual(0, session.patience(), session.token(), channel.request_handle())
            .subscription_ids(ids);
    link.ask(delete.send(&channel)).await.map(|_| ())
}

impl Subscribed {
    /// Processes a message of the server. `asked` is the time at which the gateway sent the Publish request that the
    /// message answers.
    pub(super) fn receive(&mut self, answer: PublishResponse, asked: Moment, now: Moment) -> ValueState {
        let message = answer.notification_message;
        let parts = message.notification_data.unwrap_or_default();
        if self.next.is_some_and(|next| next != message.sequence_number) {
            return ValueState::Lost(None);
        }
        self.heard = now;
        self.next = Some(message.sequence_number);
        if !parts.is_empty() {
            self.received.push(message.sequence_number);
            // The numbers restart at one.
            self.next = Some(message.sequence_number.checked_add(1).unwrap_or(1));
        }
        for part in parts {
            if let Some(ended) = part.inner_as::<StatusChangeNotification>() {
                return ValueState::Lost(Some(ended.status));
            }
            let Some(changed) = part.into_inner_as::<DataChangeNotification>() else { continue };
            for item in changed.monitored_items.unwrap_or_default() {
                let place = usize::try_from(item.client_handle).ok();
                if let Some(value) = place.and_then(|place| self.values.get_mut(place)) {
                    *value = Some(item.value);
                }
            }
        }
        if answer.more_notifications {
            return ValueState::More;
        }
        let (sent, made) = (answer.response_header.timestamp, message.publish_time);
        let sent = if sent.is_null() { made } else { sent };
        let lay = match since(made.ticks(), sent.ticks()) {
            Stamped::Ago(lay) if !made.is_null() => lay,
            _ => Duration::ZERO,
        };
        self.confirmed = Some(Confirmed { asked, sent, lay });
        ValueState::All
    }

    /// Returns the number of nodes in the subscription.
    pub(super) fn count(&self) -> usize {
        self.values.len()
    }

    /// Returns the numbers of the messages that arrived since the last call. The next Publish request acknowledges
    /// these messages.
    pub(super) fn received(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.received)
    }

    /// Returns whether the server has sent nothing for a longer time than it promised.
    pub(super) fn is_silent(&self, now: Moment) -> bool {
        now.since(self.heard) > self.patience
    }

    /// Returns whether the line must subscribe again, because a missing node may exist now or a namespace has another
    /// index.
    pub(super) fn must_be_recreated(&self, now: Moment) -> bool {
        let (table, changes) = &self.namespaces;
        table.changes() != *changes || self.lacks && now.since(self.made) >= AGAIN
    }

    /// Returns the latest reading of each node; `None` until all values are known.
    pub(super) fn readings(&self, asked: &Subscription) -> Option<Vec<NodeReading>> {
        let Confirmed { asked: left, sent, lay } = self.confirmed?;
        let of_a_node = |(node, value): (&_, &Option<DataValue>)| {
            let found = reading(node, value.as_ref()?, sent);
            // Without a time stamp, a value may be as old as the last sampling.
            let is_stamped = asked.by_stamp && found.stamped != Stamped::Unknown;
            let left = if is_stamped { left } else { left.before(lay + self.sampling) };
            Some(NodeReading { asked: Some(left), ..found })
        };
        asked.nodes.iter().zip(&self.values).map(of_a_node).collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ::opcua::types::{MonitoredItemNotification, NotificationMessage, Variant};
    use isotherm_core::codec::Node;
    use isotherm_core::reading::Reason;

    const SECOND: Duration = Duration::from_secs(1);

    pub(in super::super) fn asked(by_stamp: bool) -> Subscription {
        let node = |name: &str| Node::new(format!("ns=2;s={name}").parse().unwrap(), None);
        Subscription {
            nodes: vec![node("bed"), node("scale")],
            every: SECOND,
            max_age: SECOND * 10,
            by_stamp,
        }
    }

    fn at(seconds: u64) -> Moment {
        Moment::default().after(SECOND * u32::try_from(seconds).unwrap())
    }

    /// Returns a time of the server's clock, which differs from the gateway's by a year.
    fn by_server(seconds: u64) -> DateTime {
        DateTime::from(ticks(seconds))
    }

    fn ticks(seconds: u64) -> i64 {
        i64::try_from(365 * 86_400 + seconds).unwrap() * 10_000_000
    }

    pub(in super::super) fn subscribed() -> Subscribed {
        Subscribed {
            id: 1,
            values: vec![None, None],
            next: None,
            confirmed: None,
            heard: at(0),
            made: at(0),
            lacks: false,
            namespaces: (NamespaceTable::default(), 0),
            patience: SECOND * 3,
            sampling: SECOND,
            received: Vec::new(),
        }
    }

    /// Message that the server sends at this second of its clock.
    fn message(number: u32, seconds: u64, values: &[(u32, f64)]) -> PublishResponse {
        let items = values.iter().map(|(client_handle, value)| MonitoredItemNotification {
            client_handle: *client_handle,
            value: DataValue {
                value: Some(Variant::Double(*value)),
                source_timestamp: Some(by_server(seconds)),
                ..DataValue::null()
            },
        });
        let items: Vec<_> = items.collect();
        let time = by_server(seconds);
        let mut answer = PublishResponse {
            notification_message: if items.is_empty() {
                NotificationMessage::keep_alive(number, time)
            } else {
                NotificationMessage::data_change(number, time, items, Vec::new())
            },
            ..PublishResponse::default()
        };
        answer.response_header.timestamp = time;
        answer
    }

    #[test]
    fn a_value_is_as_old_as_the_request_that_brought_it_and_a_sign_of_life_makes_it_younger() {
        let (mut subscribed, asked) = (subscribed(), asked(false));
        assert_eq!(subscribed.receive(message(1, 10, &[(0, 21.5)]), at(9), at(11)), ValueState::All);
        assert_eq!(subscribed.readings(&asked), None, "one node has not been heard of");
        assert_eq!(subscribed.receive(message(2, 11, &[(1, 3.0)]), at(10), at(12)), ValueState::All);
        let taken = |subscribed: &Subscribed| subscribed.readings(&asked).unwrap()[0].asked;
        assert_eq!(taken(&subscribed), Some(at(9)), "a sampling older than the request at 10 s");
        assert_eq!(subscribed.receive(message(3, 14, &[]), at(13), at(15)), ValueState::All);
        assert_eq!(taken(&subscribed), Some(at(12)));
        assert_eq!(subscribed.received(), [1, 2], "a sign of life is not acknowledged");
    }

    #[test]
    fn a_stamp_that_stands_still_makes_a_value_older_whatever_the_server_says_beside_it() {
        let (mut subscribed, asked) = (subscribed(), asked(true));
        subscribed.receive(message(1, 10, &[(0, 21.5), (1, 3.0)]), at(9), at(11));
        subscribed.receive(message(2, 40, &[]), at(39), at(41));
        let bed = subscribed.readings(&asked).unwrap()[0];
        assert_eq!((bed.asked, bed.stamped), (Some(at(39)), Stamped::Ago(SECOND * 30)));
    }

    #[test]
    fn a_message_that_lay_at_the_server_before_it_was_sent_is_as_old_as_that() {
        let (mut subscribed, asked) = (subscribed(), asked(false));
        let mut late = message(1, 10, &[(0, 21.5), (1, 3.0)]);
        late.response_header.timestamp = by_server(15);
        subscribed.receive(late, at(20), at(21));
        assert_eq!(subscribed.readings(&asked).unwrap()[0].asked, Some(at(14)));
    }

    #[test]
    fn what_is_still_to_come_is_asked_for_before_anything_is_believed() {
        let (mut subscribed, asked) = (subscribed(), asked(false));
        let first = PublishResponse { more_notifications: true, ..message(1, 10, &[(0, 21.5)]) };
        assert_eq!(subscribed.receive(first, at(9), at(11)), ValueState::More);
        assert_eq!(subscribed.readings(&asked), None);
        assert_eq!(subscribed.receive(message(2, 10, &[(1, 3.0)]), at(11), at(11)), ValueState::All);
        assert!(subscribed.readings(&asked).is_some());
    }

    #[test]
    fn a_message_that_is_missing_and_an_end_are_noticed() {
        let mut some = subscribed();
        some.receive(message(1, 10, &[(0, 21.5)]), at(9), at(11));
        assert_eq!(some.receive(message(3, 12, &[(0, 22.5)]), at(11), at(13)), ValueState::Lost(None));
        let mut some = subscribed();
        some.receive(message(1, 10, &[(0, 21.5)]), at(9), at(11));
        assert_eq!(
            some.receive(message(3, 12, &[]), at(11), at(13)),
            ValueState::Lost(None),
            "a sign of life names the next"
        );
        let ended = PublishResponse {
            notification_message: NotificationMessage::status_change(
                1,
                by_server(10),
                StatusCode::BadTimeout,
            ),
            ..PublishResponse::default()
        };
        assert_eq!(
            subscribed().receive(ended, at(9), at(11)),
            ValueState::Lost(Some(StatusCode::BadTimeout))
        );
    }

    #[test]
    fn a_node_that_the_server_does_not_have_is_bad_and_the_others_are_not() {
        let (mut subscribed, asked) = (Subscribed { lacks: true, ..subscribed() }, asked(false));
        subscribed.values[1] =
            Some(DataValue { status: Some(StatusCode::BadNodeIdUnknown), ..DataValue::null() });
        assert!(!subscribed.must_be_recreated(at(59)) && subscribed.must_be_recreated(at(60)));
        subscribed.receive(message(1, 10, &[(0, 21.5)]), at(9), at(11));
        let [bed, scale] = subscribed.readings(&asked).unwrap().try_into().unwrap();
        assert!(bed.value.is_ok());
        assert_eq!(scale.value, Err(Reason::Status(StatusCode::BadNodeIdUnknown.bits())));
    }

    #[test]
    fn a_server_that_sends_less_often_than_it_was_asked_for_is_told_and_may_be_too_slow() {
        let answer = |interval: f64, alive: u32| CreateSubscriptionResponse {
            revised_publishing_interval: interval,
            revised_max_keep_alive_count: alive,
            ..CreateSubscriptionResponse::default()
        };
        let asked = asked(false);
        assert_eq!(Revised::of(&answer(1000.0, 1)).news(&asked), None);
        let slow = Revised::of(&answer(5000.0, 2));
        assert_eq!(slow.news(&asked).as_deref(), Some("the server sends every 5s, not every 1s"));
        assert_eq!(slow.oldest(&asked), SECOND * 12);
    }

    #[test]
    fn nothing_for_longer_than_was_promised_is_silence() {
        let mut subscribed = subscribed();
        subscribed.receive(message(1, 10, &[]), at(9), at(10));
        assert!(!subscribed.is_silent(at(13)));
        assert!(subscribed.is_silent(at(14)));
    }
}
