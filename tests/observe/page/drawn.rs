//! Contents of the page and the wall view in a real browser, in front of a simulated gateway.

use std::path::PathBuf;
use std::time::Duration;

use isotherm::observe::events::{Acknowledgement, Entry, Level};
use isotherm::observe::http::Admission;
use isotherm::observe::status::{DialDirection, Status};
use isotherm_core::display::Display;

use super::{OPEN, look};
use crate::http::OPERATOR;
use crate::pages::{alarm, with_120_devices};
use crate::support::fake::Door;

const NO_SCROLLING: &str = "eval:document.documentElement.scrollHeight <= innerHeight && document.documentElement.scrollWidth <= document.documentElement.clientWidth";
/// Nothing reaches over the right edge of the window. (`innerWidth` of a phone grows with what does.)
const NOTHING_CUT: &str = "eval:[...document.querySelectorAll('body *')].every((node) => !node.checkVisibility() || \
                           node.getBoundingClientRect().right <= document.documentElement.clientWidth + 1)";
/// No element is wider than its box, so nothing is cut in it and nothing scrolls sideways. Four kinds are exempt. A
/// limit bar clips the mark at its end, and a phone hides the head of a table. SVG and uPlot clip what they draw.
const NOTHING_WIDER: &str = "eval:[...document.querySelectorAll('body *')].every((node) => !node.checkVisibility() || \
                             node.matches('.track, thead, thead *, svg, svg *, .uplot, .uplot *') || \
                             node.scrollWidth <= node.clientWidth + 1)";

/// Each word of a state fits on a phone as the word of the machine.
const WORDS_FIT: &str = "eval:Object.entries(JSON.parse(document.querySelector('#words').textContent)).filter(([key]) => key.startsWith('state.'))\
                         .every(([, word]) => { const node = document.querySelector('#word'); const before = node.textContent; node.textContent = word; \
                         const { right } = node.getBoundingClientRect(); node.textContent = before; return right <= 390 - 12; })";

/// Looks at a page of a simulated gateway after these changes to its status.
fn looked_at_with(change: impl FnOnce(&mut Status), views: &[(&str, &[&str])]) -> Vec<String> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let door = Door::open(None).await;
        door.change(change);
        let mut texts = Vec::new();
        for (view, words) in views {
            let (address, view) = (format!("http://{}", door.address), (*view).to_owned());
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            let look = move || look(&address, &view, &words.iter().map(String::as_str).collect::<Vec<_>>());
            texts.push(tokio::task::spawn_blocking(look).await.unwrap());
        }
        texts
    })
}

