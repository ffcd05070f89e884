//! `isotherm place`: where the temperature sensors of a structure belong.

use std::collections::BTreeSet;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::{Failure, print_json};
use crate::clock::Clock;
use isotherm_placement::blocks::Cut;
use isotherm_placement::found::{Asked, Found, Study, place};
use isotherm_placement::methods::Method;
use isotherm_placement::report::{Subject, remarks, report};
use isotherm_placement::written::{Along, Rider, block, matrix};

mod plant;
mod structure;
mod told;

/// Says where the temperature sensors of a structure belong, and what they leave of its displacement.
///
/// From one heat-transfer deck (Abaqus, CalculiX) per load case over one mesh. The structure is divided into blocks with one
/// sensor each; the displacement of the guideway is P·ΔT of their temperatures. Out come the sensors' nodes, what is
/// left of each case, whether sensors or blocks limit, and with --write P and the model's block for the profile.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm place spindle.inp ambient.inp --report sensors.html\n  isotherm place spindle.inp \
                  ambient.inp --cut y=800 --cut z=0 --write column.toml\n\nWithout a mesh of your own:\n  \
                  isotherm place --example DIR\n\nUnits of the decks: mm, N, s, t, K (N/mm², mW/(mm·K))."
)]
pub(super) struct Arguments {
    /// The decks, one per load case
    #[arg(value_name = "CASE.inp", required_unless_present = "example")]
    decks: Vec<PathBuf>,
    /// Node sets whose names begin so are the blocks
    #[arg(long, value_name = "PREFIX", default_value = "BLK")]
    blocks: String,
    /// The node set of the guideway, whose displacement is compensated
    #[arg(long, value_name = "SET", default_value = "GUIDE")]
    guide: String,
    /// The node set that stands still in x, y and z
    #[arg(long, value_name = "SET", default_value = "BASE")]
    fixed: String,
    /// A plane that divides the blocks it goes through, or only the one behind the colon: `z=450`, `x=0:BLK3`; as often as
    /// needed
    #[arg(long, value_name = "PLANE")]
    cut: Vec<Cut>,
    /// The node set that sensors may sit on [default: what can be seen from outside]
    #[arg(long, value_name = "SET")]
    candidates: Option<String>,
    /// Sensors keep this far from other blocks, mm
    #[arg(long, value_name = "MM", default_value_t = 20.0, value_parser = not_negative)]
    margin: f64,
    /// The direction of the displacement that is judged; several, as in `y,z`, are judged together
    #[arg(long, value_name = "AXIS", default_value = "z", value_delimiter = ',')]
    component: Vec<AxisWord>,
    /// The direction of the guideway [default: the longest of its nodes]
    #[arg(long, value_name = "AXIS")]
    along: Option<AxisWord>,
    /// What computes temperatures, displacements and P: isotherm itself, or the program ccx
    #[arg(long, value_name = "ENGINE", default_value = "own")]
    engine: Engine,
    /// How nodes are chosen
    #[arg(long, value_name = "METHOD", default_value = "multi-case")]
    method: MethodWord,
    /// The load case that `patent` and `bounded` are placed by [default: the one that moves the guideway most]
    #[arg(long, value_name = "NAME")]
    case: Option<String>,
    /// Noise of a sensor, K
    #[arg(long, value_name = "K", default_value_t = 0.1, value_parser = not_negative)]
    noise: f64,
    /// How far sensors may sit from their places, mm
    #[arg(long, value_name = "MM", default_value_t = 20.0, value_parser = not_negative)]
    misplaced: f64,
    /// The patent's iteration ends below this, µm RMS
    #[arg(long, value_name = "UM", default_value_t = 1.0, value_parser = not_negative)]
    enough: f64,
    /// A part that rides on the guideway and grows by itself, by its sensor's signal, in µm/K: `head:z=-4.95`,
    /// `head:y=1.2/z=-4.95`; P gets a column for it
    #[arg(long, value_name = "SIGNAL:AXIS=UM")]
    rider: Vec<Rider>,
    /// Writes the model's block for a profile, and P beside it
    #[arg(long, value_name = "MODEL.toml")]
    write: Option<PathBuf>,
    /// Writes a page with pictures: one file, to be opened anywhere
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// A deck that says where heat comes in and goes out while the machine runs: its fluxes are ports, its films sinks
    #[arg(long, value_name = "PLANT.inp", requires = "modes")]
    plant: Option<PathBuf>,
    /// Writes the structure of --plant reduced to modes, for the thermal plant of a virtual machine
    #[arg(long, value_name = "MODES.json", requires = "plant")]
    modes: Option<PathBuf>,
    /// Writes a column's mesh and decks into this directory, to begin with, and does nothing else
    #[arg(long, value_name = "DIR", conflicts_with = "decks")]
    example: Option<PathBuf>,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

/// A direction.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum AxisWord {
    X,
    Y,
    Z,
}

