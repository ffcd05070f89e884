//! What a broker is to whoever publishes: small, so that the library behind it can be another one.

use std::fmt;
use std::future::Future;
use std::io::ErrorKind;

use isotherm_core::quantity::Moment;
use isotherm_plant::{Message, Subscription};

/// Where connections come from.
pub(super) trait Broker {
    /// One of them.
    type Connection: Connection;

    /// Connects, and has the broker keep what it is to say when the connection breaks.
    fn connect(&self, will: Option<Message>) -> impl Future<Output = Result<Self::Connection, Fault>>;
}

/// A connection that a broker has taken. Dropped, it breaks, and the broker says the will.
pub(super) trait Connection {
    /// Sends a message that was made at this moment, or gives it back where there is no room for it now.
    fn send(&mut self, message: Message, told: Moment) -> Result<(), Message>;

    /// Asks for messages.
    fn subscribe(&mut self, subscription: &Subscription) -> Result<(), Fault>;

    /// What comes next; dropped while it waits, nothing is lost.
    fn next(&mut self) -> impl Future<Output = Heard>;

    /// The broker has everything that was told before this moment.
    fn last_heard(&self) -> Moment;

    /// Nothing that was sent is still on its way to the broker.
    fn is_done(&self) -> bool;

    /// Ends it in order: the will is not said.
    fn close(self) -> impl Future<Output = ()>;
}

/// What comes of a connection.
#[derive(Debug)]
pub(super) enum Heard {
    /// There is room for more, or the broker has taken something.
    Room,
    /// A message.
    Arrived(Arrived),
    /// The connection has broken.
    Lost(Fault),
}

/// A message from the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Arrived {
    pub(super) topic: String,
    pub(super) payload: Vec<u8>,
    /// The broker has kept it: it is of some earlier day.
    pub(super) retained: bool,
    /// The broker has delivered it before, and does not know whether it arrived (DUP).
    pub(super) redelivered: bool,
}

/// Why there is no connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Its name leads to no address.
    NoAddress,
    /// The computer cannot be reached.
    Unreachable(ErrorKind),
    /// It did not answer in time.
    Silent,
    /// What TLS says, in words.
    Tls(String),
    /// It does not take the user or his password.
    WrongUser,
    /// It does not let this user in.
    NotAllowed,
    /// It does not take this client: in words.
    Refused(&'static str),
    /// It speaks, but not MQTT.
    NoMqtt,
    /// It sends a message of more than so many megabytes.
    TooLong(usize),
    /// It closed the connection, or the connection broke.
    Broken,
    /// The library failed inside.
    Inside(String),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::NoAddress => f.write_str("its name leads to no address"),
            Fault::Unreachable(ErrorKind::ConnectionRefused) => f.write_str("nothing listens at that port"),
            Fault::Unreachable(kind) => write!(f, "it cannot be reached ({kind})"),
            Fault::Silent => f.write_str("no answer"),
            Fault::Tls(why) => f.write_str(why),
            Fault::WrongUser => {
                f.write_str("it does not take this user name or password, or does not let this user in")
            }
            Fault::NotAllowed => f.write_str(
                "it does not let the gateway in: name a `user` that may connect, or a certificate in `tls`",
            ),
            Fault::Refused(why) => f.write_str(why),
            Fault::NoMqtt => {
                f.write_str("what answers there does not speak MQTT, or only inside TLS (mqtts://)")
            }
            Fault::TooLong(most) => write!(
                f,
                "it sends a message of more than {most} MB: somebody publishes, or has it keep, what is no command on a topic of commands"
            ),
            Fault::Broken => f.write_str("the connection broke"),
            Fault::Inside(why) => write!(f, "the MQTT library failed inside: {why}"),
        }
    }
}
