//! Queue of the messages that wait for one server of `[[notify]]`.

use std::collections::VecDeque;
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify as Wakeup;

use super::message::Message;
use crate::observe::events::{Delivery, Event, ReportedEvent};
use isotherm_core::compensation::AxisState;
use isotherm_profile::{ALARM, ALARM_OVER, AXIS_OFF, CLOCK, Notify, UNVERIFIED};

/// Maximum number of waiting messages. Above this number, the oldest messages are dropped, because the newest messages
/// are the most useful.
const MOST: usize = 100;

/// Queue of the messages that wait for one server of `[[notify]]`.
pub struct Outbox {
    notify: Notify,
    machine: String,
    dry_run: bool,
    queue: Mutex<Queue>,
    wakeup: Wakeup,
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<Message>,
    /// Whether a message was taken from the queue and is neither delivered nor given up.
    is_under_way: bool,
    /// Number of messages that were added since the start, including dropped messages.
    count: u64,
    /// Number of dropped messages that are not reported to the server yet.
    dropped: u64,
    losses: Losses,
}

/// Counter of the dropped messages. After a delivery, an event reports their number: the first time at once,
/// then whenever the number has doubled, and when the queue is empty.
#[derive(Debug, Default)]
struct Losses {
    unreported: u64,
    reported: u64,
}

impl Losses {
    /// Adds a number of dropped messages. `is_over` is true when the queue is empty. Returns the number that
    /// must be reported now; `None` if nothing must be reported.
    fn more(&mut self, count: u64, is_over: bool) -> Option<u64> {
        self.unreported += count;
        let is_news = self.unreported > 0 && (is_over || self.unreported >= self.reported);
        let news = is_news.then(|| std::mem::take(&mut self.unreported));
        self.reported = if is_over { 0 } else { self.reported + news.unwrap_or_default() };
        news
    }
}

impl fmt::Debug for Outbox {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Outbox({}, {} waiting)", self.notify.name, self.queue().waiting.len())
    }
}

impl Outbox {
    /// Creates an empty queue for the server of this `[[notify]]` entry.
    pub fn of(notify: &Notify, machine: &str, dry_run: bool) -> Outbox {
        let (notify, machine) = (notify.clone(), machine.to_owned());
        Outbox { notify, machine, dry_run, queue: Mutex::default(), wakeup: Wakeup::new() }
    }

    /// Returns the `[[notify]]` entry of the profile that describes the server of this queue.
    pub fn notify(&self) -> &Notify {
        &self.notify
    }

    /// Adds a message about this event, if the profile selects its kind for the server. The call waits only for the
    /// lock of this queue, which is held for a short time.
    pub fn receive(&self, happened: ReportedEvent<'_>) {
        if !self.includes(happened) {
            return;
        }
        let mut queue = self.queue();
        queue.count += 1;
        let message = Message::of(happened, &self.machine, queue.count, self.dry_run);
        if queue.waiting.len() == MOST {
            queue.waiting.pop_front();
            queue.dropped += 1;
        }
        queue.waiting.push_back(message);
        drop(queue);
        self.wakeup.notify_one();
    }

    fn includes(&self, ReportedEvent { event, entry, change }: ReportedEvent<'_>) -> bool {
        // A report about failed delivery to this server could not be delivered to it either.
        if matches!(event, Event::Delivery(delivery) if delivery.notify() == self.notify.name) {
            return false;
        }
        self.notify.on.iter().any(|word| match *word {
            ALARM => change.raised.is_some(),
            ALARM_OVER => !change.ended.is_empty(),
            AXIS_OFF => loses_its_axis(event),
            word @ (UNVERIFIED | CLOCK) => event.kind().word() == Some(word),
            kind => entry.kind == kind,
        })
    }

    /// Waits for the next message and takes it from the queue.
    pub(super) async fn next(&self) -> Message {
        loop {
            if let Some(message) = self.take() {
                return message;
            }
            self.wakeup.notified().await;
        }
    }

    /// Takes the next message from the queue; `None` if the queue is empty. After a message, the caller must call
    /// [`Outbox::arrived`] or [`Outbox::given_up`].
    pub(super) fn take(&self) -> Option<Message> {
        let mut queue = self.queue();
        let message = queue.waiting.pop_front();
        queue.is_under_way = message.is_some();
        message
    }

    /// Returns the number of dropped messages that the next message must report.
    pub(super) fn dropped(&self) -> u64 {
        self.queue().dropped
    }

    /// Records that a message was delivered. `told` is the number of dropped messages that this message reported.
    /// Returns the number of dropped messages to report as an event; `None` if nothing is reported.
    pub(super) fn arrived(&self, told: u64) -> Option<u64> {
        let mut queue = self.queue();
        queue.is_under_way = false;
        queue.dropped = queue.dropped.saturating_sub(told);
        let is_over = queue.waiting.is_empty();
        queue.losses.more(told, is_over)
    }

    /// Records that the present message was given up.
    pub(super) fn given_up(&self) {
        let mut queue = self.queue();
        queue.is_under_way = false;
        queue.dropped += 1;
    }

