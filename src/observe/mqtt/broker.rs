//! Interface of a broker for the publisher. It is small, so that the library behind it can be replaced.

use std::fmt;
use std::future::Future;
use std::io::ErrorKind;

use isotherm_core::quantity::Moment;
use isotherm_plant::{Message, Subscription};

/// Source of connections to a broker. Tests replace it.
pub(super) trait Broker {
    /// Type of a connection.
    type Connection: Connection;

    /// Connects. `will` is the message that the broker publishes when the connection breaks.
    fn connect(&self, will: Option<Message>) -> impl Future<Output = Result<Self::Connection, Fault>>;
}

/// A connection to a broker. If it is dropped without [`Connection::close`], the broker publishes the will.
pub(super) trait Connection {
    /// Sends a message. `told` is the time at which it was made. Returns the message if there is no room for it now.
    fn send(&mut self, message: Message, told: Moment) -> Result<(), Message>;

    /// Subscribes to the messages that match a filter.
    fn subscribe(&mut self, subscription: &Subscription) -> Result<(), Fault>;

    /// Waits for the next report. It is safe to drop this future: no report is lost.
    fn next(&mut self) -> impl Future<Output = BrokerReport>;

    /// Time up to which all messages have reached the broker.
    fn last_received(&self) -> Moment;

    /// Returns whether the broker has every message that was sent.
    fn is_done(&self) -> bool;

    /// Disconnects in order. The broker then does not publish the will.
    fn close(self) -> impl Future<Output = ()>;
}

/// Report of a connection.
#[derive(Debug)]
pub(super) enum BrokerReport {
    /// Room for another message, or an acknowledgement of one.
    Room,
    /// A message has arrived.
    Arrived(ReceivedMessage),
    /// The connection has broken.
    Lost(Fault),
}

/// A message from the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ReceivedMessage {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// The broker has retained the message, which may be old.
    pub(super) retained: bool,
    /// The broker delivers the message again, because it does not know whether it arrived (DUP).
    pub(super) redelivered: bool,
}

/// Reason why there is no connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The name has no address.
    NoAddress,
    /// The computer cannot be reached.
    Unreachable(ErrorKind),
    /// The broker did not answer in time.
    Silent,
    /// TLS failed, with the reason in words.
    Tls(String),
    /// The broker rejects the user name or the password.
    WrongUser,
    /// The broker does not admit this user.
    NotAllowed,
    /// The broker rejects this client, with the reason in words.
    Refused(&'static str),
    /// The server does not speak MQTT.
    NoMqtt,
    /// The broker sends a message that is larger than this number of megabytes.
    TooLong(usize),
    /// The broker closed the connection, or the connection broke.
    Broken,
    /// The MQTT library failed, for this reason.
    Inside(String),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::NoAddress => f.write_str("the host name of the broker has no address"),
            Fault::Unreachable(ErrorKind::ConnectionRefused) => f.write_str("nothing listens at that port"),
            Fault::Unreachable(kind) => write!(f, "the broker cannot be reached ({kind})"),
            Fault::Silent => f.write_str("no answer"),
            Fault::Tls(why) => f.write_str(why),
            Fault::WrongUser => {
                f.write_str("the broker rejects this user name or password, or this user may not connect")
            }
            Fault::NotAllowed => f.write_str(
                "the broker does not allow the gateway to connect: name a `user` that may connect, or a \
                 certificate in `tls`",
            ),
            Fault::Refused(why) => f.write_str(why),
            Fault::NoMqtt => {
                f.write_str("the server there does not speak MQTT, or only inside TLS (mqtts://)")
            }
            Fault::TooLong(most) => write!(
                f,
                "the broker sends a message of more than {most} MB on a topic of commands: remove the client \
                 or the retained message that causes this"
            ),
            Fault::Broken => f.write_str("the connection broke"),
            Fault::Inside(why) => write!(f, "the MQTT library failed: {why}"),
        }
    }
}
