//! From decks to what sensors are chosen on: temperatures, displacements, P.

use std::collections::{BTreeMap, BTreeSet};

use super::{Arguments, Engine, Failure};
use isotherm_placement::blocks::{Part, Reach, parts};
use isotherm_placement::body::Progress;
use isotherm_placement::ccx::Ccx;
use isotherm_placement::deck::{self, Deck};
use isotherm_placement::found::rows;
use isotherm_placement::heat::temperatures;
use isotherm_placement::mesh::Mesh;
use isotherm_placement::problem::Load;
use isotherm_placement::structure::{Adjoint, Structure};
use isotherm_placement::views::outside;

/// What is known of a structure.
pub(super) struct Known {
    /// The first deck: mesh and materials are those of all.
    pub(super) first: Deck,
    pub(super) guide: Vec<usize>,
    pub(super) parts: Vec<Part>,
    pub(super) reach: Reach,
    /// Rows 3·guide + component, columns blocks, mm/K.
    pub(super) p: Vec<Vec<f64>>,
    /// Only the own engine knows it.
    pub(super) adjoint: Option<Adjoint>,
    pub(super) loads: Vec<Load>,
}

/// What is asked of a structure.
struct Wanted {
    guide: Vec<usize>,
    fixed: Vec<usize>,
    parts: Vec<Part>,
    reach: Reach,
}

/// Reads the decks and computes.
pub(super) fn known(arguments: &Arguments, progress: Progress<'_>) -> Result<Known, Failure> {
    let decks = decks(arguments, progress)?;
    let mut wrong = Vec::new();
    let first = &decks[0];
    let mesh = &first.mesh;
    let guide = set(mesh, &arguments.guide, "--guide", &mut wrong);
    let fixed = match mesh.node_sets.get(&arguments.fixed.to_uppercase()) {
        None if !first.supports.is_empty() => first.supports.clone(),
        _ => set(mesh, &arguments.fixed, "--fixed", &mut wrong),
    };
    let parts = parts(mesh, &arguments.blocks, &arguments.cut).unwrap_or_else(|why| {
        wrong.extend(why);
        Vec::new()
    });
    let mut allowed = outside(mesh, &fixed);
    if let Some(name) = &arguments.candidates {
        let chosen = set(mesh, name, "--candidates", &mut wrong);
        allowed = vec![false; mesh.nodes.len()];
        let skin = mesh.skin();
        chosen.iter().filter(|node| skin.binary_search(node).is_ok()).for_each(|node| allowed[*node] = true);
    }
    guide.iter().chain(&fixed).for_each(|node| allowed[*node] = false);
    if !wrong.is_empty() {
        return Err(anyhow::anyhow!("{}: {}", arguments.decks[0].display(), wrong.join("\n")).into());
    }
    let wanted = Wanted { guide, fixed, parts, reach: Reach { margin: arguments.margin, allowed } };
    match arguments.engine {
        Engine::Own => own(decks, wanted, progress),
        Engine::Ccx => referee(decks, wanted, progress),
    }
}

/// With the own finite elements.
fn own(mut decks: Vec<Deck>, wanted: Wanted, progress: Progress<'_>) -> Result<Known, Failure> {
    let Wanted { guide, fixed, parts, reach } = wanted;
    let first = &decks[0];
    let structure =
        Structure::new(&first.mesh, &first.materials, &fixed, progress).map_err(anyhow::Error::from)?;
    let adjoint = structure.guideway(&guide, progress);
    let mut loads = Vec::new();
    for (place, deck) in decks.iter().enumerate() {
        progress("load cases", place, decks.len());
        let rise = temperatures(&deck.mesh, &deck.materials, &deck.load, progress)
            .map_err(|why| anyhow::anyhow!("{}: {why}", deck.name))?;
        loads.push(Load { name: deck.name.clone(), moved_mm: adjoint.displacements(&rise), rise });
    }
    progress("load cases", decks.len(), decks.len());
    let columns: Vec<Vec<f64>> = parts.iter().map(|part| adjoint.block(&part.nodes)).collect();
    let p = rows(&columns);
    let first = decks.swap_remove(0);
    Ok(Known { first, guide, parts, reach, p, adjoint: Some(adjoint), loads })
}

