//! What a person sees and presses in a real browser while arming waits. Needs chromium and python3, as `tests/page.rs`.

use std::process::Command;

use crate::bench::{Bench, OPEN_CIRCUIT};

#[test]
fn a_person_sees_what_arming_waits_for_takes_it_back_and_reads_what_happened_before_the_restart() {
    let mut bench = Bench::manual();
    bench.ask(&["disarm"]);
    bench.restart();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    bench.ask(&["arm", "--no-wait"]);
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let seen = Command::new("python3")
        .arg(look)
        .arg(format!("http://{}/", bench.page))
        .args(["waiting to arm: bed has an open circuit", "over the socket; given up in 1 min", "stopped; "])
        .args([
            "click:Show the last 24 hours",
            "stopped; ",
            "click:Cancel",
            "the request to arm is taken back",
        ])
        .args(["on the page; arm it again", "cancelled by 127.0.0.1 on the page"])
        .output();
    let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let said = [seen.stdout, seen.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    assert!(seen.status.success(), "{said}\n(without chromium: `tests/run page`)");
    assert_eq!(bench.axis()["state"], "off");
    let command = bench.events(&[]).into_iter().rfind(|event| event["kind"] == "command").unwrap();
    assert_eq!(command["data"]["way"], "page");
}
