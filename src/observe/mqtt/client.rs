//! MQTT client based on a maintained fork of the library `rumqttc`. No other file uses the library.
//!
//! Each connection has a new client of the library, which therefore cannot send messages of an earlier connection
//! again. A task runs the event loop of the library. If the task panics, the connection is treated as broken. The
//! queues in both directions are bounded.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rumqttc::mqttbytes::Error as Unreadable;
use rumqttc::mqttbytes::v4::{ConnectReturnCode, LastWill, SubscribeReasonCode};
use rumqttc::{
    AsyncClient, ConnectionError, Event, EventLoop, MqttOptions, Outgoing, Packet, QoS, StateError,
};
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{Notify, mpsc};
use tokio::task::{JoinError, JoinHandle};
use tokio_rustls::rustls::ClientConfig;

use super::broker::{
    Broker, BrokerReport, ConnectPacket, Connection, Fault, ReceivedMessage, SubscriptionAnswer,
};
use crate::clock::Clock;
use crate::net::{ConnectError, Host};
use crate::tls::TlsFault;
use isotherm_core::border::panic_message;
use isotherm_core::quantity::Moment;
use isotherm_plant::sparkplug::Address;
use isotherm_plant::{Message, Qos, Subscription};
use isotherm_profile::{BrokerUrl, Mqtt};

/// Timeout for name resolution, connection, handshake and the broker's answer together.
const CONNECT_WITHIN: Duration = Duration::from_secs(10);
/// Timeout for the broker's answer to a subscription.
const SUBSCRIBE_WITHIN: Duration = Duration::from_secs(10);
/// MQTT keep-alive interval. If the client receives no data for twice this time, it closes the connection. If the
/// broker receives no data for one and a half times this interval, it publishes the will message.
const KEEP_ALIVE: Duration = Duration::from_secs(10);
/// Maximum delay from the sending of a ping to the library's report about this ping.
const MARGIN: Duration = Duration::from_secs(1);
/// Maximum number of messages that the library holds at one time.
const IN_LIBRARY: usize = 64;
/// Maximum number of received messages that wait to be processed. Further messages are dropped, but the newest state of
/// the primary host is kept.
const UNHEARD: usize = 16;
/// Maximum size of a received packet, in bytes. A larger packet breaks the connection. Commands, the only accepted
/// messages, are much smaller.
const LARGEST_IN: usize = 1 << 20;
/// Maximum size of a sent packet, in bytes. All published messages are smaller.
const LARGEST_OUT: usize = 4 << 20;
/// Timeout for disconnecting.
const CLOSE_WITHIN: Duration = Duration::from_secs(1);
/// Reason of a failed connection to a broker that does not support MQTT 3.1.1.
const MQTT_5_ONLY: &str =
    "the broker speaks MQTT 5 only, and the gateway speaks MQTT 3.1.1: allow MQTT 3.1.1 at the broker";

/// MQTT client for the broker of the profile, with the settings of the profile.
#[derive(Clone)]
pub(super) struct Client {
    to: BrokerUrl,
    id: String,
    user: Option<(String, Vec<u8>)>,
    host: Arc<Host>,
    clock: Clock,
    /// Topic of the state of the primary host; `None` if the profile names no host.
    state_topic: Option<String>,
    /// Whether the network connection of the last attempt was opened.
    is_open: Arc<AtomicBool>,
}

impl Client {
    pub(super) fn of(mqtt: &Mqtt, id: String, trust: Option<Arc<ClientConfig>>, clock: &Clock) -> Client {
        let user = mqtt.user.as_ref().map(|user| {
            let password = user.password.as_ref().map(|file| file.bytes.as_slice()).unwrap_or_default();
            (user.name.clone(), password.trim_ascii_end().to_vec())
        });
        let (to, clock) = (mqtt.broker.clone(), clock.clone());
        let host = Arc::new(Host::new(&to.host, to.port, trust));
        let state_topic = mqtt.primary_host.as_ref().and_then(|host| Address::state_topic(host).ok());
        Client { to, id, user, host, clock, state_topic, is_open: Arc::default() }
    }

