//! Hours with a broker that is unreachable, slow or gone, in simulated time.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::*;
use crate::clock::{BootClock, TimeOfDay};
use crate::observe::events::file::FileItem;
use crate::observe::events::{Entry, Level};
use crate::observe::requester::Requester;
use crate::observe::status::{Answer, BrokerStatus, Command, ReleaseRequest, Status};
use isotherm_core::compensation::MeasuredReport;
use isotherm_plant::{Json, JsonSettings, Subscription};

mod arrived;
mod dated;
mod host;
mod refused;
mod stopped;

/// A gateway in which a set number of events happens between two samples of its status.
#[derive(Default)]
struct Machine {
    happened: Mutex<(u64, u64)>,
    looks: Mutex<u64>,
    /// Measured errors that were accepted.
    measured: Mutex<Vec<MeasuredReport>>,
    reported: Mutex<Vec<Event>>,
}

impl Machine {
    /// Sets the number of events between two samples.
    fn is_busy(&self, events: u64) {
        self.happened.lock().unwrap().1 = events;
    }

    /// Adds events since the last sample.
    fn has(&self, events: u64) {
        self.happened.lock().unwrap().0 += events;
    }

    fn happened(&self) -> u64 {
        self.happened.lock().unwrap().0
    }

    fn looks(&self) -> u64 {
        *self.looks.lock().unwrap()
    }

    fn said(&self) -> Vec<String> {
        let reported = self.reported.lock().unwrap();
        reported.iter().map(|event| event.entry(Moment::default()).text).collect()
    }
}

impl GatewayApi for Machine {
    fn status(&self) -> Status {
        *self.looks.lock().unwrap() += 1;
        let mut happened = self.happened.lock().unwrap();
        happened.0 += happened.1;
        let entry = |number: u64| Entry {
            at: "2026-07-02T12:00:00Z".into(),
            kind: "zeroed".into(),
            level: Level::Info,
            text: format!("number {number}"),
            data: serde_json::Value::Null,
        };
        Status {
            machine: "press".into(),
            label: String::new(),
            description: String::new(),
            version: "1",
            now: "2026-07-02T12:00:00Z".into(),
            zone: String::new(),
            clock: "virtual",
            uptime_s: 1.0,
            machine_on_s: None,
            language: None,
            overridden: Vec::new(),
            profile_changed: Vec::new(),
            dry_run: false,
            stopping: false,
            ready: true,
            axes: Vec::new(),
            signals: Vec::new(),
            buses: Vec::new(),
            devices: Vec::new(),
            outputs: Vec::new(),
            left: Vec::new(),
            log_dropped: 0,
            alarms: Vec::new(),
            events: (happened.0.saturating_sub(200)..happened.0).map(entry).collect(),
            event_counts: [("zeroed", happened.0)].into(),
            mqtt: None,
            lock_held: Vec::new(),
        }
    }

    fn command(&self, _: Command, _: Option<&str>, _: &Arc<Requester>) -> Result<Answer, String> {
        panic!("nobody commands over the broker")
    }

    fn arming(&self, _: Option<&str>) -> Result<Answer, String> {
        panic!("nobody arms over the broker")
    }

    fn signing(&self, _: Option<&str>) -> Result<Answer, String> {
        panic!("nobody moves over the broker")
    }

    fn measured(&self, _: &str, report: Option<MeasuredReport>, _: &Requester) -> Result<Answer, String> {
        self.measured.lock().unwrap().extend(report);
        Ok(Answer::Done(String::new()))
    }

    fn acknowledge(&self, _: Option<&str>, _: &Requester) -> Result<Answer, String> {
        panic!("nobody acknowledges over the broker")
    }

    fn confirm(&self, _: &str, _: &Requester) -> Result<Answer, String> {
        panic!("no device is confirmed over the broker")
    }

    fn release(&self, _: &str, _: ReleaseRequest<'_>, _: &Requester) -> Result<Answer, String> {
        panic!("no register is released over the broker")
    }

