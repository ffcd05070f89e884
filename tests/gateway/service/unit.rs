//! Unit file of the service, checked by systemd itself.

use std::path::Path;
use std::process::Command;

const UNIT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/packaging/isotherm@.service");

fn analyze(words: &[&str]) -> (bool, String) {
    // The program is in Debian's package systemd.
    let output = Command::new("systemd-analyze").args(words).arg(UNIT).output().unwrap();
    let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (output.status.success(), said)
}

#[test]
fn the_unit_is_no_more_exposed_than_3() {
    let (is_below, said) = analyze(&["security", "--offline=true", "--threshold=30", "--no-pager"]);
    assert!(is_below && said.contains("Overall exposure level"), "{said}");
}

#[test]
fn systemd_understands_every_line_of_the_unit() {
    let (_, said) = analyze(&["verify"]);
    let ours = said.lines().filter(|line| line.contains("isotherm@"));
    // The unit names the path at which a package installs the program.
    let wrong: Vec<&str> =
        ours.filter(|line| !line.contains("/usr/bin/isotherm is not executable")).collect();
    assert!(wrong.is_empty(), "{said}");
    let unit = std::fs::read_to_string(UNIT).unwrap();
    let of_test = Path::new(env!("CARGO_TARGET_TMPDIR")).join("isotherm@.service");
    std::fs::write(&of_test, unit.replace("WatchdogSec=", "WatchdogSecs=")).unwrap();
    let output = Command::new("systemd-analyze").arg("verify").arg(&of_test).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("WatchdogSecs"), "it finds what is wrong");
}

/// Values of the lines with this key in the unit.
fn values(key: &str) -> Vec<String> {
    let unit = std::fs::read_to_string(UNIT).unwrap();
    unit.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('=')).map(str::to_owned).collect()
}

#[test]
fn the_unit_allows_the_serial_ports_that_the_manual_names() {
    let allowed = values("DeviceAllow");
    for port in ["ttyS", "ttyUSB", "ttyACM", "ttyXRUSB", "ttyr", "ttyAMA", "ttyO", "ttymxc"] {
        assert!(allowed.contains(&format!("char-{port} rw")), "{port} in {allowed:?}");
        let manual = include_str!("../../../docs/service.md");
        assert!(manual.contains(&format!("`{port}`")), "{port}");
    }
    assert_eq!(allowed.len(), 8, "the manual names every port: {allowed:?}");
}

/// Memory of two gateways of 500 axes, the files of both profiles, and the reading of a profile, in MB.
#[test]
fn the_memory_limit_of_the_unit_is_above_what_a_gateway_may_need() {
    const MEASURED: u64 = 34;
    let manual = include_str!("../../../docs/developing.md");
    let row =
        manual.lines().find(|line| line.starts_with("| An axis and an offset for each device |")).unwrap();
    assert!(row.contains(&format!("| {MEASURED} MB |")), "{row}");
    let limit = values("MemoryMax");
    let [limit] = limit.as_slice() else { panic!("{limit:?}") };
    let limit: u64 = limit.strip_suffix('G').unwrap().parse().unwrap();
    assert!(1024 * limit > 2 * MEASURED + 2 * 256 + 420, "{limit}");
}

#[test]
fn each_protection_that_is_left_out_has_its_reason_in_the_manual() {
    let (_, said) = analyze(&["security", "--offline=true", "--no-pager"]);
    let manual = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/service.md")).unwrap();
    let left_out = said.lines().filter_map(|line| line.strip_prefix("✗ ")?.split_whitespace().next());
    let mut found = 0;
    for directive in left_out {
        found += 1;
        let (name, value) = directive.split_once('=').unwrap();
        let words = [name, value.trim_start_matches('~')];
        // Directives without which the program cannot work, and parts of other lines.
        let is_needed = ["DeviceAllow", "SupplementaryGroups"].contains(&name)
            || ["AF_UNIX", "AF_(INET|INET6)", "…", "@privileged"].contains(&words[1]);
        let is_told = words.iter().any(|word| !word.is_empty() && manual.contains(word));
        assert!(is_needed || is_told, "{directive} is not in docs/service.md");
    }
    assert!(found > 10, "{said}");
}

#[test]
fn the_learning_program_may_lower_its_priority_and_its_end_is_not_that_of_the_service() {
    let unit = std::fs::read_to_string(UNIT).unwrap();
    let excluded = unit.find("\nSystemCallFilter=~@privileged @resources\n").unwrap();
    let allowed = unit.find("\nSystemCallFilter=setpriority\n").unwrap();
    assert!(allowed > excluded, "a later line prevails");
    assert!(unit.contains("\nOOMPolicy=continue\n"));
}
