//! Files of Gmsh and of other mesh programs.

use super::*;

/// Two tetrahedra as Gmsh writes them: all entities, a node that is only the centre of a circle (1), and a surface that
/// bounds no volume (13).
const GMSH: &str = "\
*Heading
 part.inp
*NODE
1, 50, 50, -20
2, 0, 0, 0
3, 100, 0, 0
4, 0, 100, 0
5, 0, 0, 100
6, 100, 100, 100
7, 500, 500, 500
******* E L E M E N T S *************
*ELEMENT, type=T3D2, ELSET=Line1
1, 2, 3
*ELEMENT, type=CPS3, ELSET=Surface1
2, 2, 4, 3
*ELEMENT, type=CPS3, ELSET=Surface13
3, 2, 4, 7
*ELEMENT, type=C3D4, ELSET=Volume1
4, 2, 3, 4, 5
5, 3, 6, 4, 5
*ELSET,ELSET=GUIDE
1, 
*ELSET,ELSET=FOOT
2, 
*ELSET,ELSET=my_column
4, 5, 
";

const REST: &str = "\
*MATERIAL, NAME=IRON
*ELASTIC
110000, 0.26
*EXPANSION
1.1e-5
*CONDUCTIVITY
50
*SOLID SECTION, ELSET=my_column, MATERIAL=IRON
*INITIAL CONDITIONS, TYPE=TEMPERATURE
my_column, 20
*BOUNDARY
FOOT, 1, 3
*STEP
*HEAT TRANSFER, STEADY STATE
*FILM
FOOT, F, 25, 0.008
*END STEP
";

#[test]
fn the_output_of_gmsh_is_read_with_nodes_in_no_element_and_without_node_groups() {
    let input = read_text(&format!("{GMSH}{REST}")).unwrap_or_else(|faults| panic!("{faults}"));
    let ids: Vec<u32> = input.mesh.nodes.iter().map(|node| node.0).collect();
    assert_eq!(ids, [2, 3, 4, 5, 6]);
    assert_eq!(input.mesh.xyz[4].map(f64::to_bits), [100.0_f64; 3].map(f64::to_bits));
    assert_eq!(input.mesh.elements[1].nodes, [1, 4, 2, 3]);
    assert_eq!(input.mesh.node_sets["GUIDE"], [0, 1]);
    assert_eq!(input.mesh.node_sets["FOOT"], [0, 1, 2]);
    assert_eq!(input.supports, [0, 1, 2]);
    assert_eq!(input.load.films.len(), 1);
    assert!(input.load.initial.iter().all(|initial| (initial - 20.0).abs() < 1e-12));
}

#[test]
fn a_mesh_of_surfaces_alone_is_named() {
    let volume = "*ELEMENT, type=C3D4, ELSET=Volume1\n4, 2, 3, 4, 5\n5, 3, 6, 4, 5\n";
    assert!(GMSH.contains(volume));
    let said = said(&format!("{}{REST}", GMSH.replace(volume, "")));
    assert!(said.contains("lines and surfaces, but no tetrahedra") && said.contains("`gmsh -3`"), "{said}");
}

#[test]
fn a_load_that_a_line_repeats_for_a_set_is_one_error() {
    let twice = REST.replace("*END STEP", "*DFLUX\nmy_column, BF, 0.5\nmy_column, BF, 0.25\n*END STEP");
    let said = said(&format!("{GMSH}{twice}"));
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.contains("*DFLUX: element 4 has this flux already (line "), "{said}");
}

