//! Web page with the status: static HTML, and files that fill the page from the live stream.
//!
//! All files are part of the program, so the page works in a network without internet access. All addresses are relative,
//! so the page also works below a path of a proxy.

mod login;
mod words;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::status::Status;
use isotherm_profile::Language;
pub(super) use login::{LoginPlace, login};
pub(super) use words::Words;

const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const ICON: &str = "image/svg+xml";

/// Makes the icon of a page with alarms, with the number of alarms in a red circle.
macro_rules! alarm_icon {
    ($count:literal) => {
        concat!(
            r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">"##,
            r##"<rect width="32" height="32" rx="6" fill="#1d4e5f"/><circle cx="16" cy="16" r="14" fill="#c4000f" stroke="#fff" stroke-width="2"/>"##,
            r##"<text x="16" y="23" text-anchor="middle" font-family="sans-serif" font-weight="700" font-size="19" fill="#fff">"##,
            $count,
            "</text></svg>"
        )
    };
}

/// Name, content type and content of each file under `page/`.
const FILES: [(&str, &str, &str); 40] = [
    ("page.css", STYLE, include_str!("page/page.css")),
    ("axis.css", STYLE, include_str!("page/axis.css")),
    ("past.css", STYLE, include_str!("page/past.css")),
    ("login.css", STYLE, include_str!("page/login.css")),
    ("wall.css", STYLE, include_str!("page/wall.css")),
    ("main.js", SCRIPT, include_str!("page/main.js")),
    ("wall.js", SCRIPT, include_str!("page/wall.js")),
    ("live.js", SCRIPT, include_str!("page/live.js")),
    ("words.js", SCRIPT, include_str!("page/words.js")),
    ("text.js", SCRIPT, include_str!("page/text.js")),
    ("commands.js", SCRIPT, include_str!("page/commands.js")),
    ("states.js", SCRIPT, include_str!("page/states.js")),
    ("axis.js", SCRIPT, include_str!("page/axis.js")),
    ("bar.js", SCRIPT, include_str!("page/bar.js")),
    ("trend.js", SCRIPT, include_str!("page/trend.js")),
    ("course.js", SCRIPT, include_str!("page/course.js")),
    ("recent.js", SCRIPT, include_str!("page/recent.js")),
    ("history.js", SCRIPT, include_str!("page/history.js")),
    ("measured.js", SCRIPT, include_str!("page/measured.js")),
    ("sign.js", SCRIPT, include_str!("page/sign.js")),
    ("past.js", SCRIPT, include_str!("page/past.js")),
    ("chart.js", SCRIPT, include_str!("page/chart.js")),
    ("bands.js", SCRIPT, include_str!("page/bands.js")),
    ("events.js", SCRIPT, include_str!("page/events.js")),
    ("alarms.js", SCRIPT, include_str!("page/alarms.js")),
    ("uPlot.js", SCRIPT, include_str!("page/uplot/uPlot.iife.min.js")),
    ("uPlot.css", STYLE, include_str!("page/uplot/uPlot.min.css")),
    ("probe.js", SCRIPT, include_str!("page/probe.js")),
    ("learned.js", SCRIPT, include_str!("page/learned.js")),
    ("tables.js", SCRIPT, include_str!("page/tables.js")),
    ("icon.svg", ICON, include_str!("page/icon.svg")),
    ("icon-1.svg", ICON, alarm_icon!("1")),
    ("icon-2.svg", ICON, alarm_icon!("2")),
    ("icon-3.svg", ICON, alarm_icon!("3")),
    ("icon-4.svg", ICON, alarm_icon!("4")),
    ("icon-5.svg", ICON, alarm_icon!("5")),
    ("icon-6.svg", ICON, alarm_icon!("6")),
    ("icon-7.svg", ICON, alarm_icon!("7")),
    ("icon-8.svg", ICON, alarm_icon!("8")),
    ("icon-9.svg", ICON, alarm_icon!("9+")),
];

/// Script modules of the wall view, with the main module first. The page lists all modules, so that a browser loads
/// them at once instead of one after the other.
const WALL_MODULES: [&str; 11] = [
    "wall.js",
    "bar.js",
    "course.js",
    "history.js",
    "live.js",
    "measured.js",
    "recent.js",
    "states.js",
    "text.js",
    "trend.js",
    "words.js",
];

/// Script modules that only the front page has. The front page also has all modules of the wall view except `wall.js`.
const FRONT_MODULES: [&str; 12] = [
    "main.js",
    "alarms.js",
    "axis.js",
    "bands.js",
    "chart.js",
    "commands.js",
    "events.js",
    "learned.js",
    "past.js",
    "probe.js",
    "sign.js",
    "tables.js",
];

/// Returns name, content type and content of a file of the web page; `None` if the file does not exist.
pub(super) fn file(name: &str) -> Option<(&'static str, &'static str, &'static str)> {
    FILES.into_iter().find(|(known, ..)| *known == name)
}

