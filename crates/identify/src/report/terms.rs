//! Report section about the model: its terms, its stand-ins and fallback models for lost sensors, the range of its
//! inputs, and the limits of the axis.

use std::collections::BTreeSet;
use std::time::Duration;

use maud::{Markup, html};

use super::page::optional;
use crate::expected::Growth;
use crate::identified::{Fallback, Identified, TermFound};
use crate::region::Region;
use crate::select::Counted;
use crate::stand_in::StandIn;
use crate::validate::Means;
use isotherm_core::compensation::settings::{AxisSettings, OnFault};
use isotherm_html::chart::{self, Bar};
use isotherm_html::{decimals, duration, figure, number, row, table, three_digits};
use isotherm_profile::counted;

/// Maximum number of bars in the chart of the gains. The table below the chart contains all terms.
const MOST_BARS: usize = 30;

/// Renders the model: a chart of the gains with their standard errors, then a table of all terms.
pub(super) fn terms(found: &Identified) -> Markup {
    let Some(gains) = found.learned.sum() else {
        return html! {
            h2 { "The model" }
            p {
                "A " (found.network.as_deref().unwrap_or("network")) ": its weights are in a file next to the profile. It is "
                "not a sum of terms, so no terms are listed."
            }
        };
    };
    if gains.is_empty() {
        return html! { h2 { "The model" } p { "The model has no term: it compensates nothing." } };
    }
    let order = found.by_size();
    let bar = |term: &&TermFound| Bar {
        name: format!("{}, {}", named(term), lag(term)),
        value: term.gain,
        doubt: term.se.unwrap_or_default(),
        figure: format!("{} ± {}", three_digits(term.gain), optional(term.se, three_digits)),
        ..Bar::default()
    };
    let shown = &order[..order.len().min(MOST_BARS)];
    let of_unit = |unit: &&str| -> (String, Vec<Bar>) {
        let own = shown.iter().filter(|term| term.unit == **unit);
        (format!("Terms, {unit}"), own.map(bar).collect())
    };
    let units = units(shown);
    let cells = |term: &TermFound| {
        [
            lag(term),
            three_digits(term.gain),
            optional(term.se, three_digits),
            term.unit.clone(),
            // A larger value only shows that the term cannot be distinguished from the others.
            optional(
                term.inflation,
                |times| if times > 1000.0 { "> 1000".to_owned() } else { three_digits(times) },
            ),
        ]
    };
    let rows = html! { @for term in &order { (row(&named(term), cells(term))) } };
    html! {
        h2 { "The model" }
        p {
            "Cz = −e is the sum of these terms. A term is a gain times an input, through a lag with this \
             time constant. The input is the rise of a sensor since the start of the run, or a speed or its \
             square, in its unit. The largest terms in µm are first. The whisker is one standard error to \
             either side."
        }
        div .gallery {
            @for (title, bars) in units.iter().map(of_unit) {
                (figure(&title, &chart::bars("gains with their standard errors", &bars), "± standard error"))
            }
            (at_rest(&found.terms))
        }
        @if order.len() > shown.len() { p .quiet { "The " (MOST_BARS) " largest of " (order.len()) " terms." } }
        details open[order.len() <= MOST_BARS] {
            summary { "All " (order.len()) " terms in figures" }
            (table(&["sensor", "time constant τ", "gain", "standard error", "unit", "variance inflation"], &rows))
        }
        @if let Some(condition) = found.condition {
            p {
                "Condition number " (three_digits(condition)) ": "
                @if condition < 30.0 { "the terms can be distinguished." }
                @else { "terms are similar, so only the sum of their gains is meaningful." }
            }
        }
    }
}

/// Returns the units of these gains, without duplicates.
fn units<'a>(terms: &[&'a TermFound]) -> Vec<&'a str> {
    let mut units: Vec<&str> = terms.iter().map(|term| term.unit.as_str()).collect();
    units.sort_unstable();
    units.dedup();
    units
}

/// Returns the name of the signal of a term, for example `bed`. If the input is the square of the signal, the result is
/// `bed²`.
fn named(term: &TermFound) -> String {
    format!("{}{}", term.signal, if term.squared { "²" } else { "" })
}

