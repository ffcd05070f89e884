//! Certificates, users and the method `measured`.

use std::path::Path;
use std::time::Duration;

use serde_json::json;

use super::process::{Running, file, isotherm, nowhere, until};
use super::rig::{Machine, profile, python};

pub(crate) const SECURED: &str = "security = \"sign-and-encrypt\"\ncert = \"server.der\"\nkey = \"server.pem\"\n\
    trusted = \"clients\"\nusers = [{ name = \"mes\", password_file = \"mes.password\" }, \
    { name = \"probe\", cert = \"user.der\", commands = [\"measured\"] }]";

/// Makes certificates, and trusts the clients `own` and `old`. The certificate of `old` has expired.
pub(crate) fn certificates(home: &Path) {
    assert!(python("opcua_certificates.py").arg(home).status().unwrap().success());
    std::fs::create_dir(home.join("clients")).unwrap();
    for trusted in ["own.der", "old.der"] {
        std::fs::copy(home.join(trusted), home.join("clients").join(trusted)).unwrap();
    }
    file(home, "mes.password", "hot-and-cold\n");
}

/// Options of the trusted client.
const OWN: [&str; 4] = ["--cert", "own", "--server-cert", "server.der"];
const READ: [&str; 2] = ["read", "axis.z.state"];

/// Returns the arguments of the trusted client.
pub(crate) fn with<'a>(options: &[&'a str], does: &[&'a str]) -> Vec<&'a str> {
    [&OWN[..], options, does].concat()
}

#[test]
fn a_trusted_client_logs_in_with_its_password_or_its_certificate_under_every_policy() {
    let machine = Machine::with(SECURED, certificates);
    for policy in ["Aes256Sha256RsaPss", "Aes128Sha256RsaOaep", "Basic256Sha256"] {
        for user in [["--user", "mes:hot-and-cold"], ["--user-cert", "user"]] {
            let read = machine.asks(&with(&[&user[..], &["--policy", policy]].concat(), &READ));
            assert_eq!(read["axis.z.state"]["value"], "active", "{policy} {user:?}: {read}");
        }
    }
    let mut endpoints = machine.asks(&["endpoints"]);
    let modes: Vec<&str> = endpoints.as_array().unwrap().iter().filter_map(|one| one[0].as_str()).collect();
    assert_eq!(modes, ["SignAndEncrypt"; 3]);
    let url = endpoints[0][2].take();
    assert!(url.as_str().is_some_and(|url| url.starts_with("opc.tcp://127.0.0.1:")), "{url}");
}

#[test]
fn who_is_not_known_is_refused_and_reported() {
    let machine = Machine::with(SECURED, certificates);
    let user = ["--user", "mes:hot-and-cold"];
    let unlike =
        |client: &[&'static str]| [&user[..], &["--server-cert", "server.der"], client, &READ].concat();
    for (options, what) in [
        (with(&["--user", "mes:cold-and-hot"], &READ), "a wrong password"),
        (with(&["--user", "nobody:hot-and-cold"], &READ), "an unknown user"),
        (with(&["--user-cert", "other"], &READ), "an unknown certificate of a user"),
        (with(&[], &READ), "no user"),
        ([&user[..], &READ].concat(), "no security"),
        (with(&[&user[..], &["--sign"]].concat(), &READ), "no encryption"),
        (unlike(&["--cert", "other", "--uri", "urn:isotherm:user"]), "an unknown client"),
        (unlike(&["--cert", "old"]), "an expired client"),
    ] {
        let refused = machine.asks(&options);
        assert!(refused["error"].is_string(), "{what}: {refused}");
    }
    until("the refusals are reported", || {
        let said = machine.verb("events", &["--json"]);
        let has = |word: &str| said.contains(word);
        if has("opcua-client-refused") && has("wrong user, password or certificate") {
            Ok(())
        } else {
            Err(said)
        }
    });
    let said = machine.verb("events", &["--json"]);
    assert!(said.contains("copy its certificate into the directory `trusted`"), "{said}");
    assert!(!said.contains("hot-and-cold") && !said.contains("cold-and-hot"), "{said}");
    // The trusted client is served meanwhile.
    let read = machine.asks(&with(&user, &READ));
    assert_eq!(read["axis.z.state"]["value"], "active", "{read}");
}

#[test]
fn a_policy_that_no_endpoint_offers_is_refused_before_the_key_decrypts_anything() {
    let machine = Machine::with(SECURED, certificates);
    let options = with(&["--policy", "Basic128Rsa15", "--user", "mes:hot-and-cold"], &READ);
    assert_eq!(machine.asks(&options)["error"], "BadSecurityPolicyRejected");
}

#[test]
fn a_client_without_a_certificate_takes_no_session_from_others() {
    let machine = Machine::with(SECURED, certificates);
    for _ in 0..3 {
        // More than the server keeps.
        assert_eq!(machine.asks(&["sessions", "100"])["error"], "BadSecurityChecksFailed");
    }
    let read = machine.asks(&with(&["--user", "mes:hot-and-cold"], &READ));
    assert_eq!(read["axis.z.state"]["value"], "active", "{read}");
    assert_eq!(machine.asks(&["endpoints"]).as_array().map(Vec::len), Some(3));
}

#[test]
fn the_expiry_of_the_certificate_of_the_server_or_of_a_client_is_warned_of() {
    let home = tempfile::tempdir().unwrap();
    certificates(home.path());
    let soon = SECURED.replace("server.der", "soon.der").replace("server.pem", "soon.pem");
    file(home.path(), "machine.toml", &profile(&nowhere(), 4840, &soon));
    let done =
        isotherm(home.path()).args(["check", "machine.toml"]).current_dir(home.path()).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    for words in [
        "the OPC UA server: the OPC UA server's certificate soon.der expires on",
        "`isotherm opcua certificate PROFILE --server`",
        "the OPC UA server: the client's certificate clients/old.der expired on",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_trusted_client_whose_certificate_is_not_valid_yet_is_warned_of_by_check_and_by_an_event() {
    let machine = Machine::with(SECURED, |home| {
        certificates(home);
        assert!(python("opcua_certificates.py").arg("--early").arg(home).status().unwrap().success());
        std::fs::copy(home.join("early.der"), home.join("clients/early.der")).unwrap();
    });
    let home = machine.home();
    let warning = "the OPC UA server: the client's certificate clients/early.der is not valid before ";
    let done = isotherm(home).args(["check", "machine.toml"]).current_dir(home).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(said.contains(warning) && said.contains("correct the clock of this computer"), "{said}");
    until("the event is reported", || match machine.verb("events", &["--json"]) {
        events if events.contains("certificate-not-yet-valid") && events.contains(warning) => Ok(()),
        events => Err(events),
    });
}

#[test]
fn a_client_with_a_short_key_is_refused_as_check_says_and_a_user_with_one_is_not() {
    let short = SECURED.replace("user.der", "short.der");
    let machine = Machine::with(&short, |home| {
        certificates(home);
        assert!(python("opcua_certificates.py").arg("--others").arg(home).status().unwrap().success());
        std::fs::copy(home.join("short.der"), home.join("clients/short.der")).unwrap();
    });
    let client = ["--cert", "short", "--server-cert", "server.der", "--uri", "urn:freeopcua:python:server"];
    let refused = machine.asks(&[&client[..], &["--user", "mes:hot-and-cold"], &READ].concat());
    assert!(refused["error"].is_string(), "{refused}");
    let read = machine.asks(&with(&["--user-cert", "short", "--policy", "Basic256Sha256"], &READ));
    assert_eq!(read["axis.z.state"]["value"], "active", "{read}");
    let home = machine.home();
    let done = isotherm(home).args(["check", "machine.toml"]).current_dir(home).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    for words in [
        "the client's certificate clients/short.der is weak: the key has 1024 bits. The server refuses this client.",
        "the client's certificate short.der is weak: the key has 1024 bits. The gateway uses it.",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn only_an_authorised_user_teaches_an_axis_and_no_other_command_is_there() {
    let machine = Machine::with(SECURED, certificates);
    let (reader, probe) = (["--user", "mes:hot-and-cold"], ["--user-cert", "user"]);
    assert_eq!(machine.asks(&with(&probe, &["methods"])), json!(["axis.z.measured"]));
    let refused = machine.asks(&with(&reader, &["call", "z", "3.5"]));
    assert_eq!(refused["error"], "BadUserAccessDenied", "{refused}");
    assert!(machine.status()["axes"]["z"]["probe"]["last"].is_null());
    let answer = machine.asks(&with(&probe, &["call", "z", "3.5", "", "part-17/2"]));
    assert_eq!(answer[0], true, "{answer}");
    until("it is learned from", || {
        let last = machine.status()["axes"]["z"]["probe"]["last"].clone();
        if last["error_um"] == 3.5 { Ok(()) } else { Err(last.to_string()) }
    });
    std::thread::sleep(Duration::from_secs(2));
    let again = machine.asks(&with(&probe, &["call", "z", "3.5", "", "part-17/2"]));
    assert!(again[0] == false && again[1].as_str().is_some_and(|why| why.contains("part-17/2")), "{again}");
    let wrong = machine.asks(&with(&probe, &["call", "z", "3.5", "yesterday"]));
    assert!(
        wrong[0] == false && wrong[1].as_str().is_some_and(|why| why.contains("write `time`")),
        "{wrong}"
    );
    let said = machine.verb("events", &["--json"]);
    assert!(said.contains("by probe over OPC UA"), "{said}");
    let axis = &machine.status()["axes"]["z"];
    assert_eq!((&axis["armed"], &axis["state"]), (&json!(true), &json!("active")));
}

#[test]
fn the_certificate_of_the_server_is_made_by_the_verb_and_clients_accept_it() {
    let made = |home: &Path| {
        certificates(home);
        for name in ["server.der", "server.pem"] {
            std::fs::remove_file(home.join(name)).unwrap();
        }
        let profile = file(home, "first.toml", &profile(&nowhere(), 4840, SECURED));
        let done = isotherm(home).args(["opcua", "certificate", "--server"]).arg(&profile).output().unwrap();
        let said = String::from_utf8_lossy(&done.stdout);
        assert!(done.status.success() && said.contains("created for the OPC UA server"), "{done:?}");
    };
    let machine = Machine::with(SECURED, made);
    let read = machine.asks(&with(&["--user", "mes:hot-and-cold"], &READ));
    assert_eq!(read["axis.z.state"]["value"], "active", "{read}");
    let key = std::fs::read_to_string(machine.home().join("server.pem")).unwrap();
    let kept = machine.home().join(".local/state/isotherm/press-opcua");
    let own = std::fs::read_dir(kept.join("own")).unwrap().map(|entry| entry.unwrap().path());
    for path in own {
        let bytes = std::fs::read(&path).unwrap();
        assert!(!bytes.windows(40).any(|part| key.as_bytes().windows(40).any(|own| own == part)), "{path:?}");
    }
}

#[test]
fn a_taken_port_keeps_no_machine_from_being_compensated_and_the_server_comes_when_it_is_free() {
    let home = tempfile::tempdir().unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let text = profile(&nowhere(), port, "security = \"none\"\nanonymous = true");
    let profile = file(home.path(), "machine.toml", &text);
    let mut running = Running::start(isotherm(home.path()).arg("run").arg(&profile));
    running.receives("no OPC UA client is served on 127.0.0.1:");
    drop(taken);
    running.receives("OPC UA clients are served on 127.0.0.1:");
    running.signal("TERM");
    assert!(running.ends_within(Duration::from_secs(60)).success());
}