    /// Returns the options of the library for one connection. The library sends the CONNECT packet as soon as the
    /// network connection is open. At that time, `is_open` is set.
    fn options(&self, will: Option<Message>) -> MqttOptions {
        let mut options = MqttOptions::new(self.id.clone(), (self.to.host.clone(), self.to.port));
        let seconds = u16::try_from(KEEP_ALIVE.as_secs()).unwrap_or(u16::MAX);
        options.set_keep_alive(seconds).set_max_packet_size(LARGEST_IN, LARGEST_OUT);
        if let Some(will) = will {
            options.set_last_will(LastWill::new(will.topic, will.payload, qos(will.qos), will.retained));
        }
        if let Some((name, password)) = self.user.clone() {
            options.set_credentials(name, password);
        }
        let (host, is_open) = (self.host.clone(), self.is_open.clone());
        options.set_socket_connector(move |_, _| {
            let (host, is_open) = (host.clone(), is_open.clone());
            async move {
                let opened = host.open().await.inspect(|_| is_open.store(true, Ordering::Relaxed));
                // The library knows only I/O errors.
                opened.map_err(io::Error::other)
            }
        });
        options
    }
}

impl Broker for Client {
    type Connection = Connected;

    async fn connect(&self, will: Option<Message>) -> Result<Connected, Fault> {
        self.is_open.store(false, Ordering::Relaxed);
        let options = self.options(will);
        let (client, mut turns) = AsyncClient::builder(options).capacity(IN_LIBRARY).build();
        turns.network_options.set_connection_timeout(CONNECT_WITHIN.as_secs());
        let tally = Arc::new(Mutex::new(Tally { heard: self.clock.time_of_day(), ..Tally::default() }));
        let (news, inbox) = inbox(self.state_topic.clone());
        let turning = turn(turns, tally.clone(), news, self.clock.clone());
        let mut connected = Connected { client, tally, inbox, task: Some(tokio::spawn(turning)) };
        match tokio::time::timeout(CONNECT_WITHIN, connected.next()).await {
            Ok(BrokerReport::Room | BrokerReport::Arrived(_)) => Ok(connected),
            // Brokers report a wrong password with either of two codes.
            Ok(BrokerReport::Lost(Fault::NotAllowed)) if self.user.is_some() => Err(Fault::WrongUser),
            // A broker would answer an MQTT client before it closes the connection.
            Ok(BrokerReport::Lost(Fault::Broken)) => Err(Fault::NoMqtt),
            Ok(BrokerReport::Lost(fault)) => Err(fault),
            Err(_) => Err(Fault::Silent),
        }
    }

    fn packet(&self) -> ConnectPacket {
        match self.is_open.load(Ordering::Relaxed) {
            true => ConnectPacket::Sent,
            false => ConnectPacket::NotSent,
        }
    }
}

/// Record of the sent messages. It shows which messages have certainly reached the broker.
#[derive(Debug, Default)]
struct Tally {
    /// Times of the messages that the library has not written to the connection yet.
    unwritten: VecDeque<Moment>,
    /// Times of the written messages that the broker has not acknowledged yet, by packet identifier.
    unacknowledged: BTreeMap<u16, Moment>,
    /// Number of requested answers that the broker has not sent yet.
    unanswered: usize,
    /// Time before which all messages had been written when the last ping was sent. `None` if no ping waits
    /// for an answer.
    pinged: Option<Moment>,
    /// Time before which all messages have reached the broker.
    heard: Moment,
}

impl Tally {
    fn written(&mut self, id: u16) {
        let told = self.unwritten.pop_front();
        // A message without packet identifier is not acknowledged.
        if let Some(told) = told.filter(|_| id > 0) {
            self.unacknowledged.insert(id, told);
        }
    }

    fn is_answered(&mut self) {
        self.unanswered = self.unanswered.saturating_sub(1);
    }

    /// Records an acknowledgement. A broker processes messages in order, so the broker also has all messages
    /// that were written before this message.
    fn acknowledged(&mut self, id: u16) {
        if let Some(told) = self.unacknowledged.remove(&id) {
            self.heard = self.heard.max(told);
        }
    }
}

/// Sender of reports from the task of the library. Reports about room in the send queue use a separate
/// notification, so that they do not fill the queue of received messages.
struct ReportSender {
    heard: mpsc::Sender<BrokerReport>,
    room: Arc<Notify>,
    /// Topic of the state of the primary host; `None` without a primary host. The newest message to this topic is kept
    /// if the queue is full.
    state_topic: Option<String>,
    kept: KeptMessage,
}

