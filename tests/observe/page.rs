//! The page of the running demo in a real browser.
//!
//! Requires chromium and python3; `tests/run page` installs both. Without them this test fails with a message.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::process::Command;

use isotherm::observe::status::WorseStatus;

mod drawn;
mod frozen;
use crate::support::fake::Door;
use crate::support::process;

use process::{Running, isotherm};

/// Returns the text of a demo's page once the words are there.
fn looked_at(demo: &[&str], view: &str, words: &[&str]) -> String {
    let home = tempfile::tempdir().unwrap();
    let mut running = isotherm(home.path());
    let mut running = Running::start(running.args(["demo", "--listen", "127.0.0.1:0"]).args(demo));
    let address = running.receives("page  http://").trim_start_matches("page  ").to_owned();
    look(&address, view, words)
}

/// Returns the text of the page at this address once the words are there.
fn look(address: &str, view: &str, words: &[&str]) -> String {
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let seen = Command::new("python3").arg(look).arg(format!("{address}{view}")).args(words).output();
    let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let text = String::from_utf8_lossy(&seen.stdout).into_owned();
    let said = String::from_utf8_lossy(&seen.stderr);
    assert!(
        seen.status.success(),
        "the page says:\n{text}\nthe browser says:\n{said}\n(without chromium: `tests/run page`)"
    );
    text
}

/// Opens what the page has folded.
const OPEN: &str = "eval:(document.querySelectorAll('details').forEach((one) => { one.open = true; }), true)";
const DAY: [&str; 4] = ["--speed", "600", "--for", "24h"];

#[test]
fn a_browser_shows_the_running_machine() {
    // The first word appears when figures have arrived, the last one when the axis is armed.
    let folded = "eval:!document.body.innerText.includes('holding:104')";
    let words = [
        "Axis z",
        "compensating",
        "scale_z",
        "Output: armed",
        folded,
        "size:1280x900",
        OPEN,
        "cnc_z",
        "verified",
        "holding:104",
    ];
    let text = looked_at(&DAY, "", &words);
    assert!(text.contains("Not a safety function"), "{text}");
    assert!(!text.contains("This page needs JavaScript"), "{text}");
}

#[test]
fn units_are_written_as_people_do_a_bit_is_on_or_off_and_a_time_has_its_zone() {
    let bit = "eval:[...document.querySelectorAll('td span')].some((cell) => cell.textContent === 'on')";
    let text = looked_at(&DAY, "", &["Axis z", " °C", " µm", bit, " UTC"]);
    for word in ["degC", " C\n", "bool"] {
        assert!(!text.contains(word), "{word} in {text}");
    }
    assert!(!text.contains("Settings that override the profile"), "{text}");
}

#[test]
fn what_was_set_above_the_profile_stands_on_the_page_with_both_values() {
    let set = ["--set", "axis.z.limit=30", "--speed", "600", "--for", "24h"];
    let row = "eval:document.querySelectorAll('#overridden tbody tr').length === 1";
    let narrow = "eval:document.documentElement.scrollWidth <= document.documentElement.clientWidth";
    let text = looked_at(
        &set,
        "",
        &["Settings that override the profile", "--set axis.z.limit", row, "size:390x844", narrow],
    );
    assert!(text.contains("40.0") && text.contains("30"), "{text}");
}

#[test]
fn how_wrong_cz_is_expected_to_be_stands_beside_it_and_on_the_wall() {
    let model = "axis.z.model=[{ name = \"difference\", kind = \"linear\", expected = { since_datum = [0.0, 4.41] }, terms = [\
                 { signal = \"bed\", gain = 2.4, reference = 0.0 }, { signal = \"wheelhead\", gain = -2.4, reference = 0.0 }] }]";
    let set = [&["--set", model][..], &DAY].concat();
    let whole = "eval:document.documentElement.scrollWidth <= document.documentElement.clientWidth";
    let words = ["compensating", "expected within ± 2.1 µm", "size:390x844", whole];
    looked_at(&set, "", &words);
    looked_at(&set, "/?view=wall", &words);
    for (language, word) in [
        ("language:de", "erwartet auf ± 2,1 µm"),
        ("language:ja", "誤差の見込み ± 2.1 µm 以内"),
        ("language:zh", "预计误差在 ± 2.1 µm 以内"),
    ] {
        looked_at(&set, "", &[language, word, "size:390x844", whole]);
    }
}

/// The status still contains the value. The page hides it, because it does not apply while Cz is on its way.
#[test]
fn how_wrong_cz_is_expected_to_be_is_not_said_while_a_step_or_the_rate_holds_it_back() {
    let model = "axis.z.model=[{ name = \"difference\", kind = \"linear\", expected = { since_datum = [0.0, 4.41] }, terms = [\
                 { signal = \"bed\", gain = 2.4, reference = 0.0 }, { signal = \"wheelhead\", gain = -2.4, reference = 0.0 }] }]";
    // The model requests so much that Cz needs hours to reach it.
    let model = model.replace("terms = [", "offset = 30, terms = [");
    for (stage, least) in [("step", "0.1"), ("rate", "0.01")] {
        let slow = format!("axis.z.{stage}={least}");
        let set = ["--set", &model, "--set", &slow, "--speed", "60", "--for", "24h"];
        let said = format!(
            "eval:(() => {{ const ask = new XMLHttpRequest(); ask.open('GET', '/api/status', false); ask.send(); \
             const axis = JSON.parse(ask.responseText).axes[0]; return axis.state === 'active' && axis.acted.includes('{stage}') \
             && axis.expected_um > 2; }})()"
        );
        let shown = format!("● {stage}");
        let hidden = "eval:document.querySelector('.expected').textContent === ''";
        looked_at(&set, "", &["compensating", OPEN, &shown, &said, hidden]);
        looked_at(&set, "/?view=wall", &["compensating", &said, hidden]);
    }
}