    fn logs(&self, _: Moment, _: Moment) -> Option<Vec<PathBuf>> {
        None
    }

    fn turned_away(&self, _: &str, _: &Requester, _: &str) {}

    fn report(&self, event: &Event) {
        self.reported.lock().unwrap().push(event.clone());
    }

    fn events(&self, _: Moment, _: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()> {
        Ok(())
    }
}

/// A broker with adjustable faults.
#[derive(Clone, Default)]
struct Fake(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    is_away: bool,
    /// Connected, but accepts no message.
    is_full: bool,
    /// No data passes in either direction.
    is_cut_off: bool,
    /// Topics of which a message closes the connection.
    denies: Vec<String>,
    /// Topic of the denied message that closes the connection.
    closing: Option<String>,
    /// Topics of which a subscription is refused.
    refuses: Vec<String>,
    /// Topics of which a subscription closes the connection.
    closes_on: Vec<String>,
    /// Subscriptions, each with the number of messages that came before it.
    subscribed: Vec<(String, usize)>,
    attempts: u64,
    taken: Vec<Message>,
    /// Time up to which all messages have arrived; `None` if all have.
    last_received: Option<Moment>,
    arrives: VecDeque<ReceivedMessage>,
}

impl Fake {
    /// Queues a message for the gateway.
    fn brings(&self, topic: &str, payload: &[u8]) {
        self.delivers(topic, payload, false);
    }

    /// Queues a message as a repeated delivery.
    fn brings_again(&self, topic: &str, payload: &[u8]) {
        self.delivers(topic, payload, true);
    }

    fn delivers(&self, topic: &str, payload: &[u8], redelivered: bool) {
        let arrived =
            ReceivedMessage { topic: topic.into(), payload: payload.into(), retained: false, redelivered };
        self.0.lock().unwrap().arrives.push_back(arrived);
    }

    /// Queues a retained message.
    fn has_retained(&self, topic: &str, payload: &[u8]) {
        let arrived = ReceivedMessage {
            topic: topic.into(),
            payload: payload.into(),
            retained: true,
            redelivered: false,
        };
        self.0.lock().unwrap().arrives.push_back(arrived);
    }
}

impl Broker for Fake {
    type Connection = Fake;

    async fn connect(&self, _: Option<Message>) -> Result<Fake, Fault> {
        if self.0.lock().unwrap().is_cut_off {
            std::future::pending::<()>().await;
        }
        let mut state = self.0.lock().unwrap();
        state.attempts += 1;
        state.closing = None;
        match state.is_away {
            true => Err(Fault::Silent),
            false => Ok(self.clone()),
        }
    }

    fn packet(&self) -> ConnectPacket {
        let state = self.0.lock().unwrap();
        match state.is_away || state.is_cut_off {
            true => ConnectPacket::NotSent,
            false => ConnectPacket::Sent,
        }
    }
}

impl Connection for Fake {
    fn send(&mut self, message: Message, _: Moment) -> Result<(), Message> {
        let mut state = self.0.lock().unwrap();
        if state.is_full {
            return Err(message);
        }
        if state.denies.contains(&message.topic) {
            state.closing = Some(message.topic.clone());
        }
        if !state.is_cut_off && state.closing.is_none() {
            state.taken.push(message);
        }
        Ok(())
    }

    async fn subscribe(&mut self, subscription: &Subscription) -> Result<SubscriptionAnswer, Fault> {
        tokio::time::sleep(Duration::from_millis(100)).await;
        let mut state = self.0.lock().unwrap();
        let before = state.taken.len();
        state.subscribed.push((subscription.filter.clone(), before));
        if state.closes_on.contains(&subscription.filter) {
            return Err(Fault::NotSubscribed(subscription.filter.clone()));
        }
        match state.refuses.contains(&subscription.filter) {
            true => Ok(SubscriptionAnswer::Refused),
            false => Ok(SubscriptionAnswer::Accepted),
        }
    }

