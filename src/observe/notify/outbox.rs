//! What waits to be posted to one server.

use std::collections::VecDeque;
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify as Wakeup;

use super::message::Message;
use crate::observe::events::{Delivery, Event, Happened};
use isotherm_core::compensation::AxisState;
use isotherm_profile::{ALARM, ALARM_OVER, AXIS_OFF, CLOCK, Notify, UNVERIFIED};

/// So many wait. What is newest tells most of what is to be done now: of more the oldest go.
const MOST: usize = 100;
/// What "unverified" means.
const OF_UNVERIFIED: [&str; 5] =
    ["verify-failed", "write-failed", "read-failed", "not-applied", "not-read-back"];
/// What "clock" means.
const OF_THE_CLOCK: [&str; 2] = ["clock-set", "clock-doubtful"];

/// The queue of one server.
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
    /// One is out of the queue, and has not arrived.
    is_under_way: bool,
    /// So many have been laid in since the start.
    count: u64,
    /// So many have been dropped that the server has not been told of.
    dropped: u64,
    losses: Losses,
}

/// What was dropped, and is reported: at once, then each time that it has doubled, and when nothing waits any more.
#[derive(Debug, Default)]
struct Losses {
    unreported: u64,
    reported: u64,
}

impl Losses {
    /// So many more; how many are to be reported now.
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
    /// An empty one.
    pub fn of(notify: &Notify, machine: &str, dry_run: bool) -> Outbox {
        let (notify, machine) = (notify.clone(), machine.to_owned());
        Outbox { notify, machine, dry_run, queue: Mutex::default(), wakeup: Wakeup::new() }
    }

    /// Whose it is.
    pub fn notify(&self) -> &Notify {
        &self.notify
    }

    /// Takes what the profile wants to be posted there. It waits for nothing but this queue, which nobody holds while he waits.
    pub fn hear(&self, happened: Happened<'_>) {
        if !self.wants(happened) {
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

    fn wants(&self, Happened { event, entry, change }: Happened<'_>) -> bool {
        // That nothing arrives there would not arrive there.
        if matches!(event, Event::Delivery(delivery) if delivery.notify() == self.notify.name) {
            return false;
        }
        self.notify.on.iter().any(|word| match *word {
            ALARM => change.raised.is_some(),
            ALARM_OVER => !change.ended.is_empty(),
            AXIS_OFF => loses_its_axis(event),
            UNVERIFIED => OF_UNVERIFIED.contains(&entry.kind.as_ref()),
            CLOCK => OF_THE_CLOCK.contains(&entry.kind.as_ref()),
            kind => entry.kind == kind,
        })
    }

    /// The next message, as soon as there is one.
    pub(super) async fn next(&self) -> Message {
        loop {
            if let Some(message) = self.take() {
                return message;
            }
            self.wakeup.notified().await;
        }
    }

    /// The next message, if there is one. It is under way until [`Outbox::arrived`] or [`Outbox::given_up`].
    pub(super) fn take(&self) -> Option<Message> {
        let mut queue = self.queue();
        let message = queue.waiting.pop_front();
        queue.is_under_way = message.is_some();
        message
    }

    /// How many have been dropped, for the message that is posted now.
    pub(super) fn dropped(&self) -> u64 {
        self.queue().dropped
    }

    /// What was under way has arrived, and with it that so many were dropped. How many are to be reported now.
    pub(super) fn arrived(&self, told: u64) -> Option<u64> {
        let mut queue = self.queue();
        queue.is_under_way = false;
        queue.dropped = queue.dropped.saturating_sub(told);
        let is_over = queue.waiting.is_empty();
        queue.losses.more(told, is_over)
    }

    /// What was under way is not tried again.
    pub(super) fn given_up(&self) {
        let mut queue = self.queue();
        queue.is_under_way = false;
        queue.dropped += 1;
    }

    /// How many never arrive when this is the end.
    pub(super) fn left(&self) -> u64 {
        let queue = self.queue();
        queue.dropped + u64::from(queue.is_under_way) + queue.waiting.len() as u64
    }

    /// That they were dropped, at the end, where there are some.
    pub(super) fn all_dropped(&self) -> Option<Delivery> {
        let (notify, to) = (self.notify.name.clone(), self.notify.url.to_string());
        let count = self.left() + self.queue().losses.unreported;
        (count > 0).then_some(Delivery::Dropped { notify, to, count })
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An axis that followed a model does not any more. That the gateway was asked to stop is no news.
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
        let notify = Notify { name: "notify[0]".into(), url, on: on.to_vec(), token_file: None, ca: None };
        Outbox::of(&notify, "press", false)
    }

    fn hear(outbox: &Outbox, event: &Event, change: Change) -> bool {
        let before = outbox.left();
        outbox.hear(Happened { event, entry: &event.entry(Moment::default()), change: &change });
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
        assert!(hear(&outbox(&["device-lost"]), &lost, raised()));
        assert!(!hear(&outbox(&["device-back"]), &lost, raised()));
        assert!(hear(&outbox(&["alarm"]), &lost, raised()));
        assert!(!hear(&outbox(&["alarm"]), &lost, ended()));
        assert!(hear(&outbox(&["alarm", "alarm-over"]), &lost, ended()));
        let write_failed = Event::WriteFailed { output: "cnc_z".into(), fault: "timeout".into() };
        let set = Event::ClockDoubtful { last: Moment::default() };
        for (word, event, is_posted) in [
            ("unverified", &write_failed, true),
            ("unverified", &set, false),
            ("clock", &set, true),
            ("clock", &write_failed, false),
        ] {
            assert_eq!(hear(&outbox(&[word]), event, Change::default()), is_posted, "{word} {event:?}");
        }
        let off = outbox(&["axis-off"]);
        for (event, is_posted) in [
            (state("active", "holding", false), true),
            (state("degraded", "off", false), true),
            (state("holding", "ramping", false), false),
            (state("active", "degraded", false), false),
            (state("active", "ramping", true), false),
        ] {
            assert_eq!(hear(&off, &event, Change::default()), is_posted, "{event:?}");
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
        assert!(!hear(&outbox, &failed("notify[0]"), raised.clone()));
        assert!(hear(&outbox, &failed("notify[1]"), raised));
    }

    #[test]
    fn of_more_than_a_hundred_the_oldest_go_and_are_counted() {
        let outbox = outbox(&["zeroed"]);
        (0..130).for_each(|_| assert!(hear(&outbox, &Event::Zeroed, Change::default())));
        assert_eq!((outbox.dropped(), outbox.left()), (30, 130));
        let first = outbox.take().unwrap();
        assert_eq!(first.json(30)["count"], 31);
        assert_eq!(outbox.left(), 130, "it has not arrived yet");
        assert_eq!(outbox.arrived(30), Some(30));
        assert_eq!((outbox.dropped(), outbox.left()), (0, 99));
        outbox.take().unwrap();
        outbox.given_up();
        assert_eq!((outbox.dropped(), outbox.left()), (1, 99));
        // Not reported at once, because that is fewer than before: at the end it is.
        outbox.take().unwrap();
        assert_eq!(outbox.arrived(1), None);
        let (notify, to) = ("notify[0]".to_owned(), "https://a.example".to_owned());
        assert_eq!(outbox.all_dropped(), Some(Delivery::Dropped { notify, to, count: 98 }));
    }
}
