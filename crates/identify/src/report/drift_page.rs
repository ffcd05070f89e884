//! HTML report of the command `isotherm report`: drift in the terms of ISO 230-3.

use maud::{Markup, html};

use super::page::{list, machine, optional, page, runs};
use crate::dataset::{Dataset, Run};
use crate::drift::{Displacement, Drift};
use isotherm_core::quantity::Moment;
use isotherm_html::chart::{self, Line, LineStyle};
use isotherm_html::{date, decimals, duration, figure, number, row, table};
use isotherm_profile::Profile;

/// Renders the drift of each run as one HTML file. `made` is the time of the report.
pub fn drift_page(dataset: &Dataset, drifts: &[Drift], profile: Option<&Profile>, made: Moment) -> String {
    let hours: f64 = drifts.iter().map(|drift| drift.hours).sum();
    let content = html! {
        dl .facts {
            @if let Some(profile) = profile { (machine(profile)) }
            dt { "date" } dd { (date(made)) }
            (runs(drifts.len(), hours * 3600.0))
        }
        p {
            "Drift in the logs, in the terms of ISO 230-3. This is a description: no duration and no limit of the standard \
             is applied. Displacements are means of each minute; a range is the largest minus the smallest."
        }
        @for (run, drift) in dataset.runs.iter().zip(drifts) { (of_run(dataset, run, drift)) }
    };
    let name = profile.map_or_else(String::new, |profile| format!("{}: ", profile.name));
    page(&format!("{name}drift in the terms of ISO 230-3"), made, &content)
}

fn of_run(dataset: &Dataset, run: &Run, drift: &Drift) -> Markup {
    let begins = date(run.times.first().copied().unwrap_or_default());
    let remarks: Vec<Markup> = drift.remarks.iter().map(|remark| html! { (remark) }).collect();
    html! {
        h2 { (drift.name) }
        p {
            "Like a test for " strong { (drift.test.title()) } ": " (drift.because) ". "
            @if begins != "–" { "From " (begins) " on, " }
            (duration(drift.hours * 3600.0)) ", " (drift.rows) " rows."
        }
        (headline(&drift.displacements))
        (list(&remarks))
        div .gallery {
            @for moved in &drift.displacements {
                (figure(&moved.name, &course(dataset, run, &moved.name, (480, 280), "µm"),
                    &format!("range {} µm, drift {} µm/h", number(moved.range_um), number(moved.drift_um_per_h))))
            }
            @if let Some(stage) = drift.stages.first() {
                (figure(&stage.column,
                    &course(dataset, run, &stage.column, (480, 280), if stage.speed.is_some() { "speed" } else { "position" }),
                    "Turning or movement during this time."))
            }
        }
        (displacements(drift.displacements.iter().map(|moved| (moved.name.as_str(), moved))))
        (stages(drift))
        (temperatures(dataset, run, drift))
    }
}

fn headline(all: &[Displacement]) -> Markup {
    html! {
        dl .figures {
            @for moved in all {
                div {
                    dt { (moved.name) }
                    dd {
                        (number(moved.range_um)) " µm"
                        small { @match moved.largest_60min_um {
                            Some(largest) => { "at most " (number(largest)) " µm in 60 min" }
                            None => { "shorter than an hour" }
                        } }
                    }
                }
            }
        }
    }
}

/// Renders a chart of a column over the time of a run. The time is in hours, and `unit` is the unit of the values.
fn course(dataset: &Dataset, run: &Run, name: &str, (width, height): (u32, u32), unit: &str) -> Markup {
    let values = dataset.column(name).map(|column| &run.values[column]);
    let line = Line::new(LineStyle::Solid, run.hours().zip(values.into_iter().flatten()));
    chart::lines(width, height, unit, &format!("{name} over {}", run.name), &[line], None)
}

/// Renders a table with one row for each displacement. Each item of `all` is the text of the first cell, and the
/// displacement.
pub(super) fn displacements<'a>(all: impl Iterator<Item = (&'a str, &'a Displacement)>) -> Markup {
    let cells = |moved: &Displacement| {
        [
            number(moved.range_um),
            optional(moved.first_hour_um, number),
            optional(moved.last_hour_um, number),
            optional(moved.largest_60min_um, number),
            optional(moved.largest_60min_from_h, |from| duration(from * 3600.0)),
            number(moved.drift_um),
            number(moved.drift_um_per_h),
        ]
    };
    let heads = ["µm", "range", "first hour", "last hour", "in 60 min", "from", "drift", "each hour"];
    table(&heads, &html! { @for (name, moved) in all { (row(name, cells(moved))) } })
}

fn stages(drift: &Drift) -> Markup {
    let Some(first) = drift.stages.first() else { return html! {} };
    let mut heads = vec!["from", "to", first.column.as_str()];
    let names: Vec<String> = drift.displacements.iter().map(|moved| format!("{}, µm", moved.name)).collect();
    heads.extend(names.iter().map(String::as_str));
    let rows = html! {
        @for (place, stage) in drift.stages.iter().enumerate() {
            tr {
                td { (duration(stage.from_h * 3600.0)) }
                td { (duration(stage.to_h * 3600.0)) }
                td { @match (stage.speed, stage.moves) {
                    (Some(speed), _) => { (decimals(speed, 0)) }
                    (None, true) => { "moves" }
                    (None, false) => { "stands" }
                } }
                @for moved in &drift.displacements {
                    td { (optional(moved.stages_um.get(place).copied().flatten(), number)) }
                }
            }
        }
    };
    html! { h3 { "Stage by stage" } (table(&heads, &rows)) }
}

fn temperatures(dataset: &Dataset, run: &Run, drift: &Drift) -> Markup {
    if drift.temperatures.is_empty() {
        return html! {};
    }
    let rows = html! {
        @for sensor in &drift.temperatures {
            (row(&sensor.name, [
                number(sensor.begin_c),
                number(sensor.end_c),
                number(sensor.range_k),
                optional(sensor.largest_60min_k, number),
            ]))
        }
    };
    html! {
        h3 { "Temperatures" }
        (table(&["°C", "begin", "end", "range", "in 60 min"], &rows))
        div .small {
            @for sensor in &drift.temperatures {
                (figure(&sensor.name, &course(dataset, run, &sensor.name, (240, 150), "°C"), ""))
            }
        }
    }
}