/// Looks at a view, changes the status after the browser has drawn the word `drawn`, and waits for the words `new`.
async fn looked_at_while(
    door: &Door,
    view: &'static str,
    drawn: &str,
    change: impl FnOnce(&mut Status),
    new: &[&str],
) {
    // The page tells this test that it has drawn the first status.
    let tells = "eval:(fetch('/api/acknowledge?alarm=signal%20t1', \
                 { method: 'POST', headers: { 'isotherm-way': 'page' } }), true)";
    let words = [&[drawn, "size:1280x900", tells, "size:1280x800"][..], new].concat();
    let words: Vec<String> = words.into_iter().map(str::to_owned).collect();
    let (address, before) = (format!("http://{}", door.address), door.askers().len());
    let look = move || look(&address, view, &words.iter().map(String::as_str).collect::<Vec<_>>());
    let look = tokio::task::spawn_blocking(look);
    while door.askers().len() == before && !look.is_finished() {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    door.change(change);
    look.await.unwrap();
}

/// Gives the machine axes with these names, in each state in turn.
fn with_axes(status: &mut Status, names: &[&str]) {
    let states = [Display::Active, Display::Degraded, Display::Holding, Display::Ramping];
    let axis = status.axes[0].clone();
    status.axes = names
        .iter()
        .zip(states.iter().cycle())
        .map(|(name, shown)| {
            let mut axis = axis.clone();
            axis.name = (*name).to_owned();
            axis.label = if *name == "z" { "Main spindle" } else { "" }.to_owned();
            axis.shown = *shown;
            axis.verified_um = Some(-112.5);
            axis
        })
        .collect();
}

#[test]
fn a_wall_shows_three_axes_without_scrolling_with_limit_and_trend() {
    let bars = "eval:document.querySelectorAll('.panel .track').length === 3 && document.querySelectorAll('.panel .trend').length === 3";
    // CSS has 96 pixels per inch; a digit has 0.7 of its font's size.
    let figures = "eval:[...document.querySelectorAll('.figure')].every((figure) => \
                   parseFloat(getComputedStyle(figure).fontSize) * 0.7 / 96 * 25.4 >= 20)";
    let within = "eval:[...document.querySelectorAll('.panel .figure')].every((figure) => \
                  figure.getBoundingClientRect().right <= figure.closest('.panel').getBoundingClientRect().right)";
    let words = [
        "Main spindle",
        "−112.5",
        bars,
        "size:1920x1080",
        NO_SCROLLING,
        NOTHING_CUT,
        figures,
        within,
        "size:1280x800",
        NO_SCROLLING,
        NOTHING_CUT,
        figures,
        within,
        "size:390x844",
        NOTHING_CUT,
        within,
    ];
    // The longest words.
    let german = ["language:de", "−112,5", "size:1280x800", NO_SCROLLING, figures, within];
    let raise = |status: &mut Status| {
        with_axes(status, &["x", "y", "z"]);
        status.alarms = vec![alarm("signal bed", Level::Warning, "2026-07-02T11:50:00Z")];
    };
    let texts = looked_at_with(raise, &[("/?view=wall", &words), ("/?view=wall", &german)]);
    assert!(
        texts[0].contains("Active alarms: 1") && texts[0].contains("signal bed: open circuit"),
        "{}",
        texts[0]
    );
}

#[test]
fn a_wall_shows_eight_axes_as_a_table_and_the_page_as_rows() {
    let rows = "eval:document.querySelectorAll('#axes tbody tr').length === 8 && document.querySelectorAll('.track').length === 8";
    let names = ["x1", "x2", "y", "z", "w", "b", "u", "v"];
    let wall = [
        "Axis x1",
        rows,
        "size:1920x1080",
        NO_SCROLLING,
        "size:1280x800",
        NO_SCROLLING,
        "size:390x844",
        NOTHING_CUT,
    ];
    let many = "eval:document.querySelectorAll('.axes.many .axis').length === 8";
    let apart = "eval:[...document.querySelectorAll('.many .cz .whole')].every((figure) => \
                 figure.getBoundingClientRect().right <= figure.closest('.cz').getBoundingClientRect().right)";
    let page = [
        "Axis x1",
        many,
        "size:1920x1080",
        NOTHING_CUT,
        apart,
        "size:1280x800",
        NOTHING_CUT,
        apart,
        "size:390x844",
        NOTHING_CUT,
        NOTHING_WIDER,
    ];
    looked_at_with(|status| with_axes(status, &names), &[("/?view=wall", &wall), ("", &page)]);
}

#[test]
fn a_machine_with_many_devices_has_pages_with_the_state_of_the_whole() {
    let rows = "eval:document.querySelectorAll('#devices tbody tr').length === 20 && document.querySelectorAll('.axis').length === 20";
    let links = "eval:document.querySelectorAll('#pages a').length === 3 && \
                 document.querySelector('#pages a[aria-current=page]').textContent === '3'";
    let whole = "eval:document.querySelector('#does-disarm').textContent.includes('z3') && \
                 document.querySelector('#does-disarm').textContent.includes('…')";
    // The answer to a command names each axis.
    let answer = "eval:((answer) => { answer.textContent = 'z, '.repeat(20000); answer.classList.add('fresh'); \
                  return answer.getBoundingClientRect().height < innerHeight / 2; })(document.querySelector('#answer'))";
    let narrow = ["size:390x844", NOTHING_CUT, NOTHING_WIDER];
    let page = [&["Axis z119", "Pages of 50 devices:", rows, links, whole][..], &narrow, &[answer]].concat();
    let second = "eval:document.querySelectorAll('#axes tbody tr').length === 50 && location.search === '?view=wall&page=2'";
    let none = "eval:document.querySelector('#pages').hidden";
    let views: [(&str, &[&str]); 3] = [
        ("/?page=3", &page),
        ("/?view=wall&page=2", &["Axis z50", second]),
        ("/?page=99999999999999999999999", &["Axis z119", rows]),
    ];
    looked_at_with(with_120_devices, &views);
    looked_at_with(|_| {}, &[("", &["Axis z", none])]);
}

#[test]
fn an_alarm_of_another_page_leads_to_its_chart_there() {
    let raise = |status: &mut Status| {
        with_120_devices(status);
        let signals = (0..120).map(|number| format!("signal t{number}"));
        status.alarms = signals.map(|id| alarm(&id, Level::Warning, "2026-07-02T11:50:00Z")).collect();
        status.alarms.push(alarm("axis z105", Level::Error, "2026-07-02T11:55:00Z"));
    };
    let count =
        "eval:document.querySelectorAll('#alarms li').length === 100 && document.title.startsWith('(121) ')";
    let click = "eval:(document.querySelector('#alarms .moment').click(), true)";
    let there = "eval:location.search === '?page=3' && document.activeElement.id === 'chart-z105'";
    // Each click waits until the page is whole: on a half drawn page it would lead away too early.
    let page =
        ["Active alarms: 121", "21 more alarms", count, "size:1280x900", click, "size:1280x800", there];
    looked_at_with(raise, &[("", &page), ("/?view=wall", &["Active alarms: 121", "axis z105"])]);
    // On the page that has the chart, the link leads to it as well.
    looked_at_with(raise, &[("/?page=3", &page)]);
}

#[test]
fn every_state_is_whole_in_four_languages_at_three_sizes() {
    let every = |status: &mut Status| {
        let axis = status.axes[0].clone();
        let of = |(shown, name): (Display, &str)| {
            let mut axis = axis.clone();
            axis.name = name.into();
            axis.shown = shown;
            axis
        };
        status.axes = Display::ALL.iter().map(|&(shown, name, ..)| of((shown, name))).collect();
    };
    let all = format!("eval:document.querySelectorAll('.figure').length === {}", Display::ALL.len());
    for language in ["language:en", "language:de", "language:ja", "language:zh"] {
        let sizes =
            ["size:390x844", NOTHING_CUT, "size:1280x900", NOTHING_CUT, "size:1920x1080", NOTHING_CUT];
        let words = [&[language, &all][..], &sizes].concat();
        let opened = [&words[..], &[OPEN, "size:390x844", NOTHING_CUT, NOTHING_WIDER, WORDS_FIT]].concat();
        looked_at_with(every, &[("", &opened), ("/?view=wall", &words)]);
    }
}

/// The page of a gateway without a token has the lines that make one.
#[test]
fn the_lines_that_make_a_token_are_whole_on_a_phone() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let tokens = tempfile::tempdir().unwrap();
        let door = Door::open_at("127.0.0.1:0", Admission::default(), tokens).await;
        let address = format!("http://{}", door.address);
        let lines = ["Axis z", "isotherm token --out", "# below [web]"];
        let words = [&lines[..], &["size:390x844", OPEN, NOTHING_CUT, NOTHING_WIDER]].concat();
        tokio::task::spawn_blocking(move || look(&address, "", &words)).await.unwrap();
    });
}