/// With CalculiX: temperatures case by case, then all displacements and P by unit rises of each block.
fn referee(mut decks: Vec<Deck>, wanted: Wanted, progress: Progress<'_>) -> Result<Known, Failure> {
    let Wanted { guide, fixed, parts, reach } = wanted;
    let ccx = Ccx::default();
    let all = decks.len() + 1;
    let mut rises = Vec::new();
    for (place, deck) in decks.iter().enumerate() {
        progress("ccx", place, all);
        let rise = ccx.temperatures(&deck.mesh, &deck.materials, &deck.load);
        rises.push(rise.map_err(|why| anyhow::anyhow!("{}: {why}", deck.name))?);
    }
    let (mesh, materials) = (&decks[0].mesh, &decks[0].materials);
    let warmed = |part: &Part| {
        let mut warmed = vec![0.0; mesh.nodes.len()];
        part.nodes.iter().for_each(|node| warmed[*node] = 1.0);
        warmed
    };
    let units: Vec<Vec<f64>> = parts.iter().map(warmed).collect();
    let fields: Vec<&[f64]> = units.iter().chain(&rises).map(Vec::as_slice).collect();
    progress("ccx", decks.len(), all);
    let mut columns =
        ccx.displacements(mesh, materials, &fixed, &guide, &fields).map_err(anyhow::Error::from)?;
    progress("ccx", all, all);
    let moved = columns.split_off(parts.len());
    let loads = decks
        .iter()
        .zip(rises)
        .zip(moved)
        .map(|((deck, rise), moved_mm)| Load { name: deck.name.clone(), rise, moved_mm })
        .collect();
    let p = rows(&columns);
    let first = decks.swap_remove(0);
    Ok(Known { first, guide, parts, reach, p, adjoint: None, loads })
}

/// Every deck, all of one structure.
fn decks(arguments: &Arguments, progress: Progress<'_>) -> Result<Vec<Deck>, Failure> {
    let mut decks: Vec<Deck> = Vec::new();
    let mut wrong = Vec::new();
    for (place, path) in arguments.decks.iter().enumerate() {
        progress("decks", place, arguments.decks.len());
        match deck::read(path) {
            Ok(deck) => {
                if decks.iter().any(|other| other.name == deck.name) {
                    wrong.push(format!(
                        "{}: a second load case called {}; a case is called as its file is: give the files different names",
                        path.display(),
                        deck.name
                    ));
                }
                decks.push(deck);
            }
            Err(faults) => wrong.push(faults.to_string()),
        }
    }
    progress("decks", arguments.decks.len(), arguments.decks.len());
    if let Some((first, others)) = decks.split_first() {
        for other in others {
            if let Some(why) = differs(first, other) {
                wrong.push(why);
            }
        }
    }
    if wrong.is_empty() { Ok(decks) } else { Err(anyhow::anyhow!("{}", wrong.join("\n")).into()) }
}

/// Why two decks are not of one structure, in words.
pub(super) fn differs(first: &Deck, other: &Deck) -> Option<String> {
    let (one, two) = (&first.mesh, &other.mesh);
    let why = if one.nodes != two.nodes {
        format!("{} nodes and {}, or other numbers", one.nodes.len(), two.nodes.len())
    } else if one.xyz != two.xyz {
        "their nodes lie elsewhere".to_owned()
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
        "{} and {} are not one structure: {why}; every load case must have the same mesh and the same materials (one file \
         that each deck includes)",
        first.name, other.name
    ))
}

/// Node sets without the order in which a deck names their nodes: the first deck's is that of P's rows.
fn members(mesh: &Mesh) -> BTreeMap<&str, BTreeSet<usize>> {
    mesh.node_sets.iter().map(|(name, nodes)| (name.as_str(), nodes.iter().copied().collect())).collect()
}

/// The nodes of a set that must be there.
fn set(mesh: &Mesh, name: &str, option: &str, wrong: &mut Vec<String>) -> Vec<usize> {
    match mesh.node_sets.get(&name.to_uppercase()) {
        Some(nodes) if !nodes.is_empty() => nodes.clone(),
        Some(_) => {
            wrong.push(format!("node set {} is empty", name.to_uppercase()));
            Vec::new()
        }
        None => {
            let known: Vec<&str> = mesh.node_sets.keys().map(String::as_str).collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            wrong.push(format!(
                "there is no node set {} (there are: {known}); add it to the deck, or name another with {option}",
                name.to_uppercase()
            ));
            Vec::new()
        }
    }
}
