//! Arming that waits: every display shows for what, it can be cancelled, and it expires.

use std::time::Duration;

use crate::commands::bench::{Bench, OPEN_CIRCUIT};
use crate::commands::process::{Running, isotherm, until};

const SOON: Duration = Duration::from_secs(60);

#[test]
fn who_arms_with_a_broken_sensor_hears_what_is_waited_for_until_the_axis_is_armed() {
    let bench = Bench::manual();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    let mut requester = Running::start(&mut bench.verb(&["arm"]));
    requester.receives("z: waiting to arm: bed has an open circuit");
    let axis = bench.is_in_state("waiting");
    assert_eq!((&axis["armed"], &axis["cause"]), (&false.into(), &"bed has an open circuit".into()));
    let asked = axis["waiting"]["asked"].as_str().unwrap();
    assert!(asked.starts_with("by ") && asked.ends_with(" over the command socket"), "{asked}");
    assert!((60.0..120.1).contains(&axis["waiting"]["expires_s"].as_f64().unwrap()), "{axis}");
    assert!(bench.reported("command")[0].contains("z: waiting to arm: bed has an open circuit"));
    let (_, metrics) = bench.http("GET", "/metrics", "");
    assert!(metrics.contains("state=\"waiting\"} 1"), "{metrics}");

    bench.device.asks(0);
    requester.receives("z: armed");
    assert_eq!(requester.ends_within(SOON).code(), Some(0));
    let axis = bench.is_in_state("active");
    assert_eq!(axis["waiting"], serde_json::Value::Null);
    assert!(bench.reported("armed")[0].contains("over the command socket"), "{:?}", bench.reported("armed"));
}

#[test]
fn each_other_reason_is_told_to_whoever_waits() {
    let bench = Bench::manual();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    let mut requester = Running::start(&mut bench.verb(&["arm"]));
    requester.receives("bed has an open circuit");
    bench.device.hold();
    requester.hears_one_of(&["bed: no answer in time", "bed: stale", "cnc_z"]);
    bench.device.release();
    requester.receives("bed has an open circuit");
    bench.device.asks(0);
    requester.receives("z: armed");
}

#[test]
fn who_waits_and_goes_does_not_want_it_any_more() {
    for signal in ["INT", "KILL"] {
        let bench = Bench::manual();
        bench.device.asks(OPEN_CIRCUIT);
        bench.why("bed has an open circuit");
        let mut requester = Running::start(&mut bench.verb(&["arm"]));
        requester.receives("waiting to arm");
        bench.is_in_state("waiting");
        requester.signal(signal);
        requester.ends_within(SOON);
        bench.is_in_state("off");
        bench.device.asks(0);
        std::thread::sleep(Duration::from_secs(2));
        assert_eq!(bench.axis()["armed"], false, "{signal}");
        assert!(
            bench.reported("arm-ended")[0]
                .contains("cancelled: the client that requested to arm has disconnected"),
            "{signal}"
        );
    }
}

#[test]
fn who_does_not_want_to_stay_leaves_it_waiting_and_anybody_can_take_it_back() {
    let bench = Bench::manual();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    let (code, said) = bench.ask(&["arm", "--no-wait", "--axis", "z"]);
    assert_eq!((code, said.contains("z: waiting to arm: bed has an open circuit")), (1, true), "{said}");
    bench.is_in_state("waiting");
    assert_eq!(bench.http("POST", "/api/cancel?axis=z", "isotherm-way: page\r\n").0, 200);
    let axis = bench.is_in_state("off");
    let why = axis["why"].as_str().unwrap();
    assert_eq!(why, "cancelled by 127.0.0.1 on the web page; arm the axis again");
    let (code, said) = bench.http("POST", "/api/cancel", "");
    assert_eq!((code, said.as_str()), (409, r#"{"done":false,"answer":"no request to arm is waiting"}"#));

    let (code, said) = bench.http("POST", "/api/arm", "");
    assert_eq!((code, said.contains("waiting to arm: bed has an open circuit")), (202, true), "{said}");
    assert_eq!(bench.ask(&["disarm"]).0, 0);
    bench.is_in_state("off");

    bench.http("POST", "/api/arm", "");
    bench.device.asks(0);
    bench.is_in_state("active");
}

#[test]
fn a_request_that_waits_for_too_long_expires() {
    let manual = "arm = \"manual\"\narm_timeout = \"2s\"";
    let bench = Bench::of(|text| text.replace("arm = \"auto\"", manual));
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    let (code, said) = bench.ask(&["arm"]);
    let expired = "the request to arm has expired after 2s: bed has an open circuit";
    assert_eq!((code, said.contains(expired)), (1, true), "{said}");
    assert!(bench.axis()["why"].as_str().unwrap().starts_with(expired));
    assert!(bench.reported("arm-ended")[0].contains(expired));
    bench.device.asks(0);
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(bench.axis()["armed"], false);
}

#[test]
fn who_is_refused_hears_why_at_once_and_nothing_is_armed_later() {
    let bench = Bench::manual();
    bench.device.puts(30_000);
    until("it is read", || match bench.http("GET", "/api/status", "").1 {
        status if status.contains("3000") => Ok(()),
        status => Err(status),
    });
    let (code, said) = bench.ask(&["arm"]);
    assert_eq!((code, said.contains("holds 3000.0 µm, beyond the limit")), (1, true), "{said}");
    assert!(bench.reported("command-refused")[0].contains("beyond the limit"));
    bench.device.puts(0);
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(bench.axis()["armed"], false);
    assert_eq!(bench.ask(&["arm"]).0, 0);
}

#[test]
fn verbs_find_the_gateway_that_was_started_with_another_state_directory() {
    let bench = Bench::of(|text| {
        text.replace("arm = \"auto\"", "arm = \"manual\"").replacen("name = \"", "name = \"elsewhere-", 1)
    });
    let asked = |words: &[&str]| {
        let (verb, options) = words.split_first().unwrap();
        let mut command = isotherm(bench.home.path());
        let output = command.arg(verb).arg(&bench.profile).args(options).output().unwrap();
        let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        (output.status.code(), said)
    };
    let (code, said) = asked(&["arm"]);
    let state = format!("runs with --state {}", bench.home.path().join("state").display());
    assert!(code == Some(0) && said.contains(&state) && said.contains("armed"), "{code:?} {said}");
    let (code, said) = asked(&["events"]);
    assert!(code == Some(0) && said.contains("arm"), "{code:?} {said}");
    let (code, said) = asked(&["status"]);
    assert!(code == Some(0) && said.contains("axis "), "{code:?} {said}");
    // A query creates no directory.
    assert!(!bench.home.path().join(".local").exists());
    let (code, said) = asked(&["disarm", "--state", "nowhere"]);
    assert!(
        code == Some(1) && said.contains("no gateway of this machine is running here"),
        "{code:?} {said}"
    );
}