#[test]
fn alarms_stand_first_with_their_number_in_title_and_icon_and_lead_to_their_moment() {
    let counted = "eval:document.title.startsWith('(2) ') && \
                   document.querySelector('link[rel=icon]').getAttribute('href') === 'page/icon-2.svg'";
    // The most urgent one first, and all of them above the axes.
    let first = "eval:document.querySelector('#alarms li .text').innerText.startsWith('axis z') && \
                 document.querySelector('#alarms').getBoundingClientRect().top < document.querySelector('#axes').getBoundingClientRect().top";
    let hint = "eval:[...document.querySelectorAll('.hint:not([hidden])')].filter((node) => \
                node.innerText.includes('check the sensor')).length === 1";
    let press = "eval:(document.querySelector('#alarms li .moment').click(), true)";
    let moment = "eval:document.activeElement.id === 'chart-z' && (({ searchParams: p }) => \
                  new Date(p.get('from')) < new Date('2026-07-02T11:50:00Z') && \
                  new Date(p.get('to')) - new Date(p.get('from')) === 3600000)(new URL(document.querySelector('#past-download').href))";
    let raise = |status: &mut Status| {
        let mut seen = alarm("signal t1", Level::Warning, "2026-07-02T11:55:00Z");
        let by = Acknowledgement { at: "2026-07-02T11:56:00Z".into(), by: "by anna".into() };
        seen.acknowledged = Some(by);
        status.alarms = vec![seen, alarm("axis z", Level::Error, "2026-07-02T11:50:00Z")];
    };
    let words = ["seen at", counted, first, hint, "size:1280x900", press, moment];
    looked_at_with(raise, &[("", &words)]);
}

