//! Calculation of the data for the selection of sensors from FE input files: temperatures, displacements, and the
//! matrix P.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::{Arguments, Engine};
use crate::cli::loading::of_other_kind;
use isotherm_placement::blocks::{Part, Reach, parts};
use isotherm_placement::body::Progress;
use isotherm_placement::ccx::Ccx;
use isotherm_placement::fe_input::{self, Faults, FeInput};
use isotherm_placement::mesh::Mesh;
use isotherm_placement::problem::Load;
use isotherm_placement::structure::{Adjoint, guideway_and_temperatures};
use isotherm_placement::study::{Study, rows};
use isotherm_placement::views::outside;
use isotherm_profile::FileKind;

/// Reads the FE input files, and calculates temperatures, displacements and the matrix P. The second result is a remark
/// on the nodes that are fixed.
pub(super) fn study(
    arguments: &Arguments,
    plant: Option<&FeInput>,
    progress: Progress<'_>,
) -> anyhow::Result<(Study, String)> {
    let mut inputs = read(&arguments.inputs, plant, progress)?;
    let mut wrong = Vec::new();
    let mesh = &inputs[0].mesh;
    let guide = set(mesh, &arguments.guide, "--guide", &mut wrong);
    let stated: Vec<&FeInput> =
        inputs.iter().chain(plant).filter(|input| !input.supports.is_empty()).collect();
    let (fixed, remark) = fixed(mesh, arguments.fixed.as_deref(), &stated, &mut wrong);
    let parts = parts(mesh, &arguments.blocks, &arguments.cut).unwrap_or_else(|why| {
        wrong.extend(why);
        Vec::new()
    });
    let mut allowed = outside(mesh, &fixed);
    if let Some(name) = &arguments.candidates {
        let chosen: BTreeSet<usize> = set(mesh, name, "--candidates", &mut wrong).into_iter().collect();
        allowed.fill(false);
        mesh.skin().iter().filter(|node| chosen.contains(node)).for_each(|node| allowed[*node] = true);
    }
    guide.iter().chain(&fixed).for_each(|node| allowed[*node] = false);
    anyhow::ensure!(wrong.is_empty(), "{}: {}", arguments.inputs[0].display(), wrong.join("\n"));
    let Computed { p, adjoint, loads } = match arguments.engine {
        Engine::Own => own(&inputs, &fixed, &guide, &parts, progress),
        Engine::Ccx => calculix(&inputs, &fixed, &guide, &parts, progress),
    }?;
    let reach = Reach { margin: arguments.margin, allowed };
    Ok((Study { mesh: inputs.swap_remove(0).mesh, guide, p, adjoint, parts, reach, loads }, remark))
}

/// Node set that is fixed by default, without the option `--fixed` and without supports in the FE input files.
const BASE: &str = "BASE";

/// Returns the fixed nodes, and a remark that names their source: the node set `option`, or the supports of
/// the FE input files. `stated` contains the FE input files with supports. Without `option`, all these
/// supports must be the same. Without `option` and supports, the node set `BASE` is fixed. Errors are added
/// to `wrong`.
fn fixed(
    mesh: &Mesh,
    option: Option<&str>,
    stated: &[&FeInput],
    wrong: &mut Vec<String>,
) -> (Vec<usize>, String) {
    let names = || stated.iter().map(|input| input.name.as_str()).collect::<Vec<_>>().join(", ");
    match (option, stated) {
        (Some(name), []) => {
            let nodes = set(mesh, name, "--fixed", wrong);
            let remark =
                format!("The {} nodes of the node set {} are fixed.", nodes.len(), name.to_uppercase());
            (nodes, remark)
        }
        (Some(name), _) => {
            let nodes = set(mesh, name, "--fixed", wrong);
            let remark = format!(
                "The {} nodes of the node set {} are fixed. --fixed replaces the supports of *BOUNDARY in {}.",
                nodes.len(),
                name.to_uppercase(),
                names()
            );
            (nodes, remark)
        }
        (None, []) => {
            let remedy =
                "--fixed, or write the supports in the FE input files: *BOUNDARY, with the directions 1 to 3";
            let nodes = set(mesh, BASE, remedy, wrong);
            let remark = format!(
                "The {} nodes of the node set {BASE} are fixed, because no FE input file has supports (*BOUNDARY).",
                nodes.len()
            );
            (nodes, remark)
        }
        (None, [first, others @ ..]) => {
            let differing = others.iter().filter(|other| other.supports != first.supports);
            wrong.extend(differing.map(|other| {
                format!(
                    "{} and {} fix different nodes ({} and {} nodes). Every load case must have the same supports: \
                     write the same *BOUNDARY in both, or name the fixed node set with --fixed",
                    first.name,
                    other.name,
                    first.supports.len(),
                    other.supports.len()
                )
            }));
            let remark = format!("The {} nodes of *BOUNDARY in {} are fixed.", first.supports.len(), names());
            (first.supports.clone(), remark)
        }
    }
}

/// Matrix P, and the adjoint solution if isotherm has calculated it.
struct Computed {
    /// Matrix P, mm/K: displacement of the guideway if one block is 1 K warmer. Rows: 3·(guideway point) + component.
    /// Columns: blocks.
    p: Vec<Vec<f64>>,
    /// Adjoint solution of isotherm's own calculation, needed for the modes; `None` for CalculiX.
    adjoint: Option<Adjoint>,
    loads: Vec<Load>,
}

