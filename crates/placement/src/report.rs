//! Placement as one HTML file: the structure with its sensors, the residual errors, and possible improvements.

use maud::{Markup, html};

use crate::drawing;
use crate::guide_line::GuideLine;
use crate::mesh::{AXES, count};
use crate::methods::Method;
use crate::study::{CaseResult, Placement, SensorCount, Study, root_mean_square};
use isotherm_core::quantity::Moment;
use isotherm_html::chart::{self, Line, LineStyle};
use isotherm_html::{date, figure, number, page, table};

/// Renders the report as one HTML file; `made` is the time of the report.
#[must_use]
pub fn report(study: &Study, placement: &Placement, line: &GuideLine, made: Moment) -> String {
    let Study { mesh, guide, .. } = study;
    let content = html! {
        dl .facts {
            dt { "structure" } dd { (mesh.nodes.len()) " nodes, " (mesh.elements.len()) " elements, " (placement.blocks.len()) " blocks" }
            dt { "guideway" } dd {
                (guide.len()) " nodes, " (line.rails) @if line.rails == 1 { " rail" } @else { " rails" }
                ", along " (AXES[line.axis])
            }
            dt { "load cases" } dd { (placement.cases.iter().map(|case| case.name.as_str()).collect::<Vec<_>>().join(", ")) }
            dt { "judged" } dd { "displacement along " (placement.component) }
            dt { "method" } dd { (placement.method.name()) @if let Some(case) = &placement.placed_by { ", placed for the case " (case) } }
            dt { "date" } dd { (date(made)) }
        }
        (headline(placement))
        ul { @for remark in &placement.remarks { li { (remark) } } }
        (sensors(placement))
        h2 { "The structure" }
        p {
            "Temperature rise in the case that moves the guideway most. A darker colour is warmer. Thin lines \
             divide the blocks. A ring is a sensor, with its number in the table; a broken ring is a sensor \
             on the hidden side. Crosses are the guideway." }
        (drawing::views(study, placement))
        (displacements(placement, line))
        (errors(placement))
        (crossed(placement))
        (sensitivity(placement))
        (numbers(placement))
        (rounds(placement))
    };
    page(
        "Where the temperature sensors belong",
        made,
        "the finite-element model and the load cases named here",
        &content,
    )
}

fn headline(placement: &Placement) -> Markup {
    let cases = &placement.cases;
    let centres: Vec<f64> = cases.iter().map(|case| case.naive_centroid.rms_um).collect();
    let item = |name: &str, value: f64, note: &str| {
        html! { div { dt { (name) } dd { (number(value)) " µm" small { (note) } } } }
    };
    html! {
        dl .figures {
            (item("largest displacement", cases.iter().map(|case| case.largest_um).fold(0.0, f64::max), "of the guideway, any case"))
            (item("sensors at block centres", root_mean_square(&centres),
                "residual error, RMS over all cases"))
            (item("these sensors", placement.rms_um, "residual error, RMS over all cases"))
            (item("lower bound with these blocks", placement.floor_um, "residual error, RMS over all cases"))
        }
    }
}

fn sensors(placement: &Placement) -> Markup {
    let rows = html! {
        @for (place, sensor) in placement.sensors.iter().enumerate() {
            tr {
                th scope="row" { (place + 1) ". " (sensor.block) }
                @for at in sensor.xyz { td { (format!("{at:.1}").replace('-', "−")) } }
                td { (sensor.node) }
            }
        }
    };
    html! {
        h2 { "Sensors" }
        (table(&["block", "x mm", "y mm", "z mm", "node"], &rows))
    }
}

fn displacements(placement: &Placement, line: &GuideLine) -> Markup {
    let curve = |style: LineStyle, values: &[f64], axis: usize| {
        let um = line.mean(values, axis).into_iter().map(|mm| mm * 1000.0);
        Line { style, points: line.guide_mm.iter().copied().zip(um).collect() }
    };
    let picture = |case: &CaseResult, axis: usize| {
        let lines = [
            curve(LineStyle::Dashed, &case.naive_mm, axis),
            curve(LineStyle::Solid, &case.delta1_mm, axis),
            curve(LineStyle::Points, &case.read_mm, axis),
        ];
        let says = format!("displacement along {} in the case {}", AXES[axis], case.name);
        chart::along("µm", &format!("{}, mm", AXES[line.axis]), &says, &lines)
    };
    html! {
        h2 { "Displacement along the guideway" }
        @for axis in &placement.axes {
            p { "Along " (AXES[*axis]) @if line.rails > 1 { ", the mean of the rails" } "." }
            ul .keys { li { "true" } li .dashed {
                "predicted by sensors at block centres" } li .ring { "predicted by the sensors" } }
            div .gallery { @for case in &placement.cases { (figure(&case.name, &picture(case, *axis), "")) } }
        }
    }
}

