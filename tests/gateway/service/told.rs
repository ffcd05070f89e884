//! Notifications to the service manager, from the start to the end.

use std::time::Duration;

use crate::service::process::free_port;
use crate::service::rig::Service;

#[test]
fn a_gateway_is_ready_when_its_lines_were_tried_and_says_in_words_what_it_does() {
    let mut service = Service::start(|text| text);
    assert!(service.manager.heard.iter().all(|reported| !reported.contains("STOPPING")));
    service.manager.receives("WATCHDOG=1");
    service.walks_to(50);
    assert_eq!(service.verb(&["disarm"]).status.code(), Some(0));
    // On a busy computer an answer of the device may have been lost before.
    service.manager.receives("STATUS=z off\n");
    // The first status may have come with the readiness or after it.
    let heard = service.manager.heard.join("");
    assert!(heard.contains("STATUS=z compensating\n"), "{heard}");
    let again = service.manager.rest();
    assert!(
        again.iter().all(|reported| !reported.contains("STATUS=")),
        "only what is new is reported: {again:?}"
    );
}

#[test]
fn a_device_that_is_absent_keeps_no_gateway_from_being_started_and_is_named() {
    let nobody = format!("127.0.0.1:{}", free_port());
    let mut service = Service::start(|text| {
        let (before, after) = text.split_once("address = \"").unwrap();
        let (_, after) = after.split_once('"').unwrap();
        format!("{before}address = \"{nobody}\"{after}")
    });
    let heard = service.manager.heard.join("") + &service.manager.receives("WATCHDOG=1");
    assert!(heard.contains("STATUS=z waiting to arm; no answer from cnc\n"), "{heard}");
}

#[test]
fn a_stop_asks_for_the_time_that_its_fault_actions_take_until_they_are_over() {
    let mut service = Service::start(|text| text.replace("\"hold\"", "\"zero\""));
    service.walks_to(400);
    service.gateway.signal("TERM");
    let stopping = service.manager.receives("STOPPING=1");
    assert!(stopping.contains("STATUS=stopping: the fault actions run\n"), "{stopping}");
    // Another test checks that it reaches zero in time, on a computer that does not pause.
    let _ = service.gateway.ends_within(Duration::from_secs(60));
    let reported = service.manager.rest();
    let span = |reported: &String| reported.trim().strip_prefix("EXTEND_TIMEOUT_USEC=")?.parse().ok();
    let spans: Vec<u64> = reported.iter().filter_map(span).collect();
    // Forty steps of 0.1 s, and 10 s to save the state.
    assert!(spans.len() >= 2, "asked for again and again: {reported:?}");
    assert!(spans[0] > 14_000_000 && spans.windows(2).all(|pair| pair[1] < pair[0]), "{spans:?}");
    assert!(reported.iter().all(|reported| !reported.contains("RELOADING")));
}

#[test]
fn a_stop_that_holds_is_short_and_says_so() {
    let mut service = Service::start(|text| text.replace("[bus.cell]", "on_stop = \"hold\"\n[bus.cell]"));
    service.walks_to(200);
    service.gateway.signal("TERM");
    let stopping = service.manager.receives("STOPPING=1");
    assert!(stopping.contains("STATUS=stopping: the registers keep their values\n"), "{stopping}");
    let status = service.gateway.ends_within(Duration::from_secs(60));
    assert_eq!((status.code(), service.device.offset()), (Some(0), 200), "{:?}", service.gateway.said);
}
