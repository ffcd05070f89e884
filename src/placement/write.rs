//! Decks as CalculiX reads them.

use std::fmt::Write as _;

use super::body::{Case, Flux, LoadCase, Materials};
use super::mesh::{Kind, Mesh};

/// Numbers in one line of a set.
const IN_LINE: usize = 10;

/// Nodes, elements and sets: what decks include.
#[must_use]
pub fn mesh(mesh: &Mesh) -> String {
    let mut text = String::from("*NODE\n");
    for (id, [x, y, z]) in mesh.nodes.iter().zip(&mesh.xyz) {
        let _ = writeln!(text, "{id}, {x}, {y}, {z}");
    }
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mut elements = mesh.elements.iter().filter(|element| element.kind == kind).peekable();
        if elements.peek().is_some() {
            let _ = writeln!(text, "*ELEMENT, TYPE={}", kind.name());
        }
        for element in elements {
            let nodes: Vec<String> = element.nodes.iter().map(|node| mesh.nodes[*node].to_string()).collect();
            let _ = writeln!(text, "{}, {}", element.id, nodes.join(", "));
        }
    }
    for (name, nodes) in &mesh.node_sets {
        set(&mut text, &format!("*NSET, NSET={name}"), nodes.iter().map(|node| mesh.nodes[*node].0));
    }
    for (name, elements) in &mesh.element_sets {
        set(&mut text, &format!("*ELSET, ELSET={name}"), elements.iter().map(|at| mesh.elements[*at].id));
    }
    text
}

fn set(text: &mut String, card: &str, ids: impl Iterator<Item = u32>) {
    let ids: Vec<String> = ids.map(|id| id.to_string()).collect();
    let _ = writeln!(text, "{card}");
    for line in ids.chunks(IN_LINE) {
        let _ = writeln!(text, "{},", line.join(", "));
    }
}

/// Materials, and one section for each.
#[must_use]
pub fn materials(mesh: &Mesh, materials: &Materials) -> String {
    let mut text = String::new();
    for (number, material) in materials.list.iter().enumerate() {
        let _ = writeln!(text, "*MATERIAL, NAME={}", material.name);
        let _ = writeln!(text, "*ELASTIC\n{}, {}", material.young, material.poisson);
        let _ = writeln!(text, "*EXPANSION\n{:e}", material.expansion);
        let _ = writeln!(text, "*CONDUCTIVITY\n{}", material.conductivity);
        if let Some(capacity) = material.capacity {
            // Only the product counts; this density lies in the middle of what a reader takes for one.
            let density = 7e-9;
            let _ = writeln!(text, "*DENSITY\n{density:e}\n*SPECIFIC HEAT\n{:e}", capacity / density);
        }
        let mine = (materials.of_element.iter().enumerate()).filter(|(_, of)| **of == number);
        let mine: Vec<u32> = mine.map(|(at, _)| mesh.elements[at].id).collect();
        if mine.is_empty() {
            continue;
        }
        let name = format!("MADEOF{}", number + 1);
        set(&mut text, &format!("*ELSET, ELSET={name}"), mine.into_iter());
        let _ = writeln!(text, "*SOLID SECTION, ELSET={name}, MATERIAL={}", material.name);
    }
    text
}

/// Initial temperatures and the step of a load case; `print` are cards of the step that say what is to be printed.
#[must_use]
pub fn load(mesh: &Mesh, load: &LoadCase, print: &str) -> String {
    let mut text = String::from("*INITIAL CONDITIONS, TYPE=TEMPERATURE\n");
    for (node, temperature) in mesh.nodes.iter().zip(&load.initial) {
        let _ = writeln!(text, "{node}, {temperature}");
    }
    text.push_str("*STEP, INC=1000000\n");
    match load.case {
        Case::Steady => text.push_str("*HEAT TRANSFER, STEADY STATE\n"),
        Case::Transient { step, period } => {
            let _ = writeln!(text, "*HEAT TRANSFER, DIRECT\n{step}, {period}");
        }
    }
    let id = |element: usize| mesh.elements[element].id;
    if !load.held.is_empty() {
        text.push_str("*BOUNDARY\n");
    }
    for (node, temperature) in &load.held {
        let _ = writeln!(text, "{}, 11, 11, {temperature}", mesh.nodes[*node]);
    }
    if !load.films.is_empty() {
        text.push_str("*FILM\n");
    }
    for film in &load.films {
        let (id, side) = (id(film.face.element), film.face.side + 1);
        let _ = writeln!(text, "{id}, F{side}, {}, {}", film.sink, film.coefficient);
    }
    if !load.fluxes.is_empty() {
        text.push_str("*DFLUX\n");
    }
    for flux in &load.fluxes {
        let _ = match flux {
            Flux::Face(face, heat) => writeln!(text, "{}, S{}, {heat}", id(face.element), face.side + 1),
            Flux::Volume(element, heat) => writeln!(text, "{}, BF, {heat}", id(*element)),
        };
    }
    if !load.nodal.is_empty() {
        text.push_str("*CFLUX\n");
    }
    for (node, heat) in &load.nodal {
        let _ = writeln!(text, "{}, 11, {heat}", mesh.nodes[*node]);
    }
    text.push_str(print);
    text.push_str("*END STEP\n");
    text
}
