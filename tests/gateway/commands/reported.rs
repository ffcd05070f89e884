//! Every command is an event with the command, its channel, its sender and its result.

use std::time::Duration;

use serde_json::json;

use crate::commands::bench::Bench;
use crate::commands::process::until;

#[test]
fn whoever_commands_by_whatever_way_is_reported() {
    let bench = Bench::manual();
    until("a good reading, and the register is known", || match bench.axis() {
        axis if axis["raw_um"].is_number() && axis["verified_um"].is_number() => Ok(()),
        axis => Err(axis.to_string()),
    });
    assert_eq!(bench.ask(&["arm"]).0, 0);
    assert_eq!(bench.http("POST", "/api/disarm", "").0, 200);
    assert_eq!(bench.http("POST", "/api/arm?axis=z", "isotherm-way: page\r\n").0, 200);
    assert_eq!(bench.http("POST", "/api/arm?axis=q", "").0, 409);
    assert_eq!(bench.ask(&["measured", "--axis", "z", "--error", "3.2"]).0, 1);
    assert_eq!(bench.http("POST", "/api/zero", "Origin: http://elsewhere.example\r\n").0, 403);

    let (code, said) = bench.ask(&["zero", "--axis", "z"]);
    assert!(code == 0 && said.starts_with("z: nothing is captured: "), "{code} {said}");
    let (code, said) = bench.ask(&["zero", "--axis", "q"]);
    assert_eq!((code, said.contains("there is no axis q; there are z")), (1, true), "{said}");

    let events = bench.events(&[]);
    let of_commands = events.iter().filter(|event| event["kind"].as_str().unwrap().starts_with("command"));
    let reported: Vec<_> = of_commands.map(|event| (event["kind"].clone(), event["data"].clone())).collect();
    let uid = rustix::process::getuid().as_raw();
    let word = |place: usize, word: &str| reported[place].1[word].as_str().unwrap().to_owned();
    assert!(word(0, "who").ends_with(&format!("uid {uid})")) || word(0, "who") == format!("uid {uid}"));
    assert_eq!([word(0, "command"), word(0, "way"), word(0, "answer")], ["arm", "socket", "z: armed"]);
    assert_eq!(reported[0].1["axes"], json!(["z"]));
    assert_eq!([word(1, "command"), word(1, "way"), word(1, "who")], ["disarm", "api", "127.0.0.1"]);
    assert_eq!([word(2, "command"), word(2, "way"), word(2, "answer")], ["arm", "page", "z: armed"]);
    let refused: Vec<&str> = reported[3..].iter().map(|(kind, _)| kind.as_str().unwrap()).collect();
    assert_eq!(
        refused,
        ["command-refused", "command-refused", "command-refused", "command", "command-refused"]
    );
    assert_eq!(word(3, "why"), "there is no axis q; there are z");
    assert_eq!(word(4, "command"), "measured 3.2 µm");
    assert_eq!(word(5, "command"), "zero");
    assert!(word(5, "why").starts_with("Commands from a browser"));
    let armed: Vec<_> = events.iter().filter(|event| event["kind"] == "armed").collect();
    assert_eq!([&armed[0]["data"]["way"], &armed[1]["data"]["way"]], ["socket", "page"]);
}

#[test]
fn a_zero_says_what_is_captured_and_without_such_a_reference_what_to_write() {
    let bench = Bench::manual();
    let (code, said) = bench.ask(&["zero"]);
    let words = ["uses the reference \"zero\"", "Write reference = \"zero\"", "datum = \"zero\""];
    assert!(code == 0 && words.iter().all(|word| said.contains(word)), "{code} {said}");
    assert!(bench.events(&[]).iter().all(|event| event["kind"] != "zeroed"));
    let changes: [fn(String) -> String; 2] = [
        |text| text.replace("reference = 0.0", "reference = \"zero\""),
        |text| text.replace("limit = 2000.0", "limit = 2000.0\ndatum = \"zero\""),
    ];
    for change in changes {
        let bench = Bench::of(change);
        let (code, said) = bench.ask(&["zero"]);
        assert_eq!((code, said.trim()), (0, "references are captured from now on"));
        assert_eq!(bench.events(&[]).iter().filter(|event| event["kind"] == "zeroed").count(), 1);
    }
}

#[test]
fn a_reading_that_fails_is_no_write_that_fails() {
    let bench = Bench::manual();
    let text = std::fs::read_to_string(&bench.profile).unwrap();
    // The device does not have this register.
    let other = crate::commands::process::file(
        bench.home.path(),
        "other.toml",
        &text.replace("holding:10", "holding:11"),
    );
    let read = crate::commands::process::isotherm(bench.home.path()).arg("read").arg(other).output().unwrap();
    let said = String::from_utf8([read.stdout, read.stderr].concat()).unwrap();
    assert!(said.contains("output cnc_z: the register cannot be read: "), "{said}");
    assert!(!said.contains("not written") && !said.contains("write-failed"), "{said}");
}

#[test]
fn arming_by_the_profile_and_after_a_restart_are_told_apart() {
    let mut bench = Bench::of(|text| text);
    bench.device.asks(30);
    bench.is_in_state("active");
    until("it has arrived", || match bench.device.offset() {
        30 => Ok(()),
        offset => Err(format!("{offset}")),
    });
    // The verified value is on disk at the end.
    bench.restart();
    bench.is_in_state("active");
    let armed = bench.events(&[]).into_iter().filter(|event| event["kind"] == "armed");
    let ways: Vec<_> = armed.map(|event| event["data"]["way"].as_str().unwrap().to_owned()).collect();
    assert_eq!(ways, ["auto", "restart"]);

    // The control was switched off and on: its register is zero again.
    bench.device.puts(0);
    until("it goes on", || match bench.reported("goes-on").len() {
        1 => Ok(()),
        _ => Err(format!("{:?}", bench.reported("cnc-restarted"))),
    });
    std::thread::sleep(Duration::from_millis(100));
}

#[test]
fn after_a_kill_the_wait_for_late_writes_is_logged_with_its_length() {
    let mut bench = Bench::of(|text| text);
    bench.is_in_state("active");
    bench.restart();
    bench.is_in_state("active");
    assert_eq!(bench.reported("waits-after-start"), [""; 0], "an orderly stop leaves no write behind");
    bench.gateway.signal("KILL");
    bench.gateway.ends_within(Duration::from_secs(60));
    bench.restart_killed();
    let waits = bench.reported("waits-after-start");
    assert!(waits.len() == 1 && waits[0].contains("waits 30s for late writes"), "{waits:?}");
}
