//! Worked example: the column of a horizontal machining centre as FE input files. The shipped machine `column-hmc` is
//! made from these files.
//!
//! Axes of the machine: x to the right, y up from the foot, z away from the workpiece. The spindle head moves
//! vertically on two rails at the front, which is at negative z. The column is of cast iron, 700 mm wide, 1600 mm high
//! and 560 mm deep. Its walls are 40 mm thick. It has a floor at half height with a hole, and an opening in the back
//! wall.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use crate::grid::Grid;
use crate::mesh::{Kind, Mesh, count};
use crate::write::{coordinates, element, set};

/// Boundaries of the grid cells along each axis, mm.
const LINES: [&[f64]; 3] = [
    &[-350.0, -310.0, -260.0, -200.0, -100.0, 0.0, 100.0, 200.0, 260.0, 310.0, 350.0],
    &[
        0.0, 40.0, 160.0, 280.0, 400.0, 520.0, 640.0, 760.0, 800.0, 920.0, 1040.0, 1160.0, 1280.0, 1400.0,
        1560.0, 1600.0,
    ],
    &[-320.0, -280.0, -240.0, -120.0, 0.0, 120.0, 240.0, 280.0],
];

/// Heights of the horizontal planes between the blocks, mm. A vertical plane at z = 0 divides the blocks in depth.
const STOREYS: [f64; 3] = [400.0, 800.0, 1200.0];

/// Heights of the boundaries between the heated patches of the rails, mm.
const PATCHES: [f64; 6] = [160.0, 400.0, 640.0, 920.0, 1160.0, 1400.0];

