//! `isotherm restart --keep`: another program replaces the running gateway, and no register moves.

use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::time::Duration;

use isotherm::clock::Clock;

use crate::service::device::What;
use crate::service::process::{isotherm, until};
use crate::service::rig::{Service, copy, corrected};

const WAY: &str = "step = 1.0";
const QUICKLY: &str = "step = 20.0";

/// Offset in counts: 40 µm.
const OFFSET: i16 = 400;

/// Values written to the register since the last call, from and to.
fn changes(service: &Service) -> Vec<(i16, i16)> {
    let seen = std::mem::take(&mut service.device.state().seen);
    let written = seen.iter().filter_map(|seen| match seen.what {
        What::Wrote { from, to } => Some((from, to)),
        _ => None,
    });
    written.filter(|(from, to)| from != to).collect()
}

/// Moves to 40 µm, which is `stands_at` counts, and restarts several times. The register never has another count, and
/// the axis resumes.
fn nothing_moves(change: impl FnOnce(String) -> String, stands_at: i16, by_hand: bool) {
    let mut service = Service::start(|text| change(text.replace(WAY, QUICKLY)));
    if by_hand {
        until("it is armed", || match service.verb(&["arm"]).status.code() {
            Some(0) => Ok(()),
            code => Err(format!("{code:?}")),
        });
    }
    service.device.asks(OFFSET);
    until("the offset is there", || match service.device.offset() {
        found if found == stands_at => Ok(()),
        found => Err(found.to_string()),
    });
    changes(&service);
    for round in 1..=3 {
        let process = service.gateway.id();
        let (code, said) = service.restart(&[]);
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("has taken over; z: compensating"), "{said}");
        let reloading = service.manager.receives("RELOADING=1");
        assert!(reloading.contains("MONOTONIC_USEC="), "{reloading}");
        service.manager.receives("READY=1");
        assert!(
            service.manager.heard.iter().all(|reported| !reported.contains("STOPPING")),
            "it does not stop"
        );
        assert_eq!((process, service.gateway.has_ended()), (service.gateway.id(), false));
        assert_eq!(service.events("started").len(), 1 + round, "{said}");
        // Time for a few rounds, in which nothing may change.
        std::thread::sleep(Duration::from_secs(1));
        assert_eq!((changes(&service), service.device.offset()), (Vec::new(), stands_at), "{said}");
    }
    let armed = service.events("armed");
    assert_eq!(armed.len(), 4, "{armed:#?}");
    assert!(
        armed[1..].iter().all(|event| event["data"]["way"] == "restart" && event["data"]["from_um"] == 40.0),
        "{armed:#?}"
    );
    let command = &service.events("command")[usize::from(by_hand)];
    assert!(command["text"].as_str().unwrap().starts_with("restart, by "), "{command}");
    service.device.asks(OFFSET + 100);
    until("it follows", || match changes(&service).last() {
        Some(_) => Ok(()),
        None => Err(service.device.offset().to_string()),
    });
}

#[test]
fn a_register_of_ours_is_never_another_count() {
    nothing_moves(|text| text, OFFSET, false);
}

#[test]
fn a_register_shared_with_an_operator_is_never_another_count() {
    nothing_moves(
        |text| text.replace("\"holding:10\"\n", "\"holding:10\"\nshare = \"ledger\"\n"),
        OFFSET,
        false,
    );
}

#[test]
fn a_corrected_position_is_never_another_count() {
    nothing_moves(|text| corrected(&text), 2 * OFFSET, false);
}

#[test]
fn an_axis_that_a_person_armed_goes_on_armed() {
    nothing_moves(|text| text.replace("arm = \"auto\"", "arm = \"manual\""), OFFSET, true);
}

#[test]
fn an_axis_that_a_person_switched_off_stays_off() {
    let service = Service::start(|text| text);
    service.walks_to(50);
    assert_eq!(service.verb(&["disarm"]).status.code(), Some(0));
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("z: off: switched off by a person; arm the axis again"), "{said}");
    service.device.asks(200);
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((service.device.offset(), service.events("armed").len()), (50, 1));
}

