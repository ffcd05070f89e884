//! Topics to which the broker does not let the gateway publish.
//!
//! MQTT 3.1.1 has no answer for a denied message. Some brokers discard it, others close the connection. After a closed
//! connection, the gateway sends messages one by one for a while, and waits for an answer to each. If the broker closes
//! the connection again, the topic of the message without an answer is suspected. After [`CLOSED`] such connections,
//! nothing more is published to this topic.
//!
//! The documents of suspected topics are sent last, so that all other messages arrive before them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

use super::broker::Fault;
use isotherm_core::quantity::Moment;
use isotherm_plant::{Message, Qos};

/// Number of closed connections after which a topic counts as denied. The broker has closed each of them
/// after a message to this topic. An answer to a message to this topic resets the count.
const CLOSED: u32 = 3;
/// Minimum duration of a connection after which messages are no longer sent one by one.
const CAREFUL_FOR: Duration = Duration::from_secs(60);
/// Maximum wait for the answer to one message. The keep-alive detects a dead connection earlier, and some brokers do
/// not answer at all.
const ANSWERED_WITHIN: Duration = Duration::from_secs(30);
/// First level of the topics of Home Assistant. Brokers permit or deny all these topics together.
const DISCOVERY: &str = "homeassistant/";

/// Topics to which the gateway may not publish, and the state of the search for such topics.
#[derive(Debug, Default)]
pub(super) struct Denials {
    pace: Pace,
    /// Number of connections that were closed after messages to a suspected topic, by topic.
    suspected: BTreeMap<String, u32>,
    denied: BTreeSet<String>,
}

/// Pace at which messages are sent on the current connection.
#[derive(Debug, Default)]
enum Pace {
    /// Messages are sent without waiting for answers.
    #[default]
    Free,
    /// Messages are sent one by one, each after the broker has answered the previous message.
    Careful {
        /// Time at which the connection began.
        since: Moment,
        /// Topic of the message whose answer is awaited; `None` if no answer is awaited.
        awaited: Option<String>,
        /// Time of the first [check](Denials::waits) at which the awaited answer had not arrived; `None` before this
        /// check.
        missing: Option<Moment>,
        /// Number of messages that the broker has answered on this connection.
        answered: u64,
    },
}

impl Denials {
    /// Records the start of a connection. If messages are sent one by one, no answer is awaited at first.
    pub(super) fn begins(&mut self, now: Moment) {
        if let Pace::Careful { .. } = self.pace {
            self.pace = Pace::Careful { since: now, awaited: None, missing: None, answered: 0 };
        }
    }

    /// Returns whether the next message may be sent. `is_done` states whether the broker has answered all earlier
    /// messages.
    pub(super) fn may_send(&mut self, is_done: bool) -> bool {
        let Pace::Careful { awaited, answered, .. } = &mut self.pace else { return true };
        if let Some(topic) = awaited.take_if(|_| is_done) {
            self.suspected.remove(&topic);
            *answered += 1;
        }
        awaited.is_none()
    }

    /// Removes and returns the message to send next; `None` if no message waits. Messages to denied topics
    /// are removed and not returned.
    pub(super) fn next(&self, outbox: &mut VecDeque<(Moment, Message)>) -> Option<(Moment, Message)> {
        if !self.denied.is_empty() {
            outbox.retain(|(_, message)| !self.denied.contains(scope(&message.topic)));
        }
        let Pace::Careful { .. } = self.pace else { return outbox.pop_front() };
        let (told, message) = outbox.remove(self.first_unsuspected(outbox))?;
        // A retained document may arrive twice. Sparkplug requires that births and data are not acknowledged.
        let qos = if message.retained { Qos::AtLeastOnce } else { message.qos };
        Some((told, Message { qos, ..message }))
    }

    /// Returns the topic of a message if its answer must be awaited; `None` if messages are sent without waiting.
    pub(super) fn awaits(&self, message: &Message) -> Option<String> {
        matches!(self.pace, Pace::Careful { .. }).then(|| message.topic.clone())
    }

    /// Records that a message to this topic was sent, and that its answer must be awaited.
    pub(super) fn is_sent(&mut self, topic: &str) {
        if let Pace::Careful { awaited, missing, .. } = &mut self.pace {
            *awaited = Some(scope(topic).to_owned());
            *missing = None;
        }
    }

    /// Checks for how long an answer has been missing. If the broker does not answer on an open connection, messages
    /// are no longer sent one by one: otherwise nothing more would be published.
    pub(super) fn waits(&mut self, now: Moment) {
        let Pace::Careful { awaited: Some(_), missing, .. } = &mut self.pace else { return };
        let since = *missing.get_or_insert(now);
        if now.since(since) >= ANSWERED_WITHIN {
            self.pace = Pace::Free;
        }
    }

    /// Returns whether messages are sent one by one and a topic is suspected. The broker may then close the
    /// connection again. After [`CAREFUL_FOR`], a connection counts as usable, even without a message to a
    /// suspected topic.
    pub(super) fn has_suspects(&self) -> bool {
        matches!(self.pace, Pace::Careful { .. }) && !self.suspected.is_empty()
    }

    /// Records that no message waits to be sent. If the connection has lasted for [`CAREFUL_FOR`], messages
    /// are no longer sent one by one.
    pub(super) fn rests(&mut self, now: Moment) {
        if let Pace::Careful { since, awaited: None, .. } = &self.pace
            && now.since(*since) >= CAREFUL_FOR
        {
            self.pace = Pace::Free;
        }
    }

    /// Evaluates the end of a connection. Returns the fault to report, and the topic that is denied from now on, if
    /// there is one. `is_done` states whether the broker had answered all messages.
    pub(super) fn ends(&mut self, fault: Fault, is_done: bool) -> (Fault, Option<String>) {
        self.may_send(is_done);
        let pace = std::mem::take(&mut self.pace);
        if !matches!(fault, Fault::Broken | Fault::NoMqtt) {
            return (fault, None);
        }
        self.pace = Pace::Careful { since: Moment::default(), awaited: None, missing: None, answered: 0 };
        let Pace::Careful { awaited: Some(topic), answered, .. } = pace else { return (fault, None) };
        let closed = self.suspected.entry(topic.clone()).or_default();
        *closed += 1;
        match (answered, *closed >= CLOSED) {
            // The other messages may be denied as well: nothing shows that the broker accepts any.
            (0, _) => (Fault::DeniesAll, None),
            (_, false) => (Fault::Denied(topic), None),
            (_, true) => {
                self.suspected.remove(&topic);
                self.denied.insert(topic.clone());
                (Fault::Denied(topic.clone()), Some(topic))
            }
        }
    }

    /// Returns the index of the first message in `outbox` whose topic is not suspected. Only retained documents are
    /// skipped, because they may arrive in any order. The births, data and events of a topic must arrive in order.
    fn first_unsuspected(&self, outbox: &VecDeque<(Moment, Message)>) -> usize {
        let is_next = |(_, message): &(Moment, Message)| {
            !message.retained || !self.suspected.contains_key(scope(&message.topic))
        };
        outbox.iter().position(is_next).unwrap_or(0)
    }
}

/// Returns the topic filter that is denied or accepted as a whole: the topic, or all topics of Home Assistant.
fn scope(topic: &str) -> &str {
    if topic.starts_with(DISCOVERY) { "homeassistant/#" } else { topic }
}

#[cfg(test)]
mod tests;