/// Receiver of reports about the connection and of messages. The task of the MQTT library sends them.
struct ReportReceiver {
    heard: mpsc::Receiver<BrokerReport>,
    room: Arc<Notify>,
    kept: KeptMessage,
}

/// Newest message about the state of the primary host that did not fit into the queue; `None` if there is no
/// such message.
type KeptMessage = Arc<Mutex<Option<ReceivedMessage>>>;

fn inbox(state_topic: Option<String>) -> (ReportSender, ReportReceiver) {
    let ((says, heard), room, kept) =
        (mpsc::channel(UNHEARD), Arc::<Notify>::default(), KeptMessage::default());
    let sender = ReportSender { heard: says, room: room.clone(), state_topic, kept: kept.clone() };
    (sender, ReportReceiver { heard, room, kept })
}

impl ReportSender {
    /// Queues a received message. If the queue is full, the message is dropped. Only the newest message about the state
    /// of the primary host is kept, because the broker does not send it again.
    fn arrived(&self, arrived: ReceivedMessage) {
        let is_state = self.state_topic.as_deref() == Some(arrived.topic.as_str());
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if is_state && kept.is_some() {
            // A newer state must not overtake the kept one.
            *kept = Some(arrived);
        } else if let Err(TrySendError::Full(BrokerReport::Arrived(arrived))) =
            self.heard.try_send(BrokerReport::Arrived(arrived))
            && is_state
        {
            *kept = Some(arrived);
            self.room.notify_one();
        }
    }
}

impl ReportReceiver {
    /// Waits for the next report. Returns `None` if the task has ended.
    async fn next(&mut self) -> Option<BrokerReport> {
        tokio::select! {
            biased;
            heard = self.heard.recv() => heard,
            () = self.room.notified() => {
                let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner).take();
                Some(kept.map_or(BrokerReport::Room, BrokerReport::Arrived))
            }
        }
    }
}

/// Open connection to the broker. A separate task runs the event loop of the library.
pub(super) struct Connected {
    client: AsyncClient,
    tally: Arc<Mutex<Tally>>,
    inbox: ReportReceiver,
    task: Option<JoinHandle<()>>,
}

impl Connected {
    fn tally(&self) -> MutexGuard<'_, Tally> {
        self.tally.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the end of the connection, and returns its reason.
    async fn lost(&mut self) -> Fault {
        loop {
            if let BrokerReport::Lost(fault) = self.next().await {
                return fault;
            }
        }
    }
}

impl Connection for Connected {
    fn send(&mut self, message: Message, told: Moment) -> Result<(), Message> {
        let Message { topic, payload, qos: how, retained } = message.clone();
        let mut tally = self.tally();
        if tally.unwritten.len() >= IN_LIBRARY {
            return Err(message);
        }
        match self.client.try_publish(topic, qos(how), retained, payload) {
            Ok(()) => {
                tally.unwritten.push_back(told);
                Ok(())
            }
            Err(_) => Err(message),
        }
    }

    async fn subscribe(&mut self, subscription: &Subscription) -> Result<SubscriptionAnswer, Fault> {
        let filter = &subscription.filter;
        let asked = self.client.try_subscribe_tracked(filter.clone(), qos(subscription.qos));
        let answer = asked.map_err(|error| Fault::Inside(error.to_string()))?;
        match tokio::time::timeout(SUBSCRIBE_WITHIN, answer.wait_async()).await {
            Ok(Ok(answer)) if answer.return_codes.contains(&SubscribeReasonCode::Failure) => {
                Ok(SubscriptionAnswer::Refused)
            }
            Ok(Ok(_)) => Ok(SubscriptionAnswer::Accepted),
            // Some brokers close the connection instead of refusing the subscription.
            Ok(Err(_)) => Err(match self.lost().await {
                Fault::Broken => Fault::NotSubscribed(filter.clone()),
                fault => fault,
            }),
            Err(_) => Err(Fault::Silent),
        }
    }

