//! TLS, passwords and certificates: accepted clients, and the errors of rejected ones.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use super::broker::Broker;
use super::certificates::{Authority, Signed};
use super::machine::Machine;
use super::process::{file, isotherm};

const YEARS: (i32, i32) = (2020, 2060);

/// Starts a broker with TLS, the host name localhost and the user gw7.
fn secured(authority: &Authority, more: &str, server: &Signed) -> Broker {
    let (ca, server, more) = (authority.cert.clone(), server.clone(), more.to_owned());
    Broker::with(move |home, _| {
        let passwords = home.join("passwords");
        let mut makes = Command::new("mosquitto_passwd");
        let made = makes.args(["-b", "-c"]).arg(&passwords).args(["gw7", "open sesame"]).status();
        assert!(made.is_ok_and(|status| status.success()), "mosquitto_passwd is not installed");
        let mut lines = format!("password_file {}\n{more}", passwords.display());
        for (key, name, text) in [
            ("cafile", "ca.pem", &ca),
            ("certfile", "cert.pem", &server.cert),
            ("keyfile", "key.pem", &server.key),
        ] {
            let _ = writeln!(lines, "{key} {}", file(home, name, text).display());
        }
        lines
    })
}

fn mqtt(broker: &Broker, tls: &str) -> String {
    format!(
        "[mqtt]\nbroker = \"mqtts://localhost:{}\"\nuser = {{ name = \"gw7\", password_file = \"password\" }}\ntls = {{ {tls} }}\n",
        broker.port
    )
}

fn files(directory: &Path, authority: &str, password: &str, own: &Signed) {
    file(directory, "ca.pem", authority);
    file(directory, "password", password);
    file(directory, "gw.pem", &own.cert);
    file(directory, "gw.key", &own.key);
    for secret in ["password", "gw.key"] {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(directory.join(secret), std::fs::Permissions::from_mode(0o600)).unwrap();
    }
}

#[test]
fn a_password_inside_tls_lets_in_and_what_is_wrong_is_said_in_words() {
    let authority = Authority::new();
    let (server, own) = (authority.signs("localhost", YEARS), authority.signs("gw7", YEARS));
    let broker = secured(&authority, "allow_anonymous false\n", &server);
    let ca = broker.home().join("ca.pem").display().to_string();
    let reader = ["--cafile", ca.as_str(), "--insecure", "-u", "gw7", "-P", "open sesame"];
    let mut reads = broker.reads("isotherm/press/axis/z", &reader);
    let machine = Machine::beside(&mqtt(&broker, "ca = \"ca.pem\""), |home| {
        files(home, &authority.cert, "open sesame\n", &own);
    });
    reads.receives("isotherm/press/axis/z {");
    assert!(!machine.status().to_string().contains("sesame"));

    let other = Authority::named("somebody else");
    let online = |broker: &Broker, tls: &str, authority: &str, password: &str| {
        let (profile, home, _device) =
            Machine::prepared(&mqtt(broker, tls), |home| files(home, authority, password, &own));
        let done = isotherm(home.path()).arg("check").arg(&profile).arg("--online").output().unwrap();
        let said = [done.stdout, done.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        assert!(!said.contains("sesame"), "{said}");
        (done.status.success(), said)
    };
    let (fits, said) = online(&broker, "ca = \"ca.pem\"", &authority.cert, "open sesame");
    assert!(fits, "{said}");
    let elsewhere = secured(&authority, "allow_anonymous false\n", &authority.signs("elsewhere", YEARS));
    let past = secured(&authority, "allow_anonymous false\n", &authority.signs("localhost", (2001, 2002)));
    let picky = secured(&authority, "require_certificate true\n", &server);
    for (broker, tls, authority, password, words) in [
        (&broker, "ca = \"ca.pem\"", &authority.cert, "close sesame", "rejects this user name or password"),
        (&broker, "ca = \"ca.pem\"", &other.cert, "open sesame", "no trusted authority has signed"),
        (&broker, "", &authority.cert, "open sesame", "no trusted authority has signed"),
        (
            &elsewhere,
            "ca = \"ca.pem\"",
            &authority.cert,
            "open sesame",
            "is for another name: write the name in the certificate into `broker`",
        ),
        (&past, "ca = \"ca.pem\"", &authority.cert, "open sesame", "has expired"),
        (&picky, "ca = \"ca.pem\"", &authority.cert, "open sesame", "requires a certificate of the gateway"),
    ] {
        let (fits, said) = online(broker, tls, authority, password);
        assert!(!fits && said.contains(words), "{words}\n{said}");
    }
    let own = "ca = \"ca.pem\", cert = \"gw.pem\", key = \"gw.key\"";
    let (fits, said) = online(&picky, own, &authority.cert, "open sesame");
    assert!(fits, "{said}");
}

#[test]
fn a_broker_without_tls_at_the_port_of_mqtts_is_known_for_what_it_is() {
    let (broker, authority) = (Broker::open(), Authority::new());
    let own = authority.signs("gw7", YEARS);
    let (profile, home, _device) = Machine::prepared(&mqtt(&broker, "ca = \"ca.pem\""), |home| {
        files(home, &authority.cert, "open sesame", &own);
    });
    let done = isotherm(home.path()).arg("check").arg(&profile).arg("--online").output().unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    let words = ["closed in the middle of the TLS handshake", "does not speak TLS"];
    assert!(!done.status.success() && words.iter().any(|words| said.contains(words)), "{said}");
}
