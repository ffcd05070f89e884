//! A gateway with virtual devices, scraped over TLS with the scrape token as the manual describes.

use std::collections::BTreeSet;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::prometheus::certificates::Authority;
use crate::prometheus::dashboard::queries;
use crate::prometheus::process::{Running, file, free_port, isotherm, until};
use crate::prometheus::server::{Prometheus, chapter, packaging, promtool};

const ENVELOPE: &str = r#"{ "format": "isotherm-envelope", "version": 1, "covariance": [[25.0]],
    "inputs": [{ "signal": "bed", "mean": 20.0, "min": -40.0, "max": 80.0 }] }"#;

/// A running gateway with its page over TLS at `localhost`.
struct Machine {
    home: tempfile::TempDir,
    profile: PathBuf,
    port: u16,
    _devices: Running,
    gateway: Running,
}

impl Machine {
    fn start() -> Machine {
        let home = tempfile::tempdir().unwrap();
        let authority = Authority::new();
        let page = authority.signs("localhost", (2020, 2120));
        for (name, text) in [
            ("ca.pem", authority.cert.as_str()),
            ("page.pem", &page.cert),
            ("page.key", &page.key),
            ("bed.json", ENVELOPE),
        ] {
            file(home.path(), name, text);
        }
        for name in ["operator.token", "scrape.token"] {
            let made = isotherm(home.path()).args(["token", "--out"]).arg(home.path().join(name)).output();
            assert!(made.unwrap().status.success());
        }
        std::fs::set_permissions(home.path().join("page.key"), PermissionsExt::from_mode(0o600)).unwrap();
        let text = include_str!("machine.toml").replace("DEVICES", &free_port().to_string());
        let profile = file(home.path(), "walker.toml", &text);
        let mut devices = Running::start(isotherm(home.path()).arg("virtual").arg(&profile));
        devices.receives("module");
        let mut command = isotherm(home.path());
        let mut gateway =
            Running::start(command.arg("run").arg(&profile).arg("--state").arg(home.path().join("state")));
        let page = gateway.receives("page https://");
        let port = page.trim_end_matches('/').rsplit(':').next().unwrap().parse().unwrap();
        Machine { home, profile, port, _devices: devices, gateway }
    }

    /// Reports a measured error, and waits until the axis has learned from it.
    fn is_probed(&self) {
        until("the axis learns from a measured error", || {
            let mut command = isotherm(self.home.path());
            command.arg("measured").arg(&self.profile).args(["--axis", "z", "--error", "0.4", "--state"]);
            let ended = command.arg(self.home.path().join("state")).output().unwrap();
            match ended.status.success() {
                true => Ok(()),
                false => Err(String::from_utf8_lossy(&ended.stderr).into_owned()),
            }
        });
    }

    /// Configuration from the manual, for this machine and for a second target with an invalid token.
    fn configuration(&self) -> PathBuf {
        let at = |name: &str| self.home.path().join(name).display().to_string();
        let chapter = chapter();
        let shown = chapter.split("```yaml\n").nth(1).unwrap().split("```").next().unwrap();
        let mut text = shown.to_owned();
        for (from, to) in [
            ("15s", "1s".to_owned()),
            (
                "/usr/share/isotherm/prometheus/alerts.yml",
                packaging("prometheus/alerts.yml").display().to_string(),
            ),
            ("/etc/prometheus/isotherm.token", at("scrape.token")),
            ("/etc/prometheus/isotherm-ca.pem", at("ca.pem")),
            (
                r#"["grinder-3.plant.example:8443", "grinder-4.plant.example:8443"]"#,
                format!("[\"localhost:{}\"]", self.port),
            ),
        ] {
            assert!(text.contains(from), "{from} in:\n{text}");
            text = text.replace(from, &to);
        }
        file(self.home.path(), "prometheus.yml", &text)
    }
}

