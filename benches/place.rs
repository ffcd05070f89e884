//! Benchmark of sensor placement: columns of about 7,000 and 26,444 nodes, from the FE input files of six load cases to
//! the sensors.
//!
//! For comparison, it runs CalculiX on the same files. It prints elapsed time, processor time, peak memory, and for
//! each limit reached or MISSED.
//!
//! Run it with `cargo bench --bench place`. Add `-- 20` for a column with cells of 20 mm, about 200,000 nodes.

#![allow(clippy::unwrap_used, reason = "a bench that cannot go on fails")]

use std::path::Path;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;
use isotherm_placement::blocks::{Reach, parts};
use isotherm_placement::body::SILENT;
use isotherm_placement::ccx::Ccx;
use isotherm_placement::fe_input::{self, FeInput};
use isotherm_placement::heat::temperatures;
use isotherm_placement::mesh::{Kind, Mesh};
use isotherm_placement::methods::Method;
use isotherm_placement::methods::multi_case::Tolerance;
use isotherm_placement::problem::Load;
use isotherm_placement::structure::{Structure, guideway_and_temperatures};
use isotherm_placement::study::{Criteria, Study, place, rows};
use isotherm_placement::views::outside;
use isotherm_placement::write;

#[path = "../crates/placement/tests/bodies/mod.rs"]
mod bodies;

use bodies::{Column, Warming};

/// Cell sizes in mm; the second column has 26,444 nodes.
const CELLS: [f64; 2] = [80.0, 45.0];
/// Limit of elapsed time on two cores from the FE input files to the sensors. The same limit holds from one file to the
/// temperatures of its case, and to the whole matrix P. CalculiX computes one column of P.
const SECONDS: f64 = 2.0;
/// Limit as a share of the time of CalculiX for one case and one column of P. It equals [`SECONDS`] on a computer on
/// which these take 1.6 and 3.4 s.
const SHARE: f64 = 0.4;

/// Number of guideway nodes, as of two rails with fourteen nodes each.
const GUIDE: usize = 28;

fn main() {
    let more: Vec<f64> = std::env::args().filter_map(|word| word.parse().ok()).collect();
    for cell in CELLS.into_iter().chain(more.iter().copied()) {
        let home = tempfile::tempdir().unwrap();
        let seconds = own(cell, home.path());
        if !more.contains(&cell) {
            parts_alone(home.path());
            if let Some(ccx) = referee(home.path()) {
                let share = seconds / ccx;
                // The limit applies to the columns of `CELLS`.
                let verdict = match share <= SHARE {
                    _ if cell > CELLS[1] => String::new(),
                    true => format!(", at most {SHARE}: reached"),
                    false => format!(", at most {SHARE}: MISSED"),
                };
                println!("  all, beside those two      {share:7.2}{verdict}");
            }
        }
    }
}

fn inputs(home: &Path) -> Vec<FeInput> {
    let paths = Warming::EACH.map(|warming| home.join(warming.name()).with_extension("inp"));
    let inputs = fe_input::read_each(&paths, SILENT).into_iter();
    inputs.map(|input| input.unwrap_or_else(|faults| panic!("{faults}"))).collect()
}

/// Elapsed time and processor time since the begin.
struct Spent {
    clock: Clock,
    begun: Moment,
    processor: f64,
}

impl Spent {
    fn begin() -> Spent {
        let clock = Clock::wall();
        Spent { begun: clock.now(), clock, processor: processor_seconds() }
    }

    /// Prints and returns the elapsed seconds, and restarts the measurement.
    fn say(&mut self, what: &str, most: Option<f64>) -> f64 {
        let seconds = self.clock.now().since(self.begun).as_secs_f64();
        let assessed = most.map_or_else(String::new, |most| {
            format!(", at most {most} s: {}", if seconds <= most { "reached" } else { "MISSED" })
        });
        let processor = processor_seconds() - self.processor;
        println!("  {what:<26} {seconds:6.2} s ({processor:.2} s of processor time){assessed}");
        *self = Spent::begin();
        seconds
    }
}

