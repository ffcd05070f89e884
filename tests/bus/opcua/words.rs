//! Tests of the verbs for certificates, as a user runs them.

use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;

use super::process::{Running, isotherm};
use super::rig::{Line, Server, machine, no_session, python};
use super::secured::{certificates, secured, serve};
use isotherm::fieldbus::kinds::opcua::client::certificate::Certificate;
use isotherm::fieldbus::kinds::opcua::fault::OpcUaFault;
use isotherm::gateway::certificates::expiring;
use isotherm_core::quantity::Moment;

/// Result of a verb: exit code, standard output and standard error.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) said: String,
}

impl Ended {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|_| panic!("{}{}", self.out, self.said))
    }
}

/// Runs a verb with this input.
pub(crate) fn typing(command: &mut Command, typed: &str) -> Ended {
    let pipes = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = pipes.spawn().unwrap();
    // A verb that asks nothing may already have ended.
    let _ = child.stdin.take().unwrap().write_all(typed.as_bytes());
    let Output { status, stdout, stderr } = child.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ended { code: status.code(), out: text(stdout), said: text(stderr) }
}

/// Writes the profile of a machine to this directory. Its secured bus names the certificates there.
fn profile(directory: &Path, port: u16) -> PathBuf {
    let path = directory.join("machine.toml");
    std::fs::write(&path, machine(port, &secured("sign-and-encrypt", "own", ""))).unwrap();
    path
}

fn opcua(profile: &Path, what: &str, more: &[&str]) -> Command {
    let mut command = isotherm(profile.parent().unwrap());
    command.args(["opcua", what]).arg(profile).args(more);
    command
}

#[tokio::test]
async fn a_line_speaks_signed_and_encrypted_with_the_certificate_that_was_made_and_the_one_that_was_trusted()
{
    let given = certificates();
    let server = serve(given.path(), "server", &[]);
    let home = tempfile::tempdir().unwrap();
    let path = profile(home.path(), server.port);
    let made = typing(&mut opcua(&path, "certificate", &["--json"]), "");
    assert_eq!((made.code, made.json()["made"].as_bool()), (Some(0), Some(true)), "{}", made.said);
    let mode = |name: &str| std::fs::metadata(home.path().join(name)).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode("own.pem"), mode("own.der")), (0o600, 0o644));
    let again = typing(&mut opcua(&path, "certificate", &["--json"]), "");
    assert_eq!(again.json()["made"].as_bool(), Some(false));
    assert_eq!(again.json()["certificate"], made.json()["certificate"], "what is there is not written over");
    let trusted = typing(&mut opcua(&path, "trust", &[]), "yes\n");
    assert_eq!(trusted.code, Some(0), "{}{}", trusted.out, trusted.said);
    let loaded = isotherm_profile::load(&path, &[], &[]).unwrap();
    assert!(
        loaded.warnings.iter().all(|warning| !warning.to_string().contains("own.pem")),
        "nobody else may read it"
    );
    assert_eq!(Line::new(loaded.profile).signals().await, Ok([Ok(20.0), Ok(100.0)]));
    let again = typing(&mut opcua(&path, "trust", &["--json"]), "");
    assert_eq!((again.code, again.json()["trusted"].as_bool()), (Some(0), Some(false)), "it is already");
}

#[test]
fn what_a_person_compares_is_what_openssl_says_of_the_certificate() {
    let given = certificates();
    let path = profile(given.path(), 1);
    let shown = typing(&mut opcua(&path, "certificate", &["--json"]), "").json();
    let script = python("opcua_certificates.py")
        .args(["--thumbprints".as_ref(), given.path().join("own.der").as_os_str()])
        .output();
    let expected = String::from_utf8(script.unwrap().stdout).unwrap();
    let [sha1, sha256, from, to] = expected.split_whitespace().collect::<Vec<_>>()[..] else {
        panic!("{expected}");
    };
    let found = &shown["certificate"];
    let plain = |key: &str| found[key].as_str().unwrap().replace(':', "").to_lowercase();
    assert_eq!((plain("thumbprint").as_str(), plain("sha256").as_str()), (sha1, sha256));
    assert_eq!((found["from"].as_str(), found["to"].as_str()), (Some(from), Some(to)));
    assert_eq!(
        (found["subject"].as_str(), found["application"].as_str()),
        (Some("CN=own"), Some("urn:isotherm:test"))
    );
}

