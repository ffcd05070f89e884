//! One axis does not have a model yet. The others run, and every display shows which axis has none, and what to do.

use crate::commands::bench::Bench;

const Y: &str = "[axis.y]\nlimit = 20.0\nstep = 1.0\nrate = 1.0\nevery = \"500ms\"\non_fault = { action = \"hold\" }\n\
                 [output.cnc_z]";

fn bench() -> Bench {
    Bench::of(|text| text.replace("[output.cnc_z]", Y))
}

#[test]
fn an_axis_without_a_model_keeps_none_of_the_others_from_running() {
    let bench = bench();
    bench.is_in_state("active");
    let y = bench.status()["axes"][1].clone();
    assert_eq!((&y["name"], &y["state"], &y["has_model"]), (&"y".into(), &"off".into(), &false.into()));
    let why = y["why"].as_str().unwrap();
    assert!(why.contains("isotherm record") && why.contains("isotherm identify"), "{why}");
    assert_eq!((&bench.axis()["has_model"], &y["waiting"]), (&true.into(), &serde_json::Value::Null));

    let (code, said) = bench.ask(&["status"]);
    assert!(code == 0 && said.contains("axis y: no model yet"), "{said}");
    let (_, json) = bench.ask(&["status", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(
        (&json["axes"]["y"]["display"], &json["axes"]["y"]["state"]),
        (&"no model yet".into(), &"off".into())
    );
    // An axis that the profile does not require is no failure.
    assert_eq!(bench.ask(&["status", "--healthy"]), (0, "healthy\n".to_owned()));

    let checked = crate::commands::process::isotherm(bench.home.path())
        .arg("check")
        .arg(&bench.profile)
        .output()
        .unwrap();
    let said = [checked.stdout, checked.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    assert!(checked.status.success() && said.contains("`y` has no model yet: the axis stays off"), "{said}");
}

#[test]
fn an_axis_without_a_model_is_not_armed_with_the_others_and_says_why_when_it_is_meant() {
    let bench = bench();
    bench.is_in_state("active");
    assert_eq!(bench.ask(&["disarm"]).0, 0);
    bench.is_in_state("off");
    assert_eq!(bench.status()["axes"][1]["why"].as_str().unwrap().find("no model yet"), Some(0));
    let (code, said) = bench.ask(&["arm", "--axis", "y"]);
    let words = ["axis y", "no model yet", "isotherm identify", "--axis y"];
    assert!(code == 1 && words.iter().all(|word| said.contains(word)), "{said}");
    let (code, said) = bench.http("POST", "/api/arm?axis=y", "");
    assert!(code == 409 && said.contains("no model yet"), "{said}");
    bench.is_in_state("off");
    let (code, said) = bench.ask(&["arm"]);
    assert!(code == 0 && said.contains("z: armed") && said.contains("y: no model yet"), "{said}");
    bench.is_in_state("active");
    assert_eq!(bench.status()["axes"][1]["state"], "off");
}

#[test]
fn every_command_takes_one_axis() {
    let bench = bench();
    bench.is_in_state("active");
    for verb in ["zero", "disarm", "arm"] {
        let (code, said) = bench.ask(&[verb, "--axis", "z"]);
        assert!(code == 0 && said.starts_with("z: "), "{verb}: {said}");
        assert_eq!(bench.http("POST", &format!("/api/{verb}?axis=z"), "").0, 200, "{verb}");
        let (code, said) = bench.ask(&[verb, "--axis", "x"]);
        assert!(code == 1 && said.contains("there is no axis x; there are z, y"), "{verb}: {said}");
    }
}

/// Needs chromium and python3, as `tests/observe/page.rs`.
#[test]
fn a_person_sees_which_axis_has_no_model_and_disarms_one_alone() {
    let bench = bench();
    bench.is_in_state("active");
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let chosen = "eval:(document.getElementById('question-axis').value = 'y') === 'y'";
    let yes = "eval:[document.getElementById('question')].filter((it) => it.open).map((it) => it.querySelector('.yes').click()) \
               .length === 0";
    let words = [
        "no model yet",
        "Axis y: no model yet.",
        "isotherm identify",
        "click:Disarm",
        "Which axis",
        chosen,
        "size:1280x900",
        yes,
    ];
    let seen = std::process::Command::new("python3")
        .arg(look)
        .arg(format!("http://{}/", bench.page))
        .args(words)
        .arg("y: off; the registers keep their values")
        .output()
        .unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let said = [seen.stdout, seen.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    assert!(seen.status.success(), "{said}\n(without chromium: `tests/run page`)");
    assert_eq!(bench.axis()["state"], "active");
}