/// Runs the project's own solver from the FE input files to the sensors. Returns the elapsed seconds.
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
    let (mut all, mut step) = (Spent::begin(), Spent::begin());
    let mut inputs = inputs(home);
    step.say("six files read", None);
    let mesh = &inputs[0].mesh;
    let fixed = &mesh.node_sets["BASE"];
    let guide = guide(mesh);
    let (adjoint, rises) = guideway_and_temperatures(&inputs, fixed, &guide, SILENT).unwrap();
    let loads = inputs.iter().zip(rises).map(|(input, rise)| {
        let rise = rise.unwrap();
        Load { name: input.name.clone(), moved_mm: adjoint.displacements(&rise), rise }
    });
    let loads: Vec<Load> = loads.collect();
    step.say("84 adjoints, six cases", None);
    let parts = parts(mesh, "BLK", &[]).unwrap();
    let columns: Vec<Vec<f64>> = parts.iter().map(|part| adjoint.block(&part.nodes)).collect();
    let p = rows(&columns);
    let reach = Reach { margin: 20.0, allowed: outside(mesh, fixed) };
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
    step.say("sensors", None);
    let seconds = all.say("all", Some(SECONDS));
    println!("  peak memory {:.0} MB", peak_megabytes());
    assert_eq!(found.cases.len(), 6);
    seconds
}

fn guide(mesh: &Mesh) -> Vec<usize> {
    mesh.node_sets["GUIDE"].iter().copied().take(GUIDE).collect()
}

/// Measures the part that CalculiX computes too. Reading is included, because CalculiX reads its own file.
fn parts_alone(home: &Path) {
    let path = home.join(Warming::EACH[0].name()).with_extension("inp");
    let read = || fe_input::read(&path).unwrap_or_else(|faults| panic!("{faults}"));
    let mut spent = Spent::begin();
    let input = read();
    temperatures(&input.mesh, &input.materials, &input.load, SILENT).unwrap();
    drop(input);
    spent.say("one steady case alone", Some(SECONDS));
    let FeInput { mesh, materials, .. } = read();
    let structure = Structure::new(&mesh, &materials, &mesh.node_sets["BASE"], SILENT).unwrap();
    let adjoint = structure.guideway(&guide(&mesh), SILENT);
    let columns: Vec<Vec<f64>> =
        parts(&mesh, "BLK", &[]).unwrap().iter().map(|part| adjoint.block(&part.nodes)).collect();
    assert_eq!(columns.len(), 8);
    spent.say("all of P alone", Some(SECONDS));
    println!("  the factor {} MB", structure.stored() * 8 / 1_000_000);
}

/// Runs CalculiX on the same files, for one steady case and one column of P. It would repeat the latter for every
/// further column. Returns the seconds of both together; `None` if CalculiX is missing.
fn referee(home: &Path) -> Option<f64> {
    let inputs = inputs(home);
    let FeInput { mesh, materials, load, .. } = &inputs[0];
    let clock = Clock::wall();
    let begun = clock.now();
    if let Err(error) = Ccx::default().temperatures(mesh, materials, load) {
        println!("  no comparison: {error}");
        return None;
    }
    let case = clock.now().since(begun).as_secs_f64();
    println!("  CalculiX, one steady case  {case:7.2} s");
    let mut unit = vec![0.0; mesh.nodes.len()];
    mesh.node_sets["BLK1"].iter().for_each(|node| unit[*node] = 1.0);
    let begun = clock.now();
    let sets = &mesh.node_sets;
    Ccx::default().displacements(mesh, materials, &sets["BASE"], &sets["GUIDE"], &[&unit]).unwrap();
    let column = clock.now().since(begun).as_secs_f64();
    println!("  CalculiX, one column of P  {column:7.2} s");
    Some(case + column)
}

/// Peak memory of this process, in MB.
fn peak_megabytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1000.0
}

/// Processor time of all threads, in seconds. It stays comparable on a busy computer.
fn processor_seconds() -> f64 {
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    // User and system time are the 14th and 15th field; the 3rd is the first after the name.
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_SECOND
}