#[test]
fn what_nobody_measures_is_not_measured_and_commands_say_what_they_will_do() {
    let unmeasured = |status: &mut Status| {
        with_axes(status, &["y", "z"]);
        status.axes[0].probe = None;
        status.axes[1].arming.armed = false;
    };
    let measured = "eval:[...document.querySelectorAll('.axis')].map((axis) => axis.querySelector('.measured').innerText.includes('not measured'))\
                    .join() === 'true,false'";
    // One of one probing of the day was within its level of ±4 µm.
    let within = "100 % (probings: 1, ±4.0 µm)";
    let asked = "eval:document.querySelector('#question').open && document.querySelector('#question-effect').innerText.startsWith('Not armed: Main spindle (z).')";
    let words = [
        measured,
        within,
        "Output: y armed, Main spindle (z) not armed",
        "Not armed: Main spindle (z). The gateway will write offsets there, starting from the present register values.",
        "Armed now: y −112.5 µm. The gateway will stop writing, and the registers keep these values.",
        "Cz now: y −112.5 µm, z −112.5 µm.",
        "click:Arm",
        asked,
    ];
    looked_at_with(unmeasured, &[("", &words)]);
}

#[test]
fn the_way_back_of_a_change_that_waits_is_named_as_a_withdrawal() {
    let waits = |status: &mut Status| {
        status.axes[0].learned.as_mut().unwrap().waiting = Some("learned-2026-07-01-3fa2".into());
    };
    let no_return = "eval:!document.body.innerText.includes('Return to the model before')";
    looked_at_with(waits, &[("", &["Withdraw this change", no_return])]);
    looked_at_with(|_| (), &[("", &["Return to the model before"])]);
}

#[test]
fn a_wrong_sign_stays_in_sight_and_the_answer_to_a_command_is_seen_from_everywhere() {
    let checked = |status: &mut Status| {
        status.axes[0].sign_checked = Some(("2026-07-02T11:00:00Z".into(), DialDirection::Minus));
    };
    let red = "eval:[...document.querySelectorAll('.axis [data-tone=bad]')].some((node) => node.innerText.includes('WRONG'))";
    let press = "eval:(scrollTo(0, document.body.scrollHeight), document.querySelector('.axis .learned button').click(), true)";
    let seen = "eval:(({ top, bottom }) => top >= 0 && bottom <= innerHeight)(document.querySelector('#answer').getBoundingClientRect())";
    let words = [
        "Sign checked 2026-07-02 13:00:00 UTC+2: Moved to minus, but must move to plus.",
        red,
        "size:1280x900",
        press,
        "size:1280x800",
        "axis z follows another model",
        seen,
    ];
    looked_at_with(checked, &[("", &words)]);
}

