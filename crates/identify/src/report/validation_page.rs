//! Report section about the validation: results of the model on runs that were held out of its identification.

use maud::{Markup, html};

use crate::identified::Identified;
use crate::statistics::{count, least_and_most};
use crate::validate::{HeldOut, Means, RunScore};
use isotherm_html::chart::{self, Bar, Line, LineStyle};
use isotherm_html::{decimals, figure, number, table};
use isotherm_profile::counted;

/// Renders the main results: range and root mean square of the error, with the model and without compensation.
pub(super) fn headline(means: &Means, uncompensated: &Means) -> Markup {
    let figures = [
        ("mean range of a run", means.mean_range_um, uncompensated.mean_range_um),
        ("worst run", means.worst_range_um, uncompensated.worst_range_um),
        ("mean RMS", means.mean_rmse_um, uncompensated.mean_rmse_um),
    ];
    html! {
        dl .figures {
            @for (what, left, before) in figures {
                div { dt { (what) } dd { (number(left)) " µm" small { "without compensation " (number(before)) " µm" } } }
            }
            div { dt { "range reduced by" } dd { (cut(means.mean_range_um, uncompensated.mean_range_um)) small { "each run held out in turn" } } }
        }
    }
}

/// Formats the reduction of the error range in percent. The number is negative if the range grew.
fn cut(range: f64, before: f64) -> String {
    if before > 0.0 { format!("{} %", decimals(100.0 * (1.0 - range / before), 0)) } else { "–".to_owned() }
}

/// Renders bars and a table with the results of all held-out runs.
pub(super) fn cross_validation(runs: &[RunScore], means: &Means, uncompensated: &Means) -> Markup {
    let worst = runs.iter().map(|run| run.range_um).fold(0.0, f64::max);
    let bar = |run: &RunScore| Bar {
        name: run.name.clone(),
        value: run.range_um,
        outline: Some(run.uncompensated_range_um),
        figure: format!(
            "{} of {}{}",
            decimals(run.range_um, 1),
            decimals(run.uncompensated_range_um, 1),
            run.mark()
        ),
        ..Bar::default()
    };
    let all: Vec<Bar> = runs.iter().map(bar).collect();
    let rows = html! {
        @for run in runs {
            tr .worst[run.range_um >= worst && runs.len() > 1] {
                th scope="row" { (run.name) (run.mark()) }
                td { (number(run.range_um)) } td { (number(run.uncompensated_range_um)) }
                td { (cut(run.range_um, run.uncompensated_range_um)) }
                td { (number(run.rmse_um)) } td { (number(run.uncompensated_rmse_um)) }
                td { (number(run.p95_um)) }
            }
        }
        tr .sum {
            th scope="row" { "mean" }
            td { (number(means.mean_range_um)) } td { (number(uncompensated.mean_range_um)) }
            td { (cut(means.mean_range_um, uncompensated.mean_range_um)) }
            td { (number(means.mean_rmse_um)) } td { (number(uncompensated.mean_rmse_um)) }
            td {}
        }
    };
    html! {
        h2 { "Cross-validation" }
        p {
            "Each run was held out in turn: the model was identified from all the others, and tested on that \
             run. The range is the largest minus the smallest error of a run."
        }
        p { (worse(runs)) }
        ul .keys { li .filled { "residual range, µm" } li .hollow { "without compensation, µm" } }
        (chart::bars("range of each run, held out and without compensation", &all))
        (table(&["run", "range, µm", "without", "reduced by", "RMS, µm", "without",
            "95 % within ±, µm"], &rows))
    }
}

/// Returns a sentence with the number and the names of the runs whose error range is larger with the model than without
/// compensation.
fn worse(runs: &[RunScore]) -> String {
    let worse: Vec<&str> = runs.iter().filter(|run| run.is_worse()).map(|run| run.name.as_str()).collect();
    match worse.len() {
        0 => "No run has a larger range with the model than without compensation.".to_owned(),
        some => format!(
            "{some} of {} have a larger range with the model than without compensation: {}.",
            counted(runs.len(), "run"),
            worse.join(", ")
        ),
    }
}

