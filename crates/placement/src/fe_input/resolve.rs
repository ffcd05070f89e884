//! Names looked up, everything checked.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use super::card::Location;
use super::raw::{Member, Members, Raw, Target};
use super::{Fault, FeInput};
use crate::element::worst_determinant;
use crate::mesh::{Element, Face, Mesh, NodeId};

mod load;
mod material;
mod surface;

/// What names are looked up in, and what is wrong so far.
struct Resolver<'a> {
    raw: &'a Raw,
    mesh: Mesh,
    /// Places of the elements by their numbers.
    elements: HashMap<u32, usize>,
    /// Outer faces by the name of their surface.
    surfaces: BTreeMap<String, Vec<Face>>,
    faults: Vec<Fault>,
}

/// The file, where nothing is wrong, these faults included.
pub(super) fn resolve(path: &Path, raw: &Raw, mut faults: Vec<Fault>) -> Result<FeInput, Vec<Fault>> {
    let before = faults.len();
    let mesh = mesh(raw, &mut faults);
    if mesh.elements.is_empty() && faults.is_empty() {
        faults.push(Fault::of_file(path, "the file has no elements: does it include its mesh?"));
    }
    if faults.len() > before || raw.spoiled_nodes || mesh.elements.is_empty() {
        return Err(faults);
    }
    let numbers = mesh.elements.iter().enumerate().map(|(place, element)| (element.id, place));
    let elements = numbers.collect();
    let mut resolver = Resolver { raw, mesh, elements, surfaces: BTreeMap::new(), faults };
    resolver.sets();
    resolver.check_mesh();
    for (name, is_of_nodes, at) in &raw.printed {
        let target = Target::Set(name.clone());
        if *is_of_nodes {
            resolver.nodes(&target, at)
        } else {
            resolver.elements(&target, at)
        };
    }
    let materials = material::materials(&mut resolver);
    let load = load::load(path, &mut resolver);
    let supports = load::supports(&mut resolver);
    let Resolver { mesh, faults, .. } = resolver;
    match (materials, load) {
        (Some(materials), Some((load, surfaces))) if faults.is_empty() => {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            Ok(FeInput { name, mesh, materials, load, surfaces, supports })
        }
        _ => Err(faults),
    }
}

/// Nodes and elements.
fn mesh(raw: &Raw, faults: &mut Vec<Fault>) -> Mesh {
    let mut order: Vec<usize> = (0..raw.nodes.len()).collect();
    order.sort_by_key(|at| raw.nodes[*at].0);
    for pair in order.windows(2) {
        let [(id, _, first), (again, _, at)] = [&raw.nodes[pair[0]], &raw.nodes[pair[1]]];
        if id == again {
            faults.push(at.fault(format!("node {id} is defined already in line {}", first.line)));
        }
    }
    let mut mesh = Mesh {
        nodes: order.iter().map(|at| NodeId(raw.nodes[*at].0)).collect(),
        xyz: order.iter().map(|at| raw.nodes[*at].1).collect(),
        ..Mesh::default()
    };
    let mut seen: HashMap<u32, usize> = HashMap::with_capacity(raw.elements.len());
    for (id, kind, nodes, at) in &raw.elements {
        if let Some(line) = seen.insert(*id, at.line) {
            faults.push(at.fault(format!("element {id} is defined already in line {line}")));
        }
        let known: Vec<usize> = nodes.iter().filter_map(|node| mesh.place(NodeId(*node))).collect();
        if known.len() < nodes.len() {
            // A node whose line is wrong is not missed again by each of its elements.
            let missing =
                nodes.iter().filter(|node| !raw.spoiled_nodes && mesh.place(NodeId(**node)).is_none());
            faults.extend(
                missing.map(|node| at.fault(format!("element {id} names node {node}, which is not defined"))),
            );
            continue;
        }
        if (1..known.len()).any(|place| known[..place].contains(&known[place])) {
            faults.push(at.fault(format!("element {id} names a node twice")));
            continue;
        }
        let element = Element { id: *id, kind: *kind, nodes: known };
        if worst_determinant(*kind, &mesh.corners(&element)) <= 0.0 {
            faults.push(at.fault(format!(
                "element {id} is numbered inside out or folded: its volume is not positive; mesh it anew"
            )));
        }
        mesh.elements.push(element);
    }
    mesh
}