#[test]
fn no_certificate_is_trusted_without_a_yes_or_by_another_thumbprint() {
    let given = certificates();
    let server = serve(given.path(), "server", &[]);
    std::fs::remove_file(given.path().join("trusted/server.der")).unwrap();
    let path = profile(given.path(), server.port);
    let trusted = || std::fs::read_dir(given.path().join("trusted")).unwrap().count();
    for typed in ["", "no\n", "y\n", "\n"] {
        let ended = typing(&mut opcua(&path, "trust", &[]), typed);
        assert_eq!((ended.code, trusted()), (Some(1), 0), "{typed:?}");
        assert!(ended.said.contains("Compare the thumbprint"), "{}", ended.said);
    }
    let other = typing(&mut opcua(&path, "certificate", &["--json"]), "").json();
    let other = other["certificate"]["thumbprint"].as_str().unwrap();
    let ended = typing(&mut opcua(&path, "trust", &["--thumbprint", other]), "yes\n");
    assert_eq!((ended.code, trusted()), (Some(1), 0));
    assert!(ended.said.contains("shows another certificate"), "{}", ended.said);
    let ended = typing(&mut opcua(&path, "trust", &["--thumbprint", "5F3A"]), "yes\n");
    assert_eq!((ended.code, trusted()), (Some(1), 0));
    let shown = ended.out.lines().find_map(|line| line.trim().strip_prefix("thumbprint")).unwrap();
    let right = shown.trim().split(' ').next().unwrap().replace(':', "").to_lowercase();
    let ended = typing(&mut opcua(&path, "trust", &["--thumbprint", &right]), "");
    assert_eq!((ended.code, trusted()), (Some(0), 1), "{}", ended.said);
}

#[tokio::test]
async fn one_of_the_two_files_alone_is_told_and_nothing_is_made() {
    let given = certificates();
    let path = profile(given.path(), 1);
    std::fs::remove_file(given.path().join("own.pem")).unwrap();
    let ended = typing(&mut opcua(&path, "certificate", &[]), "");
    assert_eq!(ended.code, Some(1));
    assert!(ended.said.contains("own.pem is missing. Copy the key to this path"), "{}", ended.said);
    assert!(!given.path().join("own.pem").exists());
}

#[test]
fn certificate_and_key_in_one_file_that_is_not_there_are_told_by_their_keys() {
    let home = tempfile::tempdir().unwrap();
    let path = profile(home.path(), 4840);
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once("key = \"").unwrap();
    let (_, after) = rest.split_once('"').unwrap();
    let (_, cert) = text.split_once("cert = \"").unwrap();
    let cert = cert.split('"').next().unwrap();
    std::fs::write(&path, format!("{before}key = \"{cert}\"{after}")).unwrap();
    let ended = typing(&mut opcua(&path, "certificate", &[]), "");
    assert_eq!(ended.code, Some(1));
    assert!(ended.said.contains("`cert` and `key` of bus control both name"), "{}", ended.said);
}

#[test]
fn a_virtual_server_of_a_secured_line_reports_that_it_has_no_security() {
    let given = certificates();
    let path = profile(given.path(), super::process::free_port());
    let mut devices = Running::start(isotherm(given.path()).arg("virtual").arg(&path));
    devices.receives("without security: for the gateway, write security = \"none\" in a copy of the profile");
}

#[test]
fn a_line_that_is_not_secured_has_no_certificate_and_is_told_how_it_gets_one() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("machine.toml");
    std::fs::write(&path, machine(1, "")).unwrap();
    for what in ["certificate", "trust"] {
        let ended = typing(&mut opcua(&path, what, &[]), "");
        assert_eq!(ended.code, Some(1));
        assert!(ended.said.contains("bus control is not secured"), "{}", ended.said);
    }
    let server = Server::start(&[]);
    std::fs::write(&path, machine(server.port, &secured("sign", "own", ""))).unwrap();
    let ended = typing(&mut opcua(&path, "trust", &[]), "yes\n");
    assert!(ended.said.contains("offers no certificate: enable security at the server"), "{}", ended.said);
}

