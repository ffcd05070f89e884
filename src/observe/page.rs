//! The status page: a shell with what stays the same, and plain files that fill it from the live stream.
//!
//! Everything is in the program; the page works on a machine network without any other.

use maud::{DOCTYPE, Markup, html};

use super::status::Status;

const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Name, content type and text of each file under `/page/`.
const FILES: [(&str, &str, &str); 9] = [
    ("page.css", STYLE, include_str!("page/page.css")),
    ("axis.css", STYLE, include_str!("page/axis.css")),
    ("main.js", SCRIPT, include_str!("page/main.js")),
    ("text.js", SCRIPT, include_str!("page/text.js")),
    ("axis.js", SCRIPT, include_str!("page/axis.js")),
    ("chart.js", SCRIPT, include_str!("page/chart.js")),
    ("probe.js", SCRIPT, include_str!("page/probe.js")),
    ("tables.js", SCRIPT, include_str!("page/tables.js")),
    ("icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

/// A file of the page: its content type and text.
pub(super) fn file(name: &str) -> Option<(&'static str, &'static str)> {
    FILES.iter().find(|(known, ..)| *known == name).map(|(_, kind, text)| (*kind, *text))
}

/// The shell. `may_command` is false where commands would be refused anyway.
pub(super) fn front(status: &Status, may_command: bool) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (status.machine) " · isotherm" }
                link rel="icon" href="/page/icon.svg" type="image/svg+xml";
                link rel="stylesheet" href="/page/page.css";
                link rel="stylesheet" href="/page/axis.css";
                script type="module" src="/page/main.js" {}
            }
            body {
                (head(status))
                (main(may_command))
                footer {
                    p {
                        "isotherm " (status.version) " · "
                        a href="/api/status" { "status as JSON" } " · " a href="/metrics" { "metrics" }
                    }
                    p { "Not a safety function: a machine's guards and stops never depend on this gateway." }
                }
                (question())
            }
        }
    }
}

fn head(status: &Status) -> Markup {
    html! {
        p #lost .lost role="alert" hidden {}
        header {
            div .who {
                h1 { (status.machine) }
                p .quiet { (status.description) }
            }
            div #overall .overall data-tone="off" {
                p .word role="status" { span .sign aria-hidden="true" { "○" } " " span #word { "connecting" } }
                p #sentence .sentence { "Waiting for the first figures." }
            }
            dl .times {
                div { dt { "Machine time" } dd #machine-time { "–" } }
                div { dt { "Clock" } dd #clock-word { "–" } }
                div { dt { "Since machine start" } dd #machine-on { "–" } }
                div { dt { "Gateway up for" } dd #uptime { "–" } }
            }
        }
    }
}

fn main(may_command: bool) -> Markup {
    html! {
        main {
            noscript { p .lost { "This page needs JavaScript. The same figures stand in /api/status." } }
            section .commands aria-label="Commands" {
                div .buttons data-may=(may_command) {
                    button type="button" data-command="arm" disabled { "Arm" }
                    button type="button" data-command="disarm" disabled { "Disarm" }
                    button type="button" data-command="zero" disabled { "Zero" }
                }
                p #answer role="status" {
                    @if !may_command {
                        "Without a token, commands are taken only at the gateway's own computer."
                    }
                }
            }
            section #axes .axes aria-label="Axes" {}
            (table("signals", "Signals", &["Signal", "Value", "Quality", "Age"]))
            div .stack {
                (table("outputs", "Outputs", &["Output", "Value", "State", "Age"]))
                (table("devices", "Devices", &["Device", "State", "Requests", "Failed"]))
                (table("buses", "Buses", &["Bus", "State", "Cycles", "Late"]))
            }
            section .events {
                h2 { "Events" span .quiet { " newest first" } }
                button #older .small type="button" { "Show the last 24 hours" }
                ol #events tabindex="0" aria-label="Events, newest first" {}
            }
        }
    }
}

fn table(id: &str, title: &str, columns: &[&str]) -> Markup {
    html! {
        section .list {
            h2 { (title) }
            table id=(id) role="table" {
                thead { tr { @for column in columns { th scope="col" { (column) } } } }
                tbody role="rowgroup" {}
            }
        }
    }
}

/// Asked before every command.
fn question() -> Markup {
    html! {
        dialog #question aria-labelledby="question-title" {
            form method="dialog" {
                h2 #question-title {}
                p #question-text {}
                menu {
                    button type="submit" value="no" autofocus { "Cancel" }
                    button #question-yes type="submit" value="yes" .yes {}
                }
            }
        }
    }
}
