//! Sign check of an axis with a dial gauge: by an operator at a terminal, by a script, by a program.

use std::io::Write;
use std::time::Duration;

use crate::commands::bench::{Bench, OPEN_CIRCUIT};
use crate::commands::device::What;
use crate::commands::process::{Running, until};

const SOON: Duration = Duration::from_secs(60);
/// Time that an operator needs to walk to the gauge, read it and return to the keyboard.
const AT_HUMAN_SPEED: Duration = Duration::from_secs(10);

/// Bench whose axis compensates at 0 µm.
fn bench() -> Bench {
    let bench = Bench::of(|text| text.replace("limit = 2000.0", "limit = 40.0"));
    bench.is_in_state("active");
    bench
}

fn offset(bench: &Bench) -> i16 {
    bench.device.state().offset()
}

/// Waits until the register holds this value.
#[track_caller]
fn stands_at(bench: &Bench, count: i16) {
    until("the offset is there", || match offset(bench) {
        found if found == count => Ok(()),
        found => Err(found.to_string()),
    });
}

#[test]
fn a_person_at_a_terminal_is_guided_and_the_answer_is_kept_over_a_restart() {
    let mut bench = bench();
    let mut asked = Running::start(&mut bench.verb(&["sign", "--axis", "z"]));
    asked.receives("Put a dial gauge");
    assert_eq!(bench.count("command"), 0, "nothing moves before the operator confirms");
    asked.stdin().write_all(b"\n").unwrap();
    asked.receives("z: Cz goes from 0.0 µm to 5.0 µm");
    let there = asked.receives("z: Cz has changed by 5.0 µm; read the gauge now");
    assert!(
        !asked.so_far().iter().any(|line| line.contains("must have moved")),
        "the answer is not known yet: {there}"
    );
    stands_at(&bench, 50);
    let sign = bench.axis()["sign"].clone();
    assert_eq!((&sign["by_um"], &sign["there"]), (&5.0.into(), &true.into()), "{sign}");
    asked.stdin().write_all(b"perhaps\nplus\n").unwrap();
    let said = asked.receives("the sign is right");
    let expected =
        "z: the tool must have moved by 5.0 µm in plus direction of z, relative to the workpiece; ";
    assert!(said.starts_with(expected), "{said}");
    assert_eq!(asked.ends_within(SOON).code(), Some(0));
    stands_at(&bench, 0);
    let steps: Vec<String> =
        crate::commands::device::acted_wrongly(&bench.device.state().seen, Duration::from_secs(3600));
    assert!(!steps.iter().any(|wrong| wrong.contains("in one write")), "{steps:?}");
    let event = bench.events(&[]).into_iter().find(|event| event["kind"] == "sign-checked").unwrap();
    assert_eq!((&event["data"]["moved"], &event["data"]["way"]), (&"plus".into(), &"socket".into()));
    assert!(event["data"]["who"].as_str().is_some_and(|who| !who.is_empty()), "{event}");
    bench.restart();
    assert_eq!(bench.axis()["sign_checked"][1], "plus");
}

#[test]
fn an_answer_after_ten_seconds_counts_at_a_terminal_and_over_the_api() {
    let bench = bench();
    let mut asked = Running::start(&mut bench.verb(&["sign", "--axis", "z"]));
    asked.receives("Put a dial gauge");
    std::thread::sleep(AT_HUMAN_SPEED);
    asked.stdin().write_all(b"\n").unwrap();
    asked.receives("read the gauge now");
    std::thread::sleep(AT_HUMAN_SPEED);
    assert_eq!((bench.axis()["sign"]["there"].clone(), offset(&bench)), (true.into(), 50));
    asked.stdin().write_all(b"plus\n").unwrap();
    asked.receives("the sign is right");
    assert_eq!(asked.ends_within(SOON).code(), Some(0));
    stands_at(&bench, 0);

    until("the axis stands still", || match bench.http("POST", "/api/sign?axis=z", "").0 {
        202 => Ok(()),
        code => Err(code.to_string()),
    });
    stands_at(&bench, 50);
    std::thread::sleep(AT_HUMAN_SPEED);
    let (code, said) = bench.http("POST", "/api/sign-plus?axis=z", "isotherm-way: page\r\n");
    assert!(code == 200 && said.contains("the sign is right"), "{said}");
    stands_at(&bench, 0);
    assert_eq!(bench.reported("sign-ended"), [""; 0]);
    assert_eq!(bench.reported("sign-checked").len(), 2);
}