    fn request_answer(&mut self, _: &str) {}

    async fn next(&mut self) -> BrokerReport {
        loop {
            {
                let mut state = self.0.lock().unwrap();
                if state.is_away || state.closing.is_some() {
                    return BrokerReport::Lost(Fault::Broken);
                }
                if let Some(arrived) = state.arrives.pop_front() {
                    return BrokerReport::Arrived(arrived);
                }
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    fn last_received(&self) -> Moment {
        self.0.lock().unwrap().last_received.unwrap_or(Moment::END)
    }

    fn is_done(&self) -> bool {
        let state = self.0.lock().unwrap();
        !state.is_cut_off && state.closing.is_none()
    }

    async fn close(self) {}
}

/// Runs the publisher with a broker until `day` is over. Returns the publishing status at that time.
async fn run(machine: &Arc<Machine>, broker: &Fake, day: impl Future<Output = ()>) -> BrokerStatus {
    run_as((json(false), RecordQueue::in_memory()), machine, broker, day).await
}

/// Runs this publisher in the same way.
async fn run_as(
    publisher: (Box<dyn Publisher>, RecordQueue),
    machine: &Arc<Machine>,
    broker: &Fake,
    day: impl Future<Output = ()>,
) -> BrokerStatus {
    // Without a file, it remembers nothing.
    run_with(Memory::of_topics(Path::new("/not/there")), publisher, machine, broker, day).await
}

/// Runs this publisher with what it has published in earlier runs.
async fn run_with(
    memory: Memory,
    (publisher, kept): (Box<dyn Publisher>, RecordQueue),
    machine: &Arc<Machine>,
    broker: &Fake,
    day: impl Future<Output = ()>,
) -> BrokerStatus {
    let source: Arc<dyn GatewayApi> = machine.clone();
    let figures = Arc::new(BrokerFigures::of("mqtt://here".into()));
    #[allow(clippy::disallowed_types, reason = "the paused clock of the test itself")]
    let begun = tokio::time::Instant::now();
    let runner = Runner {
        publisher,
        memory,
        source,
        figures: figures.clone(),
        // Clock that follows the runtime's paused time.
        clock: Clock::wall_by(BootClock::by(move || begun.elapsed()), TimeOfDay::default()),
        commands: Commands::from("mqtt://here"),
        address: "mqtt://here".into(),
        every: Duration::from_secs(1),
        resolutions: Vec::new(),
        happenings: EventQueue::default(),
        seen: Default::default(),
        kept,
        outbox: VecDeque::new(),
        denials: Denials::default(),
        outage: Outage::default(),
        host: "scada".into(),
        host_report: HostReport::default(),
    };
    let (stop, stopped) = watch::channel(false);
    let day = async {
        day.await;
        let went = figures.read();
        stop.send_replace(true);
        went
    };
    tokio::join!(runner.run(broker.clone(), stopped), day).1
}

fn json(takes_measured: bool) -> Box<dyn Publisher> {
    Box::new(Json::new(JsonSettings {
        group: "g".into(),
        machine: "press".into(),
        version: "1".into(),
        refresh: Duration::from_secs(60),
        takes_measured,
        home_assistant: false,
    }))
}

async fn passes(seconds: u64) {
    tokio::time::sleep(Duration::from_secs(seconds)).await;
}

/// Numbers of the events that the broker has received, in order.
fn events_of(broker: &Fake) -> Vec<u64> {
    let state = broker.0.lock().unwrap();
    state.taken.iter().flat_map(|message| numbers(&message.payload)).collect()
}

fn numbers(payload: &[u8]) -> Vec<u64> {
    let text = String::from_utf8_lossy(payload);
    let digits = |rest: &str| rest.chars().take_while(char::is_ascii_digit).collect::<String>();
    text.split("number ").skip(1).map(|rest| digits(rest).parse().unwrap()).collect()
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_is_away_for_an_hour_is_tried_ever_more_seldom_and_told_of_once() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().is_away = true;
    let went = run(&machine, &broker, passes(3600)).await;
    let attempts = broker.0.lock().unwrap().attempts;
    assert!((120..300).contains(&attempts), "{attempts}");
    assert_eq!((went.connected, went.fault.as_str(), went.queued), (false, "no answer", 0));
    let said = machine.said();
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].starts_with("nothing is published to mqtt://here: no answer"), "{said:?}");
}

#[tokio::test(start_paused = true)]
async fn what_happens_meanwhile_is_told_once_each_when_it_is_back() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().is_away = true;
    machine.is_busy(1);
    let went = run(&machine, &broker, async {
        passes(600).await;
        broker.0.lock().unwrap().is_away = false;
        passes(120).await;
    })
    .await;
    assert_eq!((went.connected, went.dropped, went.queued), (true, 0, 0));
    let told = events_of(&broker);
    assert!(told.len() > 650, "{}", told.len());
    let last = told.last().copied().unwrap();
    assert_eq!(told, (0..=last).collect::<Vec<_>>(), "each once, in its order");
    let said = machine.said();
    assert!(said.len() == 2 && said[1].contains("connected after"), "{said:?}");
}

#[tokio::test(start_paused = true)]
async fn what_was_told_in_vain_is_told_again_before_what_waits_behind_it() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().is_away = true;
    machine.is_busy(1);
    let before = Mutex::new(0);
    run(&machine, &broker, async {
        passes(800).await;
        let begun = broker.0.lock().unwrap().attempts;
        broker.0.lock().unwrap().is_away = false;
        while broker.0.lock().unwrap().attempts == begun {
            passes(1).await;
        }
        // Half of the queued events have been published, and none has arrived.
        while events_of(&broker).is_empty() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        {
            let mut state = broker.0.lock().unwrap();
            (state.is_away, state.last_received) = (true, Some(Moment::default()));
        }
        passes(5).await;
        *before.lock().unwrap() = events_of(&broker).len();
        broker.0.lock().unwrap().is_away = false;
        passes(60).await;
    })
    .await;
    let before = *before.lock().unwrap();
    assert_eq!(before, 500, "at a time");
    let told = events_of(&broker)[before..].to_vec();
    let last = told.last().copied().unwrap();
    assert_eq!(told, (0..=last).collect::<Vec<_>>());
}

