//! `isotherm place`: finds places for the temperature sensors of a structure.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::extra_files::ExtraFiles;
use super::print::print_json;
use super::progress::Progress;
use super::values;
use crate::cli::print::say_all;
use crate::clock::Clock;
use isotherm_placement::blocks::Cut;
use isotherm_placement::export::{Rider, block, matrix};
use isotherm_placement::guide_line::GuideLine;
use isotherm_placement::methods::Method;
use isotherm_placement::methods::multi_case::Tolerance;
use isotherm_placement::report::report;
use isotherm_placement::study::{Criteria, place};

mod plant;
mod structure;
mod text;

use text::Text;

/// Finds places for the temperature sensors of a structure, and calculates the residual error of its displacement with
/// these sensors.
///
/// The input is one heat-transfer FE input file (Abaqus, CalculiX) for each load case, all with one mesh. The structure
/// is divided into blocks with one sensor each. The matrix P gives the displacement of the guideway, P·ΔT, from the
/// temperature rises of the blocks. The output lists the nodes of the sensors and the residual error of each case. It
/// also says whether sensors or blocks limit the result. With --write it also contains P and the model's block for the
/// profile.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm place spindle.inp ambient.inp --report sensors.html\n  isotherm place spindle.inp \
                  ambient.inp --cut y=800 --cut z=0 --write column.toml\n\nWithout a mesh of your own:\n  \
                  isotherm place --example DIR\n\nUnits of the files: mm, N, s, t, K (N/mm², mW/(mm·K))."
)]
pub(super) struct Arguments {
    /// The FE input files, one for each load case
    #[arg(value_name = "CASE.inp", required_unless_present = "example")]
    inputs: Vec<PathBuf>,
    /// Prefix of the names of the node sets that are the blocks
    #[arg(long, value_name = "PREFIX", default_value = "BLK")]
    blocks: String,
    /// The node set of the guideway with the displacement to compensate
    #[arg(long, value_name = "SET", default_value = "GUIDE")]
    guide: String,
    /// The node set that is fixed in x, y and z [default: the supports of the files (*BOUNDARY); without any, BASE]
    #[arg(long, value_name = "SET")]
    fixed: Option<String>,
    /// A plane that divides all blocks that it crosses, or only the block after the colon: `z=450`, `x=0:BLK3`; may be
    /// repeated
    #[arg(long, value_name = "PLANE")]
    cut: Vec<Cut>,
    /// The node set of the possible sensor places [default: the outer surface]
    #[arg(long, value_name = "SET")]
    candidates: Option<String>,
    /// Minimum distance of sensors from other blocks, mm
    #[arg(long, value_name = "MM", default_value_t = 20.0, value_parser = not_negative)]
    margin: f64,
    /// The direction of displacement whose error is judged; several, such as `y,z`, are judged together
    #[arg(long, value_name = "AXIS", default_value = "z", value_delimiter = ',')]
    component: Vec<AxisWord>,
    /// The direction of the guideway [default: the direction in which the guideway is longest]
    #[arg(long, value_name = "AXIS")]
    along: Option<AxisWord>,
    /// Program that calculates temperatures, displacements and the matrix P: isotherm itself, or ccx
    #[arg(long, value_name = "ENGINE", default_value = "own")]
    engine: Engine,
    /// Method that selects the nodes of the sensors
    #[arg(long, value_name = "METHOD", default_value = "multi-case")]
    method: MethodWord,
    /// With --method patent or bounded: the load case for which the places are selected [default: the load case with
    /// the largest displacement of the guideway]
    #[arg(long, value_name = "NAME")]
    case: Option<String>,
    /// Noise of a sensor, K
    #[arg(long, value_name = "K", default_value_t = 0.1, value_parser = not_negative)]
    noise: f64,
    /// Largest distance of a mounted sensor from its intended place, mm
    #[arg(long, value_name = "MM", default_value_t = 20.0, value_parser = not_negative)]
    misplaced: f64,
    /// With --method patent: the iteration ends when the residual error is below this value, µm RMS
    #[arg(long, value_name = "UM", default_value_t = 1.0, value_parser = not_negative)]
    enough: f64,
    /// A part that moves on the guideway and has its own thermal expansion. The value is the signal of its
    /// sensor with the expansion in µm/K: `head:z=-4.95`, `head:y=1.2/z=-4.95`. The matrix P gets one more
    /// column for this part
    #[arg(long, value_name = "SIGNAL:AXIS=UM")]
    rider: Vec<Rider>,
    /// Writes the model's block for a profile to this file, and the matrix P to the same directory
    #[arg(long, value_name = "MODEL.toml")]
    write: Option<PathBuf>,
    /// Writes a page with diagrams as one file, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// An FE input file with the heat sources and sinks of the running machine. Each flux becomes a heat input of the
    /// virtual plant, and each film (convection) a heat sink
    #[arg(long, value_name = "PLANT.inp", requires = "modes")]
    plant: Option<PathBuf>,
    /// Writes the structure of --plant as thermal modes, for the plant of a virtual machine
    #[arg(long, value_name = "MODES.json", requires = "plant")]
    modes: Option<PathBuf>,
    /// Writes mesh and load cases of an example column into this directory, and does nothing else
    #[arg(long, value_name = "DIR", conflicts_with = "inputs")]
    example: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// Coordinate axis in the values of `--component` and `--along`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum AxisWord {
    X,
    Y,
    Z,
}

