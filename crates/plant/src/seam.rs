//! What stands between the gateway and a format of messages.

use isotherm_core::quantity::Moment;

mod message;
mod snapshot;

pub use message::{Command, Message, Outcome, Qos, Reaction, Record, Subscription};
pub use snapshot::{Happening, Importance, Metric, Snapshot, Subject, Value};

/// A format of messages: a state machine that knows what the broker has been told.
///
/// The order of the calls: [`will`](Publisher::will) right before each attempt to connect, then
/// [`subscriptions`](Publisher::subscriptions) and [`connected`](Publisher::connected) once the broker has taken the connection,
/// [`publish`](Publisher::publish) and [`received`](Publisher::received) while it lasts,
/// [`disconnected`](Publisher::disconnected) when it has broken, [`absent`](Publisher::absent) until the next one.
/// [`farewell`](Publisher::farewell) is the last. Each event is in one snapshot only, given to `connected`, `publish` or `absent`.
///
/// `now` is counted: no clock that is set moves it, and what may not have arrived is found by it. Stamps have the time of day, by
/// the [shift](Snapshot::shift) of the snapshot.
pub trait Publisher: Send {
    /// What the broker sends to everybody when the connection breaks.
    fn will(&mut self) -> Message;

    /// What the broker is asked for on this connection; empty where nothing may arrive.
    fn subscriptions(&self) -> Vec<Subscription>;

    /// The broker has taken the connection. Everything is told that whoever comes anew has to know.
    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message>;

    /// The state now: what has changed, or has not been told for too long, becomes messages. It is called when there is room for
    /// them all, and may be called more often than there is something to tell.
    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message>;

    /// A message has arrived. The snapshot has no events: they are told by whoever gets it next.
    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction;

    /// The connection has broken. The broker was last heard at this moment: what was told after it may never have arrived, and
    /// comes back to be kept.
    fn disconnected(&mut self, last_heard: Moment) -> Vec<Record>;

    /// The state now, while there is no connection: what of it is to be kept and told later.
    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record>;

    /// Records that were kept, oldest first, as messages. It is called between `publish`, a few records at a time, until there
    /// are none left; nothing comes of a record that cannot be read.
    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message>;

    /// [`forward`](Publisher::forward) may be called. While it may not, nothing comes of records that can be read, too.
    fn may_forward(&self) -> bool {
        true
    }

    /// What happens now is told behind what waits. Otherwise records say themselves when they were.
    fn tells_in_order(&self) -> bool {
        false
    }

    /// How much could not be told, and never will be, since this was asked last.
    fn left_out(&mut self) -> u64 {
        0
    }

    /// The gateway ends: what is told before the connection is closed.
    fn farewell(&mut self, now: Moment) -> Vec<Message>;
}