#[tokio::test(start_paused = true)]
async fn more_than_has_room_is_dropped_counted_and_told_once() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().is_away = true;
    machine.is_busy(150);
    let went = run(&machine, &broker, async {
        passes(300).await;
        machine.is_busy(0);
        broker.0.lock().unwrap().is_away = false;
        passes(120).await;
    })
    .await;
    let told = u64::try_from(events_of(&broker).len()).unwrap();
    assert_eq!(told, 1000, "so many have room");
    assert_eq!(told + went.dropped, machine.happened());
    let dropped = format!("{} messages to mqtt://here dropped", went.dropped);
    assert_eq!(machine.said().iter().filter(|said| said.starts_with(&dropped)).count(), 1);
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_takes_nothing_gets_the_newest_state_later_and_a_thousand_events() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().is_full = true;
    machine.is_busy(50);
    let most = Mutex::new(0);
    let went = run(&machine, &broker, async {
        for _ in 0..600 {
            passes(1).await;
        }
        broker.0.lock().unwrap().is_full = false;
        machine.is_busy(0);
        passes(10).await;
        *most.lock().unwrap() = broker.0.lock().unwrap().taken.len();
    })
    .await;
    let taken = *most.lock().unwrap();
    assert!((1000..1200).contains(&taken), "{taken} messages waited");
    assert!(went.dropped > 20_000, "{}", went.dropped);
    assert_eq!(went.queued, 0);
}
