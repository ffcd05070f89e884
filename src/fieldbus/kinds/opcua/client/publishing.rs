//! Publish requests, one for each subscription, and the processing of their answers. A Publish request waits at the
//! server until the server has a message to send.

use std::collections::VecDeque;
use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use ::opcua::client::UARequest;
use ::opcua::client::services::Publish;
use ::opcua::types::{Error, PublishResponse, StatusCode, SubscriptionAcknowledgement, VariableId};
use isotherm_core::quantity::Moment;
use isotherm_profile::plan::Subscription;

use super::call_size::{Service, SizeRefusal, size_refusal};
use super::channel::Link;
use super::session::Session;
use super::status::call_fault;
use super::subscription::{NotSubscribed, Subscribed, ValueState, subscribe, unsubscribe};
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::NodeReading;

/// Subscriptions on one connection, and their Publish requests.
#[derive(Default)]
pub(super) struct Publishing {
    of: Vec<(Subscription, State)>,
    /// Publish requests in the order in which they were sent. The server answers them in this order.
    waiting: VecDeque<Waiting>,
    news: Option<String>,
}

enum State {
    Sent(Subscribed),
    /// The server refuses the subscription, or the values of the subscription would be too old. The line polls the
    /// nodes instead.
    Refused,
}

/// Publish request that the server has not answered yet.
struct Waiting {
    asked: Moment,
    answer: Pin<Box<dyn Future<Output = Result<PublishResponse, Error>> + Send>>,
}

/// Latest values of the nodes of a subscription, or the reason why there are none.
pub(super) enum Latest {
    /// The values of all nodes are known.
    Known(Vec<NodeReading>),
    /// Some values are not known: the line must read the nodes.
    Unknown,
    /// No subscription contains the nodes: the line must subscribe to them, possibly again.
    New,
    /// The server has sent no message within the period that it promised.
    Silent,
}

impl Publishing {
    /// Processes the answers that have arrived. Sends new requests, so that one per subscription waits at the server.
    ///
    /// # Errors
    /// The connection or the session is no longer usable.
    pub(super) async fn take_in(
        &mut self,
        link: &mut Link,
        session: &Session,
        now: Moment,
    ) -> Result<(), Error> {
        let mut is_more = false;
        for _ in 0..self.waiting.len() {
            let Some(mut first) = self.waiting.pop_front() else { break };
            let answered = tokio::select! {
                biased;
                answered = &mut first.answer => answered,
                () = std::future::ready(()) => {
                    self.waiting.push_back(first);
                    continue;
                }
            };
            is_more |= self.receive(answered, session, first.asked, now)?;
        }
        loop {
            self.ask(link, session, now).await?;
            let first = if is_more { self.waiting.pop_front() } else { None };
            let Some(first) = first else { return Ok(()) };
            let answered = link.ask(first.answer).await;
            is_more = self.receive(answered, session, first.asked, now)?;
        }
    }

    /// Processes the answer to a Publish request, or its error. Returns whether the server has more values to send at
    /// once.
    fn receive(
        &mut self,
        answered: Result<PublishResponse, Error>,
        session: &Session,
        asked: Moment,
        now: Moment,
    ) -> Result<bool, Error> {
        let answer = match answered {
            Ok(answer) => answer,
            Err(error) => {
                return match error.status() {
                    StatusCode::BadNoSubscription | StatusCode::BadSubscriptionIdInvalid => {
                        self.of.retain(|(_, state)| matches!(state, State::Refused));
                        self.lost(Some(error.status()));
                        Ok(false)
                    }
                    // Another request replaces it.
                    StatusCode::BadTooManyPublishRequests | StatusCode::BadTimeout => Ok(false),
                    status if self.has_smaller_messages(session, &error) => {
                        self.of.retain(|(_, state)| matches!(state, State::Refused));
                        self.lost(Some(status));
                        Ok(false)
                    }
                    _ => Err(error),
                };
            }
        };
        let id = answer.subscription_id;
        let sent = self.of.iter_mut().find_map(|(_, state)| match state {
            State::Sent(subscribed) if subscribed.id == id => Some(subscribed),
            _ => None,
        });
        // Data of an ended subscription is discarded.
        let Some(subscribed) = sent else { return Ok(false) };
        match subscribed.receive(answer, asked, now) {
            ValueState::All => Ok(false),
            ValueState::More => Ok(true),
            ValueState::Lost(why) => {
                self.of.retain(|(_, state)| !matches!(state, State::Sent(subscribed) if subscribed.id == id));
                self.lost(why);
                Ok(false)
            }
        }
    }