#[test]
fn sets_with_nodes_in_no_element_keep_their_other_nodes() {
    let sets = "*NSET, NSET=my_column, GENERATE\n1, 7, 1\n*NSET, NSET=ENDS\n1, 6, 7\n*NSET, NSET=CENTRE\n1\n";
    let input = read_text(&format!("{GMSH}{sets}{REST}")).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.mesh.node_sets["MY_COLUMN"], [0, 1, 2, 3, 4]);
    assert_eq!(input.mesh.node_sets["ENDS"], [4]);
    assert!(input.mesh.node_sets["CENTRE"].is_empty());
    let without_effect = REST
        .replace("my_column, 20\n", "my_column, 20\n1, 20\nCENTRE, 20\n")
        .replace("*FILM", "*NODE PRINT, NSET=CENTRE\nNT\n*FILM");
    let same =
        read_text(&format!("{GMSH}{sets}{without_effect}")).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(same, input);
    // A load or a support without any node has no effect, and is refused.
    for (line, wanted) in [
        ("CENTRE, 11, 100", "*CFLUX: no member of node set CENTRE is in an element"),
        ("7, 11, 100", "*CFLUX: node 7 is in no element"),
        ("8, 11, 100", "*CFLUX: node 8 is not defined"),
    ] {
        let loaded = REST.replace("*FILM", &format!("*CFLUX\n{line}\n*FILM"));
        let said = said(&format!("{GMSH}{sets}{loaded}"));
        assert!(said.contains(wanted), "{line}: {said}");
    }
    let said = said(&format!("{GMSH}{}{REST}", sets.replace("1, 7, 1", "1, 9, 1")));
    assert!(said.contains("*NSET: node 8 is not defined, nor are 1 others"), "{said}");
}

#[test]
fn a_mesh_of_gmsh_without_a_load_case_says_what_is_missing() {
    let said = said(GMSH);
    assert!(said.contains("the file ends without a step: write *STEP, *HEAT TRANSFER"), "{said}");
    let quads = format!("{GMSH}{REST}")
        .replace("type=CPS3, ELSET=Surface13\n3, 2, 4, 7", "type=CPS4, ELSET=S\n3, 2, 4, 7, 6");
    let said = self::said(&quads);
    assert!(said.contains("*ELEMENT: element type CPS4 is not supported: mesh the structure"), "{said}");
}

#[test]
fn an_include_of_windows_is_found() {
    let (directory, case) = place("case.inp");
    std::fs::create_dir(directory.path().join("meshes")).unwrap();
    std::fs::write(directory.path().join("meshes/part 1.inp"), GMSH.replace('\n', "\r\n")).unwrap();
    std::fs::write(&case, format!("*INCLUDE, INPUT=\"meshes\\part 1.inp\" \r\n{REST}")).unwrap();
    let input = read(&case).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input, read_text(&format!("{GMSH}{REST}")).unwrap());
}

#[test]
fn a_file_of_another_format_is_named_with_its_command_where_it_is_named() {
    let (directory, case) = place("case.inp");
    let mesh = directory.path().join("part.msh");
    std::fs::write(&mesh, "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n").unwrap();
    let said = read(&mesh).unwrap_err().to_string();
    assert!(
        said.contains(
            "part.msh is a Gmsh mesh (.msh), not an FE input file. This command converts it: `gmsh"
        ),
        "{said}"
    );
    assert_eq!(said.lines().count(), 1, "{said}");
    std::fs::write(&case, format!("*INCLUDE, INPUT=part.msh\n{REST}")).unwrap();
    let said = read(&case).unwrap_err().to_string();
    assert!(said.contains("case.inp:1: *INCLUDE: ") && said.contains("part.msh is a Gmsh mesh"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[test]
fn the_outputs_of_freecad_and_prepomax_are_the_same_load_case() {
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/corpus/deck/");
    let input = |name: &str| {
        let text = std::fs::read_to_string(format!("{corpus}{name}")).unwrap();
        read_text(&text).unwrap_or_else(|faults| panic!("{name}: {faults}"))
    };
    // FreeCAD writes kelvin, PrePoMax °C.
    for input in [input("freecad"), input("prepomax")] {
        assert_eq!(input.mesh.elements.len(), 1);
        assert_eq!(input.supports, [0, 1, 2]);
        assert_eq!(input.load.case, Case::Steady);
        let near = |one: f64, other: f64| (one - other).abs() < 1e-9;
        assert!(input.load.initial.iter().all(|initial| near(*initial, 20.0)), "{:?}", input.load.initial);
        assert!(matches!(input.load.held[..], [(3, held)] if near(held, 30.0)), "{:?}", input.load.held);
        assert!(matches!(input.load.films[..], [film] if near(film.sink, 25.0)), "{:?}", input.load.films);
        assert_eq!(input.load.films[0].face, Face { element: 0, side: 0 });
        assert!(near(input.materials.of(0).young, 110_000.0));
    }
}
