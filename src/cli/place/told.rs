//! What was found, in words.

use std::fmt::{self, Write};

use isotherm_placement::blocks::Part;
use isotherm_placement::found::{CaseFound, Found};
use isotherm_placement::report::remarks;

/// Everything, as text.
pub(super) fn told(found: &Found, parts: &[Part]) -> String {
    let mut text = String::new();
    // Writing into a string does not fail.
    let _ = write(&mut text, found, parts);
    text
}

fn write(text: &mut String, found: &Found, parts: &[Part]) -> fmt::Result {
    let placed = found.placed_by.as_ref().map(|case| format!(", placed by {case}")).unwrap_or_default();
    writeln!(text, "sensors by {}{placed}, coordinates in mm", found.method.name())?;
    let width = found.blocks.iter().map(|block| block.chars().count()).max().unwrap_or(0).max(5);
    writeln!(text, "  {:width$}     node         x         y         z   nodes of the block", "block")?;
    for (sensor, part) in found.sensors.iter().zip(parts) {
        let [x, y, z] = sensor.xyz;
        let count = part.nodes.len();
        writeln!(text, "  {:width$} {:>8} {x:>9.1} {y:>9.1} {z:>9.1}   {count}", sensor.block, sensor.node)?;
    }
    let names = found.cases.iter().map(|case| case.name.chars().count());
    let width = names.max().unwrap_or(0).max("placed by".len());
    writeln!(text, "\nleft of the displacement along {}, µm RMS over the guideway", found.component)?;
    writeln!(
        text,
        "  {:width$}  largest  centres   means   patent  bounded  multi-case  at best  left out  misplaced",
        "case"
    )?;
    for case in &found.cases {
        let left_out = case.left_out_rms_um.map_or("–".to_owned(), |left| format!("{left:.2}"));
        writeln!(
            text,
            "  {:width$}  {:>7.1}  {:>7.2} {:>7.2}  {:>7.2}  {:>7.2}  {:>10.2}  {:>7.2}  {left_out:>8}  {:>9.2}",
            case.name,
            case.largest_um,
            case.naive_centroid.rms_um,
            case.naive_mean.rms_um,
            case.patent.rms_um,
            case.bounded.rms_um,
            case.multi_case.rms_um,
            case.floor.rms_um,
            case.misplaced_um
        )?;
    }
    writeln!(
        text,
        "  patent and bounded are placed by the case itself; misplaced: what {} mm off their places adds; noise of {} K\n  \
         adds {:.2}",
        found.misplaced_mm, found.noise_k, found.noise_um
    )?;
    writeln!(
        text,
        "\neach placement on every case, µm RMS\n  {:width$}  method    {}",
        "placed by",
        heads(found)
    )?;
    for crossed in &found.cross_case {
        let by = crossed.placed_by.as_deref().unwrap_or("all");
        let figures = crossed.rms_um.iter().zip(&found.cases);
        let figures: String =
            figures.map(|(rms, case)| format!("  {rms:>width$.2}", width = column(case))).collect();
        writeln!(text, "  {by:width$}  {:10}{figures}", crossed.method.name())?;
    }
    if !found.by_number.is_empty() {
        writeln!(text, "\nsensors   left µm   at best µm   over all cases, one sensor per block")?;
        for entry in &found.by_number {
            let mark = if entry.sensors == found.blocks.len() { '*' } else { ' ' };
            let cut = entry.cut.as_ref().map(|cut| format!("--cut {cut}")).unwrap_or_default();
            writeln!(
                text,
                " {mark}{:>6}   {:>7.2}   {:>10.2}   {cut}",
                entry.sensors, entry.rms_um, entry.floor_um
            )?;
        }
    }
    writeln!(text)?;
    remarks(found).iter().try_for_each(|remark| writeln!(text, "{remark}"))
}

/// Names of the cases over the columns.
fn heads(found: &Found) -> String {
    found.cases.iter().map(|case| format!("  {:>width$}", case.name, width = column(case))).collect()
}

/// How wide the column of a case is.
fn column(case: &CaseFound) -> usize {
    case.name.chars().count().max(7)
}
