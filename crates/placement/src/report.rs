//! What was found, as one HTML file: the structure with its sensors, what they leave, and what would help.

use maud::{Markup, html};

use crate::blocks::{AXES, Part};
use crate::found::{CaseFound, Found};
use crate::mesh::Mesh;
use crate::methods::Method;
use crate::problem::Load;
use crate::written::Along;
use isotherm_core::quantity::Moment;
use isotherm_html::chart::{self, Line, Look};
use isotherm_html::{date, figure, number, page, table};

mod drawn;

/// What the report is about.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The structure.
    pub mesh: &'a Mesh,
    /// Its blocks.
    pub parts: &'a [Part],
    /// Places of the guideway's nodes.
    pub guide: &'a [usize],
    /// Temperatures of the load cases.
    pub loads: &'a [Load],
    /// What was found.
    pub found: &'a Found,
    /// The guideway as one line.
    pub along: &'a Along,
    /// When the report is made.
    pub made: Moment,
}

/// One HTML file.
#[must_use]
pub fn report(subject: &Subject<'_>) -> String {
    let Subject { mesh, found, .. } = *subject;
    let content = html! {
        dl .facts {
            dt { "structure" } dd { (mesh.nodes.len()) " nodes, " (mesh.elements.len()) " elements, " (found.blocks.len()) " blocks" }
            dt { "guideway" } dd {
                (subject.guide.len()) " nodes, " (subject.along.rails) @if subject.along.rails == 1 { " rail" } @else { " rails" }
                ", along " (AXES[subject.along.axis])
            }
            dt { "load cases" } dd { (found.cases.iter().map(|case| case.name.as_str()).collect::<Vec<_>>().join(", ")) }
            dt { "judged" } dd { "displacement along " (found.component) }
            dt { "method" } dd { (found.method.name()) @if let Some(case) = &found.placed_by { ", placed by the case " (case) } }
            dt { "date" } dd { (date(subject.made)) }
        }
        (headline(found))
        ul { @for remark in remarks(found) { li { (remark) } } }
        (sensors(found))
        h2 { "The structure" }
        p { "Temperature rise in the case that moves the guideway most: the darker, the warmer. Thin lines divide the blocks; a ring is a sensor, with its number in the table; a broken ring lies behind. Crosses are the guideway." }
        (drawn::views(subject))
        (displacements(subject))
        (errors(found))
        (crossed(found))
        (sensitivity(found))
        (numbers(found))
        (rounds(found))
    };
    page(
        "Where the temperature sensors belong",
        subject.made,
        "the finite-element model and the load cases named here",
        &content,
    )
}

/// What a reader must know, in sentences; the command line says the same.
#[must_use]
pub fn remarks(found: &Found) -> Vec<String> {
    let mut remarks = Vec::new();
    let (rms, floor) = (found.rms_um, found.floor_um);
    if found.blocks_limit {
        remarks.push(format!(
            "The division into blocks limits, not where the sensors sit: with the best temperature for every block {floor:.2} µm \
             RMS would be left, with these sensors {rms:.2}."
        ));
    } else {
        remarks.push(format!(
            "Where the sensors sit limits, not the division into blocks: {rms:.2} µm RMS are left, and the blocks could tell \
             all but {floor:.2}."
        ));
    }
    if let Some((cut, after)) = &found.best_cut {
        remarks.push(format!(
            "The cut that helps most: --cut {cut} lowers what the blocks leave at best from {floor:.2} to {after:.2} µm RMS."
        ));
    }
    if found.noise_um > rms {
        remarks.push(format!(
            "Noise of {} K at every sensor alone is {:.2} µm RMS, more than the model leaves: readings must be averaged.",
            found.noise_k, found.noise_um
        ));
    }
    let worst = found.cases.iter().filter_map(|case| case.left_out_rms_um.map(|left| (case, left)));
    if let Some((case, left)) = worst.max_by(|(_, one), (_, other)| one.total_cmp(other)) {
        remarks.push(format!(
            "A load that no case knows is told worse: placed without the case {}, the sensors leave {left:.2} µm RMS of it.",
            case.name
        ));
    }
    if found.cases.len() == 1 {
        remarks.push(
            "There is one load case only: what the sensors leave under another load is not known.".to_owned(),
        );
    }
    remarks
}

fn headline(found: &Found) -> Markup {
    let together = |of: fn(&CaseFound) -> f64| {
        let squares: f64 = found.cases.iter().map(|case| of(case).powi(2)).sum();
        (squares / super::problem::count(found.cases.len().max(1))).sqrt()
    };
    let item = |name: &str, value: f64, note: &str| {
        html! { div { dt { (name) } dd { (number(value)) " µm" small { (note) } } } }
    };
    html! {
        dl .figures {
            (item("largest displacement", found.cases.iter().map(|case| case.largest_um).fold(0.0, f64::max), "of the guideway, any case"))
            (item("sensors at block centres", together(|case| case.naive_centroid.rms_um), "left, RMS over all cases"))
            (item("these sensors", found.rms_um, "left, RMS over all cases"))
            (item("these blocks at best", found.floor_um, "left, RMS over all cases"))
        }
    }
}