/// Calculates temperatures, displacements and P with isotherm's own finite elements.
fn own(
    inputs: &[FeInput],
    fixed: &[usize],
    guide: &[usize],
    parts: &[Part],
    progress: Progress<'_>,
) -> anyhow::Result<Computed> {
    let (adjoint, rises) = guideway_and_temperatures(inputs, fixed, guide, progress)?;
    let mut loads = Vec::new();
    for (input, rise) in inputs.iter().zip(rises) {
        let rise = rise.map_err(|why| anyhow::anyhow!("{}: {why}", input.name))?;
        loads.push(Load { name: input.name.clone(), moved_mm: adjoint.displacements(&rise), rise });
    }
    let columns: Vec<Vec<f64>> = parts.iter().map(|part| adjoint.block(&part.nodes)).collect();
    Ok(Computed { p: rows(&columns), adjoint: Some(adjoint), loads })
}

/// Calculates with CalculiX: the temperatures case by case, then all displacements, and P from a rise of 1 K of each
/// block.
fn calculix(
    inputs: &[FeInput],
    fixed: &[usize],
    guide: &[usize],
    parts: &[Part],
    progress: Progress<'_>,
) -> anyhow::Result<Computed> {
    let ccx = Ccx::default();
    let all = inputs.len() + 1;
    let mut rises = Vec::new();
    for (place, input) in inputs.iter().enumerate() {
        progress("ccx", place, all);
        let rise = ccx.temperatures(&input.mesh, &input.materials, &input.load);
        rises.push(rise.map_err(|why| anyhow::anyhow!("{}: {why}", input.name))?);
    }
    let (mesh, materials) = (&inputs[0].mesh, &inputs[0].materials);
    let warmed = |part: &Part| {
        let mut warmed = vec![0.0; mesh.nodes.len()];
        part.nodes.iter().for_each(|node| warmed[*node] = 1.0);
        warmed
    };
    let units: Vec<Vec<f64>> = parts.iter().map(warmed).collect();
    let fields: Vec<&[f64]> = units.iter().chain(&rises).map(Vec::as_slice).collect();
    progress("ccx", inputs.len(), all);
    let mut columns = ccx.displacements(mesh, materials, fixed, guide, &fields)?;
    progress("ccx", all, all);
    let moved = columns.split_off(parts.len());
    let loads = inputs.iter().zip(rises).zip(moved);
    let loads = loads.map(|((input, rise), moved_mm)| Load { name: input.name.clone(), rise, moved_mm });
    Ok(Computed { p: rows(&columns), adjoint: None, loads: loads.collect() })
}

/// Reads every file. Returns an error if the files, including the file of `--plant`, do not describe the same
/// structure.
fn read(paths: &[PathBuf], plant: Option<&FeInput>, progress: Progress<'_>) -> anyhow::Result<Vec<FeInput>> {
    let mut inputs: Vec<FeInput> = Vec::new();
    let mut wrong = Vec::new();
    for (path, read) in paths.iter().zip(fe_input::read_each(paths, progress)) {
        match read {
            Ok(input) if inputs.iter().any(|other| other.name == input.name) => wrong.push(format!(
                "{}: a second load case with the name {}. A load case has the name of its file: give the \
                 files different names",
                path.display(),
                input.name
            )),
            Ok(input) => inputs.push(input),
            Err(faults) => wrong.push(named(path, faults).to_string()),
        }
    }
    if let Some((first, others)) = inputs.split_first() {
        wrong.extend(others.iter().chain(plant).filter_map(|other| differs(first, other)));
    }
    anyhow::ensure!(wrong.is_empty(), "{}", wrong.join("\n"));
    Ok(inputs)
}

/// Returns the error for a file that is no FE input. If the file has no keyword cards and its kind is known, the error
/// names the kind. Otherwise the error lists the `faults`.
pub(super) fn named(path: &Path, faults: Faults) -> anyhow::Error {
    match faults.is_without_cards(path) {
        true => of_other_kind(path, FileKind::Mesh, faults),
        false => faults.into(),
    }
}

/// Returns the reason why two files do not describe the same structure; `None` if they describe the same structure.
fn differs(first: &FeInput, other: &FeInput) -> Option<String> {
    let (one, two) = (&first.mesh, &other.mesh);
    let why = if one.nodes != two.nodes {
        format!(
            "one file has {} nodes and the other {}, or their node numbers differ",
            one.nodes.len(),
            two.nodes.len()
        )
    } else if one.xyz != two.xyz {
        "their nodes have different coordinates".to_owned()
    } else if one.elements != two.elements {
        "their elements differ".to_owned()
    } else if members(one) != members(two) {
        "their node sets differ".to_owned()
    } else if first.materials != other.materials {
        "their materials differ".to_owned()
    } else {
        return None;
    };
    Some(format!(
        "{} and {} are not the same structure: {why}. Every load case must have the same mesh and materials: \
         put both into one file that each FE input file includes",
        first.name, other.name
    ))
}

/// Returns the node sets without the order of their nodes, to compare two files. The order in the first file determines
/// the rows of P.
fn members(mesh: &Mesh) -> BTreeMap<&str, BTreeSet<usize>> {
    mesh.node_sets.iter().map(|(name, nodes)| (name.as_str(), nodes.iter().copied().collect())).collect()
}

/// Returns the nodes of a set that must exist. If it is missing or empty, adds an error to `wrong`.
fn set(mesh: &Mesh, name: &str, option: &str, wrong: &mut Vec<String>) -> Vec<usize> {
    let name = name.to_uppercase();
    match mesh.node_sets.get(&name) {
        Some(nodes) if !nodes.is_empty() => return nodes.clone(),
        Some(_) => wrong.push(format!("node set {name} is empty")),
        None => {
            let known: Vec<&str> = mesh.node_sets.keys().map(String::as_str).collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            wrong.push(format!(
                "there is no node set {name} (there are: {known}); add it to the FE input file, or name another with {option}"
            ));
        }
    }
    Vec::new()
}
