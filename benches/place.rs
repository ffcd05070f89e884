//! What placing costs: columns of about 7,000 and 24,000 nodes, from the FE input files of six load cases to the sensors; beside
//! it CalculiX on the same files. Prints seconds and the peak of the memory, and fails beyond 2 s and 10 s.
//!
//! `cargo bench --bench place`; add `-- 20` for a column of cells of 20 mm (about 200,000 nodes) as well.

#![allow(clippy::unwrap_used, reason = "a bench that cannot go on fails")]

use std::path::Path;

use isotherm::clock::Clock;
use isotherm_placement::blocks::{Reach, parts};
use isotherm_placement::body::SILENT;
use isotherm_placement::ccx::Ccx;
use isotherm_placement::fe_input::{self, FeInput};
use isotherm_placement::heat::temperatures;
use isotherm_placement::mesh::Kind;
use isotherm_placement::methods::Method;
use isotherm_placement::methods::multi_case::Tolerance;
use isotherm_placement::problem::Load;
use isotherm_placement::structure::Structure;
use isotherm_placement::study::{Criteria, Study, place, rows};
use isotherm_placement::views::outside;
use isotherm_placement::write;

#[path = "../crates/placement/tests/bodies/mod.rs"]
mod bodies;

use bodies::{Column, Warming};

/// Cells in mm, and the seconds from the FE input files to the sensors.
const COLUMNS: [(f64, f64); 2] = [(80.0, 2.0), (45.0, 10.0)];

/// As many guideway nodes as two rails of fourteen.
const GUIDE: usize = 28;

fn main() {
    let more: Vec<(f64, f64)> =
        std::env::args().filter_map(|word| word.parse().ok()).map(|cell| (cell, f64::INFINITY)).collect();
    let mut slow = Vec::new();
    for (cell, most) in COLUMNS.into_iter().chain(more) {
        let home = tempfile::tempdir().unwrap();
        let seconds = own(cell, home.path());
        if seconds > most {
            slow.push(format!("{cell} mm: {seconds:.1} s of {most} s"));
        }
        if most.is_finite() {
            referee(home.path());
        }
    }
    assert!(slow.is_empty(), "too slow: {}", slow.join(", "));
}

fn inputs(home: &Path) -> Vec<FeInput> {
    let read = |warming: Warming| fe_input::read(&home.join(warming.name()).with_extension("inp"));
    Warming::EACH.map(|warming| read(warming).unwrap_or_else(|faults| panic!("{faults}"))).into()
}

/// With the own elements, from the FE input files to the sensors: the seconds.
fn own(cell: f64, home: &Path) -> f64 {
    let column = Column::new(cell, Kind::Tet10);
    let structure = write::mesh(&column.mesh) + &write::materials(&column.mesh, &column.materials);
    std::fs::write(home.join("structure.inc"), structure).unwrap();
    for warming in Warming::EACH {
        let load = write::load(&column.mesh, &column.load(warming), "");
        let text = format!("*INCLUDE, INPUT=structure.inc\n{load}");
        std::fs::write(home.join(warming.name()).with_extension("inp"), text).unwrap();
    }
    println!("{} nodes, {} elements", column.mesh.nodes.len(), column.mesh.elements.len());
    drop(column);
    let clock = Clock::wall();
    let begun = clock.now();
    let processor = processor_seconds();
    let mut before = begun;
    let mut took = |what: &str| {
        let now = clock.now();
        println!("  {what:<22} {:7.2} s", now.since(before).as_secs_f64());
        before = now;
    };
    let mut inputs = inputs(home);
    took("six files read");
    let FeInput { mesh, materials, .. } = &inputs[0];
    let fixed = &mesh.node_sets["BASE"];
    let guide = &mesh.node_sets["GUIDE"];
    let guide = &guide[..guide.len().min(GUIDE)];
    let structure = Structure::new(mesh, materials, fixed, SILENT).unwrap();
    took("stiffness factored");
    let adjoint = structure.guideway(guide, SILENT);
    took("84 adjoints");
    let loads: Vec<Load> = (inputs.iter())
        .map(|input| {
            let rise = temperatures(&input.mesh, &input.materials, &input.load, SILENT).unwrap();
            Load { name: input.name.clone(), moved_mm: adjoint.displacements(&rise), rise }
        })
        .collect();
    took("six load cases");
    let parts = parts(mesh, "BLK", &[]).unwrap();
    let columns: Vec<Vec<f64>> = parts.iter().map(|part| adjoint.block(&part.nodes)).collect();
    let p = rows(&columns);
    let reach = Reach { margin: 20.0, allowed: outside(mesh, fixed) };
    let (guide, stored) = (guide.to_vec(), structure.stored());
    let mesh = inputs.swap_remove(0).mesh;
    let study = Study { mesh, guide, p, adjoint: Some(adjoint), parts, reach, loads };
    let criteria = Criteria {
        components: vec![2],
        method: Method::MultiCase,
        case: None,
        tolerance: Tolerance { noise: 0.1, enough: 1.0 },
        misplaced: 20.0,
    };
    let found = place(&study, &criteria, SILENT).unwrap();
    took("sensors");
    let seconds = clock.now().since(begun).as_secs_f64();
    println!(
        "  all                    {seconds:7.2} s ({:.2} s of processor time), the factor {} MB, peak memory {:.0} MB",
        processor_seconds() - processor,
        stored * 8 / 1_000_000,
        peak_megabytes()
    );
    assert_eq!(found.cases.len(), 6);
    seconds
}

/// CalculiX on the same files: one steady case and one column of P, which it repeats for every further one.
fn referee(home: &Path) {
    let inputs = inputs(home);
    let FeInput { mesh, materials, load, .. } = &inputs[0];
    let clock = Clock::wall();
    let begun = clock.now();
    if let Err(error) = Ccx::default().temperatures(mesh, materials, load) {
        println!("  no comparison: {error}");
        return;
    }
    println!("  CalculiX, one steady case  {:7.2} s", clock.now().since(begun).as_secs_f64());
    let mut unit = vec![0.0; mesh.nodes.len()];
    mesh.node_sets["BLK1"].iter().for_each(|node| unit[*node] = 1.0);
    let begun = clock.now();
    let sets = &mesh.node_sets;
    Ccx::default().displacements(mesh, materials, &sets["BASE"], &sets["GUIDE"], &[&unit]).unwrap();
    println!("  CalculiX, one column of P  {:7.2} s", clock.now().since(begun).as_secs_f64());
}

/// The most memory that this process ever had.
fn peak_megabytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1000.0
}

/// Over all threads: what remains comparable on a busy computer.
fn processor_seconds() -> f64 {
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    // User and system time are the 14th and 15th field; the 3rd is the first after the name.
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_SECOND
}
