//! The files that `docker/fleet` mounts exist, and Prometheus accepts its configuration. The compose file itself is not
//! run, because that needs a registry.

use std::path::{Path, PathBuf};

use crate::prometheus::process::file;
use crate::prometheus::server::promtool;

fn fleet() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docker/fleet")
}

fn copied(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
}

#[test]
fn whatever_the_compose_file_mounts_is_there_but_for_the_secrets_and_each_volume_is_named() {
    let text = std::fs::read_to_string(fleet().join("compose.yaml")).unwrap();
    let (services, named) = text.split_once("\nvolumes:\n").unwrap();
    let mounts = services.lines().filter_map(|line| line.trim().strip_prefix("- "));
    let mounts = mounts.filter_map(|mount| mount.split_once(":/"));
    let (mut files, mut volumes) = (0, 0);
    for (from, _) in mounts {
        if from.starts_with("./secrets/") {
            continue;
        }
        if from.starts_with('.') {
            assert!(fleet().join(from).exists(), "{from}");
            files += 1;
        } else {
            assert!(named.lines().any(|line| line.trim() == format!("{from}:")), "{from} is no volume");
            volumes += 1;
        }
    }
    assert_eq!((files, volumes), (7, 5));
}

#[test]
fn prometheus_takes_the_configuration_of_the_fleet_with_its_alarms_and_gateways() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    copied(&fleet().join("prometheus"), home);
    copied(&crate::prometheus::server::packaging("prometheus"), home);
    for secret in ["scrape.token", "ca.pem"] {
        file(home, secret, "");
    }
    let text = std::fs::read_to_string(home.join("prometheus.yml")).unwrap();
    let here = file(home, "here.yml", &text.replace("/run/prometheus", home.to_str().unwrap()));
    let (code, said) = promtool(&["check", "config", here.to_str().unwrap()], "");
    assert!(code == 0 && said.contains("1 rule files found") && !said.contains("WARNING"), "{said}");
    let spoiled =
        std::fs::read_to_string(home.join("gateways.yml")).unwrap().replace("- targets:", "- target:");
    file(home, "gateways.yml", &spoiled);
    let (code, said) = promtool(&["check", "config", here.to_str().unwrap()], "");
    assert!(code != 0, "one that is wrong is found: {said}");
}