/// Load case: name, description, data line of the step, air temperatures, and heat flows through surfaces in mW/mm².
type Case = (&'static str, &'static str, &'static str, Air, &'static [(&'static str, f64)]);

const CASES: [Case; 11] = [
    ("head_hour", "The head has worked in the middle of its travel for an hour", HOUR, STILL, &MIDDLE),
    ("head_low", "The head has worked in the lower half of its travel for four hours", FOUR, STILL, &LOW),
    ("head_high", "The head has worked in the upper half of its travel for four hours", FOUR, STILL, &HIGH),
    (
        "head_day",
        "The head works over its whole travel until the temperatures no longer change",
        STEADY,
        Air { covers: 22.0, ..STILL },
        &ALL,
    ),
    ("motor", "The motor on the top is warm", STEADY, Air { high: 20.5, ..STILL }, &[("MOTOR_FOOT", 0.8)]),
    (
        "cabinet",
        "The control cabinet hangs on the back and is warm",
        STEADY,
        STILL,
        &[("CABINET_WALL", 0.15)],
    ),
    ("room", "The room has been three kelvin warmer for three hours", THREE, ROOM, &[]),
    ("layers", "The air is warmer at the top than at the foot", STEADY, LAYERS, &[]),
    (
        "covers",
        "The air behind the covers has been warm for two hours",
        TWO,
        Air { covers: 25.0, ..STILL },
        &[],
    ),
    ("bed", "The bed is two kelvin warmer", STEADY, Air { foot: 22.0, ..STILL }, &[]),
    ("shift", "All these heat sources together for three hours", THREE, SHIFT, &SHIFTS),
];

const HOUR: &str = ", DIRECT\n300, 3600";
const TWO: &str = ", DIRECT\n600, 7200";
const THREE: &str = ", DIRECT\n600, 10800";
const FOUR: &str = ", DIRECT\n600, 14400";
const STEADY: &str = ", STEADY STATE";

const MIDDLE: [(&str, f64); 3] = [("RAILS_2", 0.9), ("RAILS_3", 1.2), ("RAILS_4", 0.9)];
const LOW: [(&str, f64); 3] = [("RAILS_1", 0.6), ("RAILS_2", 1.2), ("RAILS_3", 0.6)];
const HIGH: [(&str, f64); 3] = [("RAILS_3", 0.6), ("RAILS_4", 1.2), ("RAILS_5", 0.6)];
const ALL: [(&str, f64); 5] =
    [("RAILS_1", 0.2), ("RAILS_2", 0.6), ("RAILS_3", 0.8), ("RAILS_4", 0.6), ("RAILS_5", 0.2)];
const SHIFTS: [(&str, f64); 7] = [
    ("RAILS_1", 0.3),
    ("RAILS_2", 0.8),
    ("RAILS_3", 1.1),
    ("RAILS_4", 0.8),
    ("RAILS_5", 0.3),
    ("MOTOR_FOOT", 0.8),
    ("CABINET_WALL", 0.15),
];

/// Temperatures around the column, °C: air at the lower and at the upper half, behind the covers and inside, and the
/// bed at the foot.
#[derive(Clone, Copy)]
struct Air {
    low: f64,
    high: f64,
    covers: f64,
    inside: f64,
    foot: f64,
}

const STILL: Air = Air { low: 20.0, high: 20.0, covers: 20.0, inside: 20.0, foot: 20.0 };
const ROOM: Air = Air { low: 23.0, high: 23.0, covers: 23.0, inside: 21.0, foot: 20.5 };
const LAYERS: Air = Air { low: 20.0, high: 23.0, covers: 21.0, inside: 21.0, foot: 20.0 };
const SHIFT: Air = Air { low: 21.0, high: 22.0, covers: 23.0, inside: 21.0, foot: 20.5 };

/// Film coefficients in the load cases, mW/(mm²·K): outside at the lower and at the upper half, behind the covers,
/// inside, and at the joint with the bed.
const FILMS: [f64; 5] = [0.008, 0.008, 0.004, 0.003, 0.1];
/// Film coefficients of the simulated machine, mW/(mm²·K), in the order of [`FILMS`]. The values differ from
/// [`FILMS`], because the coefficients of a real machine are not known exactly.
const REAL: [f64; 5] = [0.009, 0.007, 0.005, 0.002, 0.07];

/// Returns names and texts of the files: `mesh.inp`, the common part `column.inp`, one file for each load case, and
/// `plant.inp`. The last file describes where heat enters and leaves the running machine.
#[must_use]
pub fn files() -> Vec<(String, String)> {
    let mut files = vec![("mesh.inp".to_owned(), mesh_file()), ("column.inp".to_owned(), COMMON.to_owned())];
    let cases =
        CASES.iter().map(|(name, what, step, air, heat)| (*name, step_file(what, step, *air, FILMS, heat)));
    let what = "This file is not a load case. It defines the surfaces through which heat enters and leaves while the \
                machine runs";
    let plant = ("plant", step_file(what, HOUR, STILL, REAL, &SHIFTS.map(|(heated, _)| (heated, 1.0))));
    files.extend(cases.chain([plant]).map(|(name, text)| (format!("{name}.inp"), text)));
    files
}

/// Returns the names of the load cases.
pub fn cases() -> impl Iterator<Item = &'static str> {
    CASES.iter().map(|(name, ..)| *name)
}

const COMMON: &str =
    "** Cast iron, and the temperature of the cold machine. Every FE input file includes this file.
*INCLUDE, INPUT=mesh.inp
*MATERIAL, NAME=CASTIRON
*ELASTIC
110000, 0.26
*EXPANSION, ZERO=20
1.1e-05
*CONDUCTIVITY
50
*DENSITY
7.25e-09
*SPECIFIC HEAT
5e+08
*SOLID SECTION, ELSET=COLUMN, MATERIAL=CASTIRON
*INITIAL CONDITIONS, TYPE=TEMPERATURE
COLUMN, 20
";

fn step_file(what: &str, step: &str, air: Air, films: [f64; 5], fluxes: &[(&str, f64)]) -> String {
    let mut text = format!("** {what}.\n*INCLUDE, INPUT=column.inp\n*STEP\n*HEAT TRANSFER{step}\n*FILM\n");
    let names = ["AIR_LOW", "AIR_HIGH", "COVERS", "INSIDE", "FOOT"];
    let sinks = [air.low, air.high, air.covers, air.inside, air.foot];
    for ((name, sink), film) in names.into_iter().zip(sinks).zip(films) {
        let _ = writeln!(text, "{name}, F, {sink}, {film}");
    }
    text.push_str(if fluxes.is_empty() { "" } else { "*DFLUX\n" });
    for (name, heat) in fluxes {
        let _ = writeln!(text, "{name}, S, {heat}");
    }
    text + "*END STEP\n"
}

fn mesh() -> Mesh {
    let cells = LINES.map(|lines| lines.len() - 1);
    // The grid counts cells; `along` converts the numbers to positions.
    let grid = Grid { cells, size: cells.map(count), origin: [0.0; 3] };
    grid.mesh(
        Kind::Tet10,
        |cell| iron([0, 1, 2].map(|axis| along(axis, cell[axis]))),
        |corner| [0, 1, 2].map(|axis| along(axis, corner[axis])),
    )
}

/// Returns the position of the grid boundary with the number `counted`, mm. A number such as 1.5 is the middle between
/// the boundaries 1 and 2.
fn along(axis: usize, counted: f64) -> f64 {
    let lines = LINES[axis];
    let at = |share: f64| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "cells along an edge")]
        let line = share as usize;
        lines[line.min(lines.len() - 1)]
    };
    f64::midpoint(at(counted.floor()), at(counted.ceil()))
}

fn iron([x, y, z]: [f64; 3]) -> bool {
    if z < -280.0 {
        return on_rail(x) && (160.0..1560.0).contains(&y);
    }
    let shell = x.abs() > 310.0 || z.abs() > 240.0 || !(40.0..1560.0).contains(&y);
    let floor = (760.0..800.0).contains(&y) && (x.abs() > 100.0 || z.abs() > 120.0);
    let opening = z > 240.0 && x.abs() < 100.0 && (160.0..400.0).contains(&y);
    (shell || floor) && !opening
}

