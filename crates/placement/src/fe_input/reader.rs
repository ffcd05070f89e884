//! Content of an FE input file as far as it has been read, and the look-up of names in it.

use std::collections::{BTreeMap, HashMap, HashSet};

use super::card::{Card, Line, Location};
use super::material::Draft;
use super::temperature::Scale;
use super::{Fault, Faults, SurfaceNames};
use crate::body::{Case, Film, Flux};
use crate::mesh::{Face, Mesh, NodeId};

/// Content of an FE input file as far as it has been read.
#[derive(Default)]
pub(super) struct Reader {
    pub(super) faults: Faults,
    /// Whether an error of the mesh was reported. References to missing nodes or elements then cause no further
    /// messages.
    pub(super) is_spoiled: bool,
    /// Numbers of the nodes that belong to no element, ascending. These nodes are not in the mesh.
    free: Vec<u32>,
    /// Number, coordinates (mm) and location of each node, in the order of the file.
    pub(super) nodes: Vec<(u32, [f64; 3], Location)>,
    pub(super) mesh: Mesh,
    /// Index of each element. The key is the number of the element in the file.
    pub(super) numbers: HashMap<u32, usize>,
    /// Location of each element in the files.
    pub(super) element_at: Vec<Location>,
    /// Outlines: line and surface elements of the input file, with their numbers and nodes. In sets, the indices of
    /// outlines begin after the last index of a solid element.
    pub(super) outlines: Vec<(u32, Vec<usize>)>,
    outline_numbers: HashMap<u32, usize>,
    /// Sets that `*NODE` (true) or `*ELEMENT` (false) defines: name, and numbers of the members.
    pub(super) named: Vec<(bool, String, Vec<u32>)>,
    /// Outer faces of the mesh. The key is the three corner nodes of the face.
    outer: HashMap<[usize; 3], Face>,
    /// Outer faces of each surface. The key is the name of the surface.
    pub(super) surfaces: BTreeMap<String, Vec<Face>>,
    pub(super) materials: Vec<Draft>,
    /// Index of the material of each element; `None` if the element has no material.
    pub(super) of_element: Vec<Option<usize>>,
    /// Members of the node sets (`true`) and element sets (`false`) that several cards define together. A file may have
    /// one card for each member.
    continued: HashMap<(bool, String), HashSet<usize>>,
    /// Initial temperature of each node, °C; `None` if the file has not set this temperature.
    pub(super) initial: Vec<Option<f64>>,
    /// Scale of the initial temperatures (°C or kelvin); `None` before the first initial temperature is read.
    pub(super) scale: Option<Scale>,
    /// Location of the first `*BOUNDARY` without `OP=NEW`. A later card with `OP=NEW` would remove its supports, and is
    /// an error.
    pub(super) kept_boundary: Option<Location>,
    /// Fixed directions (x, y, z) of each node, with the location of the data line. The key is the index of the node.
    pub(super) supports: BTreeMap<usize, ([bool; 3], Location)>,
    /// Prescribed temperatures, °C. The key is the index of the node.
    pub(super) held: BTreeMap<usize, f64>,
    /// Time range of the step; `None` before `*HEAT TRANSFER`.
    pub(super) case: Option<Case>,
    pub(super) films: Vec<Film>,
    pub(super) fluxes: Vec<Flux>,
    pub(super) nodal: Vec<(usize, f64)>,
    pub(super) names: SurfaceNames,
    /// Loads that may be defined only once, each with the number of the line that defines it.
    once: HashMap<(u8, usize, usize), usize>,
}

impl Reader {
    /// Reads every data line of a card. After an error in one line, the other lines are still read.
    pub(super) fn each(
        &mut self,
        card: &Card,
        mut read: impl FnMut(&mut Reader, &Line) -> Result<(), Fault>,
    ) {
        for line in &card.lines {
            let done = read(self, line);
            self.faults.extend(done.err());
        }
    }

    /// Adds an error about a reference to an undefined node, element or set. After an error in the mesh, adds nothing.
    pub(super) fn missed(&mut self, at: &Location, message: String) {
        if !self.is_spoiled {
            self.faults.push(at.fault(message));
        }
    }