/// Lets another profile with this change take over. No count moves before the operator arms.
fn waits_for_a_person(before: impl FnOnce(String) -> String, change: (&str, &str), words: &[&str]) {
    let service = Service::start(before);
    service.walks_to(50);
    changes(&service);
    service.rewrite(|text| text.replacen(change.0, change.1, 1));
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(words.iter().all(|word| said.contains(word)), "{words:?} in {said}");
    service.device.asks(200);
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((changes(&service), service.device.offset()), (Vec::new(), 50), "{said}");
    assert_eq!(service.events("armed").len(), 1);
    assert_eq!(service.events("output-moved").len(), 2, "at the start and after the first read");
}

#[test]
fn a_register_that_becomes_the_gateways_alone_waits_for_a_person() {
    let shared = |text: String| text.replace("\"holding:10\"\n", "\"holding:10\"\nshare = \"ledger\"\n");
    let words = [
        "z: off: output cnc_z has changed: from share ledger to share whole; 5.0 µm from the gateway",
        "holds 5.0 µm now",
    ];
    waits_for_a_person(shared, ("share = \"ledger\"\n", ""), &words);
}

#[test]
fn another_scale_waits_for_a_person() {
    let words = [
        "z: off: output cnc_z has changed: from scale 0.1 to scale 0.2; 5.0 µm from the gateway",
        "holds 10.0 µm now",
    ];
    let change = ("10\"\ntype = \"i16\"\nscale = 0.1", "10\"\ntype = \"i16\"\nscale = 0.2");
    waits_for_a_person(|text| text, change, &words);
}

#[test]
fn a_profile_that_is_wrong_leaves_the_old_gateway_running_and_is_an_event() {
    let mut service = Service::start(|text| text);
    service.walks_to(50);
    for (wrong, words) in [("limit = -1.0", "limit"), ("limit = ", "expected")] {
        service.rewrite(|text| text.replace("limit = 2000.0", wrong));
        let (code, said) = service.restart(&[]);
        assert_eq!(code, Some(64), "{said}");
        assert!(said.contains("walker.toml:") && said.contains(words), "{said}");
        assert!(said.contains("the gateway continues as before"), "{said}");
        service.rewrite(|text| text.replace(wrong, "limit = 2000.0"));
    }
    let refused = service.events("command-refused");
    assert_eq!(refused.len(), 2, "{refused:#?}");
    assert!(refused[0]["text"].as_str().unwrap().contains("the profile is wrong"), "{refused:#?}");
    service.walks_to(80);
    assert_eq!(service.events("started").len(), 1);
    let reported = service.manager.rest();
    assert!(
        reported.iter().all(|reported| !reported.contains("RELOADING") && !reported.contains("STOPPING")),
        "{reported:?}"
    );
    assert!(!service.gateway.has_ended());
}

#[test]
fn a_profile_in_which_no_name_can_be_read_is_an_event_of_the_gateway_that_runs_it() {
    let service = Service::start(|text| text);
    let whole = std::fs::read_to_string(&service.profile).unwrap();
    // Number of such events, as soon as the profile is whole again.
    let reported = || {
        std::fs::write(&service.profile, &whole).unwrap();
        let refused = service.events("command-refused");
        let is_it =
            |event: &serde_json::Value| event["text"].as_str().unwrap().contains("the profile is wrong");
        assert!(refused.iter().all(is_it), "{refused:#?}");
        refused.len()
    };
    // Another profile without a name does not concern this gateway.
    std::fs::write(service.home.path().join("other.toml"), "[machine\n").unwrap();
    let mut other = isotherm(service.home.path());
    other.args(["restart", "other.toml", "--keep", "--state"]).arg(service.home.path().join("state"));
    let other = other.output().unwrap();
    assert_eq!((other.status.code(), reported()), (Some(64), 0), "{other:?}");
    std::fs::write(&service.profile, "[machine\nname = walker\n").unwrap();
    let (code, said) = service.restart(&[]);
    assert_eq!(
        (code, said.contains("the gateway continues as before"), reported()),
        (Some(64), true, 1),
        "{said}"
    );
    std::fs::remove_file(&service.profile).unwrap();
    let (code, said) = service.restart(&[]);
    assert_eq!(
        (code, said.contains("the gateway continues as before"), reported()),
        (Some(64), true, 2),
        "{said}"
    );
    service.walks_to(30);
}