    /// Returns whether a message was too large for the server and the next subscription can have smaller messages. If
    /// so, records the smaller size.
    fn has_smaller_messages(&self, session: &Session, error: &Error) -> bool {
        if !matches!(size_refusal(error), Some(SizeRefusal::Answered(_))) {
            return false;
        }
        let sent = self.of.iter().filter_map(|(_, state)| state.sent());
        // Without a subscription, the message belonged to a subscription that has ended.
        sent.map(Subscribed::count).max().is_none_or(|count| {
            let count = session.sizes().next(Service::Publish, count);
            session.sizes().halve(Service::Publish, count)
        })
    }

    fn lost(&mut self, why: Option<StatusCode>) {
        self.news = Some(match why {
            Some(status) => {
                format!("the server has ended the subscription ({status}); the gateway creates it again")
            }
            None => {
                "a message of the server is missing; the gateway creates the subscription again".to_owned()
            }
        });
    }

    /// Sends Publish requests, until one request per subscription waits at the server. The requests acknowledge the
    /// received messages.
    async fn ask(&mut self, link: &mut Link, session: &Session, now: Moment) -> Result<(), Error> {
        let sent = || self.of.iter().filter_map(|(_, state)| state.sent());
        // A silent subscription is detected before this timeout.
        let patience = sent().map(|subscribed| subscribed.patience * 2).max().unwrap_or(Duration::ZERO);
        for _ in self.waiting.len()..sent().count() {
            let publish = Publish::new_manual(0, patience, session.token(), link.channel.request_handle())
                .acks(self.received());
            let channel = link.channel.clone();
            let mut answer: Waiting =
                Waiting { asked: now, answer: Box::pin(async move { publish.send(&channel).await }) };
            tokio::select! {
                biased;
                answered = &mut answer.answer => return answered.map(|_| ()),
                () = std::future::ready(()) => {}
            }
            self.waiting.push_back(answer);
        }
        match link.is_closed().await {
            true => Err(Error::new(StatusCode::BadConnectionClosed, "closed")),
            false => Ok(()),
        }
    }

    fn received(&mut self) -> Vec<SubscriptionAcknowledgement> {
        let sent = self.of.iter_mut().filter_map(|(_, state)| match state {
            State::Sent(subscribed) => Some(subscribed),
            State::Refused => None,
        });
        let numbers = sent.flat_map(|subscribed| {
            let subscription_id = subscribed.id;
            subscribed
                .received()
                .into_iter()
                .map(move |sequence_number| SubscriptionAcknowledgement { subscription_id, sequence_number })
        });
        numbers.collect()
    }

    /// Returns the latest values of these nodes.
    pub(super) fn latest(&self, asked: &Subscription, now: Moment) -> Latest {
        match self.of.iter().find(|(of, _)| of == asked) {
            None => Latest::New,
            Some((_, State::Refused)) => Latest::Unknown,
            Some((_, State::Sent(subscribed))) if subscribed.is_silent(now) => Latest::Silent,
            Some((_, State::Sent(subscribed))) if subscribed.must_be_recreated(now) => Latest::New,
            Some((_, State::Sent(subscribed))) => {
                subscribed.readings(asked).map_or(Latest::Unknown, Latest::Known)
            }
        }
    }

    /// Returns whether the next request may take longer than an ordinary read, because the line may first have to
    /// subscribe to the nodes.
    pub(super) fn may_take_long(&self, asked: &Subscription) -> bool {
        let is_whole = |state: &State| !state.sent().is_some_and(|sent| sent.lacks);
        !self.of.iter().any(|(of, state)| of == asked && is_whole(state))
    }