/// An axis at its limit does not follow its model, although it compensates.
#[test]
fn an_axis_at_its_limit_is_amber_with_what_its_model_requests() {
    let limited = |status: &mut Status| {
        with_axes(status, &["y", "z"]);
        for axis in &mut status.axes {
            (axis.shown, axis.state) = (Display::Active, "active");
            (axis.why, axis.warned, axis.acted) = ("".into(), false, Vec::new());
        }
        let axis = &mut status.axes[0];
        (axis.limit_um, axis.raw_um, axis.acted) = (2.5, Some(4.0), vec!["limit"]);
    };
    let amber = "eval:document.querySelector('#axis-y .badge').innerText === '▲ compensating' && \
                 document.querySelector('#axis-z .badge').innerText === '● compensating'";
    let card = "stays at its limit of ±2.5 µm: the model requests +4.0 µm";
    let bar = "eval:document.querySelector('#axis-y .ends').innerText.includes('−2.5')";
    let whole = "axes at their limit: y";
    let page = ["Main spindle", amber, card, bar, whole];
    let wall = ["Main spindle", "▲ compensating", "the model requests +4.0 µm", whole];
    looked_at_with(limited, &[("", &page), ("/?view=wall", &wall)]);
}

#[test]
fn in_a_dry_run_no_axis_compensates_and_no_command_writes() {
    let dry = |status: &mut Status| {
        with_axes(status, &["y", "z"]);
        status.dry_run = true;
        for axis in &mut status.axes {
            (axis.shown, axis.state) = (Display::Active, "active");
            (axis.why, axis.warned, axis.acted) = ("".into(), false, Vec::new());
        }
    };
    let grey = "eval:[...document.querySelectorAll('.axis')].every((card) => card.dataset.state === 'off' && \
                card.querySelector('.badge').innerText === '○ dry run')";
    let never = "eval:!document.querySelector('main').innerText.includes('compensating')";
    let disarm = "Armed now: y, Main spindle (z). In a dry run, the gateway writes nothing.";
    let page = ["Main spindle", grey, "would follow its model", disarm, never];
    looked_at_with(dry, &[("", &page), ("/?view=wall", &["Main spindle", "○ dry run", never])]);
}

/// The state says it, in the language of the page.
#[test]
fn an_axis_without_a_model_has_no_second_sentence_about_it() {
    let bare = |status: &mut Status| {
        let axis = &mut status.axes[0];
        (axis.shown, axis.has_model) = (Display::Unmodelled, false);
        (axis.why, axis.warned) = ("no model yet".into(), false);
    };
    let never = "eval:!document.querySelector('#axes').innerText.includes('no model yet')";
    let words = ["language:de", "noch kein Modell", never];
    looked_at_with(bare, &[("", &words), ("/?view=wall", &words)]);
}

#[test]
fn a_machine_without_axes_has_nothing_armed() {
    let words = ["Output: not armed", "There is no axis."];
    looked_at_with(|status| status.axes.clear(), &[("", &words), ("/?view=wall", &["off"])]);
}

/// An open page belongs to the gateway that it was opened at. Without this, figures of the former axes would stay.
#[test]
fn a_gateway_that_returns_with_other_axes_is_drawn_anew() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let door = Door::open(None).await;
        for view in ["", "/?view=wall"] {
            let [from, to] = if view.is_empty() { ["z", "y"] } else { ["y", "x"] };
            let drawn = format!("Axis {from}");
            let gone = format!(
                "eval:![...document.querySelectorAll('h2')].some((head) => head.innerText === '{drawn}')"
            );
            let rename = |status: &mut Status| status.axes[0].name = to.into();
            looked_at_while(&door, view, &drawn, rename, &[&format!("Axis {to}"), &gone]).await;
        }
    });
}

#[test]
fn a_gateway_that_returns_with_more_devices_has_the_links_of_all_its_pages() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let door = Door::open(None).await;
        door.change(with_120_devices);
        let add = |status: &mut Status| {
            let mut added = status.devices[..40].to_vec();
            added.iter_mut().for_each(|device| device.name += "_added");
            status.devices.extend(added);
        };
        let links = "eval:document.querySelectorAll('#pages a').length === 4";
        looked_at_while(&door, "", "Pages of 50 devices:", add, &[links]).await;
    });
}