/// Value of `--engine`: the program that calculates temperatures, displacements and the matrix P.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Engine {
    /// isotherm's own finite elements
    Own,
    /// CalculiX, the program ccx
    Ccx,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum MethodWord {
    /// for all load cases together
    MultiCase,
    /// for one load case, by the iteration of JP 6507619 B2
    Patent,
    /// for one load case, by bounded least squares
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
    values::number(text, |value| value >= 0.0, "write a number that is not negative, with a decimal point")
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(directory) = &arguments.example {
        return plant::write_example(directory);
    }
    let shown = Progress::begin("reading");
    let progress = |what: &str, done, all| shown.note(what, done, all);
    let plant = arguments.plant.as_deref().map(|path| plant::read(path, arguments.engine)).transpose()?;
    let (study, fixed) = structure::study(arguments, plant.as_ref(), &progress)?;
    let case = arguments.case.as_ref().map(|name| {
        study.loads.iter().position(|load| load.name == *name).ok_or_else(|| {
            let names: Vec<&str> = study.loads.iter().map(|load| load.name.as_str()).collect();
            anyhow::anyhow!("--case {name}: there is no such load case; there are {}", names.join(", "))
        })
    });
    let components: BTreeSet<usize> = arguments.component.iter().map(|axis| *axis as usize).collect();
    let criteria = Criteria {
        components: components.into_iter().collect(),
        method: arguments.method.method(),
        case: case.transpose()?,
        tolerance: Tolerance { noise: arguments.noise, enough: arguments.enough },
        misplaced: arguments.misplaced,
    };
    let mut placement =
        place(&study, &criteria, &progress).map_err(|wrong| anyhow::anyhow!("{}", wrong.join("\n")))?;
    placement.remarks.push(fixed);
    let line = GuideLine::new(&placement.guide_xyz, arguments.along.map(|axis| axis as usize));
    let mut files = ExtraFiles::default();
    if let Some(path) = &arguments.write {
        let beside = path.with_extension("matrix.json");
        let name = beside.file_name().unwrap_or_default().to_string_lossy();
        files.write("the model's block", path, block(&placement, &line, &arguments.rider, &name));
        files.write("P", &beside, matrix(&placement, &line, &arguments.rider));
    }
    if let (Some(plant), Some(path), Some(adjoint)) = (&plant, &arguments.modes, &study.adjoint) {
        files.write(
            "the structure as thermal modes",
            path,
            plant::modes(plant, adjoint, &placement, &line, &progress)?,
        );
    }
    if let Some(path) = &arguments.report {
        files.write("the report", path, report(&study, &placement, &line, Clock::wall().time_of_day()));
    }
    drop(shown);
    match arguments.json {
        true => print_json(&placement)?,
        false => say_all!("{}", Text(&placement, &study.parts))?,
    }
    files.end(arguments.json)
}