/// Renders a chart of the measured, predicted and residual error for each run. All charts have the same scale.
pub(super) fn pictures(found: &Identified) -> Markup {
    let values = |held: &HeldOut| {
        let predicted = held.cz.iter().map(|cz| -cz);
        held.error.iter().copied().chain(predicted).chain(held.residual(found.probe_s)).collect::<Vec<f64>>()
    };
    let (low, high) =
        least_and_most(found.held_out.iter().flat_map(values).chain([0.0])).unwrap_or((0.0, 0.0));
    let room = (0.05 * (high - low)).max(0.1);
    html! {
        h2 { "Measured error, prediction, residual error" }
        ul .keys {
            li { "measured error" }
            li .dashed { "predicted by the model from the other runs" }
            li .filled { "residual error" @if found.probe_s.is_some() { " after probing" } }
        }
        div .gallery {
            @for held in &found.held_out { (of_run(held, found.probe_s, (low - room, high + room))) }
        }
        (against(found))
    }
}

fn of_run(held: &HeldOut, probe: Option<f64>, within: (f64, f64)) -> Markup {
    let hours = || held.seconds.iter().map(|second| second / 3600.0);
    let lines = [
        Line::new(LineStyle::Filled, hours().zip(held.residual(probe))),
        Line::new(LineStyle::Solid, hours().zip(held.error.iter().copied())),
        Line::new(LineStyle::Dashed, hours().zip(held.cz.iter().map(|cz| -cz))),
    ];
    let score = &held.score;
    let says = format!("measured, predicted and residual error in {}", score.name);
    let caption = format!(
        "range {} µm, without compensation {} µm{}",
        number(score.range_um),
        number(score.uncompensated_range_um),
        score.mark()
    );
    figure(&score.name, &chart::lines(480, 280, "µm", &says, &lines, Some(within)), &caption)
}

/// Renders two charts over all runs: the predicted error against the measured error, and the distribution of the
/// residual error.
fn against(found: &Identified) -> Markup {
    const MOST: usize = 1200;
    let all: usize = found.held_out.iter().map(|held| held.error.len()).sum();
    let every = all.div_ceil(MOST).max(1);
    let pairs: Vec<(f64, f64)> = (found.held_out.iter())
        .flat_map(|held| held.error.iter().copied().zip(held.cz.iter().map(|cz| -cz)))
        .step_by(every)
        .collect();
    let left = found.held_out.iter().flat_map(|held| held.residual(found.probe_s));
    let histogram = spread(&left.collect::<Vec<f64>>());
    html! {
        div .gallery style="margin-top: 1.2rem" {
            (figure("Predicted against measured", &chart::scatter("µm predicted, over µm measured", "predicted against measured error", &pairs),
                "Each run was held out. On the diagonal line, the predicted error equals the measured error."))
            (figure(
                "Distribution of the residual \
                 error", &chart::bars("share of the rows by residual error", &histogram),
                "Share of the log rows of all runs in each interval of the residual error, in µm."))
        }
    }
}

/// Returns the share of the rows in each of nine equal intervals of the residual error, which are symmetric about zero.
fn spread(left: &[f64]) -> Vec<Bar> {
    let largest = left.iter().fold(0.0_f64, |largest, value| largest.max(value.abs())).max(1e-3);
    let step = 2.0 * largest / 9.0;
    let share = |number: u32| {
        let (from, to) = (-largest + step * f64::from(number), -largest + step * f64::from(number + 1));
        let is_last = number == 8;
        let inside = left.iter().filter(|value| **value >= from && (**value < to || is_last)).count();
        let share = 100.0 * count(inside) / count(left.len()).max(1.0);
        Bar {
            name: format!("{} … {}", decimals(from, 1), decimals(to, 1)),
            value: share,
            figure: format!("{} %", decimals(share, 1)),
            ..Bar::default()
        }
    };
    (0..9).map(share).collect()
}