#[test]
fn a_terminal_that_is_closed_at_the_gauge_ends_the_check() {
    for signal in ["INT", "HUP", "KILL"] {
        let bench = bench();
        let mut asked = Running::start(&mut bench.verb(&["sign"]));
        asked.stdin().write_all(b"\n").unwrap();
        asked.receives("read the gauge now");
        std::thread::sleep(Duration::from_secs(4));
        assert_eq!((bench.axis()["sign"]["there"].clone(), offset(&bench)), (true.into(), 50), "{signal}");
        asked.signal(signal);
        asked.ends_within(SOON);
        stands_at(&bench, 0);
        assert_eq!(bench.axis()["sign"], serde_json::Value::Null, "{signal}");
        let ended = bench.reported("sign-ended");
        assert!(ended.len() == 1 && ended[0].contains("has disconnected"), "{signal}: {ended:?}");
    }
}

#[test]
fn a_wrong_sign_is_said_with_what_to_do_and_a_program_may_check_too() {
    let bench = bench();
    let (code, said) = bench.ask(&["sign", "--axis", "z", "--answer", "minus"]);
    assert!(code == 1 && said.contains("the sign is WRONG") && said.contains("`scale`"), "{said}");
    assert!(bench.reported("sign-checked")[0].contains("WRONG"));
    // On a busy computer the offset may arrive before the answer. The test then tries again.
    let is_early = (0..20).any(|_| {
        stands_at(&bench, 0);
        until("the axis stands still", || match bench.http("POST", "/api/sign", "") {
            (202, _) => Ok(()),
            (code, said) => Err(format!("{code} {said}")),
        });
        let (code, said) = bench.http("POST", "/api/sign-plus", "");
        assert!(code == 200 || code == 409 && said.contains("does not hold the changed Cz yet"), "{said}");
        code == 409
    });
    assert!(is_early, "it was always there already");
    let (code, said) = bench.http("POST", "/api/sign", "");
    assert!(code == 409 && said.contains("being checked already"), "{said}");
    stands_at(&bench, 50);
    until("it is there", || match bench.axis()["sign"]["there"] == true {
        true => Ok(()),
        false => Err(bench.axis().to_string()),
    });
    assert_eq!(bench.http("POST", "/api/sign-plus?axis=z", "").0, 200);
    stands_at(&bench, 0);
    assert_eq!(bench.axis()["sign_checked"][1], "plus");
}

#[test]
fn who_goes_or_takes_it_back_or_switches_off_ends_it() {
    let bench = bench();
    let mut asked = Running::start(&mut bench.verb(&["sign"]));
    asked.stdin().write_all(b"\n").unwrap();
    asked.receives("read the gauge now");
    asked.signal("KILL");
    asked.ends_within(SOON);
    stands_at(&bench, 0);
    assert!(bench.reported("sign-ended")[0].contains("has disconnected"));
    assert_eq!(bench.axis()["sign"], serde_json::Value::Null);

    until("the axis stands still", || match bench.http("POST", "/api/sign", "").0 {
        202 => Ok(()),
        code => Err(code.to_string()),
    });
    stands_at(&bench, 50);
    let (code, said) = bench.http("POST", "/api/cancel", "");
    assert!(code == 200 && said.contains("Cz returns"), "{said}");
    stands_at(&bench, 0);
    assert!(bench.reported("sign-ended")[1].contains("cancelled by 127.0.0.1"));

    bench.ask(&["disarm"]);
    let (code, said) = bench.ask(&["sign", "--answer", "plus"]);
    assert!(code == 1 && said.contains("arm it first"), "{said}");
    assert_eq!((bench.axis()["sign_checked"].clone(), offset(&bench)), (serde_json::Value::Null, 0));
}