    fn request_answer(&mut self, topic: &str) {
        self.tally().unanswered += 1;
        // The gateway subscribes to no topic to which it publishes. Brokers answer such a request nevertheless, after
        // the message before it.
        if self.client.try_unsubscribe(topic).is_err() {
            self.tally().is_answered();
        }
    }

    async fn next(&mut self) -> BrokerReport {
        if let Some(heard) = self.inbox.next().await {
            return heard;
        }
        let Some(task) = self.task.take() else { return BrokerReport::Lost(Fault::Broken) };
        let Err(Ok(panic)) = task.await.map_err(JoinError::try_into_panic) else {
            return BrokerReport::Lost(Fault::Broken);
        };
        BrokerReport::Lost(Fault::Inside(panic_message(panic.as_ref())))
    }

    fn last_received(&self) -> Moment {
        self.tally().heard
    }

    fn is_done(&self) -> bool {
        let tally = self.tally();
        tally.unwritten.is_empty() && tally.unacknowledged.is_empty() && tally.unanswered == 0
    }

    async fn close(mut self) {
        if self.client.try_disconnect_with_timeout(CLOSE_WITHIN).is_ok() {
            let ends = async { while !matches!(self.next().await, BrokerReport::Lost(_)) {} };
            // A task that does not end in time is aborted.
            let _ = tokio::time::timeout(CLOSE_WITHIN, ends).await;
        }
    }
}

impl Drop for Connected {
    fn drop(&mut self) {
        if let Some(task) = self.task.take() {
            task.abort();
        }
    }
}

/// Runs the event loop of the library until the connection breaks, and sends reports about the connection.
async fn turn(mut turns: EventLoop, tally: Arc<Mutex<Tally>>, news: ReportSender, clock: Clock) {
    let tally = || tally.lock().unwrap_or_else(PoisonError::into_inner);
    loop {
        let is_room = match turns.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => true,
            Ok(Event::Incoming(Packet::Publish(arrived))) => {
                let arrived = ReceivedMessage {
                    topic: String::from_utf8_lossy(&arrived.topic).into_owned(),
                    payload: arrived.payload.to_vec(),
                    retained: arrived.retain,
                    redelivered: arrived.dup,
                };
                news.arrived(arrived);
                false
            }
            Ok(Event::Incoming(Packet::PubAck(acknowledged))) => {
                tally().acknowledged(acknowledged.pkid);
                true
            }
            Ok(Event::Incoming(Packet::UnsubAck(_))) => {
                tally().is_answered();
                true
            }
            Ok(Event::Outgoing(Outgoing::Publish(id))) => {
                tally().written(id);
                true
            }
            Ok(Event::Outgoing(Outgoing::PingReq)) => {
                let mut tally = tally();
                let now = clock.time_of_day().before(MARGIN);
                tally.pinged = Some(tally.unwritten.front().map_or(now, |told| now.min(*told)));
                false
            }
            Ok(Event::Incoming(Packet::PingResp)) => {
                let mut tally = tally();
                tally.heard = tally.heard.max(tally.pinged.take().unwrap_or_default());
                false
            }
            Ok(_) => false,
            Err(error) => {
                tracing::debug!(%error, "no MQTT");
                // If this fails, the receiver is gone.
                let _ = news.heard.send(BrokerReport::Lost(fault(&error))).await;
                return;
            }
        };
        if is_room {
            news.room.notify_one();
        }
    }
}

