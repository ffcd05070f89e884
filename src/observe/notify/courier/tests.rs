//! Hours with a failing server, in simulated time.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::*;
use crate::observe::events::{Change, Event, ReportedEvent};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Notify, Url};

/// A server that gives these answers, one after the other, and then accepts everything.
#[derive(Default)]
struct Fake {
    answers: Mutex<VecDeque<Answer>>,
    taken: Mutex<Vec<serde_json::Value>>,
}

enum Answer {
    No(Failure),
    Never,
}

impl Fake {
    fn failing(times: usize, failure: &Failure) -> Fake {
        let answers = (0..times).map(|_| Answer::No(failure.clone())).collect();
        Fake { answers: Mutex::new(answers), taken: Mutex::default() }
    }

    /// Fields `count` and `dropped` of each accepted message.
    fn taken(&self) -> Vec<(u64, u64)> {
        let number = |message: &serde_json::Value, key: &str| message[key].as_u64().unwrap();
        self.taken.lock().unwrap().iter().map(|one| (number(one, "count"), number(one, "dropped"))).collect()
    }
}

impl Post for Fake {
    async fn post(&self, body: &str) -> Result<(), Failure> {
        let next = self.answers.lock().unwrap().pop_front();
        match next {
            Some(Answer::No(failure)) => Err(failure),
            Some(Answer::Never) => std::future::pending().await,
            None => {
                self.taken.lock().unwrap().push(serde_json::from_str(body).unwrap());
                Ok(())
            }
        }
    }
}

fn outbox() -> Outbox {
    let url = Url::parse("https://a.example/secret").unwrap();
    let notify =
        Notify { name: "notify[0]".into(), url, on: vec!["zeroed"], token_file: None, ca: None, body: None };
    Outbox::of(&notify, "press", false)
}

fn lay(outbox: &Outbox, messages: usize) {
    for _ in 0..messages {
        let (event, change) = (Event::Zeroed, Change::default());
        outbox.receive(ReportedEvent {
            event: &event,
            entry: &event.entry(Moment::default()),
            change: &change,
        });
    }
}

/// Events that were reported until no message waits or the span is over.
async fn carried(
    outbox: &Outbox,
    server: &impl Post,
    span: Duration,
    while_it_runs: impl Future<Output = ()>,
) -> Vec<String> {
    let reported = RefCell::new(Vec::new());
    let (stop, stopped) = watch::channel(false);
    let report =
        |delivery| reported.borrow_mut().push(Event::Delivery(delivery).entry(Moment::default()).text);
    let ends = async {
        while_it_runs.await;
        tokio::time::sleep(span).await;
        stop.send_replace(true);
    };
    tokio::join!(carry(outbox, server, Rules::default(), report, stopped), ends);
    reported.into_inner()
}

const HOUR: Duration = Duration::from_secs(3600);

#[tokio::test(start_paused = true)]
async fn a_first_failure_and_the_return_are_told_once_each_and_nothing_is_lost() {
    let (outbox, server) = (outbox(), Fake::failing(7, &Failure::Refused));
    lay(&outbox, 3);
    let said = carried(&outbox, &server, HOUR, async {}).await;
    assert_eq!(server.taken(), [(1, 0), (2, 0), (3, 0)]);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[0].starts_with("notify[0]: a message to https://a.example has not arrived: no program listens"),
        "{said:?}"
    );
    assert!(said[1].contains("arrive again, after 7 attempts that failed"), "{said:?}");
    assert!(!said.concat().contains("secret"));
}

