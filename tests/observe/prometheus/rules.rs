//! Tests of the alarm rules with promtool.

use std::collections::BTreeSet;

use crate::prometheus::server::{chapter, packaging, promtool};

/// Values after a key in a file of rules or of their tests.
fn named<'a>(text: &'a str, word: &str) -> BTreeSet<&'a str> {
    let behind = |part: &'a str| part.trim_start().split([',', ' ', '\n']).next().unwrap();
    text.split(word).skip(1).map(behind).collect()
}

#[test]
fn every_alarm_rises_when_it_must_after_its_time_and_not_where_it_must_not() {
    for verb in [["check", "rules", "alerts.yml"], ["test", "rules", "alerts-test.yml"]] {
        let (code, said) = promtool(&verb, "");
        assert!(code == 0 && said.contains("SUCCESS"), "{said}");
    }
    let read = |name: &str| std::fs::read_to_string(packaging("prometheus").join(name)).unwrap();
    let (rules, tests, chapter) = (read("alerts.yml"), read("alerts-test.yml"), chapter());
    let alarms = named(&rules, "- alert:");
    assert!(alarms.len() > 10, "{alarms:?}");
    assert_eq!(alarms, named(&tests, "alertname:"), "each is tried");
    let rows = chapter.lines().filter_map(|line| line.strip_prefix("| `Isotherm")?.split('`').next());
    let listed: BTreeSet<String> = rows.map(|name| format!("Isotherm{name}")).collect();
    assert_eq!(alarms, listed.iter().map(String::as_str).collect(), "the manual lists each");
}

#[test]
fn an_alarm_that_does_not_rise_when_its_test_says_so_is_found() {
    let home = tempfile::tempdir().unwrap();
    for name in ["alerts.yml", "alerts-test.yml"] {
        let text = std::fs::read_to_string(packaging("prometheus").join(name)).unwrap();
        std::fs::write(
            home.path().join(name),
            text.replace("isotherm_device_up == 0", "isotherm_device_up == 2"),
        )
        .unwrap();
    }
    let tests = home.path().join("alerts-test.yml");
    let (code, said) = promtool(&["test", "rules", tests.to_str().unwrap()], "");
    assert!(code != 0 && said.contains("IsothermDeviceLost"), "{said}");
}
