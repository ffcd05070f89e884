use super::*;

#[test]
fn every_other_format_is_named_with_the_command_that_converts_it() {
    let gmsh = |from: &str, to: &str| {
        format!("`gmsh {from} -save -setnumber Mesh.SaveGroupsOfNodes 1 -format inp -o {to}`")
    };
    let meshed = |from: &str, to: &str| {
        format!("`gmsh -3 {from} -order 2 -setnumber Mesh.SaveGroupsOfNodes 1 -format inp -o {to}`")
    };
    let meshio = |from: &str, format: &str, to: &str| {
        format!("`meshio convert {from} --input-format {format} --output-format abaqus {to}`")
    };
    let cases: [(&str, &[u8], &str, String); 30] = [
        ("a.msh", b"$MeshFormat\n4.1 0 8\n", "a Gmsh mesh", gmsh("a.msh", "a.inp")),
        ("mesh.inp", b"$Comments\nx\n$EndComments\n$MeshFormat\n", "Gmsh", gmsh("mesh.inp", "mesh.mesh.inp")),
        ("a.geo", b"Point(1)={0,0,0,30};\n", "a Gmsh geometry", meshed("a.geo", "a.inp")),
        ("a.step", b"ISO-10303-21;\nHEADER;\n", "a STEP geometry", meshed("a.step", "a.inp")),
        ("a.brep", b"DBRep_DrawableShape\n", "a BREP geometry", meshed("a.brep", "a.inp")),
        ("a.igs", b"                     S      1\n", "an IGES geometry", meshed("a.igs", "a.inp")),
        ("a.unv", b"    -1\n  2411\n         1\n", "I-DEAS", gmsh("a.unv", "a.inp")),
        ("a.med", b"\x89HDF\r\n\x1a\n\0\0", "a MED mesh", gmsh("a.med", "a.inp")),
        ("a.bdf", b"$ Created by Gmsh\nGRID    1       0\n", "a Nastran file", gmsh("a.bdf", "a.inp")),
        ("a.nas", b"SOL 101\nCEND\nBEGIN BULK\n", "a Nastran file", gmsh("a.nas", "a.inp")),
        ("a.mesh", b" MeshVersionFormatted 2\n", "a Medit mesh", gmsh("a.mesh", "a.inp")),
        ("a.vtk", b"# vtk DataFile Version 2.0\n", "a VTK file", gmsh("a.vtk", "a.inp")),
        ("a.vtu", b"<?xml version=\"1.0\"?>\n<VTKFile>", "a VTK file", meshio("a.vtu", "vtu", "a.inp")),
        ("a.xdmf", b"<Xdmf Version=\"3.0\">", "an XDMF file", meshio("a.xdmf", "xdmf", "a.inp")),
        ("a.exo", b"CDF\x01\0\0", "an Exodus mesh", meshio("a.exo", "exodus", "a.inp")),
        ("a.vol", b"mesh3d\ndimension\n3\n", "a Netgen mesh", meshio("a.vol", "netgen", "a.inp")),
        ("a.inp", b"8 1 0 0 0\n1 0 0 0\n", "an AVS-UCD mesh", meshio("a.inp", "avsucd", "a.mesh.inp")),
        (
            "a.inp",
            b"# Written by meshio\n\n8 1 0 0 0\n",
            "an AVS-UCD mesh",
            meshio("a.inp", "avsucd", "a.mesh.inp"),
        ),
        ("a.nas", b"$NODES of the column\nGRID    1       0\n", "a Nastran file", gmsh("a.nas", "a.inp")),
        ("a.fem", b"$$ a long comment\n", "a Nastran file", gmsh("a.fem", "a.inp")),
        ("a.3mf", b"PK\x03\x04\0\0", "a surface", "gmsh -3 part.step".to_owned()),
        (
            "a.k",
            b"$# LS-DYNA Keyword file\n$NODES\n*Keyword MEMORY=1\n",
            "an LS-DYNA file",
            "Abaqus".to_owned(),
        ),
        ("parts/my part.msh", b"$NOD\n1\n", "Gmsh", gmsh("\"parts/my part.msh\"", "\"parts/my part.inp\"")),
        ("a.cdb", b"/COM,ANSYS\n/PREP7\n", "an Ansys file", "pyvista.save_meshio".to_owned()),
        ("a.k", b"*KEYWORD\n*NODE\n", "an LS-DYNA file", "`gmsh mesh.bdf -save".to_owned()),
        ("a.stl", b"solid x\nfacet normal 0 0 1\n", "an STL surface", "gmsh -3 part.step".to_owned()),
        ("a.frd", b"    1C\n    1UUSER\n", "a result file of CalculiX", "name the .inp file".to_owned()),
        ("a.FCStd", b"PK\x03\x04\0\0", "a FreeCAD document", "Write .inp file".to_owned()),
        ("a.inp", b"\xff\xfe*\0N\0", "UTF-16 text", "save it as UTF-8".to_owned()),
        ("a.inp.gz", b"\x1f\x8b\x08\0", "compressed by gzip", "gunzip".to_owned()),
    ];
    for (name, bytes, kind, way) in cases {
        let said = refusal(Path::new(name), bytes).unwrap_or_else(|| panic!("{name} is accepted"));
        assert!(said.starts_with(&format!("{name} is ")), "{said}");
        for wanted in [kind, way.as_str(), "not an FE input file"] {
            assert!(said.contains(wanted), "{name}: `{wanted}` is not in: {said}");
        }
    }
}

#[test]
fn an_fe_input_file_is_of_no_other_format_whatever_its_extension_and_comments() {
    for name in ["a.inp", "a.stl", "a.node", "a.geo", "a.odb", "a"] {
        for text in [
            "*HEADING\n$MeshFormat\n*NODE\n",
            "\n\n  *Node, nset=all\n1, 0, 0, 0\n",
            "** GRID 1\n*NODE\n",
            "\u{feff}*NODE\n",
            "",
        ] {
            assert_eq!(refusal(Path::new(name), text.as_bytes()), None, "{name}: {text}");
        }
    }
    // The text of a heading can look like a comment or a card of LS-DYNA.
    assert_eq!(refusal(Path::new("a.inp"), b"\n*HEADING\n$ *KEYWORD\n*NODE\n"), None);
    // No format is recognised: the reader reports the line.
    assert_eq!(refusal(Path::new("a.inp"), b"1, 2\n*HEADING\n"), None);
}

#[test]
fn the_command_does_not_overwrite_a_file() {
    let directory = tempfile::tempdir().unwrap();
    let mesh = directory.path().join("column.msh");
    let named = |bytes: &[u8]| refusal(&mesh, bytes).unwrap();
    let bytes = b"$MeshFormat\n4.1 0 8\n";
    assert!(named(bytes).ends_with("*INCLUDE, INPUT=column.inp"), "{}", named(bytes));
    std::fs::write(directory.path().join("column.inp"), "*INCLUDE, INPUT=column.msh\n").unwrap();
    assert!(named(bytes).ends_with("*INCLUDE, INPUT=column.mesh.inp"), "{}", named(bytes));
    let command = format!("-o {}`", directory.path().join("column.mesh.inp").display());
    assert!(named(bytes).contains(&command), "{}", named(bytes));
}