fn on_rail(x: f64) -> bool {
    (200.0..=260.0).contains(&x.abs())
}

/// Returns the text of the mesh file: nodes, elements, the outer surface as flat elements, and the sets of blocks,
/// guideway, foot and surfaces.
fn mesh_file() -> String {
    let mesh = &mesh();
    let mut text = "** The column's mesh: quadratic tetrahedra, its skin as flat elements; mm.\n".to_owned();
    text.push_str(&coordinates(mesh));
    text.push_str("*ELEMENT, TYPE=C3D10, ELSET=COLUMN\n");
    mesh.elements.iter().for_each(|each| element(&mut text, each.id, &each.nodes, mesh));
    let first = u32::try_from(mesh.elements.len() + 1).unwrap_or(u32::MAX);
    let skin: Vec<Vec<usize>> =
        mesh.outer_faces().into_iter().map(|face| mesh.face_nodes(face).collect()).collect();
    text.push_str("*ELEMENT, TYPE=CPS6, ELSET=SKIN\n");
    (first..).zip(&skin).for_each(|(id, nodes)| element(&mut text, id, nodes, mesh));
    let middle = |nodes: &Vec<usize>| {
        [0, 1, 2].map(|axis| nodes[..3].iter().map(|node| mesh.xyz[*node][axis]).sum::<f64>() / 3.0)
    };
    let names: Vec<Vec<String>> = skin.iter().map(middle).map(surfaces).collect();
    for name in names.iter().flatten().collect::<BTreeSet<_>>() {
        let on = (first..).zip(&names).filter(|(_, names)| names.contains(name)).map(|(id, _)| id);
        set(&mut text, &format!("*ELSET, ELSET={name}"), on);
    }
    let each = |kept: &dyn Fn([f64; 3]) -> bool| {
        let kept = mesh.nodes.iter().zip(&mesh.xyz).filter(|(_, xyz)| kept(**xyz));
        kept.map(|(id, _)| id.0).collect::<Vec<_>>().into_iter()
    };
    let _ = writeln!(text, "*NSET, NSET=COLUMN, GENERATE\n1, {}, 1", mesh.nodes.len());
    set(&mut text, "*NSET, NSET=BASE", each(&|[_, y, _]| y < 1.0));
    let touched = |free: bool| {
        let faces = skin.iter().zip(&names);
        let mine = faces.filter(move |(_, names)| free != names.iter().any(|name| is_covered(name)));
        mine.flat_map(|(nodes, _)| nodes.iter().copied()).collect::<BTreeSet<usize>>()
    };
    let reached: BTreeSet<usize> = touched(true).difference(&touched(false)).copied().collect();
    set(&mut text, "*NSET, NSET=REACHED", reached.into_iter().map(|node| mesh.nodes[node].0));
    set(
        &mut text,
        "*NSET, NSET=GUIDE",
        each(&|[x, y, z]| {
            let corner = LINES[1].iter().any(|line| (y - line).abs() < 1.0);
            z < -319.0 && (x.abs() - 200.0).abs() < 1.0 && corner && (280.0..=1400.0).contains(&y)
        }),
    );
    for (side, front) in [("FRONT", true), ("BACK", false)] {
        for storey in 0..=STOREYS.len() {
            let own = |[_, y, z]: [f64; 3]| {
                (z < 0.0) == front && STOREYS.iter().filter(|plane| y >= **plane).count() == storey
            };
            set(&mut text, &format!("*NSET, NSET=COLUMN_{side}_{}", storey + 1), each(&own));
        }
    }
    text
}

/// Returns whether no sensor can be mounted on this surface. The surface is then inside the column, or
/// another component is mounted or slides on it.
fn is_covered(surface: &str) -> bool {
    ["FOOT", "INSIDE", "MOTOR_FOOT", "CABINET_WALL"].contains(&surface) || surface.starts_with("RAILS_")
}

/// Returns the names of the surfaces to which a face with this centre belongs.
fn surfaces([x, y, z]: [f64; 3]) -> Vec<String> {
    let flows = if y < 1.0 {
        "FOOT"
    } else if z < -279.0 {
        "COVERS"
    } else if x.abs() > 349.0 || z > 279.0 || y > 1599.0 {
        if y < STOREYS[1] { "AIR_LOW" } else { "AIR_HIGH" }
    } else {
        "INSIDE"
    };
    let mut names = vec![flows.to_owned()];
    if z < -319.0 {
        let patch = PATCHES.windows(2).position(|edges| (edges[0]..edges[1]).contains(&y));
        names.extend(patch.map(|patch| format!("RAILS_{}", patch + 1)));
    }
    if y > 1599.0 && x.abs() < 100.0 && z.abs() < 120.0 {
        names.push("MOTOR_FOOT".to_owned());
    }
    if z > 279.0 && x.abs() < 200.0 && (520.0..1040.0).contains(&y) {
        names.push("CABINET_WALL".to_owned());
    }
    names
}