fn fault(error: &ConnectionError) -> Fault {
    match error {
        ConnectionError::Io(error)
        | ConnectionError::MqttState(
            StateError::Io(error) | StateError::Deserialization(Unreadable::Io(error)),
        ) => fault_of(error),
        ConnectionError::NetworkTimeout | ConnectionError::FlushTimeout => Fault::Silent,
        ConnectionError::MqttState(StateError::AwaitPingResp) => Fault::Silent,
        ConnectionError::ConnectionRefused(code) => match code {
            ConnectReturnCode::BadUserNamePassword => Fault::WrongUser,
            ConnectReturnCode::NotAuthorized => Fault::NotAllowed,
            ConnectReturnCode::RefusedProtocolVersion => {
                Fault::Refused("the broker does not support MQTT 3.1.1")
            }
            ConnectReturnCode::BadClientId => {
                Fault::Refused("the broker rejects the client ID of the gateway")
            }
            ConnectReturnCode::ServiceUnavailable => {
                Fault::Refused("the broker reports that it is not available")
            }
            ConnectReturnCode::Success => Fault::NoMqtt,
        },
        ConnectionError::MqttState(StateError::Deserialization(Unreadable::InvalidConnectReturnCode(
            code,
        ))) => refusal_of_mqtt_5(*code),
        // A CONNACK packet of MQTT 5 is longer than one of MQTT 3.1.1.
        ConnectionError::MqttState(StateError::Deserialization(Unreadable::PayloadSizeIncorrect)) => {
            Fault::Refused(MQTT_5_ONLY)
        }
        ConnectionError::MqttState(StateError::Deserialization(Unreadable::PayloadSizeLimitExceeded(_))) => {
            Fault::TooLong(LARGEST_IN >> 20)
        }
        // Some brokers refuse a subscription with a reason code of MQTT 5, which the library does not know.
        ConnectionError::MqttState(StateError::Deserialization(Unreadable::InvalidSubscribeReasonCode(
            _,
        ))) => Fault::Broken,
        ConnectionError::NotConnAck(_) | ConnectionError::MqttState(StateError::Deserialization(_)) => {
            Fault::NoMqtt
        }
        _ => Fault::Broken,
    }
}

/// Converts a reason code of MQTT 5, which some brokers send to clients of MQTT 3.1.1, to a fault.
fn refusal_of_mqtt_5(code: u8) -> Fault {
    match code {
        0x84 => Fault::Refused(MQTT_5_ONLY),
        0x85 => Fault::Refused("the broker rejects the client ID of the gateway"),
        0x86 => Fault::WrongUser,
        0x87 => Fault::NotAllowed,
        0x88 | 0x89 => Fault::Refused("the broker reports that it is not available"),
        _ => Fault::NoMqtt,
    }
}

/// Converts a failed TLS handshake to a fault that contains the cause and a remedy.
fn tls_fault(fault: TlsFault) -> Fault {
    let remedy = match fault {
        TlsFault::OtherName => Some(
            "write the name in the certificate into `broker`, or the path of this certificate into the \
             profile: `tls = { ca = \"…\" }`",
        ),
        TlsFault::UnknownAuthority => {
            Some("write the path of the authority's certificate into the profile: `tls = { ca = \"…\" }`")
        }
        TlsFault::BadCertificate => Some(
            "to trust a self-signed certificate, write its path into the profile: `tls = { ca = \"…\" }`",
        ),
        TlsFault::OursMissing => {
            Some("write the paths of a certificate and its key into `cert` and `key` of `tls`")
        }
        TlsFault::OursExpired => Some("renew the certificate that `cert` names in `tls`"),
        TlsFault::OursRefused => {
            Some("make the broker trust the authority that signed the certificate in `cert` of `tls`")
        }
        TlsFault::NoTls => Some("try another port, or mqtt://"),
        TlsFault::Silent => Some("does the server speak TLS at this port, or plain MQTT (mqtt://)?"),
        _ => None,
    };
    Fault::Tls(fault.advised(remedy))
}

/// Converts the error of a connection to a fault.
fn fault_of(error: &io::Error) -> Fault {
    match error.get_ref().and_then(|inside| inside.downcast_ref::<ConnectError>()) {
        Some(ConnectError::Unresolved) => Fault::NoAddress,
        Some(ConnectError::Unreachable(error)) => Fault::Unreachable(error.kind()),
        Some(ConnectError::UnfitName) => {
            Fault::Tls("a certificate cannot contain the name in `broker`".to_owned())
        }
        Some(ConnectError::Tls(fault)) => tls_fault(*fault),
        None => {
            // If the connection ended within a message (`Other`), the server does not speak MQTT.
            let is_within = error.kind() == io::ErrorKind::Other;
            TlsFault::of(error).map_or(if is_within { Fault::NoMqtt } else { Fault::Broken }, tls_fault)
        }
    }
}

fn qos(qos: Qos) -> QoS {
    match qos {
        Qos::AtMostOnce => QoS::AtMostOnce,
        Qos::AtLeastOnce => QoS::AtLeastOnce,
    }
}

#[cfg(test)]
mod tests;
