//! Recognition of files that are not FE input files: other mesh formats, results and archives. The error message
//! contains the command that converts such a file.

use std::iter;
use std::path::{Path, PathBuf};

/// Way to convert a file of another format to an FE input file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Remedy {
    /// Gmsh converts the mesh: it reads the file, and writes an FE input file.
    Gmsh,
    /// The file contains only geometry, which Gmsh divides into a mesh.
    GmshMeshes,
    /// The command `meshio convert` converts the file; contains the input format for the command.
    Meshio(&'static str),
    /// Another way to convert the file, described in a sentence.
    By(&'static str),
}

/// Name of a file format, and the way to convert such a file to an FE input file.
type Known = (&'static str, Remedy);

/// Number of bytes at the start of a file by which its format is recognised.
const HEAD: usize = 64 * 1024;

/// Returns the reason for rejecting a file that is not an FE input file, with the command that converts it. Returns
/// `None` if the file can be an FE input file.
pub(super) fn refusal(path: &Path, bytes: &[u8]) -> Option<String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let (kind, remedy) = recognised(&extension, &bytes[..bytes.len().min(HEAD)])?;
    let result = result(path, &extension);
    let name = result.file_name().unwrap_or_default().to_string_lossy();
    let (from, to) = (argument(path), argument(&result));
    let way = match remedy {
        Remedy::Gmsh => {
            format!("gmsh {from} -save -setnumber Mesh.SaveGroupsOfNodes 1 -format inp -o {to}")
        }
        Remedy::GmshMeshes => {
            format!("gmsh -3 {from} -order 2 -setnumber Mesh.SaveGroupsOfNodes 1 -format inp -o {to}")
        }
        Remedy::Meshio(format) => {
            format!("meshio convert {from} --input-format {format} --output-format abaqus {to}")
        }
        Remedy::By(way) => return Some(format!("{} is {kind}, not an FE input file: {way}", path.display())),
    };
    Some(format!(
        "{} is {kind}, not an FE input file. This command converts it: `{way}`. Include the result in an FE input \
         file that has the materials and a load case: *INCLUDE, INPUT={name}",
        path.display()
    ))
}

/// Returns the path of the file that the conversion command writes: next to the input file, and never an existing file.
fn result(path: &Path, extension: &str) -> PathBuf {
    let plain = path.with_extension("inp");
    if extension == "inp" || plain.exists() { path.with_extension("mesh.inp") } else { plain }
}

/// Returns a path as an argument of a command, in quotation marks if it contains blanks or other special characters.
fn argument(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |letter: char| letter.is_alphanumeric() || "._-/+:".contains(letter);
    if text.chars().all(is_plain) { text } else { format!("\"{text}\"") }
}

/// Recognises a format by the first bytes of the file. If these bytes are not sufficient, the file extension decides.
fn recognised(extension: &str, head: &[u8]) -> Option<Known> {
    if let Some(known) = binary(extension, head) {
        return Some(known);
    }
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}');
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let first = lines.next()?;
    // Comments of LS-DYNA begin with `$`.
    let card = iter::once(first).chain(lines.clone()).find(|line| !line.starts_with('$'));
    if card.is_some_and(|card| begins(card, "*KEYWORD")) {
        return Some(("an LS-DYNA file", OTHER_MESHER));
    }
    if first.trim_start().starts_with('*') {
        return None;
    }
    of_text(first, lines.next().unwrap_or_default(), text).or_else(|| by_extension(extension, text))
}

const OTHER_MESHER: Remedy = Remedy::By(
    "export the mesh from the program that made it as Abaqus input (.inp), or as Nastran (.bdf), which `gmsh mesh.bdf \
     -save -format inp -o mesh.inp` converts",
);
const MESH_CAD: Remedy = Remedy::By(
    "it has a surface without a volume; mesh the solid of the CAD model instead, exported as STEP: `gmsh -3 part.step \
     -order 2 -format inp -o part.inp`",
);

fn binary(extension: &str, head: &[u8]) -> Option<Known> {
    let is = |magic: &[u8]| head.starts_with(magic);
    if is(b"\xff\xfe") || is(b"\xfe\xff") {
        return Some(("UTF-16 text", Remedy::By("save it as UTF-8")));
    }
    if is(b"\x1f\x8b") {
        return Some(("compressed by gzip", Remedy::By("unpack it with gunzip")));
    }
    if is(b"PK\x03\x04") {
        let free_cad = "write the FE input file in FreeCAD: in the FEM workbench, open the solver CalculiX and press \
                        `Write .inp file`";
        return Some(match extension {
            "fcstd" => ("a FreeCAD document", Remedy::By(free_cad)),
            "3mf" => ("a surface", MESH_CAD),
            _ => ("a ZIP archive", Remedy::By("unpack the archive, and use the .inp file in it")),
        });
    }
    if is(b"\x89HDF\r\n\x1a\n") {
        return Some(match extension {
            "med" | "rmed" | "mmed" => ("a MED mesh (Salome)", Remedy::Gmsh),
            "cgns" => ("a CGNS mesh", Remedy::Gmsh),
            "e" | "ex2" | "exo" => ("an Exodus mesh", Remedy::Meshio("exodus")),
            _ => ("an HDF5 file", OTHER_MESHER),
        });
    }
    if is(b"CDF\x01") || is(b"CDF\x02") || is(b"CDF\x05") {
        return Some(("an Exodus mesh (netCDF)", Remedy::Meshio("exodus")));
    }
    None
}

