//! CalculiX as a second, independent solver, with which the results of isotherm are compared.
//!
//! The module writes FE input files into a scratch directory, runs `ccx`, and reads the printed results. CalculiX
//! prints only seven digits, which limits the accuracy of this comparison.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::body::{LoadCase, Materials};
use crate::mesh::{Mesh, NodeId};
use crate::write;

/// Error of a CalculiX run.
#[derive(Debug, thiserror::Error)]
pub enum CcxError {
    /// The program cannot be started.
    #[error(
        "cannot start {program}: {error}; install CalculiX (Debian and Ubuntu: calculix-ccx) or leave out --engine ccx"
    )]
    Start {
        /// Name or path of the program.
        program: String,
        /// Error of the operating system.
        error: std::io::Error,
    },
    /// A file cannot be written or read.
    #[error("{}: {error}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        error: std::io::Error,
    },
    /// CalculiX ended with an error; contains lines of its output.
    #[error("CalculiX did not finish: {0}")]
    Unfinished(String),
    /// The results lack a requested quantity; contains the name of this quantity.
    #[error("CalculiX finished, but its results lack {0}")]
    Lacks(String),
}

/// The program CalculiX, which computes temperatures and displacements.
#[derive(Debug, Clone)]
pub struct Ccx {
    /// Path of the program, or its name if it is on the search path.
    pub program: String,
}

/// Name of the set of all nodes. User files do not contain this name.
const ALL: &str = "ISOTHERMALL";
/// Name of the set of the guideway nodes. User files do not contain this name.
const GUIDE: &str = "ISOTHERMGUIDE";

impl Default for Ccx {
    fn default() -> Self {
        Self { program: "ccx".to_owned() }
    }
}

impl Ccx {
    /// Computes the temperature rise of every node at the end of the load case, K, relative to its initial temperature.
    ///
    /// # Errors
    /// CalculiX is missing or failed.
    pub fn temperatures(
        &self,
        mesh: &Mesh,
        materials: &Materials,
        load: &LoadCase,
    ) -> Result<Vec<f64>, CcxError> {
        let mut input = write::mesh(mesh);
        write::nodes(&mut input, ALL, mesh, 0..mesh.nodes.len());
        input.push_str(&write::materials(mesh, materials));
        let print = format!("*NODE PRINT, NSET={ALL}, FREQUENCY=1000000\nNT\n");
        input.push_str(&write::load(mesh, load, &print));
        let blocks = self.run(&input, mesh, 1)?;
        let last = blocks.last().ok_or_else(|| CcxError::Lacks("the temperatures".to_owned()))?;
        let rises: Option<Vec<f64>> =
            last.iter().zip(&load.initial).map(|(values, initial)| Some(values.first()? - initial)).collect();
        rises.ok_or_else(|| CcxError::Lacks("the temperature of a node".to_owned()))
    }

    /// Computes the displacements of the guideway nodes, mm. Each field in `rises` contains the temperature rise of
    /// every node, K. The result has one list for each field: x, y and z of each guideway node. If a field is 1 in one
    /// block and 0 elsewhere, the list is a column of the matrix P (displacements per kelvin of each block).
    ///
    /// # Errors
    /// CalculiX is missing or failed.
    pub fn displacements(
        &self,
        mesh: &Mesh,
        materials: &Materials,
        fixed: &[usize],
        guide: &[usize],
        rises: &[&[f64]],
    ) -> Result<Vec<Vec<f64>>, CcxError> {
        let mut input = write::mesh(mesh);
        write::nodes(&mut input, GUIDE, mesh, guide.iter().copied());
        input.push_str(&write::materials(mesh, materials));
        input.push_str("*INITIAL CONDITIONS, TYPE=TEMPERATURE\n");
        mesh.nodes.iter().for_each(|node| input.push_str(&format!("{node}, 0\n")));
        input.push_str("*BOUNDARY\n");
        fixed.iter().for_each(|node| input.push_str(&format!("{}, 1, 3\n", mesh.nodes[*node])));
        for rises in rises {
            input.push_str("*STEP\n*STATIC\n*TEMPERATURE\n");
            for (node, rise) in mesh.nodes.iter().zip(*rises) {
                input.push_str(&format!("{node}, {}\n", write::number(*rise)));
            }
            input.push_str(&format!("*NODE PRINT, NSET={GUIDE}\nU\n*END STEP\n"));
        }
        let blocks = self.run(&input, mesh, 3)?;
        if blocks.len() != rises.len() {
            return Err(CcxError::Lacks(format!("{} of {} cases", rises.len() - blocks.len(), rises.len())));
        }
        let lacks = || CcxError::Lacks("the displacement of a guideway node".to_owned());
        let column = |block: &Vec<Vec<f64>>| {
            let each = guide.iter().map(|node| (block[*node].len() == 3).then_some(&block[*node][..]));
            each.collect::<Option<Vec<&[f64]>>>().map(|each| each.concat())
        };
        blocks.iter().map(|block| column(block).ok_or_else(lacks)).collect()
    }