#[test]
fn what_the_running_gateway_would_find_wrong_counts_not_what_the_verb_was_given() {
    let service = Service::start(|text| text);
    service.rewrite(|text| text.replace("limit = 2000.0", "limit = -1.0"));
    let (code, said) = service.restart(&["--set", "axis.z.limit=5.0"]);
    assert_eq!((code, said.contains("axis.z.limit")), (Some(64), true), "{said}");
    service.rewrite(|text| text.replace("limit = -1.0", "limit = 2000.0"));
    assert_eq!(service.events("started").len(), 1);
    service.walks_to(30);
}

#[test]
fn another_machine_s_profile_does_not_take_the_place() {
    let service = Service::start(|text| text);
    service.rewrite(|text| text.replace("name = \"walker\"", "name = \"mill\""));
    let (code, said) = service.restart(&[]);
    assert_eq!((code, said.contains("no gateway of this machine is running")), (Some(1), true), "{said}");
    let (code, said) = service.restart(&["--set", "machine.name=walker"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("would be another gateway") && said.contains("continues as before"), "{said}");
    service.rewrite(|text| text.replace("name = \"mill\"", "name = \"walker\""));
    service.walks_to(30);
}

/// Replaces the program file by a script, or by the program itself.
fn replace(service: &Service, script: Option<&str>) {
    let new = service.home.path().join("new");
    match script {
        Some(text) => std::fs::write(&new, text).unwrap(),
        None => copy(env!("CARGO_BIN_EXE_isotherm"), &new),
    }
    std::fs::set_permissions(&new, std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::rename(&new, &service.program).unwrap();
}

/// Script that runs `check` for a check, and `run` otherwise.
fn program(check: &str, run: &str) -> String {
    format!("#!/bin/sh\ncase \"$*\" in *--check-only*) {check};; esac\n{run}\n")
}

#[test]
fn a_new_program_that_ends_at_once_or_hangs_is_reported_soon() {
    let patience = Duration::from_secs(40);
    let clock = Clock::wall();
    for (check, run, words) in [
        ("exit 0", "exit 3", "took over and ended at once"),
        ("exit 0", "exec sleep 100", "has not answered within 10 s"),
    ] {
        let service = Service::start(|text| text);
        replace(&service, Some(&program(check, run)));
        let begun = clock.now();
        let (code, said) = service.restart(&[]);
        assert_eq!((code, said.contains(words)), (Some(1), true), "{run}: {said}");
        assert!(clock.now().since(begun) < patience, "{run}: {said}");
        service.gateway.signal("KILL");
    }
    let service = Service::start(|text| text);
    replace(&service, Some(&program("exec sleep 100", "exit 3")));
    let (code, said) = service.restart(&[]);
    let words = "has not checked the profile within 10 s; the gateway continues as before";
    assert_eq!((code, said.contains(words)), (Some(1), true), "{said}");
    service.walks_to(30);
}

#[test]
fn the_program_that_lies_there_now_takes_over_and_one_that_cannot_run_does_not() {
    let mut service = Service::start(|text| text);
    service.walks_to(50);
    replace(&service, Some("#!/bin/sh\necho 'isotherm: this computer is too old' >&2\nexit 1\n"));
    let (code, said) = service.restart(&[]);
    assert_eq!(
        (code, said.contains("this computer is too old; the gateway continues")),
        (Some(1), true),
        "{said}"
    );
    replace(&service, Some("no program at all"));
    let (code, said) = service.restart(&[]);
    assert_eq!((code, said.contains("cannot be started")), (Some(1), true), "{said}");
    replace(&service, None);
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    let runs = std::fs::metadata(format!("/proc/{}/exe", service.gateway.id())).unwrap().ino();
    assert_eq!(runs, std::fs::metadata(&service.program).unwrap().ino(), "the new one runs");
    assert_eq!(service.device.offset(), 50);
    service.walks_to(80);
    service.gateway.signal("TERM");
    assert_eq!(service.gateway.ends_within(Duration::from_secs(20)).code(), Some(0));
}

#[test]
fn where_no_gateway_runs_nothing_is_restarted_and_without_keep_there_is_no_restart() {
    let mut service = Service::start(|text| text);
    assert_eq!(service.verb(&["restart"]).status.code(), Some(2));
    service.gateway.signal("TERM");
    service.gateway.ends_within(Duration::from_secs(20));
    let (code, said) = service.restart(&[]);
    assert_eq!((code, said.contains("no gateway of this machine is running")), (Some(1), true), "{said}");
}