#[tokio::test]
async fn a_user_is_let_in_by_his_certificate_and_not_by_another() {
    let given = certificates();
    let server =
        serve(given.path(), "server", &["--user-cert", &given.path().join("user.der").display().to_string()]);
    for (name, expected) in
        [("user", Ok([Ok(20.0), Ok(100.0)])), ("other", Err(no_session(OpcUaFault::UserRefused)))]
    {
        let user = format!("user = {{ cert = \"{name}.der\", key = \"{name}.pem\" }}");
        let text = machine(server.port, &secured("sign-and-encrypt", "own", &user));
        let mut line = Line::new(super::rig::profile(&text, given.path()));
        assert_eq!(line.signals().await, expected, "{name}");
    }
}

#[test]
fn a_certificate_is_told_thirty_days_before_it_expires_when_it_has_and_not_where_a_newer_one_is_trusted() {
    let given = certificates();
    let copied =
        |file: &str, to: &str| std::fs::copy(given.path().join(file), given.path().join(to)).unwrap();
    copied("soon.der", "trusted/soon.der");
    let user = "user = { cert = \"user.der\", key = \"user.pem\" }";
    let profile = super::rig::profile(&machine(1, &secured("sign", "own", user)), given.path());
    let ends = |name: &str| Certificate::read(&std::fs::read(given.path().join(name)).unwrap()).unwrap().to;
    let reported = |at: Moment| -> Vec<(String, bool)> {
        let found = expiring(&profile, at).into_iter();
        found.map(|expiry| (expiry.file, expiry.is_over)).collect()
    };
    let of = |names: &[(&str, bool)]| -> Vec<_> {
        names.iter().map(|(name, is_over)| ((*name).to_owned(), *is_over)).collect()
    };
    const DAY: Duration = Duration::from_hours(24);
    let end = ends("soon.der");
    assert_eq!(reported(end.before(31 * DAY)), of(&[]));
    assert_eq!(reported(end.before(29 * DAY)), of(&[("trusted/soon.der", false)]));
    assert_eq!(reported(end.after(DAY)), of(&[("trusted/soon.der", true)]));
    let all =
        [("own.der", false), ("user.der", false), ("trusted/server.der", false), ("trusted/soon.der", true)];
    let mut found = reported(ends("own.der").before(DAY));
    found.sort_by_key(|(file, _)| all.iter().position(|(name, _)| name == file));
    assert_eq!(found, of(&all));
    // Same name and longer validity: the server has a new certificate, so the old one is not reported.
    assert!(
        python("opcua_certificates.py")
            .args(["--renew".as_ref(), given.path().as_os_str()])
            .status()
            .unwrap()
            .success()
    );
    copied("renewed.der", "trusted/renewed.der");
    let profile = super::rig::profile(&machine(1, &secured("sign", "own", "")), given.path());
    assert_eq!(expiring(&profile, end.after(DAY)), [], "{end}");
}

#[test]
fn a_running_gateway_has_an_alarm_of_a_certificate_that_expires_in_status_and_check_warns_of_it() {
    let given = certificates();
    for name in ["der", "pem"] {
        std::fs::copy(given.path().join(format!("soon.{name}")), given.path().join(format!("own.{name}")))
            .unwrap();
    }
    let path = profile(given.path(), 1);
    let expected = "bus control: the gateway's certificate own.der expires on ";
    let checked = typing(isotherm(given.path()).arg("check").arg(&path), "");
    assert!(checked.said.contains(expected), "{}", checked.said);
    let mut command = isotherm(given.path());
    let mut gateway =
        Running::start(command.arg("run").arg(&path).args(["--state", "state"]).current_dir(given.path()));
    gateway.receives(expected);
    let mut status = isotherm(given.path());
    let status =
        status.arg("status").arg(&path).args(["--state", "state", "--json"]).current_dir(given.path());
    let status = typing(status, "");
    let alarms = status.json()["alarms"].clone();
    let is_it = |alarm: &&Value| alarm["id"] == "certificate own.der of bus control";
    let alarm = alarms.as_array().unwrap().iter().find(is_it).unwrap_or_else(|| panic!("{alarms}"));
    assert_eq!(alarm["kind"], "certificate-expires");
    assert!(
        alarm["text"].as_str().unwrap().contains("create both again (`isotherm opcua certificate PROFILE`)")
    );
}