/// The page has only just been opened, so none of the history comes from the page.
#[test]
fn the_past_comes_from_the_logs_with_zoom_and_as_a_file() {
    let two = "eval:document.querySelectorAll('.uplot').length === 2 && document.querySelector('#past-note').textContent === '' \
               && document.querySelector('#past-charts').ariaBusy === 'false'";
    let span = |test: &str| {
        format!(
            "eval:(({{searchParams: p}}) => (new Date(p.get('to')) - new Date(p.get('from'))) / 1000 {test})\
             (new URL(document.querySelector('#past-download').href))"
        )
    };
    let file = "eval:(() => { const ask = new XMLHttpRequest(); ask.open('GET', document.querySelector('#past-download').href, \
                false); ask.send(); return ask.responseText.startsWith('time,z_cz_um,z_raw_um,bed,wheelhead\\n2026-') })()";
    let steps =
        ["compensating", "size:1280x900", two, &span("=== 28800"), "click:1 h", two, &span("=== 3600")];
    let hours = "eval:document.querySelector('#uptime').textContent.includes(' h ')";
    // The mouse draws over a tenth of the chart.
    let closer = [hours, "click:+", &span("=== 1800"), two, "drag:.u-over", &span("< 200"), two, file];
    looked_at(&["--speed", "600", "--for", "24h"], "", &[&steps[..], &closer].concat());
}

/// A new gateway has logs of minutes. In the intervals of eight hours, they would be a few points.
#[test]
fn logs_that_cover_little_of_a_span_are_read_in_intervals_of_their_own_time() {
    // The trends of the last hour ask for 120 points.
    let closer = "eval:performance.getEntriesByType('resource').filter(({ name }) => name.includes('api/history?')).some(({ name }) => { \
                  const asked = new URL(name).searchParams; const span = new Date(asked.get('to')) - new Date(asked.get('from')); \
                  return asked.get('points') !== '120' && span > 0 && span <= 14400e3; })";
    let pressed = "eval:document.querySelector('#past-tools [aria-pressed=true]').textContent === '8 h'";
    looked_at(&["--speed", "120", "--for", "24h"], "", &["compensating", pressed, closer]);
}

#[test]
fn the_page_and_the_wall_speak_the_languages_of_the_browser() {
    for (language, words) in [
        ("language:de", ["kompensiert", "Achse z", "bestätigt", "Korrekturwert"]),
        ("language:ja", ["補正中", "軸 z", "確認済み", "補正値"]),
        ("language:zh", ["补偿中", "轴 z", "已验证", "补偿值"]),
    ] {
        let whole = "eval:document.documentElement.scrollWidth <= document.documentElement.clientWidth";
        let opened = [&[language, OPEN][..], &words, &["size:390x844", whole]].concat();
        looked_at(&DAY, "", &opened);
        looked_at(&DAY, "/?view=wall", &[&[language][..], &words[..2]].concat());
    }
}

/// CSS has 96 pixels per inch; a digit has 0.7 of its font's size.
#[test]
fn the_wall_is_one_colour_with_figures_of_twenty_millimetres_and_no_buttons() {
    let figures = "eval:[...document.querySelectorAll('.figure')].length > 0 && [...document.querySelectorAll('.figure')]\
                   .every((figure) => parseFloat(getComputedStyle(figure).fontSize) * 0.7 / 96 * 25.4 >= 20)";
    let colour = "eval:getComputedStyle(document.body).backgroundColor === 'rgb(0, 112, 47)' && \
                  document.body.clientWidth === innerWidth && document.body.clientHeight >= innerHeight";
    let whole = "eval:document.documentElement.scrollWidth <= document.documentElement.clientWidth";
    let buttons = "eval:document.querySelectorAll('button').length === 0";
    let words = [
        "compensating",
        "Axis z",
        buttons,
        "size:1280x800",
        figures,
        colour,
        whole,
        "size:390x844",
        figures,
        whole,
    ];
    looked_at(&DAY, "/?view=wall", &words);
}

#[test]
fn an_orderly_stop_is_no_fault_neither_while_it_runs_nor_after_it() {
    let calm = "eval:!document.querySelector('[data-tone=bad], [data-tone=warn]')";
    let banner = "eval:document.querySelector('#lost').classList.contains('stopped')";
    let end = ["--speed", "600", "--for", "2h"];
    let words = ["compensating", "size:1280x900", "The gateway was stopped at", calm, banner];
    let text = looked_at(&end, "", &words);
    assert!(text.contains("→ returning to zero"), "{text}");
    assert!(!text.contains("No connection"), "{text}");
}

#[test]
fn a_model_that_is_worse_than_no_compensation_is_named_with_both_figures() {
    let amber = "eval:document.querySelector('.axis .badge').dataset.tone === 'warn'";
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let door = Door::open(None).await;
        door.change(|status| {
            let axis = &mut status.axes[0];
            axis.warned = false;
            let worse = WorseStatus { touches: 5, without_um: 2.04, with_um: 3.16, ramps: false };
            axis.probe.as_mut().unwrap().worse = Some(worse);
        });
        for words in [
            vec![OPEN, "worse: 3.2 µm are left with the model, 2.0 µm without (last probings: 5)", amber],
            vec![OPEN, "language:de", "schlechter: 3,2 µm bleiben mit dem Modell, 2,0 µm ohne"],
        ] {
            let address = format!("http://{}", door.address);
            tokio::task::spawn_blocking(move || look(&address, "", &words)).await.unwrap();
        }
    });
}