#[test]
fn events_are_filtered_by_level() {
    let texts = |test: &str| {
        format!(
            "eval:(([...all]) => {test})([...document.querySelectorAll('#events .text')].map((node) => node.innerText))"
        )
    };
    let [two, one] = ["all.length === 2", "all.length === 1 && all[0].includes('stale')"].map(texts);
    let none = "No such events.";
    let add = |status: &mut Status| {
        let at = "2026-07-02T11:40:00Z".to_owned();
        let text = "the gateway has started".to_owned();
        let data = serde_json::Value::Null;
        status.events.insert(0, Entry { at, kind: "started".into(), level: Level::Info, data, text });
    };
    let (two, one) = (two.as_str(), one.as_str());
    let words = [two, "click:Warnings and errors", one, "click:Errors", none, "click:All", two];
    looked_at_with(add, &[("", &words)]);
}

/// Checks the pure parts of the page's scripts, which the page has loaded.
#[test]
fn the_first_clause_of_a_cause_and_the_bands_of_states_are_found() {
    let module = |file: &str, test: &str| {
        format!(
            "eval:((name) => globalThis[name] ? (({{ brief, bands, packed, inOrder, level, Chart, withinToday, residual, isComplete, keep, lastHour }}) => {test})(globalThis[name]) : \
             (import('/page/{file}').then((it) => {{ globalThis[name] = it; }}), false))('{file}')"
        )
    };
    let brief = module(
        "text.js",
        "[['bed: open circuit (raw 0x7fff)', 'bed: open circuit'], ['no answer in time; 3 tries', 'no answer in time'], \
          ['one two three four five six', 'one two three four five …'], \
          ['output cnc_x is unverified: no program listens', 'output cnc_x is unverified'], ['wheelhead 自 10:30 起冻结，用由', 'wheelhead 自 10:30 起冻结'], ['', '']]\
          .every(([text, short]) => brief(text) === short)",
    );
    // Off until 100, active until 200, frozen to the end; and a ramp that the operator asked for.
    let bands = module(
        "bands.js",
        "(() => { const change = (at, from, to, level) => ({ kind: 'axis-state', level, at: new Date(at * 1000).toISOString(), \
          data: { axis: 'z', from, to } }); const axis = { name: 'z', state: 'holding' }; \
          const events = [change(100, 'off', 'active', 'info'), change(200, 'active', 'holding', 'warning')]; \
          const found = bands(axis, events, 50, 300).map(({ from, to, tone }) => [from, to, tone].join()).join(' '); \
          const asked = bands(axis, [change(100, 'active', 'ramping', 'info')], 50, 300).map(({ tone }) => tone).join(); \
          const none = bands({ name: 'z', state: 'active' }, [], 50, 300).length; \
          return found === '50,100,off 200,300,warn' && asked === 'off' && none === 0; })()",
    );
    let packed = module(
        "history.js",
        "(() => { const group = (count) => Array(count).fill('a'); \
          return packed([group(40), group(20), group(10), group(70)]).map((one) => one.length).join() === '60,10,64'; })()",
    );
    // A falling line falls within its intervals too, and begins again after a gap.
    let in_order = module(
        "history.js",
        "inOrder([[0, 12], [4, 8], [0, 4], [null, null], [3, 5]]).join(' ') === '0,12 8,4 4,0 , 3,5'",
    );
    let level =
        module("text.js", "[40, 2.5, 0.25, 12.000000001].map((um) => level(um)).join() === '40,2.5,0.25,12'");
    // The data has the extremes of an interval. The legend has the value of now, where the chart reaches until now.
    let legend = module(
        "chart.js",
        "(() => { const lines = [{ column: 'z_cz_um', label: 'Cz', unit: 'um', dash: [], width: 2, index: 0 }]; \
          const chart = new Chart({ id: 'test', title: 'z', unit: 'um', lines }, () => {}, () => {}); \
          const past = { bands: [], marks: [], dots: [], limit: null, moment: null }; \
          chart.show([[0, 0, 60, 60], [1, 2, 3, 9]], past, 0, 60); \
          const said = () => chart.root.querySelector('.legend b').textContent; \
          const first = said(); chart.live([5]); const second = said(); chart.live([null]); const third = said(); chart.live(null); \
          return [first, second, third, said()].join() === '+9.0 µm,+5.0 µm,–,+9.0 µm'; })()",
    );
    let within = module(
        "measured.js",
        "(() => { const at = (hour, um) => [`2026-07-02T${hour}:00:00Z`, um]; const now = new Date('2026-07-02T12:00:00Z'); \
          const probe = { warn_um: 4, history: [['2026-06-30T10:00:00Z', 9], at('08', 1), at('09', -4), at('10', 4.1)] }; \
          return withinToday({ probe }, now).percent === 66 && withinToday({ probe: null }, now) === null \
            && withinToday({ probe: { ...probe, warn_um: null } }, now) === null; })()",
    );
    // What was measured with the Cz that acted; a refused probing counts for nothing.
    let residual = module(
        "measured.js",
        "(() => { const history = [['2026-07-02T08:00:00Z', 1]]; const last = { at: '2026-07-02T08:00:00Z', error_um: 9, refused: null }; \
          const of = (probe) => residual({ probe })?.um; \
          return of({ history, last }) === 9 && of({ history, last: { ...last, refused: 'no' } }) === 1 && of({ history: [], last: null }) === undefined; })()",
    );
    // The last event that a status has is of 11:59.
    let complete = module(
        "events.js",
        "['2026-07-02T11:58:00Z', '2026-07-02T12:00:00Z'].map((at) => isComplete(new Date(at) / 1000)).join() === 'false,true'",
    );
    // A clock that is set back does not stop the last hour.
    let set_back = module(
        "recent.js",
        "(globalThis.setBack ??= ['13', '11'].map((hour) => { keep({ now: `2026-07-02T${hour}:00:00Z`, axes: [], signals: [{ name: 'q', value: 1 }] }); \
          return lastHour('q').map(([at]) => new Date(at * 1000).toISOString().slice(11, 13)).join('+'); }).join()) === '13,11'",
    );
    looked_at_with(
        |_| (),
        &[(
            "",
            &[
                "Axis z", &brief, &bands, &packed, &in_order, &level, &within, &residual, &complete,
                &set_back, &legend,
            ],
        )],
    );
}

