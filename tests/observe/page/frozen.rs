//! A frozen sensor and a silent control on the page: a real gateway with a virtual machine. Its time is stopped while
//! the browser reads the page.

use std::path::Path;
use std::time::Duration;

use isotherm::clock::{Clock, zone};
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::http::{Admission, serve};
use isotherm::virtual_machine::{FaultScript, PlantSpec, Setup, VirtualMachine};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Commands, Profile, parse_with};

use super::{OPEN, look};

const GRINDER: &str = include_str!("../../../profiles/surface-grinder.toml");
const STAND_INS: &str = r#"{ "format": "isotherm-stand-ins", "version": 1, "sensors": [
  { "signal": "wheelhead", "threshold": 0.3, "stands_in": true, "terms": [
    { "signal": "bed", "lag_s": 0, "gain": 1.2 }, { "signal": "scale_z", "lag_s": 0, "gain": 1e-9 }] } ] }"#;
const FROZEN: &str = "[[fault]]\ndevice = \"thermocouples\"\nkind = \"value\"\nsignal = \"wheelhead\"\nvalue = 23.0\nat = \"30min\"";

/// Profile of the grinder with one model, with its expected error. The bed predicts the wheelhead.
fn grinder() -> Profile {
    let model = "[[axis.z.model]]
name = \"rises\"
kind = \"linear\"
stand_ins = \"s.json\"
expected = { since_datum = [0.0, 4.41] }
terms = [
  { signal = \"bed\", gain = 2.6, reference = \"start\" },
  { signal = \"wheelhead\", gain = -1.2, reference = \"start\" },
]
";
    let (before, rest) = GRINDER.split_once("[[axis.z.model]]").unwrap();
    let (_, after) = rest.split_once("[output.").unwrap();
    let files = [("s.json", STAND_INS.as_bytes())];
    let text = format!("{before}{model}\n[output.{after}");
    parse_with(Path::new("grinder.toml"), &text, &files, &[], &[])
        .unwrap_or_else(|why| panic!("{why}"))
        .profile
}

/// Returns the page three hours after the machine started at this hour of its own time zone. The sensor froze after
/// half an hour.
fn looked_at_from(hour: i8, view: &str, words: &[&str]) -> String {
    looked_at_after(FROZEN, hour, view, words)
}

/// Returns the page after these faults.
fn looked_at_after(faults: &str, hour: i8, view: &str, words: &[&str]) -> String {
    let here = jiff::tz::TimeZone::get(&zone()).unwrap();
    let begin = jiff::civil::date(2026, 1, 5).at(hour, 0, 0, 0).to_zoned(here).unwrap().timestamp();
    let begin = Moment::from_nanos(u64::try_from(begin.as_nanosecond()).unwrap());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let profile = grinder();
        let clock = Clock::simulated(begin, None);
        let hold = clock.hold();
        let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
        let faults = FaultScript::parse(faults, &profile).unwrap();
        let setup = Setup { faults, ..Setup::on_free_ports(plant, 1) };
        let mut machine = VirtualMachine::start(&profile, setup, &clock).await.unwrap();
        let mut last = clock.join();
        let gateway = Gateway::new(machine.serving(profile), &clock, Options::default());
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let admission = Admission { commands: Commands::Local, ..Admission::default() };
        tokio::spawn(serve(listener, gateway.source(), admission, std::future::pending()));
        let (view, words) =
            (view.to_owned(), words.iter().map(|word| (*word).to_owned()).collect::<Vec<String>>());
        let look = move || look(&url, &view, &words.iter().map(String::as_str).collect::<Vec<&str>>());
        drop(hold);
        let mut text = String::new();
        let over = async {
            last.sleep_until(begin.after(Duration::from_hours(3))).await;
            let _still = clock.hold();
            text = tokio::task::spawn_blocking(look).await.unwrap();
            drop(last);
        };
        tokio::select! {
            outcome = gateway.run(over, std::future::pending()) => assert!(!outcome.failed, "{outcome:?}"),
            error = machine.failure() => panic!("{error}"),
        }
        text
    })
}