fn errors(placement: &Placement) -> Markup {
    let rows = html! {
        @for case in &placement.cases {
            tr {
                th scope="row" { (case.name) }
                @for um in [
                    case.largest_um, case.naive_centroid.rms_um, case.naive_mean.rms_um, case.patent.optimised_rms_um,
                    case.patent.rms_um, case.bounded.rms_um, case.multi_case.rms_um, case.multi_case.max_um,
                    case.floor.rms_um,
                ] { td { (number(um)) } }
                td { (case.left_out_rms_um.map_or("–".to_owned(), number)) }
            }
        }
    };
    html! {
        h2 { "Residual error of each case" }
        p {
            "µm, RMS over the guideway. Patent and bounded are placed for the case itself and tested on it; \
             multi-case is one placement for all cases. Asked: with the block temperatures at the end of the \
             iteration. Read back: with the temperatures at the selected nodes. Left out: multi-case placed \
             for all the other cases." }
        (table(&["case", "largest", "block centres", "block means", "patent, asked", "patent, read back", "bounded", "multi-case", "multi-case, largest", "lower bound with these blocks", "left out"], &rows))
    }
}

fn crossed(placement: &Placement) -> Markup {
    let mut heads = vec!["placed for"];
    heads.extend(placement.cases.iter().map(|case| case.name.as_str()));
    let rows = html! {
        @for crossed in &placement.cross_case {
            tr .sum[crossed.method == Method::MultiCase] {
                th scope="row" { (crossed.method.name()) @if let Some(case) = &crossed.placed_by { ", " (case) } @else { ", all" } }
                @for rms in &crossed.rms_um { td { (number(*rms)) } }
            }
        }
    };
    html! {
        h2 { "Sensors of one load case under the other load cases" }
        p { "µm, RMS over the guideway: each row is one placement, each column the case that tests it." }
        (table(&heads, &rows))
    }
}

fn sensitivity(placement: &Placement) -> Markup {
    let rows = html! {
        @for case in &placement.cases { tr { th scope="row" { (case.name) } td { (number(case.misplaced_um)) } } }
    };
    html! {
        h2 { "Noise and misplacement" }
        p { "Noise of " (placement.noise_k) " K at each sensor, independently, adds " (number(placement.noise_um)) " µm RMS. Sensors that are " (placement.misplaced_mm) " mm from their places, each in any direction along the surface, add:" }
        (table(&["case", "µm RMS"], &rows))
    }
}

fn numbers(placement: &Placement) -> Markup {
    if placement.by_number.is_empty() {
        return html! {};
    }
    let own = placement.blocks.len();
    let rows = html! {
        @for entry in &placement.by_number {
            tr .sum[entry.sensors == own] {
                th scope="row" { (entry.sensors) }
                td { (number(entry.rms_um)) }
                td { (number(entry.floor_um)) }
                td .words { @if let Some(cut) = &entry.cut { "--cut " (cut) } @else if entry.sensors < own { "neighbours joined" } @else { "these blocks" } }
            }
        }
    };
    let points = |of: fn(&SensorCount) -> f64| {
        placement.by_number.iter().map(|entry| (count(entry.sensors), of(entry))).collect()
    };
    let lines = [
        Line { style: LineStyle::Dashed, points: points(|entry| entry.floor_um) },
        Line { style: LineStyle::Solid, points: points(|entry| entry.rms_um) },
        Line { style: LineStyle::Points, points: vec![(count(own), placement.rms_um)] },
    ];
    let picture = chart::along("µm", "sensors", "error against number of sensors", &lines);
    html! {
        h2 { "Error by number of sensors" }
        p {
            "RMS over guideway and all cases. For fewer sensors, the neighbouring blocks with the smallest \
             loss are joined. For more sensors, the best further cut is added, one after the other." }
        ul .keys { li {
            "residual error with the sensors" } li .dashed { "lower bound with these blocks" } li .ring { "these blocks" } }
        (figure("", &picture, ""))
        (table(&["sensors", "residual µm", "lower bound µm", "blocks:"], &rows))
    }
}

fn rounds(placement: &Placement) -> Markup {
    html! {
        h2 { "The patent's iteration" }
        p {
            "Each round uses the pattern whose displacement is most similar to the residual error, with the \
             difference degree r." }
        @for case in &placement.cases {
            details {
                summary { (case.name) ": " (case.patent.rounds.len()) " rounds, " (number(case.naive_mean.rms_um)) " → " (number(case.patent.optimised_rms_um)) " µm" }
                @if case.patent.rounds.is_empty() { p { "The mean temperatures of the blocks are accurate enough." } } @else {
                    (table(&["round", "pattern:", "likeness", "r K", "residual µm"], &html! {
                        @for (place, round) in case.patent.rounds.iter().enumerate() {
                            tr {
                                th scope="row" { (place + 1) }
                                td .words { (round.pattern) }
                                td { (number(round.likeness)) }
                                td { (isotherm_html::decimals(round.r, 3)) }
                                td { (isotherm_html::decimals(round.rms_um, 3)) }
                            }
                        }
                    }))
                }
            }
        }
    }
}
