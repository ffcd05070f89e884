//! The Grafana dashboard: its queries, and its completeness.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::prometheus::server::packaging;

pub(crate) fn dashboard() -> Value {
    let path = packaging("grafana").join("isotherm.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Titles and queries of all panels, for all machines and axes.
pub(crate) fn queries() -> Vec<(String, String)> {
    let dashboard = dashboard();
    let panels = dashboard["panels"].as_array().unwrap().iter();
    let asked = panels.flat_map(|panel| {
        let targets = panel["targets"].as_array().into_iter().flatten();
        targets.map(|target| (panel["title"].as_str().unwrap(), target["expr"].as_str().unwrap()))
    });
    let chosen =
        |text: &str| text.replace("$machine", ".*").replace("$axis", ".*").replace("$__rate_interval", "1m");
    asked.map(|(title, query)| (title.to_owned(), chosen(query))).collect()
}

#[test]
fn every_panel_has_a_title_a_place_of_its_own_and_the_source_that_is_chosen() {
    let dashboard = dashboard();
    let (mut ids, mut taken) = (BTreeSet::new(), BTreeSet::new());
    for panel in dashboard["panels"].as_array().unwrap() {
        let title = panel["title"].as_str().unwrap();
        assert!(!title.is_empty() && ids.insert(panel["id"].as_u64().unwrap()), "{title}");
        let place = |name: &str| panel["gridPos"][name].as_u64().unwrap();
        assert!(place("x") + place("w") <= 24, "{title} is wider than the page");
        for x in place("x")..place("x") + place("w") {
            for y in place("y")..place("y") + place("h") {
                assert!(taken.insert((x, y)), "{title} lies over another one");
            }
        }
        for target in panel["targets"].as_array().into_iter().flatten() {
            assert_eq!(target["datasource"]["uid"], "${datasource}", "{title}");
        }
    }
    let variables = dashboard["templating"]["list"].as_array().unwrap();
    let names: Vec<&str> = variables.iter().map(|variable| variable["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["datasource", "machine", "axis"]);
    for (title, query) in queries() {
        assert!(!query.contains('$'), "{title}: {query}");
    }
}
