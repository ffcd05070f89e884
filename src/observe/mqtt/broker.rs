//! Interface to a broker, for the publisher. The interface is small, so that the MQTT library that implements it can be
//! replaced.

use std::fmt;
use std::future::Future;
use std::io::ErrorKind;

use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_plant::{Message, Subscription};

/// Broker to which the publisher connects. Tests replace it.
pub(super) trait Broker {
    /// Type of the connections that [`Broker::connect`] returns.
    type Connection: Connection;

    /// Connects to the broker. `will` is the message that the broker publishes when the connection breaks.
    fn connect(&self, will: Option<Message>) -> impl Future<Output = Result<Self::Connection, Fault>>;

    /// Returns the state of the CONNECT packet of the last attempt. The attempt may still be in progress.
    fn packet(&self) -> ConnectPacket;
}

/// State of the CONNECT packet of an attempt. The packet contains the will message, and is sent when the network
/// connection is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ConnectPacket {
    NotSent,
    Sent,
}

/// Answer of the broker to a subscription (SUBACK).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SubscriptionAnswer {
    Accepted,
    Refused,
}

/// Connection to a broker. If it is dropped without [`Connection::close`], the broker publishes the will message.
pub(super) trait Connection {
    /// Sends a message. `told` is the time at which the message was made. If the send queue is full, returns the
    /// message as an error.
    fn send(&mut self, message: Message, told: Moment) -> Result<(), Message>;

    /// Subscribes to the topics that match a filter, and waits for the answer of the broker.
    fn subscribe(
        &mut self,
        subscription: &Subscription,
    ) -> impl Future<Output = Result<SubscriptionAnswer, Fault>>;

    /// Requests an answer from the broker after a message with QoS 0, which the broker does not acknowledge.
    /// [`Connection::is_done`] then returns `false` until this answer arrives. `topic` is the topic of the
    /// message.
    fn request_answer(&mut self, topic: &str);

    /// Waits for the next report about the connection. If this future is dropped, no report is lost.
    fn next(&mut self) -> impl Future<Output = BrokerReport>;

    /// Returns the time before which all messages have reached the broker. A message counts by the time at
    /// which it was made.
    fn last_received(&self) -> Moment;

    /// Returns whether the broker has received every message that was sent.
    fn is_done(&self) -> bool;

    /// Disconnects from the broker, which then does not publish the will message.
    fn close(self) -> impl Future<Output = ()>;
}

/// Report about a connection.
#[derive(Debug)]
pub(super) enum BrokerReport {
    /// The send queue has room for another message, or the broker has acknowledged a message.
    Room,
    /// A message was received from the broker.
    Arrived(ReceivedMessage),
    /// The connection is broken, for this reason.
    Lost(Fault),
}

/// Message that was received from the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ReceivedMessage {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// Whether the broker had stored the message before (retained). Such a message may be old.
    pub(super) retained: bool,
    /// Whether this is a repeated delivery, because the first delivery was not acknowledged (flag DUP).
    pub(super) redelivered: bool,
}

/// Reason why there is no connection to the MQTT broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The host name of the broker has no address.
    NoAddress,
    /// The computer of the broker cannot be reached.
    Unreachable(ErrorKind),
    /// The broker did not answer in time.
    Silent,
    /// The TLS handshake failed; contains the reason.
    Tls(String),
    /// The broker rejects the user name or the password.
    WrongUser,
    /// The broker does not allow this user to connect.
    NotAllowed,
    /// The broker does not allow the gateway to subscribe to this topic.
    NotSubscribed(String),
    /// The broker closes the connection after each message to this topic.
    Denied(String),
    /// The broker closes the connection after the first message, whatever its topic.
    DeniesAll,
    /// The broker rejects the connection; contains the reason.
    Refused(&'static str),
    /// The server at this address does not speak MQTT.
    NoMqtt,
    /// The broker sends a message that is larger than this number of megabytes.
    TooLong(usize),
    /// The broker closed the connection, or the connection broke.
    Broken,
    /// The MQTT library failed; contains the reason.
    Inside(String),
}

impl Fault {
    /// Returns the cause, with a hint if this cause has a specific remedy.
    pub(super) fn explained(&self) -> Explained {
        match self {
            Fault::NoAddress => "the host name of the broker has no address".into(),
            Fault::Unreachable(ErrorKind::ConnectionRefused) => "no program listens at this port".into(),
            Fault::Unreachable(kind) => format!("the broker cannot be reached ({kind})").into(),
            Fault::Silent => "no answer".into(),
            Fault::Tls(why) => why.as_str().into(),
            Fault::WrongUser => {
                "the broker rejects this user name or password, or this user may not connect".into()
            }
            Fault::NotAllowed => Explained::new(
                "the broker does not allow the gateway to connect",
                "write a `user` that may connect, or a client certificate with its key in `tls`, into the profile",
            ),
            Fault::NotSubscribed(topic) => Explained::new(
                format!("the broker refuses the subscription to {topic}"),
                "allow the user of the gateway to subscribe to this topic",
            ),
            Fault::Denied(topic) => Explained::new(
                format!("the broker closes the connection after a message to {topic}"),
                "allow the user of the gateway to publish to this topic",
            ),
            Fault::DeniesAll => Explained::new(
                "the broker closes the connection after the first message",
                "allow the user of the gateway to publish to the topics that `isotherm check` lists",
            ),
            Fault::Refused(why) => (*why).into(),
            Fault::NoMqtt => {
                "the server at this address does not speak MQTT, or it requires TLS (mqtts://)".into()
            }
            Fault::TooLong(most) => Explained::new(
                format!("the broker sends a message of more than {most} MB on a command topic"),
                "remove the client or the retained message that causes this",
            ),
            Fault::Broken => "the connection was lost".into(),
            Fault::Inside(why) => format!("the MQTT library failed: {why}").into(),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.explained(), f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_has_one_remedy_and_no_question_inside() {
        let topic = || "g/press/axis/z".to_owned();
        for (fault, remedy) in [
            (Fault::NotAllowed, "write a `user`"),
            (Fault::NotSubscribed(topic()), "allow the user of the gateway to subscribe"),
            (Fault::Denied(topic()), "allow the user of the gateway to publish"),
            (Fault::DeniesAll, "allow the user of the gateway to publish"),
            (Fault::TooLong(1), "remove the client"),
        ] {
            let Explained { cause, hint } = fault.explained();
            assert!(!cause.contains(['?', ':', ';']), "{cause}");
            let hint = hint.unwrap_or_default();
            assert!(hint.starts_with(remedy), "{hint}");
            assert_eq!(fault.to_string(), format!("{cause}; {hint}"));
        }
        assert_eq!(Fault::Broken.explained().hint, None, "the catalogue has the remedy");
    }
}
