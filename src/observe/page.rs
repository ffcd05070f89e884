//! Web page with the status: static HTML, and files that fill the page from the live stream.
//!
//! All files are part of the program, so the page works in a network without internet access. All addresses are relative,
//! so the page also works below a path of a proxy.

mod login;
mod words;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::status::Status;
pub(super) use login::login;
pub(super) use words::Words;

const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Name, content type and content of each file under `/page/`.
const FILES: [(&str, &str, &str); 22] = [
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
    ("which.js", SCRIPT, include_str!("page/which.js")),
    ("states.js", SCRIPT, include_str!("page/states.js")),
    ("axis.js", SCRIPT, include_str!("page/axis.js")),
    ("sign.js", SCRIPT, include_str!("page/sign.js")),
    ("past.js", SCRIPT, include_str!("page/past.js")),
    ("alarms.js", SCRIPT, include_str!("page/alarms.js")),
    ("uPlot.js", SCRIPT, include_str!("page/uplot/uPlot.iife.min.js")),
    ("uPlot.css", STYLE, include_str!("page/uplot/uPlot.min.css")),
    ("probe.js", SCRIPT, include_str!("page/probe.js")),
    ("learned.js", SCRIPT, include_str!("page/learned.js")),
    ("tables.js", SCRIPT, include_str!("page/tables.js")),
    ("icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

/// Returns name, content type and content of a file of the web page. `None` if there is no such file.
pub(super) fn file(name: &str) -> Option<(&'static str, &'static str, &'static str)> {
    FILES.into_iter().find(|(known, ..)| *known == name)
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

/// Example of a command that creates a token, and of the line for the profile.
const TOKEN_LINES: &str = "isotherm token --out /etc/isotherm/operator.token\n\
                           token_file = \"/etc/isotherm/operator.token\"   # below [web]";

/// Makes the front page. Its buttons are disabled if commands would be refused.
pub(super) fn front(words: &Words, status: &Status, may: PageAction, is_signed_in: bool) -> Markup {
    let files = html! {
        link rel="stylesheet" href="page/page.css";
        link rel="stylesheet" href="page/axis.css";
        link rel="stylesheet" href="page/uPlot.css";
        link rel="stylesheet" href="page/past.css";
        script defer src="page/uPlot.js" {}
        script type="module" src="page/main.js" {}
    };
    document(
        words,
        status,
        &files,
        &html! {
            body {
                (head(words, status))
                (main(words, may, is_signed_in))
                footer {
                    p {
                        "isotherm " (status.version) " · "
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
pub(super) fn wall(words: &Words, status: &Status) -> Markup {
    let files = html! {
        link rel="stylesheet" href="page/wall.css";
        script type="module" src="page/wall.js" {}
    };
    document(
        words,
        status,
        &files,
        &html! {
            body data-tone="off" {
                header {
                    h1 { (title(status)) }
                    p #time {}
                }
                main {
                    noscript { p { (words.get("no_script")) } }
                    p #lost role="alert" hidden {}
                    p #word role="status" { (words.get("connecting")) }
                    p #sentence { (words.get("waiting_for_figures")) }
                }
                div #axes {}
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

fn document(words: &Words, status: &Status, files: &Markup, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang=(words.language) {
            head {
                (heading(title(status), ""))
                // This file is part of the program, and contains no `<`.
                script type="application/json" id="words" { (PreEscaped(words.json)) }
                (files)
            }
            (body)
        }
    }
}

/// Returns the displayed name of the machine, or its name if it has none.
fn title(status: &Status) -> &str {
    if status.label.is_empty() { &status.machine } else { &status.label }
}

fn head(words: &Words, status: &Status) -> Markup {
    html! {
        p #lost .lost role="alert" hidden {}
        header {
            div .who {
                h1 { (title(status)) }
                @if !status.label.is_empty() { p .quiet { (status.machine) } }
                p .quiet { (status.description) }
            }
            div #overall .overall data-tone="off" {
                p .word role="status" {
                    span .sign aria-hidden="true" { "○" } " " span #word { (words.get("connecting")) }
                }
                p #sentence .sentence { (words.get("waiting_for_figures")) }
            }
            dl .times {
                div { dt { (words.get("machine_time")) } dd { span #machine-time { "–" } small #utc {} } }
                div { dt { (words.get("clock")) } dd #clock-word { "–" } }
                div { dt { (words.get("machine_on")) } dd #machine-on { "–" } }
                div { dt { (words.get("uptime")) } dd #uptime { "–" } }
            }
        }
    }
}

fn main(words: &Words, may: PageAction, is_signed_in: bool) -> Markup {
    html! {
        main {
            noscript { p .lost { (words.get("no_script")) } }
            section .commands aria-label=(words.get("commands")) {
                div .buttons data-may=(may == PageAction::Command) {
                    @for command in ["arm", "disarm", "zero"] {
                        button type="button" data-command=(command) disabled { (words.get(command)) }
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
            section #alarms .alarms hidden {
                h2 { (words.get("alarms")) " " span .quiet { (words.get("alarms_stand")) } }
                ol {}
            }
            section #axes .axes aria-label=(words.get("axes_title")) {}
            section .list .past {
                h2 { (words.get("past")) " " span .quiet { (words.get("past_from_logs")) } }
                div #past-tools role="group" aria-label=(words.get("past")) {}
                p #past-note .quiet role="status" {}
                div #past-charts {}
                p { a #past-download href="api/history.csv" download { (words.get("past_download")) } }
            }
            div #set-above hidden { (table(words, "overridden", &["setting", "in_profile", "now", "set_by"])) }
            (table(words, "signals", &["signal", "value", "quality", "age"]))
            div .stack {
                (table(words, "outputs", &["output", "value", "state", "age"]))
                (table(words, "devices", &["device", "state", "requests", "failed"]))
                (table(words, "buses", &["bus", "state", "cycles", "late"]))
            }
            section .events {
                h2 { (words.get("events")) " " span .quiet { (words.get("newest_first")) } }
                button #older .small type="button" { (words.get("last_24_hours")) }
                ol #events tabindex="0" aria-label=(words.get("events")) {}
            }
        }
    }
}

/// Makes a table. The key of its title is also its id.
fn table(words: &Words, id: &'static str, columns: &[&'static str]) -> Markup {
    html! {
        section .list {
            h2 { (words.get(id)) }
            table id=(id) role="table" {
                thead { tr { @for column in columns { th scope="col" { (words.get(column)) } } } }
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
                label #question-which hidden { (words.get("which_axis")) " " select #question-axis {} }
                menu {
                    button type="submit" value="no" autofocus { (words.get("cancel")) }
                    button #question-yes type="submit" value="yes" .yes {}
                }
            }
        }
    }
}
