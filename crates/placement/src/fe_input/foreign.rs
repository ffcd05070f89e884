//! Files that are no FE input: mesh formats, results and archives, with the command that converts each of them.

use std::path::Path;

/// Way to an FE input file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Remedy {
    /// Gmsh reads the mesh and writes it.
    Gmsh,
    /// Gmsh meshes the geometry.
    GmshMeshes,
    /// `meshio convert` with this input format.
    Meshio(&'static str),
    /// Sentence with the way.
    By(&'static str),
}

/// Kind of a file with the way to an FE input file.
type Known = (&'static str, Remedy);

/// Number of bytes at the start of a file by which its format is recognised.
const HEAD: usize = 4096;

/// Returns the reason for rejecting a file that is no FE input, with the command that converts it. Returns `None` if
/// the file can be an FE input file.
pub(super) fn refusal(path: &Path, bytes: &[u8]) -> Option<String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let (kind, remedy) = recognised(&extension, &bytes[..bytes.len().min(HEAD)])?;
    let from = path.display();
    let to = path.with_extension(if extension == "inp" { "mesh.inp" } else { "inp" });
    let to = to.file_name().unwrap_or_default().to_string_lossy();
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
        Remedy::By(way) => return Some(format!("{from} is {kind}, not an FE input file: {way}")),
    };
    Some(format!(
        "{from} is {kind}, not an FE input file. This command converts it: `{way}`. Include the result in an FE input \
         file that has the materials and a load case: *INCLUDE, INPUT={to}"
    ))
}

/// Recognises a format by the first bytes of the file, and by its extension if the bytes do not decide.
fn recognised(extension: &str, head: &[u8]) -> Option<Known> {
    if let Some(known) = binary(extension, head) {
        return Some(known);
    }
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}');
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let first = lines.next()?;
    if first.trim_start().starts_with('*') {
        let is_dyna = first.trim().eq_ignore_ascii_case("*KEYWORD");
        return is_dyna.then_some(("an LS-DYNA file", OTHER_MESHER));
    }
    of_text(first, lines.next().unwrap_or_default(), text).or_else(|| by_extension(extension, first))
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
            _ => ("a ZIP archive", Remedy::By("unpack it, and name the .inp file in it")),
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

fn of_text(first: &str, second: &str, text: &str) -> Option<Known> {
    let begin = first.trim_start();
    let line = |starts: &[&str]| {
        text.lines().any(|line| {
            let line = line.trim_start();
            starts
                .iter()
                .any(|start| line.get(..start.len()).is_some_and(|head| head.eq_ignore_ascii_case(start)))
        })
    };
    let is_universal = begin.trim_end() == "-1" && second.trim().parse::<u32>().is_ok();
    let starts = |words: &[&str]| words.iter().any(|word| begin.starts_with(word));
    Some(match () {
        () if line(&["$MeshFormat", "$NOD"]) => ("a Gmsh mesh (.msh)", Remedy::Gmsh),
        () if starts(&["# vtk DataFile"]) => ("a VTK file (.vtk)", Remedy::Gmsh),
        () if text.contains("<VTKFile") => ("a VTK file (.vtu)", Remedy::Meshio("vtu")),
        () if text.contains("<Xdmf") => ("an XDMF file", Remedy::Meshio("xdmf")),
        () if starts(&["MeshVersionFormatted"]) => ("a Medit mesh (.mesh)", Remedy::Gmsh),
        () if starts(&["ISO-10303-21"]) => ("a STEP geometry without a mesh", Remedy::GmshMeshes),
        () if starts(&["DBRep_DrawableShape", "CASCADE Topology"]) => {
            ("a BREP geometry without a mesh", Remedy::GmshMeshes)
        }
        () if is_universal => ("an I-DEAS universal file (.unv)", Remedy::Gmsh),
        () if first.starts_with("    1C") => {
            ("a result file of CalculiX (.frd)", Remedy::By("name the .inp file from which it was computed"))
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
        () if starts(&["mesh3d"]) => ("a Netgen mesh (.vol)", Remedy::Meshio("netgen")),
        () if line(&["NDIME="]) => ("an SU2 mesh", Remedy::Meshio("su2")),
        () if starts(&["solid "]) && line(&["facet normal"]) => ("an STL surface", MESH_CAD),
        () if starts(&["ply"]) && line(&["element vertex"]) => ("a PLY surface", MESH_CAD),
        () if starts(&["(0 ", "(2 "]) => ("a Fluent mesh", Remedy::Meshio("ansys")),
        () => return None,
    })
}

/// Recognises formats without a mark at their start. The file does not begin with a card.
fn by_extension(extension: &str, first: &str) -> Option<Known> {
    let counts = || first.split_whitespace().filter(|word| word.parse::<u32>().is_ok()).count();
    Some(match extension {
        "geo" => ("a Gmsh geometry without a mesh (.geo)", Remedy::GmshMeshes),
        "igs" | "iges" => ("an IGES geometry without a mesh", Remedy::GmshMeshes),
        "stl" => ("an STL surface", MESH_CAD),
        "obj" | "off" | "3mf" => ("a surface", MESH_CAD),
        "node" | "ele" => ("a TetGen mesh", Remedy::Meshio("tetgen")),
        "inp" if counts() == 5 => ("an AVS-UCD mesh", Remedy::Meshio("avsucd")),
        "odb" => (
            "a result file of Abaqus (.odb)",
            Remedy::By("name the .inp file of the job (Abaqus/CAE: Job, Write Input)"),
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