impl Resolver<'_> {
    fn nodes(&mut self, target: &Target, at: &Location) -> Vec<usize> {
        let found = look_up(target, "node", |id| self.mesh.place(NodeId(id)), &self.mesh.node_sets);
        self.or_fault(found, at)
    }

    fn elements(&mut self, target: &Target, at: &Location) -> Vec<usize> {
        let found = look_up(target, "element", |id| self.elements.get(&id).copied(), &self.mesh.element_sets);
        self.or_fault(found, at)
    }

    fn surface(&mut self, target: &Target, at: &Location) -> Vec<Face> {
        let found = look_up(target, "surface", |_| None, &self.surfaces);
        self.or_fault(found, at)
    }

    fn or_fault<T>(&mut self, found: Result<Vec<T>, String>, at: &Location) -> Vec<T> {
        found.unwrap_or_else(|why| {
            self.faults.push(at.fault(why));
            Vec::new()
        })
    }

    fn sets(&mut self) {
        let solids = self.mesh.elements.len();
        // Outlines count on after the solids.
        let flat = self.raw.outlines.iter().enumerate().map(|(place, (id, ..))| (*id, solids + place));
        let flat: HashMap<u32, usize> = flat.collect();
        let element = |id: u32| self.elements.get(&id).or_else(|| flat.get(&id)).copied();
        let node = |id: u32| self.mesh.place(NodeId(id));
        let node_sets = sets(&self.raw.node_sets, "node", node, &mut self.faults);
        let mut element_sets = sets(&self.raw.element_sets, "element", element, &mut self.faults);
        element_sets.values_mut().for_each(|set| set.sort_unstable());
        self.mesh.node_sets = node_sets;
        surface::surfaces(self, element_sets);
    }

    /// Refuses nodes without elements, faces with too many, neighbours of different kinds.
    fn check_mesh(&mut self) {
        let (raw, mesh) = (self.raw, &self.mesh);
        let used = mesh.used();
        for (id, _, at) in &raw.nodes {
            if mesh.place(NodeId(*id)).is_some_and(|place| !used[place]) {
                let message =
                    format!("node {id} belongs to no element: take it out of the mesh and its sets");
                self.faults.push(at.fault(message));
            }
        }
        let mut faces: HashMap<[usize; 3], (usize, usize)> = HashMap::with_capacity(2 * mesh.elements.len());
        for (place, element) in mesh.elements.iter().enumerate() {
            for side in 0..4 {
                let (first, times) = faces.entry(mesh.face_key(element, side)).or_insert((place, 0));
                *times += 1;
                let first = &mesh.elements[*first];
                let (id, other) = (element.id, first.id);
                let wrong = if *times > 2 {
                    format!(
                        "element {id} has a face that {other} and another element have already: parts of the mesh overlap"
                    )
                } else if first.kind != element.kind {
                    let (kind, other_kind) = (element.kind.name(), first.kind.name());
                    format!(
                        "element {id} ({kind}) joins element {other} ({other_kind}): all elements that touch are of one kind"
                    )
                } else {
                    continue;
                };
                self.faults.push(raw.elements[place].3.fault(wrong));
            }
        }
    }
}

/// What a target means, or why it means nothing.
fn look_up<T: Clone>(
    target: &Target,
    what: &str,
    find: impl Fn(u32) -> Option<T>,
    sets: &BTreeMap<String, Vec<T>>,
) -> Result<Vec<T>, String> {
    match target {
        Target::Id(id) => {
            find(*id).map(|found| vec![found]).ok_or_else(|| format!("{what} {id} is not defined"))
        }
        Target::Set(name) => sets.get(name).cloned().ok_or_else(|| {
            let known: Vec<&str> = sets.keys().map(String::as_str).collect();
            let known = known.join(", ");
            let known =
                if known.is_empty() { "there is none".to_owned() } else { format!("there are {known}") };
            format!("{what} set {name} is not defined ({known})")
        }),
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
        for (member, at) in &members.members {
            match member {
                Member::Ids(first, last, by) => {
                    for id in (*first..=*last).step_by(usize::try_from(*by).unwrap_or(1)) {
                        match find(id) {
                            Some(place) => found.push(place),
                            None => faults.push(at.fault(format!("{what} {id} is not defined"))),
                        }
                    }
                }
                Member::Set(name) => match sets.get(name) {
                    Some(of) => found.extend(of),
                    None => {
                        faults.push(at.fault(format!("`{name}` is neither a number nor a {what} set above")))
                    }
                },
            }
        }
        if members.own_card && sets.contains_key(&members.name) {
            let message =
                format!("{what} set {} is defined already: name all its members once", members.name);
            faults.push(members.at.fault(message));
            continue;
        }
        let set = sets.entry(members.name.clone()).or_default();
        set.append(&mut found);
        let mut seen = HashSet::new();
        set.retain(|place| seen.insert(*place));
    }
    for members in raw.iter().filter(|members| members.own_card && members.members.is_empty()) {
        faults.push(members.at.fault(format!("{what} set {} is empty", members.name)));
    }
    sets
}
