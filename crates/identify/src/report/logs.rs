//! Report section about the logs: runs, sensors over time, and similar sensors.

use maud::{Markup, html};

use crate::ambient::ambient_column;
use crate::bank::Bank;
use crate::campaign::Campaign;
use crate::dataset::{Column, Dataset, Kind, Run, Series};
use crate::faults::{self, Finding};
use crate::similarity::{correlations, order};
use crate::statistics::{count, least_and_most};
use isotherm_html::chart::{self, Line, LineStyle};
use isotherm_html::{date, decimals, duration, figure, plain, table, three_digits};

/// Maximum number of inputs in a correlation map.
const MOST_MAPPED: usize = 32;

/// Renders the table of the runs: date, duration, rows, speeds and ambient temperature.
pub(super) fn runs(dataset: &Dataset, like: &[Finding]) -> Markup {
    let name = |column: usize| dataset.columns[column].name.as_str();
    let speeds: Vec<usize> = dataset.of_kind(Kind::Speed).collect();
    let ambient = ambient_column(dataset, like);
    let ambient_head = ambient.map(|column| format!("ambient ({}), °C", name(column)));
    let mut heads = vec!["run", "begins", "duration", "rows"];
    heads.extend(speeds.iter().map(|column| name(*column)));
    heads.extend(ambient_head.as_deref());
    let rows = html! {
        @for run in &dataset.runs {
            tr {
                th scope="row" { (run.name) }
                td { (date(run.times.first().copied().unwrap_or_default())) }
                td { (duration(run.lasts().as_secs_f64())) }
                td { (run.times.len()) }
                @for column in &speeds { td { (stages(&run.values[*column])) } }
                @if let Some(column) = ambient { td { (spanned(&run.values[column], 1)) } }
            }
        }
    };
    html! {
        h2 { "Runs" }
        (table(&heads, &rows))
        @if ambient.is_none() {
            p .quiet { "No column has a name for the air around the machine (ambient, air, room, hall, shop), \
                        and no sensor behaves like the air." }
        }
    }
}

/// Formats the smallest and the largest of the values, for example as `20.1 … 23.4`.
fn spanned(values: impl IntoIterator<Item = f64>, places: usize) -> String {
    least_and_most(values).map_or("–".to_owned(), |(low, high)| {
        format!("{} … {}", decimals(low, places), decimals(high, places))
    })
}

/// Formats the speeds of a run: each speed if there are at most six different speeds, otherwise the range of
/// the speeds. A speed that occurs in less than a twentieth of the rows of the run is ignored.
fn stages(values: &Series) -> String {
    const FEW: usize = 6;
    let mut held: Vec<f64> = values.iter().filter(|value| value.is_finite()).map(f64::round).collect();
    held.sort_by(f64::total_cmp);
    let all = held.len();
    let long: Vec<String> = held
        .chunk_by(|one, other| (one - other).abs() < 0.5)
        .filter(|same| same.len() * 20 >= all)
        .map(|same| decimals(same[0], 0))
        .collect();
    if (1..=FEW).contains(&long.len()) { long.join(", ") } else { spanned(values, 0) }
}

/// Renders the table of the sensors: kind, resolution, range, use, and findings.
pub(super) fn sensors(
    dataset: &Dataset,
    used: &dyn Fn(&str) -> &'static str,
    excluded: &[Finding],
    like: &[Finding],
) -> Markup {
    let rows = html! {
        @for (place, column) in dataset.columns.iter().enumerate() {
            tr {
                th scope="row" { (column.name) }
                td .words style="min-width: 7rem" { (column.kind) }
                td { (plain(faults::resolution(dataset, place))) }
                td { (spanned(dataset.runs.iter().flat_map(|run| &run.values[place]), 2)) }
                td .words style="min-width: 6rem" { (used(&column.name)) }
                td .words { (remarks(column, excluded, like)) }
            }
        }
        @for column in &dataset.unread {
            tr {
                th scope="row" { (column.name) }
                td .words { (column.kind) }
                td { "–" }
                td { "–" }
                td .words { (used(&column.name)) }
                td .words { "not read" }
            }
        }
    };
    html! {
        h2 { "Sensors" }
        (table(&["column", "kind:", "resolution", "from … to", "used as:", "what was found:"], &rows))
    }
}

fn remarks(column: &Column, excluded: &[Finding], like: &[Finding]) -> String {
    let own = excluded.iter().chain(like).filter(|finding| finding.signal == column.name);
    let own: Vec<&str> = own.map(|finding| finding.reason.as_str()).collect();
    match column.kind {
        _ if !own.is_empty() => own.join("; "),
        Kind::Temperature => "no fault found".to_owned(),
        _ => "–".to_owned(),
    }
}

/// Renders a small chart for each temperature. Each chart contains one curve for each run.
pub(super) fn over_time(dataset: &Dataset, excluded: &[Finding]) -> Markup {
    html! {
        h2 { "Sensors over time" }
        ul .keys { li .faint { "every run, °C" } li { "a run in which the sensor was found faulty" } }
        div .small { @for column in dataset.of_kind(Kind::Temperature) { (sensor(dataset, column, excluded)) } }
    }
}

fn sensor(dataset: &Dataset, column: usize, excluded: &[Finding]) -> Markup {
    let name = &dataset.columns[column].name;
    let line = |run: &Run| {
        let of_run = format!(" {}", run.name);
        let mut own = excluded.iter().filter(|faulty| faulty.signal == *name);
        let style = match own.any(|faulty| faulty.reason.ends_with(&of_run)) {
            true => LineStyle::Solid,
            false => LineStyle::Faint,
        };
        Line::new(style, run.hours().zip(&run.values[column]))
    };
    let lines: Vec<Line> = dataset.runs.iter().map(line).collect();
    let widest = dataset.runs.iter().map(|run| run.range(column)).fold(0.0, f64::max);
    let picture = chart::lines(240, 150, "°C", &format!("{name} over every run"), &lines, None);
    figure(name, &picture, &format!("up to {} °C in a run", three_digits(widest)))
}

/// Renders the correlation map, a table of the correlations between the inputs and the error.
pub(super) fn alike(campaign: &Campaign<'_>) -> Markup {
    let bank = Bank::of(campaign, &[None]);
    let inputs: Vec<usize> = (0..campaign.inputs.len()).collect();
    let between = correlations(&bank, &inputs);
    let error = inputs.len();
    let mut order = order(&between, error);
    if order.len() > MOST_MAPPED {
        order.sort_by(|one, other| between[*other][error].abs().total_cmp(&between[*one][error].abs()));
        order.truncate(MOST_MAPPED);
    }
    order.insert(0, error);
    let name = |place: &usize| campaign.inputs.get(*place).map_or("error", |input| input.name.as_str());
    let names: Vec<&str> = order.iter().map(name).collect();
    let values: Vec<Vec<f64>> =
        order.iter().map(|one| order.iter().map(|other| between[*one][*other]).collect()).collect();
    let width = decimals(count(names.len()) * 1.9 + 7.0, 1);
    html! {
        h2 { "Sensors with similar values" }
        p {
            "Correlations in hundredths, over the rows of all runs. The values are the measured error, and the \
             rises of the sensors since the start of a run. A darker cell is a stronger correlation. If the \
             correlation is negative, one value falls while the other rises."
        }
        // The map has a fixed minimum width, so that its figures remain legible.
        div .scroll tabindex="0" {
            div style={ "width: max(100%, " (width) "rem); max-width: " (width) "rem" } {
                (chart::map("correlations of the sensors and the error", &names, &values))
            }
        }
    }
}
