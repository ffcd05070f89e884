//! Result of `isotherm select` as text for the terminal.

use std::io::{self, Write};

use isotherm_identify::select::{Selected, Step};

pub(super) fn render(out: &mut impl Write, found: &Selected) -> io::Result<()> {
    for faulty in &found.notes.excluded {
        writeln!(out, "left out: {} {}", faulty.signal, faulty.reason)?;
    }
    for like in &found.notes.ambient {
        writeln!(out, "note: {} {}", like.signal, like.reason)?;
    }
    for remark in &found.notes.remarks {
        writeln!(out, "note: {remark}")?;
    }
    let width = found.points.iter().map(|point| point.name.chars().count()).max().unwrap_or(0).max(5);
    writeln!(out, "{:width$}  correlation with {}   grey grade   range °C", "point", found.error)?;
    let under = found.error.chars().count() + "correlation with ".len();
    for point in &found.points {
        writeln!(
            out,
            "{:width$}  {:>under$.3}   {:>10.3}   {:>8.2}",
            point.name, point.correlation, point.grey_grade, point.moved
        )?;
    }
    for grouped in &found.groups {
        writeln!(out, "\ncorrelated with each other by {} or more:", grouped.correlation)?;
        for group in &grouped.groups {
            writeln!(out, "  {}", group.join(", "))?;
        }
    }
    writeln!(out, "\nstepwise, partial F over {:.0} independent samples:", found.stepwise.samples)?;
    for step in &found.stepwise.steps {
        let way = if step.comes_in { "in " } else { "out" };
        writeln!(out, "  {way} {}", tested(step, width))?;
    }
    if let Some(next) = &found.stepwise.next {
        writeln!(out, "  not {}", tested(next, width))?;
    }
    writeln!(
        out,
        "\nerror on held-out runs, by the number of points that are kept:\n  points  RMS µm   range µm   worst µm"
    )?;
    for row in &found.by_count {
        let mark = if row.k == found.recommended.k { '*' } else { ' ' };
        let last = row.points.last().map(|point| format!("+ {point}")).unwrap_or_default();
        writeln!(
            out,
            " {mark}{:>6}  {:>6.2}   {:>8.2}   {:>8.2}   {last}",
            row.k, row.means.mean_rmse_um, row.means.mean_range_um, row.means.worst_range_um
        )?;
    }
    let all = &found.all_points;
    writeln!(
        out,
        "  all {:>3} {:>6.2}   {:>8.2}   {:>8.2}",
        all.k, all.means.mean_rmse_um, all.means.mean_range_um, all.means.worst_range_um
    )?;
    let kept = &found.recommended;
    writeln!(out, "\n{}", kept.why)?;
    if kept.k == 0 {
        return Ok(());
    }
    for point in &kept.points {
        let alike = kept.alike.get(point).filter(|alike| !alike.is_empty());
        let alike = alike.map(|alike| format!("; similar points: {}", alike.join(", "))).unwrap_or_default();
        let times = kept.chosen_in.get(point).copied().unwrap_or(0);
        writeln!(
            out,
            "  keep {point:width$}  chosen in {times} of {} held-out fits{alike}",
            found.runs.len()
        )?;
    }
    writeln!(out, "next: isotherm identify … --inputs {}", kept.points.join(","))
}

fn tested(step: &Step, width: usize) -> String {
    let chance = if step.chance < 1e-4 { "< 0.0001".to_owned() } else { format!("{:.4}", step.chance) };
    format!("{:width$}  F {:>9.2}  chance {chance}", step.point, step.f)
}
