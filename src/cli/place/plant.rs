//! Thermal modes of a structure for the plant of a virtual machine (`--modes`), and files of the example column
//! (`--example`).

use crate::cli::print::say;
use std::path::Path;

use anyhow::Context;

use super::Engine;
use super::structure::named;
use isotherm_placement::body::Progress;
use isotherm_placement::example;
use isotherm_placement::export::signals;
use isotherm_placement::fe_input::{self, FeInput};
use isotherm_placement::guide_line::GuideLine;
use isotherm_placement::mesh::NodeId;
use isotherm_placement::reduced::Modes;
use isotherm_placement::structure::Adjoint;
use isotherm_placement::study::{Placement, Sensor};

/// Reads the FE input file of `--plant`. This happens before the long calculation, so that errors appear early.
pub(super) fn read(path: &Path, engine: Engine) -> anyhow::Result<FeInput> {
    if engine == Engine::Ccx {
        anyhow::bail!("--modes needs isotherm's own finite elements: leave --engine ccx out");
    }
    fe_input::read(path).map_err(|faults| named(path, faults))
}

/// Calculates the modes of the structure as JSON. They include the temperatures at the sensors and at the centres of
/// the blocks (`NAME_centre`), and the displacement along the guideway.
pub(super) fn modes(
    plant: &FeInput,
    adjoint: &Adjoint,
    placement: &Placement,
    line: &GuideLine,
    progress: Progress<'_>,
) -> anyhow::Result<String> {
    let modes = Modes::of(plant, progress).map_err(|why| anyhow::anyhow!("{}: {why}", plant.name))?;
    let names = signals(placement, &[]);
    let node = |sensor: &Sensor| plant.mesh.place(NodeId(sensor.node)).unwrap_or_default();
    let placed = placement.sensors.iter().zip(&names).map(|(sensor, name)| (name.clone(), node(sensor)));
    let centres = placement.centres.iter().zip(&names);
    let centres = centres.map(|(sensor, name)| (format!("{name}_centre"), node(sensor)));
    let points: Vec<(String, usize)> = placed.chain(centres).collect();
    Ok(modes.to_json(&points, adjoint, line))
}

/// Writes the files of the example, and prints the command to run next.
pub(super) fn write_example(directory: &Path) -> anyhow::Result<()> {
    let place = directory.display();
    std::fs::create_dir_all(directory).with_context(|| format!("cannot create the directory {place}"))?;
    let files: Vec<_> =
        example::files().into_iter().map(|(name, text)| (directory.join(name), text)).collect();
    // Files that were changed in this directory are not overwritten.
    for (path, text) in &files {
        if std::fs::read(path).is_ok_and(|there| there != text.as_bytes()) {
            let path = path.display();
            anyhow::bail!("{path} exists already, with other content: name another directory");
        }
    }
    for (path, text) in files {
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let cases: Vec<String> = example::cases().map(|case| format!("{place}/{case}.inp")).collect();
    say!(
        "the column is in {place}/mesh.inp, and its load cases are in the same directory. This command \
         places its sensors:"
    )?;
    say!(
        "isotherm place {} --blocks COLUMN_ --candidates REACHED --component y,z --report sensors.html",
        cases.join(" ")
    )?;
    Ok(())
}