    /// Returns the index of a node, or the indices of the nodes of a set. If no node set has this name, returns the
    /// nodes of the element set with this name: Gmsh writes only element sets by default. If the name is unknown, adds
    /// an error and returns an empty list.
    pub(super) fn nodes(&mut self, name: &str, at: &Location) -> Vec<usize> {
        let found = look_up(name, "node", |id| self.mesh.place(NodeId(id)), &self.mesh.node_sets);
        let found = found.or_else(|why| match name.parse() {
            Ok(id) if self.is_free(id) => Err(format!("node {id} is in no element")),
            Ok(_) => Err(why),
            Err(_) => self.nodes_of_elements(name).ok_or(why),
        });
        self.found(found, at)
    }

    /// Returns the nodes of an element set, ascending; `None` if there is no such set.
    fn nodes_of_elements(&self, name: &str) -> Option<Vec<usize>> {
        let elements = self.mesh.element_sets.get(&name.to_uppercase())?;
        let mut is_in = vec![false; self.mesh.nodes.len()];
        for node in elements.iter().flat_map(|element| &self.mesh.elements[*element].nodes) {
            is_in[*node] = true;
        }
        Some((0..is_in.len()).filter(|node| is_in[*node]).collect())
    }

    /// Returns the index of an element, or the indices of the elements of a set. If the name is unknown, adds an error
    /// and returns an empty list.
    pub(super) fn elements(&mut self, name: &str, at: &Location) -> Vec<usize> {
        let number = |id: u32| self.numbers.get(&id).copied();
        let found = look_up(name, "element", number, &self.mesh.element_sets);
        self.found(found, at)
    }

    /// Returns the faces that the first value of the line names. Without `side`, the value is the name of a surface.
    /// With `side`, the value is an element or an element set, and the result is this side of each element. `letter` is
    /// the prefix of a side in messages. Adds an error for each face inside the structure.
    pub(super) fn faces(&mut self, line: &Line, side: Option<usize>, letter: &str) -> Vec<Face> {
        let faces = match side {
            None => {
                let found = look_up(line.text(0), "surface", |_| None, &self.surfaces);
                self.found(found, &line.at)
            }
            Some(side) => {
                let elements = self.elements(line.text(0), &line.at).into_iter();
                elements.map(|element| Face { element, side }).collect()
            }
        };
        for face in &faces {
            let element = &self.mesh.elements[face.element];
            if self.outer.get(&self.mesh.face_key(element, face.side)) != Some(face) {
                let (side, id) = (face.side + 1, element.id);
                self.faults.push(line.fault(format!(
                    "side {letter}{side} of element {id} lies inside the structure, between two elements"
                )));
            }
        }
        faces
    }

    /// Adds an error if a load is defined a second time, at most one error per line. `key` identifies the load, and
    /// `what` describes it in the message.
    pub(super) fn once(&mut self, line: &Line, key: (u8, usize, usize), what: impl Fn() -> String) {
        let Some(first) = self.once.insert(key, line.at.line) else { return };
        let end = format!(" already (line {first}); remove one of the two");
        let fault = line.fault(format!("{}{end}", what()));
        // A line for a set repeats the load of each member.
        let is_repeated = self.faults.described.last().is_some_and(|last| {
            (&last.file, last.line) == (&fault.file, fault.line) && last.message.ends_with(&end)
        });
        if !is_repeated {
            self.faults.push(fault);
        }
    }

    fn found<T>(&mut self, found: Result<Vec<T>, String>, at: &Location) -> Vec<T> {
        found.unwrap_or_else(|why| {
            self.missed(at, why);
            Vec::new()
        })
    }

    pub(super) fn sets(&mut self, of_nodes: bool) -> &mut BTreeMap<String, Vec<usize>> {
        if of_nodes { &mut self.mesh.node_sets } else { &mut self.mesh.element_sets }
    }

    /// Returns the index of the node with this number if `of_nodes` is true. Otherwise, returns the index of the
    /// element or outline. `None` if the number is not defined.
    pub(super) fn member(&self, of_nodes: bool, id: u32) -> Option<usize> {
        if of_nodes {
            return self.mesh.place(NodeId(id));
        }
        let outline = || self.outline_numbers.get(&id).map(|place| self.mesh.elements.len() + place);
        self.numbers.get(&id).copied().or_else(outline)
    }