#[test]
fn the_check_waits_until_the_axis_is_ready() {
    let bench = bench();
    bench.device.asks(OPEN_CIRCUIT);
    bench.is_in_state("holding");
    let mut asked = Running::start(&mut bench.verb(&["sign", "--axis", "z"]));
    asked.receives("z: waiting until the axis is ready: bed has an open circuit");
    // Also a program waits: the gateway accepts the request, and moves nothing.
    let (code, said) = bench.http("POST", "/api/sign?axis=z", "");
    assert!(code == 202 && said.contains("the sign check waits for the axis"), "{code} {said}");
    assert_eq!((bench.axis()["sign"]["there"].clone(), offset(&bench)), (false.into(), 0));
    assert_eq!(bench.http("POST", "/api/cancel?axis=z", "").0, 200);
    bench.device.asks(0);
    asked.receives("Put a dial gauge");
    // The gateway accepts a check once a second.
    std::thread::sleep(Duration::from_millis(1100));
    asked.stdin().write_all(b"\n").unwrap();
    asked.receives("read the gauge now");
    asked.stdin().write_all(b"plus\n").unwrap();
    asked.receives("the sign is right");
    assert_eq!(asked.ends_within(SOON).code(), Some(0));
    stands_at(&bench, 0);
}

#[test]
fn without_a_gateway_nobody_is_sent_to_the_gauge() {
    let bench = bench();
    bench.gateway.signal("TERM");
    until("the gateway has ended", || match bench.ask(&["sign", "--axis", "z", "--answer", "plus"]) {
        (1, said) if said.contains("no gateway of this machine is running") => Ok(()),
        (_, said) => Err(said),
    });
    let (code, said) = bench.ask(&["sign", "--axis", "z"]);
    assert!(code == 1 && !said.contains("dial gauge"), "{said}");
}

#[test]
fn without_an_operator_or_for_an_unknown_axis_nothing_moves() {
    let bench = bench();
    bench.is_in_state("active");
    // Standard input has ended, so nobody can press Enter.
    let (code, said) = bench.ask(&["sign", "--axis", "z"]);
    assert!(code == 1 && said.contains("nothing was moved"), "{said}");
    let (code, said) = bench.ask(&["sign", "--axis", "q"]);
    assert!(code == 1 && said.contains("no axis `q`") && !said.contains("dial gauge"), "{said}");
    assert_eq!((bench.reported("sign-ended"), offset(&bench)), (Vec::new(), 0));
}

/// Bench whose axis has no model, and whose register was read.
fn unmodelled() -> Bench {
    let bench = Bench::of(|text| {
        let (before, behind) = text.split_once("[[axis.z.model]]").unwrap();
        let (_, output) = behind.split_once("[output.cnc_z]").unwrap();
        format!("{before}[output.cnc_z]{output}").replace("limit = 2000.0", "limit = 40.0")
    });
    holds(&bench, 0.0);
    bench
}

/// Waits until the gateway has read this value in the register, µm.
#[track_caller]
fn holds(bench: &Bench, um: f64) {
    until("the register was read", || match bench.axis()["verified_um"].as_f64() {
        Some(held) if (held - um).abs() < 1e-6 => Ok(()),
        _ => Err(bench.axis().to_string()),
    });
}

#[test]
fn an_axis_without_a_model_is_armed_for_the_check_and_off_again_after_it() {
    let bench = unmodelled();
    assert_eq!(
        (bench.axis()["state"].clone(), bench.axis()["has_model"].clone()),
        ("off".into(), false.into())
    );
    for (word, code, says) in [("plus", 0, "the sign is right"), ("minus", 1, "the sign is WRONG")] {
        let (ended, said) = bench.ask(&["sign", "--axis", "z", "--answer", word]);
        assert!(ended == code && said.contains(says), "{said}");
        bench.is_in_state("off");
        stands_at(&bench, 0);
        assert_eq!(bench.axis()["sign_checked"][1], word);
    }
    let state = bench.device.state();
    let written = state.seen.iter().filter_map(|seen| match seen.what {
        What::Wrote { to, .. } => Some(to),
        What::Asked { .. } | What::Looked => None,
    });
    let written: Vec<i16> = written.collect();
    drop(state);
    assert_eq!(
        (written.iter().min(), written.iter().max()),
        (Some(&0), Some(&50)),
        "+5 µm, and nothing else"
    );
    assert!(bench.reported("disarmed").iter().all(|text| text.contains("the sign check is over")));
    let (code, said) = bench.ask(&["arm", "--axis", "z"]);
    assert!(code == 1 && said.contains("no model"), "{said}");

    // Who leaves at the gauge leaves zero behind.
    let mut asked = Running::start(&mut bench.verb(&["sign", "--axis", "z"]));
    asked.stdin().write_all(b"\n").unwrap();
    asked.receives("read the gauge now");
    asked.signal("KILL");
    asked.ends_within(SOON);
    stands_at(&bench, 0);
    bench.is_in_state("off");
}

