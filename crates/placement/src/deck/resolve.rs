//! Names looked up, the whole checked.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use super::raw::{Member, Members, Raw, Target};
use super::{Deck, Fault};
use crate::element::worst_determinant;
use crate::mesh::{Element, Mesh, NodeId};

mod load;
mod names;
mod outline;
mod solid;

use names::Names;

/// The deck, where nothing hinders; what is wrong goes to `faults`.
pub(super) fn deck(path: &Path, raw: &Raw, faults: &mut Vec<Fault>) -> Option<Deck> {
    let before = faults.len();
    let mut mesh = mesh(raw, faults);
    if mesh.elements.is_empty() && faults.is_empty() {
        faults.push(whole(path, "the deck has no elements: does it include its mesh?"));
    }
    if faults.len() > before || raw.spoiled_nodes || mesh.elements.is_empty() {
        return None;
    }
    let elements: HashMap<u32, usize> =
        mesh.elements.iter().enumerate().map(|(place, element)| (element.id, place)).collect();
    let nodes = mesh.nodes.clone();
    let node = |id: u32| nodes.binary_search(&NodeId(id)).ok();
    // Outlines count on after the solids.
    let flat: HashMap<u32, usize> =
        raw.outlines.iter().enumerate().map(|(at, (id, ..))| (*id, mesh.elements.len() + at)).collect();
    let element = |id: u32| elements.get(&id).or_else(|| flat.get(&id)).copied();
    mesh.node_sets = sets(&raw.node_sets, "node", node, faults);
    let mut element_sets = sets(&raw.element_sets, "element", element, faults);
    element_sets.values_mut().for_each(|set| set.sort_unstable());
    let surfaces = outline::surfaces(raw, &mut mesh, element_sets, faults);
    let names = Names { mesh: &mesh, elements: &elements, surfaces: &surfaces };
    whole_body(raw, &mesh, faults);
    for (name, nodal, place) in &raw.printed {
        let target = Target::Set(name.clone());
        if *nodal {
            names.nodes(&target, place, faults)
        } else {
            names.elements(&target, place, faults)
        };
    }
    let materials = solid::materials(raw, &names, faults);
    let load = load::load(path, raw, &names, faults);
    let supports = load::supports(raw, &names, faults);
    let (load, places) = load?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Some(Deck { name, mesh, materials: materials?, load, places, supports })
}

fn whole(path: &Path, message: &str) -> Fault {
    Fault { file: path.to_path_buf(), line: None, card: String::new(), message: message.to_owned() }
}

/// Nodes and elements.
fn mesh(raw: &Raw, faults: &mut Vec<Fault>) -> Mesh {
    let mut order: Vec<usize> = (0..raw.nodes.len()).collect();
    order.sort_by_key(|at| raw.nodes[*at].0);
    for pair in order.windows(2) {
        let [(id, _, first), (again, _, place)] = [&raw.nodes[pair[0]], &raw.nodes[pair[1]]];
        if id == again {
            faults.push(place.fault(format!("node {id} is defined already in line {}", first.line)));
        }
    }
    let mut mesh = Mesh {
        nodes: order.iter().map(|at| NodeId(raw.nodes[*at].0)).collect(),
        xyz: order.iter().map(|at| raw.nodes[*at].1).collect(),
        ..Mesh::default()
    };
    let mut seen: HashMap<u32, usize> = HashMap::with_capacity(raw.elements.len());
    for (id, kind, nodes, place) in &raw.elements {
        if let Some(line) = seen.insert(*id, place.line) {
            faults.push(place.fault(format!("element {id} is defined already in line {line}")));
        }
        let mut found = Vec::with_capacity(nodes.len());
        for node in nodes {
            match mesh.place(NodeId(*node)) {
                Some(at) => found.push(at),
                // A node whose line is wrong is not missed again by each of its elements.
                None if raw.spoiled_nodes => {}
                None => {
                    faults.push(place.fault(format!("element {id} names node {node}, which is not defined")))
                }
            }
        }
        if found.len() < nodes.len() {
            continue;
        }
        if (1..found.len()).any(|at| found[..at].contains(&found[at])) {
            faults.push(place.fault(format!("element {id} names a node twice")));
            continue;
        }
        let element = Element { id: *id, kind: *kind, nodes: found };
        if worst_determinant(*kind, &mesh.corners(&element)) <= 0.0 {
            faults.push(place.fault(format!(
                "element {id} is numbered inside out or folded: its volume is not positive; mesh it anew"
            )));
        }
        mesh.elements.push(element);
    }
    mesh
}

/// Nodes without elements, faces with too many, neighbours of different kinds.
fn whole_body(raw: &Raw, mesh: &Mesh, faults: &mut Vec<Fault>) {
    let mut used = vec![false; mesh.nodes.len()];
    mesh.elements.iter().flat_map(|element| &element.nodes).for_each(|node| used[*node] = true);
    for (id, _, place) in &raw.nodes {
        if mesh.place(NodeId(*id)).is_some_and(|at| !used[at]) {
            faults.push(
                place.fault(format!("node {id} belongs to no element: take it out of the mesh and its sets")),
            );
        }
    }
    let mut faces: HashMap<[usize; 3], (usize, usize)> = HashMap::with_capacity(2 * mesh.elements.len());
    for (place, element) in mesh.elements.iter().enumerate() {
        for side in 0..4 {
            let (first, times) = faces.entry(mesh.face_key(element, side)).or_insert((place, 0));
            *times += 1;
            let first = &mesh.elements[*first];
            let at = &raw.elements[place].3;
            if *times > 2 {
                faults.push(at.fault(format!(
                    "element {} has a face that {} and another element have already: parts of the mesh overlap",
                    element.id, first.id
                )));
            } else if first.kind != element.kind {
                faults.push(at.fault(format!(
                    "element {} ({}) joins element {} ({}): all elements that touch are of one kind",
                    element.id,
                    element.kind.name(),
                    first.id,
                    first.kind.name()
                )));
            }
        }
    }
}

fn sets(
    raw: &[Members],
    what: &str,
    find: impl Fn(u32) -> Option<usize>,
    faults: &mut Vec<Fault>,
) -> BTreeMap<String, Vec<usize>> {
    let mut sets: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for members in raw {
        let mut found = Vec::new();
        for member in &members.members {
            match member {
                Member::One(Target::Id(id), place) => match find(*id) {
                    Some(at) => found.push(at),
                    None => faults.push(place.fault(format!("{what} {id} is not defined"))),
                },
                Member::One(Target::Set(name), place) => match sets.get(name) {
                    Some(of) => found.extend(of),
                    None => faults
                        .push(place.fault(format!("`{name}` is neither a number nor a {what} set above"))),
                },
                Member::Range { first, last, by, place } => {
                    for id in (*first..=*last).step_by(usize::try_from(*by).unwrap_or(1)) {
                        match find(id) {
                            Some(at) => found.push(at),
                            None => faults.push(place.fault(format!("{what} {id} is not defined"))),
                        }
                    }
                }
            }
        }
        let set = match sets.get_mut(&members.name) {
            Some(_) if members.own_card => {
                let message =
                    format!("{what} set {} is defined already: name all its members once", members.name);
                faults.push(members.place.fault(message));
                continue;
            }
            Some(set) => set,
            None => sets.entry(members.name.clone()).or_default(),
        };
        set.append(&mut found);
        let mut seen = HashSet::new();
        set.retain(|at| seen.insert(*at));
    }
    for members in raw.iter().filter(|members| members.own_card && members.members.is_empty()) {
        faults.push(members.place.fault(format!("{what} set {} is empty", members.name)));
    }
    sets
}
