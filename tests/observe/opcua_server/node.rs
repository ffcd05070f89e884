//! node-opcua as the client: nodes that are browsed, read and subscribed to, writes and calls that are refused, and
//! certificates.

use serde_json::{Value, json};

use super::process::until;
use super::rig::{Behaviour, Machine, node_opcua};
use super::secured::{SECURED, certificates, with};

pub(crate) const USER: [&str; 2] = ["--user", "mes:hot-and-cold"];
const PROBE: [&str; 2] = ["--user-cert", "user"];

/// Starts a machine whose clients need a certificate, and may do without a user.
pub(crate) fn machine() -> Machine {
    Machine::with(&format!("anonymous = true\n{SECURED}"), certificates)
}

fn asks(machine: &Machine, user: &[&str], does: &[&str]) -> Value {
    machine.asks_client(node_opcua(), &with(user, does))
}

#[track_caller]
fn is_a_time(time: &Value) {
    assert!(time.as_str().is_some_and(|time| time.starts_with("20")), "{time}");
}

#[test]
fn node_opcua_browses_the_same_nodes_and_reads_value_quality_time_and_unit() {
    let machine = machine();
    let nodes = asks(&machine, &USER, &["browse"]);
    let others = machine.asks(&with(&USER, &["browse"]));
    let others = others.as_object().unwrap();
    assert!(others.contains_key("axis.z.verified_um") && others.contains_key("events.text"), "{others:?}");
    for (id, name) in others {
        assert_eq!(&nodes[id.as_str()], name, "{id}");
    }
    assert_eq!(nodes["signal.bed7.value.EngineeringUnits"], "EngineeringUnits");
    let ids = ["axis.z.verified_um", "signal.bed0.value", "axis.z.state", "axis.z.armed", "axis.z.warn_um"];
    let read = asks(&machine, &USER, &[&["read"][..], &ids].concat());
    // JavaScript writes 10.0 as 10.
    for (id, value, status, unit) in [
        ("axis.z.verified_um", json!(10), "Good", json!("µm")),
        ("signal.bed0.value", json!(10), "Good", json!("°C")),
        ("axis.z.state", json!("active"), "Good", Value::Null),
        ("axis.z.armed", json!(true), "Good", Value::Null),
        ("axis.z.warn_um", Value::Null, "GoodNoData", json!("µm")),
    ] {
        let found = &read[id];
        assert_eq!((&found["value"], &found["unit"]), (&value, &unit), "{id}: {found}");
        assert_eq!(found["status"], status, "{id}");
        is_a_time(&found["time"]);
    }
}

#[test]
fn node_opcua_subscribes_and_gets_changes_of_value_and_quality_with_their_time() {
    let machine = machine();
    let signals: Vec<String> = (1..=12).map(|place| format!("signal.bed{place}.value")).collect();
    let mut does = vec!["watch", "60", "output.cnc_z.value"];
    does.extend(signals.iter().map(String::as_str));
    let mut watcher = machine.watched_by_client(node_opcua(), &with(&USER, &does));
    watcher.receives("changing");
    machine.device(Behaviour::IsGone);
    let said = watcher.receives("\"signal.bed12.value\"");
    let changes: Value = serde_json::from_str(&said).unwrap();
    for signal in &signals {
        let found = &changes[signal.as_str()];
        assert!(found["count"].as_u64().is_some_and(|count| count >= 10), "{signal}: {found}");
        assert_eq!(found["statuses"][0], "Good", "{signal}: {found}");
        is_a_time(&found["time"]);
    }
    let output = &changes["output.cnc_z.value"];
    let statuses = output["statuses"].as_array().unwrap();
    let uncertain = json!("UncertainNoCommunicationLastUsableValue");
    assert_eq!((&statuses[0], statuses.last()), (&json!("Good"), Some(&uncertain)), "{output}");
    is_a_time(&output["time"]);
}

#[test]
fn node_opcua_writes_nothing_and_only_an_authorised_user_of_it_calls_the_method() {
    let machine = machine();
    for id in ["axis.z.cz_um", "axis.z.limit_um", "signal.bed0.value"] {
        assert_eq!(asks(&machine, &PROBE, &["write", id, "7"])["error"], "BadNotWritable", "{id}");
    }
    let call = ["call", "z", "3.5"];
    for user in [Vec::new(), USER.to_vec()] {
        assert_eq!(asks(&machine, &user, &call)["error"], "BadUserAccessDenied", "{user:?}");
    }
    let axis = machine.status()["axes"]["z"].clone();
    assert_eq!((&axis["limit_um"], &axis["probe"]["last"]), (&json!(40.0), &Value::Null));
    let answer = asks(&machine, &PROBE, &call);
    assert_eq!(answer[0], true, "{answer}");
    until("it is learned from", || {
        let last = machine.status()["axes"]["z"]["probe"]["last"].clone();
        if last["error_um"] == 3.5 { Ok(()) } else { Err(last.to_string()) }
    });
}

#[test]
fn node_opcua_is_served_under_every_policy_and_refused_with_a_wrong_certificate_or_password() {
    let machine = machine();
    let read = ["read", "axis.z.state"];
    for policy in ["Aes256_Sha256_RsaPss", "Aes128_Sha256_RsaOaep", "Basic256Sha256"] {
        let found = asks(&machine, &[&USER[..], &["--policy", policy]].concat(), &read);
        assert_eq!(found["axis.z.state"]["value"], "active", "{policy}: {found}");
    }
    let own = |name| ["--cert", name, "--server-cert", "server.der"];
    let other = [&own("other")[..], &["--uri", "urn:isotherm:user"], &USER, &read].concat();
    // The connection is closed before the client gets a status.
    assert!(machine.asks_client(node_opcua(), &other)["error"].is_string());
    until("the unknown client is reported", || match machine.verb("events", &["--json"]) {
        said if said.contains("opcua-client-refused") && said.contains("CN=other") => Ok(()),
        said => Err(said),
    });
    let expired = [&own("old")[..], &USER, &read].concat();
    let refused = machine.asks_client(node_opcua(), &expired);
    assert_eq!(refused["error"], "BadCertificateTimeInvalid", "{refused}");
    let refused = asks(&machine, &["--user", "mes:cold-and-hot"], &read);
    assert_eq!(refused["error"], "BadUserAccessDenied", "{refused}");
}