/// A gauge that was set to zero before this movement would show the wrong direction.
#[test]
fn a_register_that_does_not_hold_zero_returns_there_before_a_gauge_is_set() {
    let bench = unmodelled();
    for (before, word) in [(80, "plus"), (-30, "plus"), (120, "minus")] {
        bench.device.puts(before);
        holds(&bench, f64::from(before) / 10.0);
        let mut asked = Running::start(&mut bench.verb(&["sign", "--axis", "z"]));
        asked.receives("Enter moves the offset to zero");
        assert_eq!(offset(&bench), before, "nothing moves before the operator confirms");
        asked.stdin().write_all(b"\n").unwrap();
        asked.receives("Put a dial gauge");
        assert_eq!(offset(&bench), 0, "the gauge is set to zero where the movement begins");
        asked.stdin().write_all(b"\n").unwrap();
        asked.receives("read the gauge now");
        assert_eq!(offset(&bench), 50);
        asked.stdin().write_all(format!("{word}\n").as_bytes()).unwrap();
        assert_eq!(asked.ends_within(SOON).code(), Some(i32::from(word != "plus")));
        stands_at(&bench, 0);
        bench.is_in_state("off");
        assert_eq!(bench.axis()["sign_checked"][1], word);
    }
    // Over the API, the check ends at zero and says why.
    bench.device.puts(80);
    holds(&bench, 8.0);
    let before = bench.reported("sign-ended").len();
    let (code, said) = bench.http("POST", "/api/sign?axis=z", "");
    assert!(code == 202 && !said.contains("8.0"), "{code} {said}");
    until("the check has ended", || match &bench.reported("sign-ended")[before..] {
        [text] if text.contains("set the gauge to zero") => Ok(()),
        other => Err(format!("{other:?}")),
    });
    bench.is_in_state("off");
    stands_at(&bench, 0);
    assert_eq!(bench.axis()["sign"], serde_json::Value::Null);
    // A script needs no Enter.
    bench.device.puts(80);
    holds(&bench, 8.0);
    let (code, said) = bench.ask(&["sign", "--axis", "z", "--answer", "plus"]);
    assert!(code == 0 && said.contains("its register holds 8.0 µm"), "{said}");
}

#[test]
fn near_its_limit_it_is_refused() {
    let bench = bench();
    bench.device.asks(380);
    stands_at(&bench, 380);
    until("it is refused for the limit", || match bench.ask(&["sign", "--answer", "plus"]) {
        (1, said) if said.contains("beyond axis.z.limit of 40.0 µm") => Ok(()),
        (_, said) => Err(said),
    });
    assert_eq!(offset(&bench), 380);
}

#[test]
fn arm_reminds_once_of_a_check_that_there_never_was() {
    let mut bench = bench();
    let reminder = "the sign of z was never checked with a dial gauge: isotherm sign";
    bench.ask(&["disarm"]);
    let (code, said) = bench.ask(&["arm"]);
    assert!(code == 0 && said.contains(reminder), "{said}");
    bench.restart();
    bench.is_in_state("active");
    bench.ask(&["disarm"]);
    let (code, said) = bench.ask(&["arm"]);
    assert!(code == 0 && !said.contains("gauge"), "{said}");
}

/// Needs chromium and python3, as `tests/observe/page.rs`.
#[test]
fn a_person_is_guided_on_the_page() {
    let bench = bench();
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let words =
        ["never checked with a dial gauge", "click:Check sign", "set it to zero", "click:Move by +5 µm"];
    let seen = std::process::Command::new("python3")
        .arg(look)
        .arg(format!("http://{}/", bench.page))
        .args(words)
        .args(["Which way did the gauge move?", "click:Moved to plus"])
        .args(["must have moved by 5.0 µm in plus direction of z", "the sign is right", "Sign checked 2"])
        .output()
        .unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let said = [seen.stdout, seen.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    assert!(seen.status.success(), "{said}\n(without chromium: `tests/run page`)");
    assert_eq!(bench.axis()["sign_checked"][1], "plus");
    let event = bench.events(&[]).into_iter().find(|event| event["kind"] == "sign-checked").unwrap();
    assert_eq!(event["data"]["way"], "page");
}
