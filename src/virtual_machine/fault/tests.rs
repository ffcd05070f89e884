use super::*;
use crate::virtual_machine::tests::support::profile;
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

fn complaint(text: &str) -> String {
    FaultScript::parse(text, &profile()).unwrap_err().to_string()
}

fn one(device: &str, kind: &str, more: &str) -> String {
    format!("[[fault]]\ndevice = \"{device}\"\nkind = \"{kind}\"\n{more}\n")
}

#[test]
fn a_script_is_checked_against_the_profile_and_every_error_is_reported() {
    let text = one("thermocuples", "silent", "") + &one("cnc", "sulky", "") + &one("cnc", "late", "");
    let lines: Vec<String> = complaint(&text).lines().map(str::to_owned).collect();
    assert_eq!(
        lines[0],
        "fault 1 (silent): there is no device `thermocuples`; allowed: thermocouples, counter, readout, cnc"
    );
    assert!(lines[1].starts_with("fault 2 (sulky): there is no such kind; allowed: silent, late, "));
    assert_eq!(lines[2], "fault 3 (late): `delay` is missing, for example \"400ms\"");
}

#[test]
fn what_makes_no_sense_is_refused() {
    for (text, expected) in [
        (one("cnc", "silent", "delay = \"1s\""), "`delay` has no effect for this kind of fault"),
        (one("cnc", "silent", "for = 3\nfor_time = \"1s\""), "give `for` (replies) or `for_time`, not both"),
        (one("cnc", "silent", "for = 0"), "`for` must be 1 or more"),
        (one("cnc", "refuse", "for = 3"), "write `for_time`"),
        (one("cnc", "restart", "for_time = \"1s\""), "happens once"),
        (
            one("cnc", "nan", "signal = \"bed\""),
            "device `cnc` has no signal `bed`; allowed: hydraulics_on, offset_now",
        ),
        (one("thermocouples", "nan", "signal = \"bed\""), "`bed` is i16: only f32 and f64 have NaN"),
        (
            one("counter", "sentinel", "signal = \"scale_z\""),
            "`raw` is missing, and `scale_z` has no `bad` value",
        ),
        (
            one("thermocouples", "value", "signal = \"bed\"\nvalue = nan"),
            "`value` is missing or not a finite number",
        ),
        (one("cnc", "register", "register = \"coil:0\"\nwords = [2]"), "a bit is 0 or 1"),
        (one("cnc", "register", "register = \"holding:65535\"\nwords = [0, 2]"), "2 words from"),
        (one("cnc", "no-acknowledge", ""), "no output or set of `cnc` has a handshake"),
        (one("cnc", "late-acknowledge", ""), "`delay` is missing"),
        (one("cnc", "stuck-acknowledge", "for = 3"), "write `for_time`"),
        (one("cnc", "silent", "at = \"soon\""), "line 4"),
        (one("cnc", "silent", "forr = 3"), "unknown field `forr`"),
    ] {
        let error = complaint(&text);
        assert!(error.contains(expected), "{error}");
    }
}

fn running(text: &str) -> (Profile, Faults) {
    let profile = profile();
    let script = FaultScript::parse(text, &profile).unwrap();
    (profile, Faults::new(script, Moment::from_nanos(0)))
}

const CNC: DeviceId = DeviceId(3);

fn at(seconds: u64) -> Moment {
    Moment::from_nanos(0).after(Duration::from_secs(seconds))
}

#[test]
fn a_fault_waits_for_its_time_and_its_requests_and_ends_after_its_time() {
    let (_, mut faults) = running(&one("cnc", "silent", "at = \"1h\"\nafter = 10\nfor_time = \"1min\""));
    faults.advance(at(3599), |_| 50);
    assert_eq!(faults.reply(CNC, false, at(3599)), None);
    faults.advance(at(3600), |_| 10);
    assert_eq!(faults.reply(CNC, false, at(3600)), None);
    faults.advance(at(3605), |_| 11);
    assert_eq!(faults.reply(DeviceId(0), false, at(3605)), None);
    assert_eq!(faults.reply(CNC, false, at(3664)), Some(ReplyFault::Silent));
    assert_eq!(faults.reply(CNC, false, at(3665)), None);
}

#[test]
fn a_fault_of_writes_counts_no_reads() {
    let (_, mut faults) = running(&one("cnc", "wrong-echo", "for = 1"));
    faults.advance(at(0), |_| 0);
    assert_eq!(faults.reply(CNC, false, at(0)), None);
    assert_eq!(faults.reply(CNC, true, at(0)), Some(ReplyFault::WrongEcho));
    assert_eq!(faults.reply(CNC, true, at(0)), None);
}

#[test]
fn a_one_time_fault_happens_once() {
    let (_, mut faults) = running(&one("cnc", "restart", "at = \"5s\""));
    assert_eq!(faults.advance(at(4), |_| 0), []);
    assert_eq!(faults.advance(at(9), |_| 0), [(CNC, Kind::Restart)]);
    assert_eq!(faults.advance(at(10), |_| 0), []);
}

#[test]
fn an_opc_ua_server_has_faults_of_nodes_and_connections_and_none_of_registers() {
    let mut profile = profile();
    profile.buses[1].opcua = Some(Box::new(isotherm_profile::OpcUa::plain()));
    let refusal = |text: String| FaultScript::parse(&text, &profile).err().map(|error| error.to_string());
    for kind in ["silent", "close", "half-open", "refuse", "garbage", "ignored-write", "restart", "status"] {
        assert_eq!(refusal(one("cnc", kind, "")), None, "{kind}");
    }
    let of_signal = "signal = \"offset_now\"\n";
    for (kind, more) in [("text", ""), ("status", "code = 0x80310000"), ("value", "value = 1.0")] {
        assert_eq!(refusal(one("cnc", kind, &format!("{of_signal}{more}"))), None, "{kind}");
    }
    for (text, expected) in [
        (
            one("cnc", "exception", "code = 4"),
            "no registers, exceptions and frames; allowed: silent, late, close, ",
        ),
        (one("cnc", "short-read", ""), "not possible on an OPC UA server"),
        (one("cnc", "babbling", ""), "not possible on an OPC UA server"),
        (one("cnc", "status", "code = 0"), "`code` must be a status that is not good"),
        (one("cnc", "text", ""), "`signal` is missing"),
        (one("thermocouples", "status", ""), "`thermocouples` is not an OPC UA server"),
    ] {
        let refusal = refusal(text).unwrap();
        assert!(refusal.contains(expected), "{refusal}");
    }
}