/// Texts of the machine that stay the same while the gateway runs.
pub(super) struct MachineTexts {
    pub(super) language: Option<Language>,
    machine: String,
    label: String,
    description: String,
    version: &'static str,
}

impl MachineTexts {
    pub(super) fn of(status: Status) -> MachineTexts {
        let Status { language, machine, label, description, version, .. } = status;
        MachineTexts { language, machine, label, description, version }
    }

    /// Returns the displayed name of the machine, or its name if it has none.
    pub(super) fn title(&self) -> &str {
        if self.label.is_empty() { &self.machine } else { &self.label }
    }
}

/// Actions that the web page offers to its user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PageAction {
    /// The user may send commands.
    Command,
    /// The user may only view, and can command after signing in with the operator's token.
    SignIn,
    /// The user may only view, and the profile has no operator's token.
    MakeToken,
}

/// Example of a command that creates a token, and of the profile line that names the token file.
const TOKEN_LINES: &str = "isotherm token --out /etc/isotherm/operator.token\n\
                           token_file = \"/etc/isotherm/operator.token\"   # below [web]";

/// Makes the front page. Its buttons are disabled if commands would be refused.
pub(super) fn front(words: &Words, texts: &MachineTexts, may: PageAction, is_signed_in: bool) -> Markup {
    let files = html! {
        link rel="stylesheet" href="page/page.css";
        link rel="stylesheet" href="page/axis.css";
        link rel="stylesheet" href="page/uPlot.css";
        link rel="stylesheet" href="page/past.css";
        (preloaded(FRONT_MODULES.iter().chain(WALL_MODULES.iter().skip(1))))
        script defer src="page/uPlot.js" {}
        script type="module" src="page/main.js" {}
    };
    document(
        words,
        texts,
        &files,
        &html! {
            body {
                a .skip href="#axes" { (words.get("skip_to_axes")) }
                p #lost .lost role="alert" hidden {}
                (head(words, texts))
                (main(words, may, is_signed_in))
                footer {
                    p {
                        "isotherm " (texts.version) " · "
                        a href="api/status" { (words.get("status_as_json")) } " · "
                        a href="metrics" { (words.get("metrics")) } " · "
                        a href="?view=wall" { (words.get("wall_view")) }
                    }
                    p { (words.get("not_safety")) }
                }
                (question(words))
            }
        },
    )
}

/// Makes the wall view: a page that is readable from three metres, and has no buttons.
pub(super) fn wall(words: &Words, texts: &MachineTexts) -> Markup {
    let files = html! {
        link rel="stylesheet" href="page/wall.css";
        (preloaded(WALL_MODULES.iter()))
        script type="module" src="page/wall.js" {}
    };
    document(
        words,
        texts,
        &files,
        &html! {
            body data-tone="off" {
                header {
                    h1 { (texts.title()) }
                    p #time {}
                }
                section .says-all aria-label=(words.get("state")) {
                    noscript { p { (words.get("no_script")) } }
                    p #lost role="alert" hidden {}
                    p #word role="status" { (words.get("connecting")) }
                    p #sentence { (words.get("waiting_for_figures")) }
                    p #alarms hidden { span #alarm-count {} " " span #alarm-text lang="en" {} }
                }
                main #axes aria-label=(words.get("axes_title")) {}
            }
        },
    )
}

/// Makes the part of `<head>` that all pages share. `top` is the relative address of the web page.
fn heading(title: &str, top: &str) -> Markup {
    html! {
        meta charset="utf-8";
        meta name="viewport" content="width=device-width, initial-scale=1";
        meta name="color-scheme" content="light dark";
        title { (title) " · isotherm" }
        link rel="icon" href={ (top) "page/icon.svg" } type="image/svg+xml";
    }
}

/// Makes the links that load modules before the scripts that import them.
fn preloaded<'a>(modules: impl Iterator<Item = &'a &'a str>) -> Markup {
    html! { @for module in modules { link rel="modulepreload" href=(format!("page/{module}")); } }
}

fn document(words: &Words, texts: &MachineTexts, files: &Markup, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang=(words.language) {
            head {
                (heading(texts.title(), ""))
                // This file is part of the program, and contains no `<`.
                script type="application/json" id="words" { (PreEscaped(words.json)) }
                (files)
            }
            (body)
        }
    }
}