/// Returns the script of axe-core, which `tests/run page` installs.
fn axe() -> String {
    let target = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().to_path_buf();
    let script = target.join("tools/node/node_modules/axe-core/axe.min.js");
    assert!(script.exists(), "axe-core is not installed: `tests/run tools` does it");
    format!("axe:{}", script.display())
}

#[test]
fn axe_core_finds_nothing_serious_on_the_page_the_wall_and_the_page_to_sign_in() {
    let axe = axe();
    let raise = |status: &mut Status| {
        with_axes(status, &["x", "y", "z"]);
        status.alarms = vec![alarm("signal t1", Level::Warning, "2026-07-02T11:55:00Z")];
    };
    let check = axe.as_str();
    let page = ["Main spindle", OPEN, "size:1280x900", check, "dark", check, "size:390x844", check];
    let wall = ["Main spindle", "size:1920x1080", check, "dark", check];
    looked_at_with(raise, &[("", &page), ("/?view=wall", &wall)]);
    let many = ["Axis v", "size:1920x1080", check];
    let names = ["x1", "x2", "y", "z", "w", "b", "u", "v"];
    looked_at_with(|status| with_axes(status, &names), &[("", &many), ("/?view=wall", &many)]);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let door = Door::open(Some(OPERATOR)).await;
        let address = format!("http://{}", door.address);
        let words = ["Sign in".to_owned(), axe.clone(), "dark".to_owned(), axe];
        let look = move || look(&address, "/login", &words.each_ref().map(String::as_str));
        tokio::task::spawn_blocking(look).await.unwrap();
    });
}