#[test]
fn who_is_frozen_since_when_and_who_stands_in_is_read_on_the_page_and_on_the_wall() {
    let whole = "eval:document.documentElement.scrollWidth <= document.documentElement.clientWidth";
    let frozen = "wheelhead frozen since 10:30, replaced by a stand-in from 2 other sensors";
    let card: &str = &format!("follows a fallback model: {frozen}");
    let first: &str = &format!("Axis z: follows a fallback model ({frozen}).");
    // The expected error is unknown while a sensor has a stand-in.
    let unreported = "eval:document.querySelector('.expected').textContent === ''";
    let row = "eval:[...document.querySelectorAll('#signals tr')].some((row) => row.innerText.includes('▲ frozen'))";
    // The card has the first words; the details have the whole sentence.
    let brief = "eval:document.querySelector('.axis .why').innerText === \
                 'follows a fallback model: wheelhead frozen since 10:30'";
    let words = [first, brief, OPEN, card, unreported, row, "size:390x844", whole];
    let text = looked_at_from(10, "", &words);
    // The text is that of the gateway's event.
    assert!(text.contains("axis z: wheelhead frozen for "), "{text}");
    looked_at_from(10, "/?view=wall", &[first, unreported, "size:390x844", whole]);
}

#[test]
fn what_is_frozen_since_yesterday_says_the_day() {
    let frozen = "wheelhead frozen since 2026-01-05 22:30, replaced by a stand-in from 2 other sensors";
    looked_at_from(22, "", &[frozen]);
}

#[test]
fn each_language_says_it_in_its_own_words_and_marks_them_as_its_own() {
    for (language, words) in [
        ("de", "wheelhead eingefroren seit 10:30, ersetzt durch einen Ersatzwert aus 2 anderen Sensoren"),
        ("ja", "wheelhead は 10:30 から固着。他の 2 点のセンサーから推定した代替値を使用"),
        ("zh", "wheelhead 自 10:30 起冻结，用由其他 2 个传感器推算的替代值代替"),
    ] {
        let own =
            format!("eval:document.querySelector('.axis .why > span:last-of-type').lang === '{language}'");
        looked_at_from(10, "", &[&format!("language:{language}"), words, &own]);
    }
}

/// Checks that page and wall view show the verified value, not the present decision, and a hint below each trouble.
#[test]
fn a_control_that_does_not_answer_is_unreachable_with_the_verified_value_and_its_age() {
    let silent = "[[fault]]\ndevice = \"cnc\"\nkind = \"silent\"\nat = \"179min\"";
    let red = "eval:document.body.innerHTML.includes('unreachable')";
    let held =
        ["unreachable", "last verified ", "the control may hold another value now", "verified ", "Target"];
    // The hint is shown once, on a line of its own.
    let hint = "eval:[...document.querySelectorAll('.axis, #alarms li, #events li')].some((node) => \
                node.querySelector('.hint:not([hidden])')?.innerText.startsWith('To do: is the unit number right'))";
    let once = "eval:[...document.querySelectorAll('#alarms .text, #events .text > span')].every((node) => \
                !node.innerText.includes('is the unit number right'))";
    // A hint is shown once, above the axes, and not again at the axis or its events.
    let alone = "eval:[...document.querySelectorAll('.hint:not([hidden])')].filter((node) => \
                 node.innerText.includes('is the unit number right')).length === 1";
    let text = looked_at_after(silent, 10, "", &[&held[..], &[red, hint, once, alone]].concat());
    assert!(!text.contains("Every armed axis follows its model"), "{text}");
    assert!(!text.contains("expected within"), "{text}");
    looked_at_after(silent, 10, "/?view=wall", &held);
    let german =
        ["language:de", "nicht erreichbar", "zuletzt bestätigt ", "Zu tun: is the unit number right"];
    looked_at_after(silent, 10, "", &german);
}

/// Checks that before the first verified value the figure is missing and the bar is empty. The target is no substitute.
#[test]
fn a_control_that_never_answered_has_no_figure_and_an_empty_bar() {
    let refused = "[[fault]]\ndevice = \"cnc\"\nkind = \"refuse\"";
    let empty = "eval:document.querySelector('.bar .fill').hidden";
    let none = "eval:document.querySelector('.figure').innerText === '–'";
    looked_at_after(refused, 10, "", &["not verified yet", empty, none]);
    looked_at_after(refused, 10, "/?view=wall", &["not verified yet", none]);
}
