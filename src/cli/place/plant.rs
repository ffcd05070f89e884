//! What a plant is made from: the structure's modes; and an example to begin with.

use std::path::Path;

use anyhow::Context;

use super::structure::{Known, differs};
use super::{Engine, Failure};
use isotherm_placement::body::Progress;
use isotherm_placement::deck::{self, Deck};
use isotherm_placement::example;
use isotherm_placement::found::{Found, Sensor};
use isotherm_placement::mesh::NodeId;
use isotherm_placement::reduced::{Modes, Outputs, file};
use isotherm_placement::written::{Along, signals};

/// The plant's deck, read before the long work begins.
pub(super) fn deck(path: &Path, engine: Engine) -> Result<Deck, Failure> {
    if engine == Engine::Ccx {
        return Err(needs_own_engine());
    }
    Ok(deck::read(path).map_err(anyhow::Error::from)?)
}

fn needs_own_engine() -> Failure {
    anyhow::anyhow!("--modes needs isotherm's own finite elements: leave --engine ccx out").into()
}

/// Writes the modes of the plant's deck, told at the sensors, at the blocks' centres (`NAME_centre`) and along the guideway.
pub(super) fn modes(
    plant: &Deck,
    out: &Path,
    known: &Known,
    found: &Found,
    along: &Along,
    progress: Progress<'_>,
) -> Result<(), Failure> {
    if let Some(why) = differs(&known.first, plant) {
        return Err(anyhow::anyhow!("{why}").into());
    }
    let adjoint = known.adjoint.as_ref().ok_or_else(needs_own_engine)?;
    let modes = Modes::of(plant, progress).map_err(|why| anyhow::anyhow!("{}: {why}", plant.name))?;
    let names = signals(found, &[]);
    let node = |sensor: &Sensor| plant.mesh.place(NodeId(sensor.node)).unwrap_or_default();
    let placed = found.sensors.iter().zip(&names).map(|(sensor, name)| (name.clone(), node(sensor)));
    let centres =
        found.centres.iter().zip(&names).map(|(sensor, name)| (format!("{name}_centre"), node(sensor)));
    let points: Vec<(String, usize)> = placed.chain(centres).collect();
    let text = file(&modes, &Outputs { points: &points, adjoint, along });
    std::fs::write(out, text).with_context(|| format!("cannot write {}", out.display()))?;
    Ok(())
}

/// Writes the example's files, and says what to do with them.
pub(super) fn example(directory: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(directory)
        .with_context(|| format!("cannot make the directory {}", directory.display()))?;
    let files: Vec<_> =
        example::files().into_iter().map(|(name, text)| (directory.join(name), text)).collect();
    // What somebody has changed there is not lost.
    for (path, text) in &files {
        if std::fs::read(path).is_ok_and(|there| there != text.as_bytes()) {
            return Err(anyhow::anyhow!(
                "{} is there already, and is another: name another directory",
                path.display()
            )
            .into());
        }
    }
    for (path, text) in files {
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let place = directory.display();
    let cases: Vec<String> = example::cases().map(|case| format!("{place}/{case}.inp")).collect();
    println!("the column is in {place}/mesh.inp, its load cases beside it; where its sensors belong:");
    println!(
        "isotherm place {} --blocks COLUMN_ --candidates REACHED --component y,z --report sensors.html",
        cases.join(" ")
    );
    Ok(())
}
