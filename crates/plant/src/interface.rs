//! Interface between the gateway and a message format.

use isotherm_core::quantity::Moment;

mod message;
mod snapshot;

pub use message::{Command, Message, Outcome, Qos, Reaction, Record, Subscription};
pub use snapshot::{Importance, Metric, PlantEvent, Snapshot, Subject, Value};

/// Message format, as a state machine that stores what has been published.
///
/// The gateway calls the functions in this order:
///
/// - [`will`](Publisher::will) directly before each attempt to connect;
/// - [`subscriptions`](Publisher::subscriptions) and [`connected`](Publisher::connected) when the broker has accepted
///   the connection;
/// - [`publish`](Publisher::publish) and [`received`](Publisher::received) while it is open;
/// - [`disconnected`](Publisher::disconnected) when it is lost, and [`absent`](Publisher::absent) until the next one;
/// - [`farewell`](Publisher::farewell) at the end.
///
/// Each event is in one snapshot only, which is passed to `connected`, `publish` or `absent`.
///
/// `now` is monotonic: setting a clock does not change it. It determines which messages may be undelivered. Time stamps
/// are in wall-clock time, by the [shift](Snapshot::shift) of the snapshot.
pub trait Publisher: Send {
    /// Will message, which the broker publishes when the connection is lost.
    fn will(&mut self) -> Message;

    /// Subscriptions of this connection; empty if no messages are accepted.
    fn subscriptions(&self) -> Vec<Subscription>;

    /// Handles an accepted connection. Returns messages with everything that a new subscriber requires.
    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message>;

    /// Returns messages for values that have changed, or that have not been published for too long. The gateway calls
    /// it when there is room for all messages, possibly more often than necessary.
    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message>;

    /// Handles a received message. The snapshot contains no events; they are in the next snapshot.
    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction;

    /// Handles a lost connection. `last_received` is the time of the last message from the broker. Messages that were
    /// published after it may be undelivered, and are returned as records to store.
    fn disconnected(&mut self, last_received: Moment) -> Vec<Record>;

    /// Returns records to store while there is no connection, for publication later.
    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record>;

    /// Makes messages from stored records, which are passed oldest first. The gateway calls it between `publish`, with
    /// a few records at a time, until all are published. A record that cannot be read gives no message.
    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message>;

    /// Returns whether [`forward`](Publisher::forward) may be called. If not, it returns no messages for valid records
    /// either.
    fn may_forward(&self) -> bool {
        true
    }

    /// Returns whether new events must be published after the stored records. Otherwise records contain their own
    /// times.
    fn publishes_in_order(&self) -> bool {
        false
    }

    /// Number that the next run must know: the death number (bdSeq) of a Sparkplug node.
    fn number_to_keep(&self) -> Option<u8> {
        None
    }

    /// Number of values, records and events that were lost since the last call.
    fn left_out(&mut self) -> u64 {
        0
    }

    /// Returns the last messages before the gateway closes the connection.
    fn farewell(&mut self, now: Moment) -> Vec<Message>;
}