    /// Returns the numbers and indices of the existing nodes or elements in a range of numbers with this step,
    /// ascending. The run time does not depend on the size of the range.
    pub(super) fn members_between(
        &self,
        of_nodes: bool,
        (first, last): (u32, u32),
        by: u32,
    ) -> Vec<(u32, usize)> {
        let is_meant = |id: &u32| (first..=last).contains(id) && (id - first).is_multiple_of(by);
        let mut ids: Vec<u32> = if of_nodes {
            self.mesh.nodes.iter().map(|node| node.0).filter(is_meant).collect()
        } else {
            self.numbers.keys().chain(self.outline_numbers.keys()).copied().filter(is_meant).collect()
        };
        ids.sort_unstable();
        ids.dedup();
        ids.into_iter().filter_map(|id| Some((id, self.member(of_nodes, id)?))).collect()
    }

    /// Adds nodes or elements to a set. Each member occurs once in the set, in the order of the file.
    pub(super) fn add_to_set(&mut self, of_nodes: bool, name: String, mut members: Vec<usize>) {
        let sets = if of_nodes { &mut self.mesh.node_sets } else { &mut self.mesh.element_sets };
        if let Some(set) = sets.get_mut(&name) {
            let continued = self.continued.entry((of_nodes, name));
            let known = continued.or_insert_with(|| set.iter().copied().collect());
            set.extend(members.into_iter().filter(|place| known.insert(*place)));
        } else {
            let mut seen = HashSet::new();
            members.retain(|place| seen.insert(*place));
            sets.insert(name, members);
        }
    }

    pub(super) fn sort_nodes(&mut self) {
        self.nodes.sort_by_key(|(id, ..)| *id);
        for pair in self.nodes.windows(2) {
            let [(id, _, first), (again, _, at)] = [&pair[0], &pair[1]];
            if id == again {
                self.faults.push(at.fault(format!("node {id} is defined already in line {}", first.line)));
            }
        }
        self.mesh.nodes = self.nodes.iter().map(|(id, ..)| NodeId(*id)).collect();
        self.mesh.xyz = self.nodes.iter().map(|(_, xyz, _)| *xyz).collect();
    }

    /// Removes the nodes that are in no element, as CalculiX does. Gmsh writes such nodes, for example the
    /// centres of circles, and the nodes of surfaces that bound no volume.
    pub(super) fn remove_free_nodes(&mut self) {
        let used = self.mesh.used();
        if !used.contains(&false) {
            return;
        }
        let mut left = 0;
        let places: Vec<Option<usize>> = used
            .iter()
            .map(|used| {
                left += usize::from(*used);
                used.then(|| left - 1)
            })
            .collect();
        let mut kept = used.iter();
        self.nodes.retain(|_| kept.next().is_some_and(|used| *used));
        self.free =
            self.mesh.nodes.iter().zip(&used).filter(|(_, used)| !**used).map(|(id, _)| id.0).collect();
        self.mesh.nodes = self.nodes.iter().map(|(id, ..)| NodeId(*id)).collect();
        self.mesh.xyz = self.nodes.iter().map(|(_, xyz, _)| *xyz).collect();
        let moved = |nodes: &mut Vec<usize>| *nodes = nodes.iter().filter_map(|node| places[*node]).collect();
        self.mesh.elements.iter_mut().for_each(|element| moved(&mut element.nodes));
        self.outlines.iter_mut().for_each(|(_, nodes)| moved(nodes));
    }

    /// Returns whether the file has a node with this number that is in no element.
    pub(super) fn is_free(&self, id: u32) -> bool {
        self.free.binary_search(&id).is_ok()
    }

    /// Returns whether `name` is the number of a node that is in no element, or the name of a set that contains only
    /// such nodes.
    pub(super) fn is_without_elements(&self, name: &str) -> bool {
        match name.parse() {
            Ok(id) => self.is_free(id),
            Err(_) => self.mesh.node_sets.get(&name.to_uppercase()).is_some_and(Vec::is_empty),
        }
    }

    /// Returns the numbers of the nodes that are in no element, within a range of numbers with this step, ascending.
    pub(super) fn free_between(&self, first: u32, last: u32, by: u32) -> impl Iterator<Item = u32> {
        let is_meant = move |id: &u32| (first..=last).contains(id) && (id - first).is_multiple_of(by);
        self.free.iter().copied().filter(is_meant)
    }