fn sensors(found: &Found) -> Markup {
    let rows = html! {
        @for (place, sensor) in found.sensors.iter().enumerate() {
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

fn displacements(subject: &Subject<'_>) -> Markup {
    let Subject { found, along, .. } = *subject;
    let line = |look: Look, values: &[f64], axis: usize| {
        let told = along.of(values, axis);
        Line { look, points: along.guide_mm.iter().copied().zip(told.iter().map(|mm| mm * 1000.0)).collect() }
    };
    let picture = |case: &CaseFound, axis: usize| {
        let lines = [
            line(Look::Dashed, &case.naive_mm, axis),
            line(Look::Solid, &case.delta1_mm, axis),
            line(Look::Faint, &case.read_mm, axis),
        ];
        let says = format!("displacement along {} in the case {}", AXES[axis], case.name);
        chart::along("µm", &format!("{}, mm", AXES[along.axis]), &says, &lines)
    };
    html! {
        h2 { "Displacement along the guideway" }
        @for axis in &found.axes {
            p { "Along " (AXES[*axis]) @if along.rails > 1 { ", the mean of the rails" } "." }
            ul .keys { li { "true" } li .dashed { "told by nodes at block centres" } li .ring { "told by the sensors" } }
            div .gallery { @for case in &found.cases { (figure(&case.name, &picture(case, *axis), "")) } }
        }
    }
}

fn errors(found: &Found) -> Markup {
    let rows = html! {
        @for case in &found.cases {
            tr {
                th scope="row" { (case.name) }
                td { (number(case.largest_um)) }
                td { (number(case.naive_centroid.rms_um)) }
                td { (number(case.naive_mean.rms_um)) }
                td { (number(case.patent.optimised_rms_um)) }
                td { (number(case.patent.rms_um)) }
                td { (number(case.bounded.rms_um)) }
                td { (number(case.multi_case.rms_um)) }
                td { (number(case.multi_case.max_um)) }
                td { (number(case.floor.rms_um)) }
                td { (case.left_out_rms_um.map_or("–".to_owned(), number)) }
            }
        }
    };
    html! {
        h2 { "What is left of each case" }
        p { "µm, RMS over the guideway. Patent and bounded are placed by the case itself and judged on it; multi-case is one placement for all. Asked: with the block temperatures that the iteration ends at; read back: with those at its nodes. Left out: multi-case placed by all the other cases." }
        (table(&["case", "largest", "block centres", "block means", "patent, asked", "patent, read back", "bounded", "multi-case", "its largest", "blocks at best", "left out"], &rows))
    }
}

fn crossed(found: &Found) -> Markup {
    let mut heads = vec!["placed by"];
    heads.extend(found.cases.iter().map(|case| case.name.as_str()));
    let rows = html! {
        @for crossed in &found.cross_case {
            tr .sum[crossed.method == Method::MultiCase] {
                th scope="row" { (crossed.method.name()) @if let Some(case) = &crossed.placed_by { ", " (case) } @else { ", all" } }
                @for rms in &crossed.rms_um { td { (number(*rms)) } }
            }
        }
    };
    html! {
        h2 { "Sensors of one case under the others" }
        p { "µm, RMS over the guideway: each row is one placement, each column the case it is judged on." }
        (table(&heads, &rows))
    }
}

fn sensitivity(found: &Found) -> Markup {
    let rows = html! {
        @for case in &found.cases { tr { th scope="row" { (case.name) } td { (number(case.misplaced_um)) } } }
    };
    html! {
        h2 { "Noise and misplacement" }
        p { "Noise of " (found.noise_k) " K at each sensor, each for itself, adds " (number(found.noise_um)) " µm RMS. Sensors that sit " (found.misplaced_mm) " mm from their places, each in any direction along the surface, add:" }
        (table(&["case", "µm RMS"], &rows))
    }
}

fn numbers(found: &Found) -> Markup {
    if found.by_number.is_empty() {
        return html! {};
    }
    let own = found.blocks.len();
    let rows = html! {
        @for entry in &found.by_number {
            tr .sum[entry.sensors == own] {
                th scope="row" { (entry.sensors) }
                td { (number(entry.rms_um)) }
                td { (number(entry.floor_um)) }
                td .words { @if let Some(cut) = &entry.cut { "--cut " (cut) } @else if entry.sensors < own { "neighbours joined" } @else { "these blocks" } }
            }
        }
    };
    let points = |of: fn(&super::found::Numbered) -> f64| {
        found.by_number.iter().map(|entry| (super::problem::count(entry.sensors), of(entry))).collect()
    };
    let lines = [
        Line { look: Look::Dashed, points: points(|entry| entry.floor_um) },
        Line { look: Look::Solid, points: points(|entry| entry.rms_um) },
        Line { look: Look::Faint, points: vec![(super::problem::count(own), found.rms_um)] },
    ];
    let picture = chart::along("µm", "sensors", "error against number of sensors", &lines);
    html! {
        h2 { "How many sensors are worth it" }
        p { "RMS over guideway and all cases. Fewer: neighbours become one block where it costs least; more: the cut that helps most, one after the other." }
        ul .keys { li { "left by the sensors" } li .dashed { "blocks at best" } li .ring { "these blocks" } }
        (figure("", &picture, ""))
        (table(&["sensors", "left µm", "at best µm", "blocks:"], &rows))
    }
}

fn rounds(found: &Found) -> Markup {
    html! {
        h2 { "The patent's iteration" }
        p { "The pattern whose displacement looks most like what is left, and its difference degree r." }
        @for case in &found.cases {
            details {
                summary { (case.name) ": " (case.patent.rounds.len()) " rounds, " (number(case.naive_mean.rms_um)) " → " (number(case.patent.optimised_rms_um)) " µm" }
                @if case.patent.rounds.is_empty() { p { "The means of the blocks are near enough." } } @else {
                    (table(&["round", "pattern:", "likeness", "r K", "left µm"], &html! {
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
