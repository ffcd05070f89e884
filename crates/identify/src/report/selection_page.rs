//! HTML report of the command `isotherm select`: the assessed and the recommended temperature measuring points.

use maud::{Markup, html};

use super::page::{page, runs};
use super::{logs, validation_page};
use crate::select::{Counted, Point, Pointed, Selected, Step};
use isotherm_core::quantity::Moment;
use isotherm_html::chart::{self, Bar};
use isotherm_html::{date, decimals, figure, number, table, three_digits};

/// Renders the selected measuring points and their assessment as one HTML file. `made` is the time of the report.
pub fn selection_page(pointed: &Pointed<'_>, found: &Selected, made: Moment) -> String {
    let dataset = pointed.campaign.dataset.as_ref();
    let used = |name: &str| {
        if name == found.error {
            "error"
        } else if found.recommended.points.iter().any(|point| point == name) {
            "point, recommended"
        } else if found.points.iter().any(|point| point.name == name) {
            "point"
        } else if found.notes.excluded.iter().any(|faulty| faulty.signal == name) {
            "left out: faulty"
        } else {
            "not used"
        }
    };
    let (means, uncompensated) = (&found.by_count[found.recommended.k].means, &found.by_count[0].means);
    let content = html! {
        dl .facts {
            dt { "measured error" } dd { (found.error) }
            dt { "date" } dd { (date(made)) }
            (runs(dataset.runs.len(), dataset.seconds()))
            dt { "points" } dd { (found.points.len()) }
        }
        h2 { "Recommended" }
        @if found.recommended.points.is_empty() { p { strong { "No point." } } }
        @else { p { strong { (found.recommended.points.join(", ")) } } }
        p { (found.recommended.why) "." }
        (validation_page::headline(means, uncompensated))
        (recommended(found))
        (by_count(found))
        (validation_page::cross_validation(&found.runs, means, uncompensated))
        (points(found))
        (groups(found))
        (stepwise(found))
        (logs::alike(&pointed.campaign))
        (logs::runs(dataset, &found.notes.ambient))
        (logs::sensors(dataset, &used, &found.notes.excluded, &found.notes.ambient))
        (logs::over_time(dataset, &found.notes.excluded))
        @if !found.notes.remarks.is_empty() { h2 { "Remarks" } ul { @for remark in &found.notes.remarks { li { (remark) } } } }
    };
    page(&format!("Temperature points for {}", found.error), made, &content)
}

fn recommended(found: &Selected) -> Markup {
    let kept = &found.recommended;
    if kept.points.is_empty() {
        return html! {};
    }
    let rows = html! {
        @for point in &kept.points {
            tr {
                th scope="row" { (point) }
                td { (kept.chosen_in.get(point).copied().unwrap_or(0)) " of " (found.runs.len()) }
                td .words { (kept.alike.get(point).filter(|alike| !alike.is_empty()).map_or("–".to_owned(), |alike| alike.join(", "))) }
            }
        }
    };
    table(&["point", "chosen in held-out fits", "similar points:"], &rows)
}

fn by_count(found: &Selected) -> Markup {
    let of = |figure: fn(&Counted) -> f64| {
        let values: Vec<f64> = found.by_count.iter().map(figure).collect();
        let says = "held-out error by the number of points";
        chart::curve("µm", says, &values, found.recommended.k, figure(&found.all_points))
    };
    let row = |row: &Counted, added: &str| {
        html! {
            tr .kept[row.k == found.recommended.k && added != "all"] {
                th scope="row" { (row.k) }
                @for figure in [row.means.mean_rmse_um, row.means.mean_range_um, row.means.worst_range_um] { td { (number(figure)) } }
                td .words { (added) }
            }
        }
    };
    let rows = html! {
        @for counted in &found.by_count { (row(counted, counted.points.last().map_or("–", String::as_str))) }
        (row(&found.all_points, "all"))
    };
    html! {
        h2 { "How many points" }
        p {
            "For each run, the points were chosen with the data of all other runs, and tested on that run. \
             The curves show the residual error by the number of points." }
        ul .keys { li {
            "error of held-out runs against the number of sensor points; a ring marks the recommended number" } li .dashed { "with every point" } }
        div .gallery {
            (figure("Mean range of the residual error in a run", &of(|row| row.means.mean_range_um), ""))
            (figure("Mean RMS of the residual error in a run", &of(|row| row.means.mean_rmse_um), ""))
        }
        (table(&["points", "mean RMS, µm", "mean range, µm", "worst run, µm", "point added (on all runs):"], &rows))
    }
}

fn points(found: &Selected) -> Markup {
    let bars = |says: &str, of: fn(&Point) -> f64| {
        let bar = |point: &Point| {
            let figure = decimals(of(point), 3);
            Bar { name: point.name.clone(), value: of(point), figure, ..Bar::default() }
        };
        chart::bars(says, &found.points.iter().map(bar).collect::<Vec<Bar>>())
    };
    html! {
        h2 { "Each point alone" }
        div .gallery {
            (figure("Correlation with the error", &bars("correlation of each point with the error", |point| point.correlation),
                "The correlations are calculated from the rises since the start of a run, over the rows of \
                 all runs. If a correlation is negative, the temperature of the point falls while the error \
                 rises."))
            (figure("Grey relational grade", &bars("grey relational grade of each point", |point| point.grey_grade),
                "After Deng, ζ = 0.5. The grade is 1 if the curve of a point has the shape of the curve of the error."))
        }
    }
}

fn groups(found: &Selected) -> Markup {
    html! {
        h2 { "Points with similar values" }
        p {
            "Any two points of a group have at least the correlation in its heading. The first point of a \
             group has the highest correlation with the error, and can represent the others." }
        @for grouped in &found.groups {
            h3 { "by " (chart::tick(grouped.correlation)) " or more" }
            ol { @for group in &grouped.groups { li { (group.join(", ")) } } }
        }
    }
}

fn stepwise(found: &Selected) -> Markup {
    let row = |step: &Step, way: &str| {
        html! {
            tr {
                th scope="row" { (step.point) }
                td .words style="min-width: 6rem" { (way) }
                td { (three_digits(step.f)) }
                td { @if step.chance < 1e-4 { "< 0.0001" } @else { (decimals(step.chance, 4)) } }
            }
        }
    };
    let rows = html! {
        @for step in &found.stepwise.steps { (row(step, if step.comes_in { "added" } else { "removed" })) }
        @if let Some(next) = &found.stepwise.next { (row(next, "not significant")) }
    };
    html! {
        h2 { "Stepwise, by partial F tests" }
        p {
            "In the order in which points are added, on rises without lags, with " (decimals(found.stepwise.samples, 0))
            " independent samples. The chance is the probability of such an F if the point has no effect on \
             the error."
        }
        (table(&["point", "step:", "partial F", "chance"], &rows))
    }
}