#[tokio::test(start_paused = true)]
async fn pauses_grow_to_two_minutes_and_a_message_is_given_up_after_twelve_attempts() {
    let (outbox, server) = (outbox(), Fake::failing(12, &Failure::Answered(500, None)));
    lay(&outbox, 2);
    let clock = tokio::time::sleep(Duration::from_secs(450));
    let half = async {
        clock.await;
        assert_eq!(server.taken(), [], "it is tried for a quarter of an hour");
    };
    let said = carried(&outbox, &server, HOUR, half).await;
    assert_eq!(server.taken(), [(2, 1)]);
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(said[2].contains("dropped 1 message to https://a.example"), "{said:?}");
    for (failures, least, most) in [(1, 0.75, 1.0), (4, 6.0, 8.0), (8, 90.0, 120.0), (4000, 90.0, 120.0)] {
        let pause = Rules::default().pause(failures).as_secs_f64();
        assert!(least <= pause && pause <= most, "{failures}: {pause}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_server_that_says_how_long_to_wait_is_left_alone_for_so_long() {
    let pause = Some(Duration::from_secs(600));
    let (outbox, server) = (outbox(), Fake::failing(1, &Failure::Answered(429, pause)));
    lay(&outbox, 1);
    let early = async {
        tokio::time::sleep(Duration::from_secs(599)).await;
        assert_eq!(server.taken(), []);
    };
    carried(&outbox, &server, Duration::from_secs(2), early).await;
    assert_eq!(server.taken(), [(1, 0)]);
}

#[tokio::test(start_paused = true)]
async fn what_a_server_will_never_take_is_dropped_at_once_and_the_next_arrives() {
    let (outbox, server) = (outbox(), Fake::failing(1, &Failure::Answered(400, None)));
    lay(&outbox, 2);
    let said = carried(&outbox, &server, Duration::ZERO, async {}).await;
    assert_eq!(server.taken(), [(2, 1)]);
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(said[0].contains("the server answered 400: the server does not accept this message"), "{said:?}");
}

#[tokio::test(start_paused = true)]
async fn of_a_storm_at_a_server_that_is_silent_the_newest_hundred_arrive_and_the_others_are_counted() {
    let answers = (0..5).map(|_| Answer::Never).collect();
    let (outbox, server) = (outbox(), Fake { answers: Mutex::new(answers), taken: Mutex::default() });
    lay(&outbox, 1);
    let storm = async {
        tokio::time::sleep(Duration::from_secs(1)).await;
        lay(&outbox, 5000);
    };
    let said = carried(&outbox, &server, HOUR, storm).await;
    let taken = server.taken();
    assert_eq!((taken.len(), taken[0], taken[1], taken[100]), (101, (1, 4900), (4902, 0), (5001, 0)));
    assert!(said[0].contains("no answer within 10 s"), "{said:?}");
    assert!(said[2].contains("4900 messages"), "{said:?}");
    assert_eq!(said.len(), 3, "{said:?}");
}

#[tokio::test(start_paused = true)]
async fn at_the_end_what_waits_is_tried_once_more_and_no_pause_is_waited_out() {
    let (outbox, server) = (Arc::new(outbox()), Fake::failing(8, &Failure::Refused));
    lay(&outbox, 2);
    let ended = tokio::time::timeout(
        Duration::from_secs(20),
        carried(&outbox, &server, Duration::from_secs(10), async {}),
    );
    ended.await.expect("it waits for a pause");
    assert_eq!((server.taken(), outbox.left()), (Vec::new(), 2));
}

#[tokio::test(start_paused = true)]
async fn a_stop_waits_for_nobody_who_has_said_nothing_before() {
    // During the pause after the first attempt, and during the second attempt.
    for stopped_at in [10_200, 15_000].map(Duration::from_millis) {
        let answers = (0..9).map(|_| Answer::Never).collect();
        let (outbox, server) = (outbox(), Fake { answers: Mutex::new(answers), taken: Mutex::default() });
        lay(&outbox, 2);
        let ended = stopped_at + Duration::from_millis(1);
        let ended = tokio::time::timeout(ended, carried(&outbox, &server, stopped_at, async {})).await;
        assert_eq!((ended.is_ok(), outbox.left()), (true, 2), "{stopped_at:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn one_attempt_in_vain_is_no_news() {
    let (outbox, server) = (outbox(), Fake::failing(1, &Failure::Closed));
    lay(&outbox, 1);
    let said = carried(&outbox, &server, HOUR, async {}).await;
    assert_eq!((server.taken(), said), (vec![(1, 0)], Vec::new()));
}

/// A server that accepts everything, one second after the request.
struct Slow(Fake);

impl Post for Slow {
    async fn post(&self, body: &str) -> Result<(), Failure> {
        tokio::time::sleep(Duration::from_secs(1)).await;
        self.0.post(body).await
    }
}

#[tokio::test(start_paused = true)]
async fn what_a_slow_server_misses_of_a_long_storm_is_told_a_few_times() {
    let (outbox, server) = (outbox(), Slow(Fake::default()));
    let storm = async {
        for _ in 0..3600 {
            lay(&outbox, 10);
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    };
    let said = carried(&outbox, &server, HOUR, storm).await;
    let taken = server.0.taken();
    let dropped: u64 = taken.iter().map(|(_, dropped)| dropped).sum();
    assert_eq!(dropped + taken.len() as u64, 36_000);
    assert!(dropped > 30_000 && said.len() < 20, "{dropped} {said:?}");
    let count = |said: &String| said.split(' ').find_map(|word| word.parse::<u64>().ok()).unwrap();
    assert_eq!(said.iter().map(count).sum::<u64>(), dropped, "{said:?}");
}
