//! Interface between the gateway and the format of its MQTT messages.

use isotherm_core::quantity::Moment;

mod host;
mod message;
mod snapshot;

pub use host::PrimaryHost;
pub use message::{Command, Message, Outcome, Qos, Reaction, Record, Subscription};
pub use snapshot::{Importance, Metric, PlantEvent, Snapshot, Subject, Value};

/// Format of the MQTT messages. An implementation stores the values that it published last, to find the
/// values that have changed.
///
/// The gateway calls the functions in this order:
///
/// - [`will`](Publisher::will) directly before each attempt to connect;
/// - [`connect_sent`](Publisher::connect_sent) when a CONNECT packet with this will was sent;
/// - [`subscriptions`](Publisher::subscriptions) when the broker has accepted the connection;
/// - [`connected`](Publisher::connected) when the broker has answered the subscriptions, and the
///   [primary host](Publisher::host) is present. Until then, it calls [`absent`](Publisher::absent);
/// - [`publish`](Publisher::publish) while the connection is open, and [`received`](Publisher::received) from the first
///   subscription;
/// - [`disconnected`](Publisher::disconnected) when the connection is lost, then [`absent`](Publisher::absent) until
///   the next connection;
/// - [`farewell`](Publisher::farewell) at the end of the gateway's run.
///
/// Each event is in one snapshot only, which the gateway passes to `connected`, `publish` or `absent`.
///
/// `now` is monotonic time, which does not change when a clock is set. It determines which messages may be undelivered.
/// Time stamps in messages are wall-clock time: `now` plus the [shift](Snapshot::shift) of the snapshot.
pub trait Publisher: Send {
    /// Returns the will message, which the broker publishes when the connection is lost.
    fn will(&mut self) -> Message;

    /// Records that a CONNECT packet with the last will was sent, whether or not the broker has accepted the
    /// connection.
    fn connect_sent(&mut self) {}

    /// Returns the subscriptions of this connection; empty if the gateway accepts no messages.
    fn subscriptions(&self) -> Vec<Subscription>;

    /// Returns the state of the host that must be present before [`connected`](Publisher::connected) is called. If it
    /// goes offline, the gateway publishes the [`farewell`](Publisher::farewell) and closes the connection.
    fn host(&self) -> PrimaryHost {
        PrimaryHost::NotNeeded
    }

    /// Returns whether a retained message on this topic is passed to [`received`](Publisher::received). Retained
    /// commands are refused, because they may be old.
    fn takes_retained(&self, _topic: &str) -> bool {
        false
    }

    /// Handles an accepted connection. Returns messages with the whole state, for subscribers that do not know it yet.
    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message>;

    /// Returns messages for values that have changed, or whose last publication is too long ago. The gateway calls this
    /// function when no earlier message waits for the broker, possibly more often than necessary.
    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message>;

    /// Handles a received message. The snapshot contains no events; they are in the next snapshot.
    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction;

    /// Handles a lost connection. `last_received` is the time of the last message from the broker. Messages that were
    /// published after this time may be undelivered. The function returns them as records to store.
    fn disconnected(&mut self, last_received: Moment) -> Vec<Record>;

    /// Returns records to store while there is no connection. They are published later.
    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record>;

    /// Makes messages from stored records, oldest first. Between two calls of `publish`, the gateway passes a few
    /// records at a time, until all are published. A record that cannot be read gives no message.
    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message>;

    /// Returns whether [`forward`](Publisher::forward) may be called. If `false`, `forward` would return no messages,
    /// even for valid records.
    fn may_forward(&self) -> bool {
        true
    }

    /// Returns whether new events must wait until the stored records are published. If `false`, the order does not
    /// matter, because each record contains the times of its values.
    fn publishes_in_order(&self) -> bool {
        false
    }

    /// Returns the number of the last will, which the gateway stores before it sends a CONNECT packet. A Sparkplug node
    /// has such a number, the death number (bdSeq). Returns `None` if the format has no such number.
    fn number_to_keep(&self) -> Option<u8> {
        None
    }

    /// Returns the number of the last will (see [`Publisher::number_to_keep`]) in the last CONNECT packet that was
    /// sent. Returns `None` if no packet was ever sent, or the format has no such number.
    fn number_sent(&self) -> Option<u8> {
        None
    }

    /// Returns the number of values, records and events that were lost since the last call of this function.
    fn left_out(&mut self) -> u64 {
        0
    }

    /// Returns the last messages before the gateway closes the connection.
    fn farewell(&mut self, now: Moment) -> Vec<Message>;
}
