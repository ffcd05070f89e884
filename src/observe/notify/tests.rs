//! Tests of the thread that sends messages, and of its end.

use std::net::TcpListener;
use std::sync::Mutex;
use std::sync::mpsc::channel;

use super::*;
use crate::observe::events::{Change, Event};
use isotherm_core::quantity::Moment;
use isotherm_profile::Url;

#[tokio::test]
async fn where_another_program_takes_its_place_nobody_waits_and_what_did_not_arrive_is_told() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = Url::parse(&format!("http://{}", listener.local_addr().unwrap())).unwrap();
    let notify =
        Notify { name: "notify[0]".into(), url, on: vec!["zeroed"], token_file: None, ca: None, body: None };
    let outboxes = Outboxes(vec![Arc::new(Outbox::of(&notify, "press", false))]);
    let receives = outboxes.listener().unwrap();
    let told = Arc::new(Mutex::new(Vec::new()));
    let tell = told.clone();
    let report = Arc::new(move |delivery| tell.lock().unwrap().push(delivery));
    let trust = |_: &Notify| Err("nobody is asked for that".to_owned());
    let posting = outboxes.posted(report, Rules::default(), trust).unwrap().unwrap();
    let (event, change) = (Event::Zeroed, Change::default());
    let entry = event.entry(Moment::default());
    (0..3).for_each(|_| receives(ReportedEvent { event: &event, entry: &entry, change: &change }));
    // The server accepts the connection, and never answers.
    let (arrived, wait) = channel();
    std::thread::spawn(move || arrived.send(listener.accept().unwrap()));
    let _open = wait.recv().unwrap();
    posting.finish(async {}).await;
    let to = notify.url.to_string();
    assert_eq!(*told.lock().unwrap(), [Delivery::Dropped { notify: "notify[0]".into(), to, count: 3 }]);
}