/// Renders charts of the effect of each signal in equilibrium. This effect is the sum of the gains of the signal over
/// all lags. Each unit has its own chart.
fn at_rest(terms: &[TermFound]) -> Markup {
    let mut sums: Vec<(&TermFound, f64)> = Vec::new();
    for term in terms.iter().filter(|term| !term.slope) {
        let is_same = |first: &TermFound| (&first.signal, first.squared) == (&term.signal, term.squared);
        match sums.iter_mut().find(|(first, _)| is_same(first)) {
            Some((_, sum)) => *sum += term.gain,
            None => sums.push((term, term.gain)),
        }
    }
    let plain = terms.iter().filter(|term| !term.slope).count();
    if sums.len() == plain {
        return html! {};
    }
    sums.sort_by(|one, other| other.1.abs().total_cmp(&one.1.abs()));
    let bar = |(term, sum): &(&TermFound, f64)| Bar {
        name: named(term),
        value: *sum,
        figure: format!("{} {}", three_digits(*sum), term.unit),
        ..Bar::default()
    };
    let of_unit =
        |unit: &&str| -> Vec<Bar> { sums.iter().filter(|(term, _)| term.unit == **unit).map(bar).collect() };
    let units = units(&sums.iter().map(|(term, _)| *term).collect::<Vec<_>>());
    html! {
        @for bars in units.iter().map(of_unit) {
            (figure(
                "Each sensor in equilibrium",
                &chart::bars("sum of the gains of each sensor", &bars),
                "The sum of the gains of a sensor is its effect on Cz for a change of one unit, after all \
                 lags have settled.",
            ))
        }
    }
}

fn lag(term: &TermFound) -> String {
    match term.lag_s {
        lag if lag > 0.0 => duration(lag),
        _ => "at once".to_owned(),
    }
}

/// Renders the residual errors that remain if a sensor is lost, for each sensor.
pub(super) fn stand_ins(found: &Identified) -> Markup {
    let figures = |means: &Means| {
        let [mean, worst, rms] = [means.mean_range_um, means.worst_range_um, means.mean_rmse_um].map(number);
        [mean, worst, rms, format!("{} %", decimals(100.0 * means.worse_share, 0))]
    };
    let of_sensor = |stand_in: &StandIn| {
        let others = stand_in.terms.iter().map(|(signal, ..)| signal).collect::<BTreeSet<_>>().len();
        (
            stand_in.signal.clone(),
            stand_in.means,
            format!("the value predicted from {}", counted(others, "other")),
        )
    };
    let of_model = |fallback: &Fallback| {
        let kind = format!("{} without it, {}", fallback.kind(), counted(fallback.terms.len(), "term"));
        (fallback.without.clone(), fallback.means, kind)
    };
    let used = found.stand_ins.iter().filter(|stand_in| stand_in.stands_in).map(of_sensor);
    let mut lost: Vec<(String, Means, String)> = used.chain(found.fallbacks.iter().map(of_model)).collect();
    if lost.is_empty() || found.runs.is_empty() {
        return html! {};
    }
    lost.sort_by(|one, other| other.1.mean_range_um.total_cmp(&one.1.mean_range_um));
    let rows = html! {
        @for (signal, means, by) in lost { (row(&signal, figures(&means).into_iter().chain([by]))) }
        tr .sum { th scope="row" { "none" } @for figure in figures(&Means::unprobed(&found.held_out)) { td { (figure) } } td {} }
    };
    html! {
        h2 { "Without one of its sensors" }
        p {
            "If a sensor is frozen or fails, a value predicted from the other sensors replaces it, or a \
             model without this sensor is used. The one with the smaller error is chosen. Errors on held-out \
             runs, with the sensor lost from the beginning of each run"
            @if found.probe_s.is_some() { ", without the probe" }
            ":"
        }
        @for signal in &found.irreplaceable {
            p { strong { (signal) } ": without this sensor, the mean range of the residual error grows by more \
                                     than a quarter. Keep a spare sensor." }
        }
        (table(&["lost", "mean range, µm", "worst run, µm", "mean RMS, µm",
            "worse runs", "what replaces it"], &rows))
        @if !found.stand_ins.is_empty() {
            p .quiet {
                "A sensor counts as frozen if its reading is constant while the other sensors indicate a \
                 change of more than: "
                (found.stand_ins.iter().map(|own| format!("{} {} °C", own.signal, decimals(own.threshold, 2))).collect::<Vec<_>>().join(", ")) "."
            }
        }
    }
}

/// Renders how the error range on held-out runs depends on the number of sensors in the model. Renders nothing if there
/// are fewer than three results.
pub(super) fn by_sensors(counted: &[Counted]) -> Markup {
    if counted.len() < 3 {
        return html! {};
    }
    let ranges: Vec<f64> = counted.iter().map(|row| row.means.mean_range_um).collect();
    let best = ranges.iter().copied().fold(f64::INFINITY, f64::min);
    let few = ranges.iter().position(|range| *range <= 1.1 * best).unwrap_or_default();
    let rows = html! {
        @for counted in counted {
            tr {
                th scope="row" { (counted.k) }
                td { (number(counted.means.mean_range_um)) } td { (number(counted.means.worst_range_um)) }
                td .words { (counted.points.last().map_or("–", String::as_str)) }
            }
        }
    };
    let says = "held-out range by the number of sensors";
    html! {
        h2 { "How many sensors" }
        p {
            "How much each further sensor reduces the error. For each run, the sensors were chosen with the \
             data of all other runs, and the error was measured on that run." }
        div .gallery {
            (figure("Mean range of the residual error in a run",
                &chart::curve("µm", says, &ranges, few, ranges[0]),
                "Horizontal axis: number of sensors; dashed line: result without sensors. A ring marks the \
                 smallest number of sensors whose result is within a tenth of the best result."))
        }
        (table(&["sensors", "mean range, µm", "worst run, µm", "sensor added (on all runs):"], &rows))
    }
}

