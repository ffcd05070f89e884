//! Result of a sensor placement as text for the terminal.

use std::fmt::{self, Display, Formatter};

use isotherm_placement::blocks::Part;
use isotherm_placement::study::{CaseResult, Placement};

/// Text of a sensor placement, and of the parts into which the placement divides the structure.
pub(super) struct Text<'a>(pub(super) &'a Placement, pub(super) &'a [Part]);

impl Display for Text<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Text(placement, parts) = *self;
        let placed =
            placement.placed_by.as_ref().map(|case| format!(", placed for {case}")).unwrap_or_default();
        writeln!(f, "sensors by {}{placed}, coordinates in mm", placement.method.name())?;
        let width = placement.blocks.iter().map(|block| block.chars().count()).max().unwrap_or(0).max(5);
        writeln!(f, "  {:width$}     node         x         y         z   nodes of the block", "block")?;
        for (sensor, part) in placement.sensors.iter().zip(parts) {
            let [x, y, z] = sensor.xyz;
            let (block, node, nodes) = (&sensor.block, sensor.node, part.nodes.len());
            writeln!(f, "  {block:width$} {node:>8} {x:>9.1} {y:>9.1} {z:>9.1}   {nodes}")?;
        }
        let names = placement.cases.iter().map(|case| case.name.chars().count());
        let width = names.max().unwrap_or(0).max("placed for".len());
        writeln!(
            f,
            "\nresidual error of the displacement along {}, µm RMS over the guideway",
            placement.component
        )?;
        writeln!(
            f,
            "  {:width$}  largest  centres   means   patent  bounded  multi-case  at best  left out  misplaced",
            "case"
        )?;
        for case in &placement.cases {
            let left_out = case.left_out_rms_um.map_or("–".to_owned(), |left| format!("{left:.2}"));
            writeln!(
                f,
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
            f,
            "  patent and bounded: placed for the case itself. At best: lower bound with these blocks. \
             Misplaced: added by sensors {} mm off their places; noise of {} K\n  adds {:.2} µm",
            placement.misplaced_mm, placement.noise_k, placement.noise_um
        )?;
        let columns = |cell: &dyn Fn(usize, &CaseResult) -> String| -> String {
            let cases = placement.cases.iter().enumerate();
            cases
                .map(|(at, case)| format!("  {:>1$}", cell(at, case), case.name.chars().count().max(7)))
                .collect()
        };
        let heads = columns(&|_, case| case.name.clone());
        writeln!(
            f,
            "\nresidual error of each placement on every case, µm RMS\n  {:width$}  method    {heads}",
            "placed for"
        )?;
        for row in &placement.cross_case {
            let by = row.placed_by.as_deref().unwrap_or("all");
            let figures = columns(&|at, _| format!("{:.2}", row.rms_um[at]));
            writeln!(f, "  {by:width$}  {:10}{figures}", row.method.name())?;
        }
        if !placement.by_number.is_empty() {
            writeln!(f, "\nsensors  error µm   at best µm   over all cases, one sensor per block")?;
        }
        for entry in &placement.by_number {
            let mark = if entry.sensors == placement.blocks.len() { '*' } else { ' ' };
            let cut = entry.cut.as_ref().map(|cut| format!("--cut {cut}")).unwrap_or_default();
            let (sensors, left, floor) = (entry.sensors, entry.rms_um, entry.floor_um);
            writeln!(f, " {mark}{sensors:>6}   {left:>7.2}   {floor:>10.2}   {cut}")?;
        }
        writeln!(f)?;
        placement.remarks.iter().try_for_each(|remark| writeln!(f, "{remark}"))
    }
}