    /// Returns the number of messages that would be lost if the program ended now.
    pub(super) fn left(&self) -> u64 {
        let queue = self.queue();
        queue.dropped + u64::from(queue.is_under_way) + queue.waiting.len() as u64
    }

    /// Makes the event about all lost messages at the end of the program. `None` if no messages are lost.
    pub(super) fn all_dropped(&self) -> Option<Delivery> {
        let (notify, to) = (self.notify.name.clone(), self.notify.url.to_string());
        let count = self.left() + self.queue().losses.unreported;
        (count > 0).then_some(Delivery::Dropped { notify, to, count })
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns whether the event means that an axis has stopped following its model. A stop of the gateway does not count.
fn loses_its_axis(event: &Event) -> bool {
    let follows =
        |name: &str| [AxisState::Active, AxisState::Degraded].iter().any(|state| state.name() == name);
    matches!(event, Event::AxisState { from, to, stopping: false, .. } if follows(from) && !follows(to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::events::Change;
    use isotherm_core::quantity::Moment;
    use isotherm_profile::Url;

    fn outbox(on: &[&'static str]) -> Outbox {
        let url = Url::parse("https://a.example/secret?key=1").unwrap();
        let notify =
            Notify { name: "notify[0]".into(), url, on: on.to_vec(), token_file: None, ca: None, body: None };
        Outbox::of(&notify, "press", false)
    }

    fn receive(outbox: &Outbox, event: &Event, change: Change) -> bool {
        let before = outbox.left();
        outbox.receive(ReportedEvent { event, entry: &event.entry(Moment::default()), change: &change });
        outbox.left() > before
    }

    fn state(from: &'static str, to: &'static str, stopping: bool) -> Event {
        Event::AxisState { axis: "z".into(), from, to, why: "bed is lost".into(), stopping }
    }

    #[test]
    fn what_is_posted_is_what_the_profile_names() {
        let lost = Event::DeviceLost { device: "cnc".into(), at: String::new(), fault: "timeout".into() };
        let raised = || Change { raised: Some("device cnc".into()), ended: Vec::new() };
        let ended = || Change { raised: None, ended: vec!["device cnc".into()] };
        assert!(receive(&outbox(&["device-lost"]), &lost, raised()));
        assert!(!receive(&outbox(&["device-back"]), &lost, raised()));
        assert!(receive(&outbox(&["alarm"]), &lost, raised()));
        assert!(!receive(&outbox(&["alarm"]), &lost, ended()));
        assert!(receive(&outbox(&["alarm", "alarm-over"]), &lost, ended()));
        let write_failed = Event::WriteFailed { output: "cnc_z".into(), fault: "timeout".into() };
        let set = Event::ClockDoubtful { last: Moment::default() };
        for (word, event, is_posted) in [
            ("unverified", &write_failed, true),
            ("unverified", &set, false),
            ("clock", &set, true),
            ("clock", &write_failed, false),
        ] {
            assert_eq!(receive(&outbox(&[word]), event, Change::default()), is_posted, "{word} {event:?}");
        }
        let off = outbox(&["axis-off"]);
        for (event, is_posted) in [
            (state("active", "holding", false), true),
            (state("degraded", "off", false), true),
            (state("holding", "ramping", false), false),
            (state("active", "degraded", false), false),
            (state("active", "ramping", true), false),
        ] {
            assert_eq!(receive(&off, &event, Change::default()), is_posted, "{event:?}");
        }
    }

    #[test]
    fn nobody_is_told_that_nothing_reaches_him_and_another_is() {
        let failed = |notify: &str| {
            let (notify, to, why) = (notify.to_owned(), "https://a".to_owned(), "refused".to_owned());
            Event::Delivery(Delivery::Failed { notify, to, why })
        };
        let outbox = outbox(&["notify-failed", "alarm"]);
        let raised = Change { raised: Some("messages of notify[0]".into()), ended: Vec::new() };
        assert!(!receive(&outbox, &failed("notify[0]"), raised.clone()));
        assert!(receive(&outbox, &failed("notify[1]"), raised));
    }

    #[test]
    fn of_more_than_a_hundred_the_oldest_go_and_are_counted() {
        let outbox = outbox(&["zeroed"]);
        (0..130).for_each(|_| assert!(receive(&outbox, &Event::Zeroed, Change::default())));
        assert_eq!((outbox.dropped(), outbox.left()), (30, 130));
        let first = outbox.take().unwrap();
        assert_eq!(first.json(30)["count"], 31);
        assert_eq!(outbox.left(), 130, "it has not arrived yet");
        assert_eq!(outbox.arrived(30), Some(30));
        assert_eq!((outbox.dropped(), outbox.left()), (0, 99));
        outbox.take().unwrap();
        outbox.given_up();
        assert_eq!((outbox.dropped(), outbox.left()), (1, 99));
        // The number is smaller than the last one, so that it is reported only at the end.
        outbox.take().unwrap();
        assert_eq!(outbox.arrived(1), None);
        let (notify, to) = ("notify[0]".to_owned(), "https://a.example".to_owned());
        assert_eq!(outbox.all_dropped(), Some(Delivery::Dropped { notify, to, count: 98 }));
    }
}