/// Renders the expected error of the model (standard deviation of its residual error) after several hours. If the
/// expected error is not known, renders the reason.
pub(super) fn expected(found: &Identified) -> Markup {
    let Some(expected) = found.expected else {
        return html! { @if let Some(why) = found.expected_missing { h2 { "Expected error" } p { "Not known: " (why) "." } } };
    };
    let after = |[a, b]: Growth, hours: f64| format!("± {} µm", number((a * hours + b).sqrt()));
    let rows = html! {
        @for hours in [0.5, 1.0, 2.0, 4.0, 8.0] {
            (row(&duration(hours * 3600.0), [after(expected.since_datum, hours), if hours <= 2.0 { after(expected.since_touch, hours) } else { "–".to_owned() }]))
        }
    };
    let shares = found.runs.iter().filter_map(|run| Some((run, run.expected_um?)));
    html! {
        h2 { "Expected error" }
        p {
            "Standard deviation of the residual error, from the held-out runs. It grows with the time since \
             the datum (zero point of Cz), or since the last touch of a probe. Two rows of three should be \
             within one standard deviation, 19 of 20 within two."
        }
        (table(&["after", "since the datum", "since a touch"], &rows))
        p .quiet {
            "Share of the rows whose residual error is within one and within two standard deviations, as \
             expected from the other runs: "
            (shares.map(|(run, inside)| format!("{} {} and {} %", run.name, decimals(100.0 * inside.inside_1, 0), decimals(100.0 * inside.inside_2, 0))).collect::<Vec<_>>().join("; ")) "."
        }
        @if let Some(q) = found.probe_q {
            p {
                "The residual error drifts randomly, by " (three_digits(q)) " µm² an hour: "
                code { "q = " (three_digits(q)) } " is the setting for a probe of the axis." }
        }
    }
}

/// Renders the envelope: the range of the rises in the logs from which the model was identified. A rise is the value of
/// an input minus its reference.
pub(super) fn envelope(region: Option<&Region>) -> Markup {
    let Some(region) = region else {
        return html! {
            h2 { "Envelope" }
            p { "No envelope is written: the model has too many inputs, or an input that never changed." }
        };
    };
    let rows = html! {
        @for (name, mean, low, high) in &region.inputs {
            (row(name, [*low, *mean, *high].map(number)))
        }
    };
    html! {
        h2 { "Envelope" }
        p {
            "In the logs, the rises since the start of a run were in these ranges. The model was not tested \
             outside them, and the gateway reports when an input is outside." }
        (table(&["sensor", "least, °C", "mean, °C", "most, °C"], &rows))
    }
}

/// Renders the limits of the axis, which apply to Cz (the compensation value) of every model.
pub(super) fn limits(axis: &AxisSettings) -> Markup {
    let micron = |value: f64| format!("{} µm", chart::tick(value));
    let time = |time: Duration| duration(time.as_secs_f64());
    let fault = match axis.on_fault {
        OnFault::Hold => "Cz stays as it is".to_owned(),
        OnFault::Ramp { after } => {
            format!("Cz stays for {}, then goes to zero at the largest rate", time(after))
        }
        OnFault::Zero => "Cz goes to zero in steps".to_owned(),
    };
    html! {
        h2 { "Limits in force" }
        dl .facts {
            dt { "largest Cz" } dd { "± " (micron(axis.guard.limit.get())) }
            dt { "largest step" } dd { (micron(axis.guard.step.get())) " in " (time(axis.every)) }
            dt { "largest rate" } dd { (chart::tick(axis.guard.rate.get())) " µm/s, " (decimals(axis.guard.rate.get() * 60.0, 1)) " µm/min" }
            dt { "deadband" } dd { (micron(axis.guard.deadband.get())) }
            @if let Some(warn) = axis.levels.warn { dt { "warns beyond" } dd { (micron(warn.get())) } }
            @if let Some(error) = axis.levels.error {
                dt { "switches off beyond" } dd { (micron(error.get())) }
            }
            dt { "on a fault" } dd { (fault) }
        }
    }
}