    /// Subscribes to these nodes. If the server refuses, or the values could become older than `max_age`, the line
    /// polls the nodes from now on.
    ///
    /// # Errors
    /// The server does not answer, or the connection has ended.
    pub(super) async fn subscribe(
        &mut self,
        link: &mut Link,
        session: &Session,
        asked: &Subscription,
        now: Moment,
    ) -> Result<(), Error> {
        self.of.retain(|(of, _)| of != asked);
        let most = VariableId::Server_ServerCapabilities_OperationLimits_MaxMonitoredItemsPerCall;
        let most = session.most(link, most).await?;
        let made = loop {
            self.end_others(link, session).await?;
            match subscribe(link, session, asked, (most, now)).await {
                Ok(made) => break Ok(made),
                Err(NotSubscribed::TooLarge) => {}
                Err(NotSubscribed::Failed(error)) => break Err(error),
            }
        };
        let state = match made {
            Ok((_, revised)) if revised.oldest(asked) > asked.max_age => {
                self.news = Some(format!(
                    "a value of the subscription may become {:?} old, but `max_age` is {:?}. The gateway \
                     polls the nodes instead. Raise `max_age`, or write read = \"poll\"",
                    revised.oldest(asked),
                    asked.max_age
                ));
                State::Refused
            }
            Ok((subscribed, revised)) => {
                self.news = revised.news(asked);
                State::Sent(subscribed)
            }
            Err(error) => match call_fault(&error) {
                Fault::Status(_) => {
                    self.news = Some(format!(
                        "the server refuses the subscription ({}): the gateway polls the nodes instead",
                        error.status()
                    ));
                    State::Refused
                }
                _ => return Err(error),
            },
        };
        let is_refused = matches!(state, State::Refused);
        self.of.push((asked.clone(), state));
        if is_refused {
            self.end_others(link, session).await?;
        }
        self.ask(link, session, now).await
    }

    /// Deletes subscriptions at the server that the gateway no longer uses. Examples: a subscription of an earlier
    /// connection, one with missing messages, and one that the line has replaced by polling.
    async fn end_others(&mut self, link: &mut Link, session: &Session) -> Result<(), Error> {
        let is_kept =
            |id: &u32| self.of.iter().any(|(_, state)| state.sent().is_some_and(|sent| sent.id == *id));
        let others: Vec<u32> = session.subscriptions().into_iter().filter(|id| !is_kept(id)).collect();
        if others.is_empty() {
            return Ok(());
        }
        session.forgets(&others);
        unsubscribe(link, session, others).await
    }

    /// Returns a sentence about the last change of a subscription. The next call returns `None`, unless there was
    /// another change.
    pub(super) fn news(&mut self) -> Option<String> {
        self.news.take()
    }
}

impl State {
    const fn sent(&self) -> Option<&Subscribed> {
        match self {
            State::Sent(subscribed) => Some(subscribed),
            State::Refused => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::call_size::CallSizes;
    use super::super::subscription::tests::{asked, subscribed};
    use super::*;

    #[test]
    fn after_a_message_that_is_too_large_for_the_server_the_next_subscription_has_smaller_ones() {
        let session = Session::none("urn:test".to_owned(), Duration::from_secs(1), CallSizes::default());
        let refused = |status| Err(Error::new(status, "said"));
        let with_two_nodes = || Publishing {
            of: vec![(asked(false), State::Sent(subscribed()))],
            waiting: VecDeque::new(),
            news: None,
        };
        let (mut publishing, now) = (with_two_nodes(), Moment::default());
        let received = publishing.receive(refused(StatusCode::BadResponseTooLarge), &session, now, now);
        assert!(matches!(received, Ok(false)));
        assert!(publishing.of.is_empty(), "the line creates the subscription again");
        assert!(publishing.news().is_some_and(|news| news.contains("BadResponseTooLarge")));
        assert_eq!(session.sizes().most(Service::Publish), Some(1));
        let of_another = publishing.receive(refused(StatusCode::BadResponseTooLarge), &session, now, now);
        assert!(matches!(of_another, Ok(false)), "the message of another subscription was too large as well");
        for status in [StatusCode::BadResponseTooLarge, StatusCode::BadUnknownResponse] {
            let mut publishing = with_two_nodes();
            assert!(publishing.receive(refused(status), &session, now, now).is_err(), "{status}");
            assert_eq!(publishing.of.len(), 1);
        }
    }
}