/// Returns whether this system provides the value. Values that are not known have no metric.
fn is_told_by_the_kernel(prometheus: &Prometheus) -> bool {
    !prometheus.values("count(isotherm_clock_synchronised)").is_empty()
}

/// Names of metrics in a text.
fn metrics(text: &str) -> BTreeSet<&str> {
    let words = text.split(|letter: char| !(letter.is_ascii_lowercase() || letter == '_'));
    words.filter(|word| word.starts_with("isotherm_")).collect()
}

fn rules() -> String {
    let text = std::fs::read_to_string(packaging("prometheus/alerts.yml")).unwrap();
    let expressions =
        text.lines().filter(|line| !line.contains("description:") && !line.contains("shows how far"));
    expressions.collect::<Vec<_>>().join("\n")
}

#[test]
fn with_the_configuration_of_the_manual_every_query_of_the_dashboard_has_an_answer_and_no_alarm_rises() {
    let mut machine = Machine::start();
    let configuration = machine.configuration();
    let (code, said) = promtool(&["check", "config", configuration.to_str().unwrap()], "");
    assert!(code == 0 && said.contains("SUCCESS"), "{said}");
    let prometheus = Prometheus::start(&configuration, machine.home.path());
    until("the gateway is scraped", || match prometheus.targets() {
        targets if matches!(&targets[..], [(health, _)] if health == "up") => Ok(()),
        other => Err(format!("{other:?}: {:?}", machine.gateway.so_far())),
    });
    machine.is_probed();

    let mut unanswered = queries();
    assert!(unanswered.len() > 30, "{unanswered:?}");
    until("every query has an answer", || {
        unanswered.retain(|(_, query)| {
            let is_excused =
                query.contains("isotherm_clock_synchronised") && !is_told_by_the_kernel(&prometheus);
            !is_excused && !prometheus.values(query).iter().any(|value| value.is_finite())
        });
        if unanswered.is_empty() { Ok(()) } else { Err(format!("{unanswered:#?}")) }
    });
    let compensating = prometheus.values(r#"isotherm_axis_state{axis="z", state="active"}"#);
    assert_eq!(compensating, [1.0], "{:?}", machine.gateway.so_far());

    let rules = rules();
    for name in metrics(&rules) {
        let is_there = !prometheus.values(&format!("count({name})")).is_empty();
        assert!(
            is_there || name == "isotherm_clock_synchronised",
            "an alarm asks for {name}, which there is not"
        );
    }
    until("every rule has been worked out", || {
        let alarms = prometheus.alarms();
        let is_ok = |[_, health, _]: &[String; 3]| health == "ok";
        if !alarms.is_empty() && alarms.iter().all(is_ok) { Ok(()) } else { Err(format!("{alarms:?}")) }
    });
    let firing: Vec<_> = prometheus.alarms().into_iter().filter(|[_, _, state]| state == "firing").collect();
    assert!(firing.is_empty(), "{firing:?}");
}

#[test]
fn a_token_that_is_none_is_seen_as_a_target_that_is_down_and_counted_by_the_gateway() {
    let machine = Machine::start();
    let configuration = machine.configuration();
    let right = std::fs::read_to_string(machine.home.path().join("scrape.token")).unwrap();
    let other = file(machine.home.path(), "other.token", &right.chars().rev().collect::<String>());
    let text = std::fs::read_to_string(&configuration).unwrap();
    let of = |path: &Path| format!("credentials_file: {}", path.display());
    let wrong = text.replace(&of(&machine.home.path().join("scrape.token")), &of(&other));
    assert_ne!(wrong, text);
    let prometheus = Prometheus::start(&file(machine.home.path(), "wrong.yml", &wrong), machine.home.path());
    until("it is down, and says why", || match &prometheus.targets()[..] {
        [(health, why)] if health == "down" && (why.contains("401") || why.contains("429")) => Ok(()),
        other => Err(format!("{other:?}")),
    });
    assert_eq!(prometheus.values(r#"up{job="isotherm"}"#), [0.0]);
}
