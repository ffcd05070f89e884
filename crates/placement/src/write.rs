//! Writer of FE input files in the format of CalculiX. A card is a keyword line such as `*NODE`, together with its data
//! lines.

use std::fmt::Write as _;

use crate::body::{Case, Flux, LoadCase, Materials};
use crate::mesh::{Kind, Mesh};

/// Number of node or element numbers in one text line of a set.
const IN_LINE: usize = 10;

/// Returns the mesh as text of an FE input file: its nodes, elements and sets.
#[must_use]
pub fn mesh(mesh: &Mesh) -> String {
    let mut text = coordinates(mesh);
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mut elements = mesh.elements.iter().filter(|element| element.kind == kind).peekable();
        if elements.peek().is_some() {
            let _ = writeln!(text, "*ELEMENT, TYPE={}", kind.name());
        }
        elements.for_each(|element| self::element(&mut text, element.id, &element.nodes, mesh));
    }
    for (name, nodes) in &mesh.node_sets {
        self::nodes(&mut text, name, mesh, nodes.iter().copied());
    }
    for (name, elements) in &mesh.element_sets {
        set(&mut text, &format!("*ELSET, ELSET={name}"), elements.iter().map(|at| mesh.elements[*at].id));
    }
    text
}

/// Returns the text of the card `*NODE` with all nodes.
pub(super) fn coordinates(mesh: &Mesh) -> String {
    let mut text = String::from("*NODE\n");
    for (id, [x, y, z]) in mesh.nodes.iter().zip(&mesh.xyz) {
        let _ = writeln!(text, "{id}, {}, {}, {}", number(*x), number(*y), number(*z));
    }
    text
}

/// Appends the line of an element to `text`: its number, and the numbers of its nodes.
pub(super) fn element(text: &mut String, id: u32, nodes: &[usize], mesh: &Mesh) {
    let nodes: Vec<String> = nodes.iter().map(|node| mesh.nodes[*node].to_string()).collect();
    let _ = writeln!(text, "{id}, {}", nodes.join(", "));
}

/// Appends a node set with this name to `text`.
pub(super) fn nodes(text: &mut String, name: &str, mesh: &Mesh, nodes: impl Iterator<Item = usize>) {
    set(text, &format!("*NSET, NSET={name}"), nodes.map(|node| mesh.nodes[node].0));
}

/// Formats a number for CalculiX, which reads only the first twenty characters. A longer number would lose its
/// exponent.
pub(super) fn number(value: f64) -> String {
    let whole = value.to_string();
    if whole.len() <= 20 { whole } else { format!("{value:.12e}") }
}

pub(super) fn set(text: &mut String, card: &str, ids: impl Iterator<Item = u32>) {
    let ids: Vec<String> = ids.map(|id| id.to_string()).collect();
    let _ = writeln!(text, "{card}");
    for line in ids.chunks(IN_LINE) {
        let _ = writeln!(text, "{},", line.join(", "));
    }
}

/// Returns the text of the materials, with a section for each material.
#[must_use]
pub fn materials(mesh: &Mesh, materials: &Materials) -> String {
    let mut text = String::new();
    for (place, material) in materials.list.iter().enumerate() {
        let _ = writeln!(text, "*MATERIAL, NAME={}", material.name);
        let _ = writeln!(text, "*ELASTIC\n{}, {}", number(material.young), number(material.poisson));
        let _ = writeln!(text, "*EXPANSION\n{}", number(material.expansion));
        let _ = writeln!(text, "*CONDUCTIVITY\n{}", number(material.conductivity));
        if let Some(capacity) = material.capacity {
            // Only the product is used. This density is in the middle of the range that the reader accepts.
            let density = 7e-9;
            let _ = writeln!(text, "*DENSITY\n{density:e}\n*SPECIFIC HEAT\n{}", number(capacity / density));
        }
        let mine = (materials.of_element.iter().enumerate()).filter(|(_, of)| **of == place);
        let mine: Vec<u32> = mine.map(|(at, _)| mesh.elements[at].id).collect();
        if mine.is_empty() {
            continue;
        }
        let name = format!("MADEOF{}", place + 1);
        set(&mut text, &format!("*ELSET, ELSET={name}"), mine.into_iter());
        let _ = writeln!(text, "*SOLID SECTION, ELSET={name}, MATERIAL={}", material.name);
    }
    text
}

/// Returns the text of the initial temperatures and the step of a load case. `print` contains the cards of the print
/// requests.
#[must_use]
pub fn load(mesh: &Mesh, load: &LoadCase, print: &str) -> String {
    let mut text = String::from("*INITIAL CONDITIONS, TYPE=TEMPERATURE\n");
    for (node, temperature) in mesh.nodes.iter().zip(&load.initial) {
        let _ = writeln!(text, "{node}, {}", number(*temperature));
    }
    text.push_str("*STEP, INC=1000000\n");
    match load.case {
        Case::Steady => text.push_str("*HEAT TRANSFER, STEADY STATE\n"),
        Case::Transient { step, period } => {
            let _ = writeln!(text, "*HEAT TRANSFER, DIRECT\n{}, {}", number(step), number(period));
        }
    }
    let id = |element: usize| mesh.elements[element].id;
    let held = load
        .held
        .iter()
        .map(|(node, temperature)| format!("{}, 11, 11, {}", mesh.nodes[*node], number(*temperature)));
    let films = load.films.iter().map(|film| {
        let (id, side) = (id(film.face.element), film.face.side + 1);
        format!("{id}, F{side}, {}, {}", number(film.sink), number(film.coefficient))
    });
    let fluxes = load.fluxes.iter().map(|flux| match flux {
        Flux::Face(face, heat) => format!("{}, S{}, {}", id(face.element), face.side + 1, number(*heat)),
        Flux::Volume(element, heat) => format!("{}, BF, {}", id(*element), number(*heat)),
    });
    let nodal = load.nodal.iter().map(|(node, heat)| format!("{}, 11, {}", mesh.nodes[*node], number(*heat)));
    card(&mut text, "*BOUNDARY", held);
    card(&mut text, "*FILM", films);
    card(&mut text, "*DFLUX", fluxes);
    card(&mut text, "*CFLUX", nodal);
    text.push_str(print);
    text.push_str("*END STEP\n");
    text
}

/// Appends a card with these lines to `text`; without lines, appends nothing.
fn card(text: &mut String, card: &str, lines: impl Iterator<Item = String>) {
    for (place, line) in lines.enumerate() {
        let _ = if place == 0 { writeln!(text, "{card}\n{line}") } else { writeln!(text, "{line}") };
    }
}