    /// Creates the sets that `*NODE` and `*ELEMENT` define.
    pub(super) fn begin_sets(&mut self) {
        let outlines = self.outlines.iter().enumerate();
        self.outline_numbers = outlines.map(|(place, (id, _))| (*id, place)).collect();
        self.initial = vec![None; self.mesh.nodes.len()];
        self.of_element = vec![None; self.mesh.elements.len()];
        for (of_nodes, name, ids) in std::mem::take(&mut self.named) {
            let members = ids.into_iter().filter_map(|id| self.member(of_nodes, id)).collect();
            self.add_to_set(of_nodes, name, members);
        }
    }

    /// Converts sets with outlines to surfaces, and to node sets if no node set has the same name. Elements in such a
    /// set remain an element set. A surface inside the structure becomes a node set only, because no fluid can flow
    /// along it.
    pub(super) fn find_surfaces(&mut self) {
        let mesh = &mut self.mesh;
        let outer = mesh.outer_faces().into_iter();
        self.outer =
            outer.map(|face| (mesh.face_key(&mesh.elements[face.element], face.side), face)).collect();
        for (name, mut members) in std::mem::take(&mut mesh.element_sets) {
            members.sort_unstable();
            let flat = members.split_off(members.partition_point(|member| *member < mesh.elements.len()));
            if !members.is_empty() || flat.is_empty() {
                mesh.element_sets.insert(name.clone(), members);
            }
            if flat.is_empty() {
                continue;
            }
            let flat: Vec<&[usize]> =
                flat.iter().map(|member| &self.outlines[member - mesh.elements.len()].1[..]).collect();
            let faces: Option<Vec<Face>> =
                flat.iter().map(|nodes| self.outer.get(&key(nodes)?).copied()).collect();
            self.surfaces.extend(faces.map(|faces| (name.clone(), faces)));
            let mut nodes: Vec<usize> = flat.concat();
            nodes.sort_unstable();
            nodes.dedup();
            mesh.node_sets.entry(name).or_insert(nodes);
        }
    }

    /// Adds an error for each face that more than two elements share, and for adjacent elements of different kinds.
    pub(super) fn check_mesh(&mut self) {
        if self.is_spoiled {
            return;
        }
        let mesh = &self.mesh;
        let mut faces: HashMap<[usize; 3], (usize, usize)> = HashMap::with_capacity(2 * mesh.elements.len());
        for (place, element) in mesh.elements.iter().enumerate() {
            for side in 0..4 {
                let (first, times) = faces.entry(mesh.face_key(element, side)).or_insert((place, 0));
                *times += 1;
                let first = &mesh.elements[*first];
                let (id, other) = (element.id, first.id);
                let wrong = if *times > 2 {
                    format!(
                        "element {id} has a face that element {other} and a third element have too: \
                         parts of the mesh overlap"
                    )
                } else if first.kind != element.kind {
                    let (kind, other_kind) = (element.kind.name(), first.kind.name());
                    format!(
                        "element {id} ({kind}) joins element {other} ({other_kind}): elements that touch \
                         must be of one kind"
                    )
                } else {
                    continue;
                };
                self.faults.push(self.element_at[place].fault(wrong));
            }
        }
    }
}

/// Returns the node or element with this number, or the members of the set with this name. Returns a message if neither
/// exists.
fn look_up<T: Clone>(
    name: &str,
    what: &str,
    find: impl Fn(u32) -> Option<T>,
    sets: &BTreeMap<String, Vec<T>>,
) -> Result<Vec<T>, String> {
    if let Ok(id) = name.parse() {
        return find(id).map(|found| vec![found]).ok_or_else(|| format!("{what} {id} is not defined"));
    }
    let name = name.to_uppercase();
    let known = || {
        let known = sets.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        if known.is_empty() { "there is none".to_owned() } else { format!("there are {known}") }
    };
    match sets.get(&name) {
        Some(set) if set.is_empty() => Err(format!("no member of {what} set {name} is in an element")),
        Some(set) => Ok(set.clone()),
        None => Err(format!("{what} set {name} is not defined ({})", known())),
    }
}

/// Returns the three corner nodes of a flat triangle, ascending; `None` for a line element.
fn key(nodes: &[usize]) -> Option<[usize; 3]> {
    // The middle of a line with three nodes is no corner of a face, so that no face is found.
    let mut key = [*nodes.first()?, *nodes.get(1)?, *nodes.get(2)?];
    key.sort_unstable();
    Some(key)
}
