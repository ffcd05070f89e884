//! The report of `report`: drift in the terms of ISO 230-3.

use maud::{Markup, html};

use super::chart::{self, Line, Look};
use super::{date, decimals, duration, figure, number, page, table};
use crate::dataset::{Dataset, Run};
use crate::drift::{Displacement, Drift};
use isotherm_core::quantity::Moment;

/// One HTML file; `machine`: name and description, where a profile was given.
pub fn drifted(dataset: &Dataset, drifts: &[Drift], machine: Option<(&str, &str)>, made: Moment) -> String {
    let hours: f64 = drifts.iter().map(|drift| drift.hours).sum();
    let content = html! {
        dl .facts {
            @if let Some((name, description)) = machine {
                dt { "machine" } dd { (name) @if !description.is_empty() { ": " (description) } }
            }
            dt { "date" } dd { (date(made)) }
            dt { "runs" } dd { (drifts.len()) ", " (duration(hours * 3600.0)) " together" }
        }
        p {
            "What the logs say about drift, in the terms of ISO 230-3. It describes them: no duration and no limit of the \
             standard is applied. Displacements are means of each minute; a range is the largest minus the smallest."
        }
        @for (run, drift) in dataset.runs.iter().zip(drifts) { (of_run(dataset, run, drift)) }
    };
    let name = machine.map_or_else(String::new, |(name, _)| format!("{name}: "));
    page(&format!("{name}drift in the terms of ISO 230-3"), made, &content)
}

fn of_run(dataset: &Dataset, run: &Run, drift: &Drift) -> Markup {
    let begins = date(run.times.first().copied().unwrap_or_default());
    html! {
        h2 { (drift.name) }
        p {
            "Like a test for " strong { (drift.test.words()) } ": " (drift.because) ". "
            @if begins != "–" { "From " (begins) " on, " }
            (duration(drift.hours * 3600.0)) ", " (drift.rows) " rows."
        }
        (headline(&drift.displacements))
        @if !drift.remarks.is_empty() { ul { @for remark in &drift.remarks { li { (remark) } } } }
        div .gallery {
            @for moved in &drift.displacements { (picture(dataset, run, moved)) }
            (activity(dataset, run, drift))
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

fn course(dataset: &Dataset, run: &Run, name: &str) -> Vec<(f64, f64)> {
    let Some(column) = dataset.column(name) else { return Vec::new() };
    run.seconds().map(|second| second / 3600.0).zip(run.values[column].iter().copied()).collect()
}

fn picture(dataset: &Dataset, run: &Run, moved: &Displacement) -> Markup {
    let points = course(dataset, run, &moved.name);
    let line = Line::new(Look::Solid, points.into_iter());
    let says = format!("{} over {}", moved.name, run.name);
    let caption = format!("range {} µm, drift {} µm/h", number(moved.range_um), number(moved.drift_um_per_h));
    figure(&moved.name, &chart::lines(480, 280, "µm", &says, &[line], None), &caption)
}

/// What turned or moved, over the same hours.
fn activity(dataset: &Dataset, run: &Run, drift: &Drift) -> Markup {
    let Some(stage) = drift.stages.first() else { return html! {} };
    let line = Line::new(Look::Solid, course(dataset, run, &stage.column).into_iter());
    let says = format!("{} over {}", stage.column, run.name);
    let unit = if stage.speed.is_some() { "speed" } else { "position" };
    figure(
        &stage.column,
        &chart::lines(480, 280, unit, &says, &[line], None),
        "What turned or moved meanwhile.",
    )
}

/// A row for each, under its name.
pub(super) fn displacements<'a>(all: impl Iterator<Item = (&'a str, &'a Displacement)>) -> Markup {
    let rows = html! {
        @for (name, moved) in all {
            tr {
                th scope="row" { (name) }
                td { (number(moved.range_um)) }
                td { (optional(moved.first_hour_um)) }
                td { (optional(moved.last_hour_um)) }
                td { (optional(moved.largest_60min_um)) }
                td { (moved.largest_60min_from_h.map_or("–".to_owned(), |from| duration(from * 3600.0))) }
                td { (number(moved.drift_um)) }
                td { (number(moved.drift_um_per_h)) }
            }
        }
    };
    let heads = ["µm", "range", "first hour", "last hour", "in 60 min", "from", "drift", "each hour"];
    table(&heads, &rows)
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
                @for moved in &drift.displacements { td { (optional(moved.stages_um.get(place).copied().flatten())) } }
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
            tr {
                th scope="row" { (sensor.name) }
                td { (number(sensor.begin_c)) }
                td { (number(sensor.end_c)) }
                td { (number(sensor.range_k)) }
                td { (optional(sensor.largest_60min_k)) }
            }
        }
    };
    let small = |name: &str| {
        let line = Line::new(Look::Solid, course(dataset, run, name).into_iter());
        figure(name, &chart::lines(240, 150, "°C", &format!("{name} over {}", run.name), &[line], None), "")
    };
    html! {
        h3 { "Temperatures" }
        (table(&["°C", "begin", "end", "range", "in 60 min"], &rows))
        div .small { @for sensor in &drift.temperatures { (small(&sensor.name)) } }
    }
}

fn optional(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), number)
}