/// Returns whether a line begins with `start`, in capital or small letters.
fn begins(line: &str, start: &str) -> bool {
    line.trim_start().get(..start.len()).is_some_and(|head| head.eq_ignore_ascii_case(start))
}

fn of_text(first: &str, second: &str, text: &str) -> Option<Known> {
    let begin = first.trim_start();
    let line = |starts: &[&str]| text.lines().any(|line| starts.iter().any(|start| begins(line, start)));
    let is_gmsh = text.lines().map(str::trim).any(|line| line == "$MeshFormat" || line == "$NOD");
    let is_universal = begin.trim_end() == "-1" && second.trim().parse::<u32>().is_ok();
    let starts = |words: &[&str]| words.iter().any(|word| begin.starts_with(word));
    Some(match () {
        () if is_gmsh => ("a Gmsh mesh (.msh)", Remedy::Gmsh),
        // Gmsh reads only old versions of this format.
        () if starts(&["# vtk DataFile"]) => ("a VTK file (.vtk)", Remedy::Meshio("vtk")),
        () if text.contains("<VTKFile") => ("a VTK file (.vtu)", Remedy::Meshio("vtu")),
        () if text.contains("<Xdmf") => ("an XDMF file", Remedy::Meshio("xdmf")),
        () if starts(&["MeshVersionFormatted"]) => ("a Medit mesh (.mesh)", Remedy::Gmsh),
        () if starts(&["ISO-10303-21"]) => ("a STEP geometry without a mesh", Remedy::GmshMeshes),
        () if starts(&["DBRep_DrawableShape", "CASCADE Topology"]) => {
            ("a BREP geometry without a mesh", Remedy::GmshMeshes)
        }
        () if is_universal => ("an I-DEAS universal file (.unv)", Remedy::Gmsh),
        () if first.starts_with("    1C") => {
            ("a result file of CalculiX (.frd)", Remedy::By("use the .inp file from which it was computed"))
        }
        () if line(&["BEGIN BULK", "BEGIN,BULK", "GRID ", "GRID,", "GRID*", "CTETRA"]) => {
            ("a Nastran file", Remedy::Gmsh)
        }
        () if line(&["/PREP7", "/COM,", "NBLOCK,", "ET,"]) => (
            "an Ansys file (.cdb)",
            Remedy::By(
                "export the mesh as Nastran (.bdf), which `gmsh mesh.bdf -save -format inp -o mesh.inp` converts, or \
                 use the Python packages mapdl-archive and pyvista: `pyvista.save_meshio(\"mesh.inp\", \
                 mapdl_archive.Archive(\"mesh.cdb\").grid)`",
            ),
        ),
        () if starts(&["# Created by COMSOL"]) => ("a COMSOL mesh", OTHER_MESHER),
        () if text.lines().any(|line| line.trim() == "mesh3d") => {
            ("a Netgen mesh (.vol)", Remedy::Meshio("netgen"))
        }
        () if line(&["NDIME="]) => ("an SU2 mesh", Remedy::Meshio("su2")),
        () if starts(&["solid "]) && line(&["facet normal"]) => ("an STL surface", MESH_CAD),
        () if starts(&["ply"]) && line(&["element vertex"]) => ("a PLY surface", MESH_CAD),
        () if starts(&["(0 ", "(1 ", "(2 "]) => ("a Fluent mesh", Remedy::Meshio("ansys")),
        () => return None,
    })
}

/// Recognises by its extension a format that has no signature at the start of the file. The file must not begin with a
/// card (`*KEYWORD`).
fn by_extension(extension: &str, text: &str) -> Option<Known> {
    // The first line of an AVS-UCD file below its comments has five counts.
    let is_ucd = || {
        let first = text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#'));
        let words: Vec<&str> = first.unwrap_or_default().split_whitespace().collect();
        words.len() == 5 && words.iter().all(|word| word.parse::<u32>().is_ok())
    };
    Some(match extension {
        // The first card may be below a long comment.
        "bdf" | "nas" | "fem" => ("a Nastran file", Remedy::Gmsh),
        "geo" => ("a Gmsh geometry without a mesh (.geo)", Remedy::GmshMeshes),
        "igs" | "iges" => ("an IGES geometry without a mesh", Remedy::GmshMeshes),
        "stl" => ("an STL surface", MESH_CAD),
        "obj" | "off" => ("a surface", MESH_CAD),
        "node" | "ele" => ("a TetGen mesh", Remedy::Meshio("tetgen")),
        "inp" | "avs" | "ucd" if is_ucd() => ("an AVS-UCD mesh", Remedy::Meshio("avsucd")),
        "odb" => (
            "a result file of Abaqus (.odb)",
            Remedy::By("use the .inp file of the job (Abaqus/CAE: Job, Write Input)"),
        ),
        "cae" => (
            "a model file of Abaqus/CAE",
            Remedy::By("write the FE input file in Abaqus/CAE: Job, Write Input"),
        ),
        "pmx" => {
            ("a PrePoMax project", Remedy::By("write the FE input file in PrePoMax: File, Export, CalculiX"))
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests;