impl AxisWord {
    fn place(self) -> usize {
        match self {
            AxisWord::X => 0,
            AxisWord::Y => 1,
            AxisWord::Z => 2,
        }
    }
}

/// What computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Engine {
    /// isotherm's own finite elements
    Own,
    /// CalculiX, the program ccx
    Ccx,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum MethodWord {
    /// all load cases together
    MultiCase,
    /// the iteration of JP 6507619 B2, on one case
    Patent,
    /// bounded least squares, on one case
    Bounded,
}

impl MethodWord {
    fn method(self) -> Method {
        match self {
            MethodWord::MultiCase => Method::MultiCase,
            MethodWord::Patent => Method::Patent,
            MethodWord::Bounded => Method::Bounded,
        }
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("write a number that is not negative, with a decimal point".to_owned()),
    }
}

/// One JSON document: what was found, and what is to be said of it.
#[derive(serde::Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    found: &'a Found,
    /// Coordinates of the guideway's nodes, mm.
    guide_xyz: Vec<[f64; 3]>,
    remarks: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(directory) = &arguments.example {
        return plant::example(directory);
    }
    let progress = progress();
    let plant = arguments.plant.as_deref().map(|path| plant::deck(path, arguments.engine)).transpose()?;
    let known = structure::known(arguments, &progress)?;
    let case = match &arguments.case {
        None => None,
        Some(name) => Some(known.loads.iter().position(|load| load.name == *name).ok_or_else(|| {
            let names: Vec<&str> = known.loads.iter().map(|load| load.name.as_str()).collect();
            anyhow::anyhow!("--case {name}: there is no such load case; there are {}", names.join(", "))
        })?),
    };
    let components: BTreeSet<usize> = arguments.component.iter().map(|word| word.place()).collect();
    let asked = Asked {
        components: components.into_iter().collect(),
        method: arguments.method.method(),
        case,
        noise: arguments.noise,
        misplaced: arguments.misplaced,
        enough: arguments.enough,
    };
    let study = Study {
        mesh: &known.first.mesh,
        guide: &known.guide,
        p: &known.p,
        adjoint: known.adjoint.as_ref(),
        parts: &known.parts,
        reach: &known.reach,
        loads: &known.loads,
    };
    let found = place(&study, &asked, &progress).map_err(|wrong| anyhow::anyhow!("{}", wrong.join("\n")))?;
    let guide_xyz: Vec<[f64; 3]> = known.guide.iter().map(|node| known.first.mesh.xyz[*node]).collect();
    let along = Along::new(&guide_xyz, arguments.along.map(AxisWord::place));
    if let Some(path) = &arguments.write {
        write(path, &found, &along, &arguments.rider)?;
    }
    if let (Some(deck), Some(path)) = (&plant, &arguments.modes) {
        plant::modes(deck, path, &known, &found, &along, &progress)?;
    }
    if let Some(path) = &arguments.report {
        let page = report(&Subject {
            mesh: &known.first.mesh,
            parts: &known.parts,
            guide: &known.guide,
            loads: &known.loads,
            found: &found,
            along: &along,
            made: Clock::wall().now(),
        });
        std::fs::write(path, page).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if arguments.json {
        return print_json(&Document { found: &found, guide_xyz, remarks: remarks(&found) });
    }
    let mut out = std::io::stdout();
    write!(out, "{}", told::told(&found, &known.parts))?;
    if let Some(path) = &arguments.write {
        writeln!(out, "the model's block is in {}, P in {}", path.display(), beside(path).display())?;
    }
    if let Some(path) = &arguments.modes {
        writeln!(out, "the modes are in {}", path.display())?;
    }
    if let Some(path) = &arguments.report {
        writeln!(out, "the report is in {}", path.display())?;
    }
    Ok(())
}

/// Where P goes.
fn beside(path: &Path) -> PathBuf {
    path.with_extension("matrix.json")
}

fn write(path: &Path, found: &Found, along: &Along, riders: &[Rider]) -> Result<(), Failure> {
    let beside = beside(path);
    let name = beside.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for (path, text) in [(path, block(found, along, riders, &name)), (&beside, matrix(found, along, riders))]
    {
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Tells what is being computed, where somebody watches.
fn progress() -> impl Fn(&str, usize, usize) {
    let shows = std::io::stderr().is_terminal();
    move |what, done, all| {
        if shows {
            let end = if done == all { "\n" } else { "" };
            eprint!("\r{what}: {done} of {all}\u{1b}[K{end}");
        }
    }
}