    /// Runs CalculiX on the text of an FE input file. Returns one list for each printed table. This list contains for
    /// each node of the mesh its `width` values, or an empty list if the table does not contain the node.
    fn run(&self, input: &str, mesh: &Mesh, width: usize) -> Result<Vec<Vec<Vec<f64>>>, CcxError> {
        let directory = ScratchDirectory::new()?;
        let path = directory.0.join("case.inp");
        std::fs::write(&path, input).map_err(|error| CcxError::File { path, error })?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let done = Command::new(&self.program)
            .args(["-i", "case"])
            .current_dir(&directory.0)
            .env("OMP_NUM_THREADS", threads.to_string())
            .stdin(Stdio::null())
            .output()
            .map_err(|error| CcxError::Start { program: self.program.clone(), error })?;
        let said = String::from_utf8_lossy(&done.stdout);
        let wrong = said.lines().position(|line| line.contains("*ERROR"));
        if wrong.is_some() || !done.status.success() || !said.contains("Job finished") {
            let lines: Vec<&str> = match wrong {
                Some(at) => said.lines().skip(at).take(3).collect(),
                None => said.lines().filter(|line| !line.trim().is_empty()).collect(),
            };
            let last: Vec<&str> = lines.iter().rev().take(3).rev().map(|line| line.trim()).collect();
            return Err(CcxError::Unfinished(last.join(" ")));
        }
        let path = directory.0.join("case.dat");
        let printed = std::fs::read_to_string(&path).map_err(|error| CcxError::File { path, error })?;
        Ok(blocks(&printed, mesh, width))
    }
}

/// Parses the printed tables of values. Each table begins with a heading. Each further line of the table contains the
/// number of a node and its values.
fn blocks(printed: &str, mesh: &Mesh, width: usize) -> Vec<Vec<Vec<f64>>> {
    let mut blocks: Vec<Vec<Vec<f64>>> = Vec::new();
    for line in printed.lines().filter(|line| !line.trim().is_empty()) {
        let mut fields = line.split_whitespace();
        let node = fields.next().and_then(|field| field.parse::<u32>().ok());
        let Some(node) = node else {
            blocks.push(vec![Vec::new(); mesh.nodes.len()]);
            continue;
        };
        let values: Vec<f64> = fields.filter_map(|field| field.parse().ok()).collect();
        let place = mesh.place(NodeId(node));
        if let (Some(block), Some(place)) = (blocks.last_mut(), place.filter(|_| values.len() == width)) {
            block[place] = values;
        }
    }
    blocks
}

/// Directory for the files of one CalculiX run. It is deleted when this value is dropped.
struct ScratchDirectory(PathBuf);

static MADE: AtomicUsize = AtomicUsize::new(0);

impl ScratchDirectory {
    fn new() -> Result<Self, CcxError> {
        let number = MADE.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("isotherm-place-{}-{number}", std::process::id()));
        std::fs::create_dir(&path).map_err(|error| CcxError::File { path: path.clone(), error })?;
        Ok(Self(path))
    }
}

impl Drop for ScratchDirectory {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