fn head(words: &Words, texts: &MachineTexts) -> Markup {
    html! {
        header {
            div .who {
                h1 { (texts.title()) }
                @if !texts.label.is_empty() { p .quiet { (texts.machine) } }
                p .quiet { (texts.description) }
            }
            dl .times {
                div { dt { (words.get("machine_time")) } dd { span #machine-time { "–" } " " small #utc {} } }
                div { dt { (words.get("clock")) } dd #clock-word { "–" } }
                div { dt { (words.get("machine_on")) } dd #machine-on { "–" } }
                div { dt { (words.get("uptime")) } dd #uptime { "–" } }
            }
        }
    }
}

/// Makes the part of the front page that shows the state of the machine.
fn overall(words: &Words) -> Markup {
    html! {
        section #overall .overall data-tone="off" aria-label=(words.get("state")) {
            p .word role="status" {
                span .sign aria-hidden="true" { "○" } " " span #word { (words.get("connecting")) }
            }
            p #sentence .sentence { (words.get("waiting_for_figures")) }
            p #alarm-count .alarm-count {}
        }
    }
}

fn main(words: &Words, may: PageAction, is_signed_in: bool) -> Markup {
    html! {
        main {
            noscript { p .lost { (words.get("no_script")) } }
            (overall(words))
            section #alarms .alarms hidden aria-labelledby="alarms-title" {
                div .head {
                    h2 #alarms-title { (words.get("alarms")) }
                    p .quiet { (words.get("alarms_stand")) }
                }
                ol tabindex="0" aria-labelledby="alarms-title" {}
                p #alarms-more .quiet hidden {}
            }
            section #axes .axes aria-label=(words.get("axes_title")) {}
            nav #pages .pages aria-labelledby="pages-title" hidden {
                span #pages-title .quiet { (words.get("pages")) }
            }
            (commands(words, may, is_signed_in))
            section #past .list .past aria-labelledby="past-title" {
                div .head {
                    h2 #past-title { (words.get("past")) }
                    div #past-tools role="group" aria-label=(words.get("past")) {}
                }
                p .quiet { (words.get("past_from_logs")) }
                p #past-note .quiet role="status" {}
                div #past-charts {}
                p { a #past-download href="api/history.csv" download { (words.get("past_download")) } }
            }
            div #set-above hidden { (table(words, "overridden", &["setting", "in_profile", "now", "set_by"])) }
            div .signals { (table(words, "signals", &["signal", "value", "trend", "quality", "age"])) }
            section .events aria-labelledby="events-title" {
                div .head {
                    h2 #events-title { (words.get("events")) }
                    div #event-filter role="group" aria-labelledby="events-title" {}
                }
                p .quiet { (words.get("newest_first")) }
                ol #events tabindex="0" aria-labelledby="events-title" {}
                button #older .small type="button" { (words.get("last_24_hours")) }
            }
            details #expert {
                summary { (words.get("expert")) }
                div .stack {
                    (table(words, "outputs", &["output", "value", "state", "age"]))
                    (table(words, "devices", &["device", "state", "requests", "failed"]))
                    (table(words, "buses", &["bus", "state", "cycles", "late"]))
                }
            }
        }
    }
}

/// Makes the part of the front page with the commands. Below each button, the page shows the present state
/// and the effect of the command.
fn commands(words: &Words, may: PageAction, is_signed_in: bool) -> Markup {
    html! {
        section .commands aria-labelledby="commands-title" {
            div .head {
                h2 #commands-title { (words.get("commands")) }
                p #outputs-now {}
            }
            div .buttons data-may=(may == PageAction::Command) {
                @for command in ["arm", "disarm", "zero"] {
                    @let does = format!("does-{command}");
                    div .act {
                        button type="button" data-command=(command) aria-describedby=(does) disabled { (words.get(command)) }
                        p id=(does) {}
                    }
                }
            }
            @match may {
                PageAction::Command => {}
                PageAction::SignIn => { p { (words.get("commands_want_operator")) " " a href="login" { (words.get("sign_in")) } } }
                PageAction::MakeToken => {
                    p { (words.get("commands_want_token")) }
                    pre { code { (TOKEN_LINES) } }
                }
            }
            p #answer role="status" {}
            @if is_signed_in {
                form method="post" action="api/logout" { button .small type="submit" { (words.get("sign_out")) } }
            }
        }
    }
}

/// Makes a table of the front page. The key of its title is also the id of its HTML element.
fn table(words: &Words, id: &'static str, columns: &[&'static str]) -> Markup {
    html! {
        section .list {
            h2 { (words.get(id)) }
            table id=(id) role="table" {
                thead role="rowgroup" { tr role="row" { @for column in columns { th scope="col" role="columnheader" { (words.get(column)) } } } }
                tbody role="rowgroup" {}
            }
        }
    }
}

/// Makes the dialog that asks the user before every command.
fn question(words: &Words) -> Markup {
    html! {
        dialog #question aria-labelledby="question-title" {
            form method="dialog" {
                h2 #question-title {}
                p #question-text {}
                p #question-effect role="status" {}
                label #question-which hidden { (words.get("which_axis")) " " select #question-axis {} }
                menu {
                    button type="submit" value="no" autofocus { (words.get("cancel")) }
                    button #question-yes type="submit" value="yes" .yes {}
                }
            }
        }
    }
}
