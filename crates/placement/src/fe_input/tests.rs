use std::path::PathBuf;

use super::*;
use crate::bodies::{block, calm, iron};
use crate::body::{Case, Film, Flux};
use crate::mesh::{Face, Kind};

use crate::write;

/// One tetrahedron, with everything an FE input file requires.
const FILE: &str = "\
*HEADING
one tetrahedron
*NODE, NSET=ALL
1, 0, 0, 0
2, 100, 0, 0
3, 0, 100, 0
4, 0, 0, 100
*ELEMENT, TYPE=C3D4, ELSET=BODY
1, 1, 2, 3, 4
*NSET, NSET=BASE, GENERATE
1, 3
*MATERIAL, NAME=IRON
*ELASTIC
110000, 0.26
*EXPANSION, ZERO=20
1.1e-5
*CONDUCTIVITY
50
*SPECIFIC HEAT
5e8
*DENSITY
7.25E-9
*SOLID SECTION, ELSET=BODY, MATERIAL=IRON
*INITIAL CONDITIONS, TYPE=TEMPERATURE
ALL, 20
*STEP, INC=100
*HEAT TRANSFER, STEADY STATE
*FILM
1, F1, 25, 0.008
*DFLUX
BODY, S2, 0.5
BODY, BF, 1d-3
*CFLUX
4, 11, 100
*BOUNDARY
2, 11, 11, 21.5
*NODE PRINT, NSET=ALL
NT
*END STEP
";

fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    (directory, path)
}

fn read_text(text: &str) -> Result<FeInput, Faults> {
    let (_directory, path) = place("case.inp");
    std::fs::write(&path, text).unwrap();
    read(&path)
}

/// Returns the error message for a file with this text, without the directory.
fn said(text: &str) -> String {
    let faults = read_text(text).expect_err("this file must be refused").to_string();
    let lines = faults.lines().map(|line| match line.find("case.inp") {
        Some(at) => &line[at..],
        None => line,
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Returns the error message for [`FILE`] with `from` replaced by `to`.
fn with(from: &str, to: &str) -> String {
    assert!(FILE.contains(from), "{from}");
    said(&FILE.replacen(from, to, 1))
}

#[test]
fn a_node_set_keeps_the_order_of_its_file_and_has_every_node_once() {
    let sets = "*NSET, NSET=RAIL\n3, 1, 3\n*NSET, NSET=BOTH\n4, RAIL\n*NSET, NSET=TWICE\n3\n*NSET, NSET=TWICE\n1, 3\n";
    let text = FILE.replacen("*MATERIAL", &format!("{sets}*MATERIAL"), 1);
    let input = read_text(&text).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.mesh.node_sets["TWICE"], [2, 0], "a second card adds to the set");
    assert_eq!(input.mesh.node_sets["RAIL"], [2, 0]);
    assert_eq!(input.mesh.node_sets["BOTH"], [3, 2, 0]);
}

#[test]
fn a_file_becomes_a_mesh_materials_and_a_load_case() {
    let input = read_text(FILE).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.name, "case");
    assert_eq!(input.mesh.xyz[3].map(f64::to_bits), [0.0_f64, 0.0, 100.0].map(f64::to_bits));
    assert_eq!(input.mesh.node_sets["BASE"], [0, 1, 2]);
    assert_eq!(input.mesh.elements[0].kind, Kind::Tet4);
    assert_eq!(input.materials.of(0).capacity, Some(5e8 * 7.25e-9));
    assert_eq!(input.load.case, Case::Steady);
    assert_eq!(input.load.initial, [20.0; 4]);
    let face = |side| Face { element: 0, side };
    assert_eq!(input.load.films, [Film { face: face(0), sink: 25.0, coefficient: 0.008 }]);
    assert_eq!(input.load.fluxes, [Flux::Face(face(1), 0.5), Flux::Volume(0, 1e-3)]);
    assert_eq!(input.load.nodal, [(3, 100.0)]);
    assert_eq!(input.load.held, [(1, 21.5)]);
    assert!(input.supports.is_empty());
}

#[test]
fn a_file_that_is_written_is_read_as_it_was() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mut mesh = block(kind);
        mesh.node_sets.insert("BASE".to_owned(), vec![0, 3, 4, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
        let mut load = calm(&mesh, Case::Transient { step: 0.1, period: 12.3 });
        let face = mesh.outer_faces()[3];
        load.films = vec![Film { face, sink: 25.5, coefficient: 0.008 }];
        load.fluxes = vec![Flux::Face(face, -0.1), Flux::Volume(3, 1e-7)];
        load.nodal = vec![(5, 12.5)];
        load.held = vec![(6, 33.0)];
        let materials = iron(&mesh);
        let parts = [write::mesh(&mesh), write::materials(&mesh, &materials), write::load(&mesh, &load, "")];
        let input = read_text(&parts.concat()).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!(input.mesh.elements, mesh.elements);
        assert_eq!(input.mesh.node_sets, mesh.node_sets);
        assert_eq!(input.load, load);
        assert!((input.materials.list[0].young - materials.list[0].young).abs() < 1e-9);
        for (read, made) in input.mesh.xyz.iter().zip(&mesh.xyz) {
            assert!((0..3).all(|axis| (read[axis] - made[axis]).abs() < 1e-9), "{read:?}, not {made:?}");
        }
    }
}

#[test]
fn small_letters_blanks_continued_lines_and_comments_change_nothing() {
    let wanted = read_text(FILE).unwrap();
    let loose = FILE.to_lowercase().replace("*film", "*Film,\nop = new").replace(", ", " ,  ");
    let loose = loose.replace("1 ,  1 ,  2 ,  3 ,  4\n", "** nodes\n1, 1, 2,\n\n3, 4,\r\n");
    assert_eq!(read_text(&loose).unwrap_or_else(|faults| panic!("{faults}")), wanted);
}

#[test]
fn a_decimal_comma_is_reported_as_one() {
    for (from, to) in [
        ("2, 100, 0, 0", "2, 100,5, 0, 0"),
        ("110000, 0.26", "110000, 0,26"),
        ("1.1e-5", "1,1e-5"),
        ("7.25E-9", "7,25E-9"),
        ("1, F1, 25, 0.008", "1, F1, 25, 0,008"),
        ("BODY, S2, 0.5", "BODY, S2, 0,5"),
        ("ALL, 20\n", "ALL, 20,5\n"),
        ("2, 11, 11, 21.5", "2, 11, 11, 21,5"),
    ] {
        let said = with(from, to);
        assert!(said.contains("1.5, not 1,5"), "{to}: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

/// Checks FE input files that CalculiX accepts without a warning, rejects, or crashes on. isotherm rejects each of them
/// with location and cause.
#[test]
fn what_is_wrong_is_said_with_line_card_and_remedy() {
    let transient = "*HEAT TRANSFER\n10, 100";
    let steady = "*HEAT TRANSFER, STEADY STATE";
    for (from, to, wanted) in [
        ("*EXPANSION,", "*EXPANSON,", "case.inp:15: *EXPANSON: no such card; did you mean *EXPANSION?"),
        ("*EXPANSION, ZERO=20\n1.1e-5\n", "", "case.inp:12: *MATERIAL: IRON has no *EXPANSION"),
        ("*ELASTIC\n110000, 0.26\n", "", "*MATERIAL: IRON has no *ELASTIC"),
        ("*CONDUCTIVITY\n50\n", "", "*MATERIAL: IRON has no *CONDUCTIVITY"),
        (
            "110000,",
            "1.1e11,",
            "case.inp:14: *ELASTIC: the Young's modulus is 1.1e11, which is not plausible in MPa",
        ),
        ("*SOLID SECTION, ELSET=BODY, MATERIAL=IRON\n", "", "1 elements have no material, the first is 1"),
        ("MATERIAL=IRON", "MATERIAL=STEEL", "*SOLID SECTION: material STEEL is not defined"),
        ("ALL, 20", "BLKX, 20", "*INITIAL CONDITIONS: node set BLKX is not defined (there are ALL, BASE)"),
        ("*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20\n", "", "node 1 has no initial temperature"),
        ("*NODE PRINT, NSET=ALL", "*NODE PRINT, NSET=NOPE", "*NODE PRINT: node set NOPE is not defined"),
        ("1, 1, 2, 3, 4\n", "1, 1, 2, 3, 9\n", "*ELEMENT: element 1 names node 9, which is not defined"),
        ("1, 1, 2, 3, 4\n", "1, 1, 2, 3\n", "*ELEMENT: the element has 3 nodes, but a C3D4 has 4"),
        ("1, 1, 2, 3, 4\n", "1, 1, 2, 3, 4, 2\n", "*ELEMENT: the element has 5 nodes, but a C3D4 has 4"),
        ("1, 1, 2, 3, 4\n", "1, 1, 3, 2, 4\n", "element 1 is numbered inside out or folded"),
        ("TYPE=C3D4", "TYPE=C3D8", "*ELEMENT: element type C3D8 is not supported: mesh the structure"),
        ("ALL, 20\n", "ALL, 20\n7, 20\n", "*INITIAL CONDITIONS: node 7 is not defined"),
        ("4, 0, 0, 100\n", "4, 0, 0, 100\n4, 1, 1, 1\n", "*NODE: node 4 is defined already in line 7"),
        ("*MATERIAL", "*NSET, NSET=EMPTY\n*MATERIAL", "*NSET: node set EMPTY is empty"),
        ("GENERATE\n1, 3", "GENERATE\n1, 9", "*NSET: node 5 is not defined"),
        ("*END STEP\n", "", "case.inp:26: *STEP: the step is not ended: *END STEP is missing"),
        ("*STEP, INC=100", "*STEP, PERTURBATION", "*STEP: the parameter PERTURBATION is not understood"),
        (
            "*STEP, INC=100",
            "*RESTART, READ\n*STEP, INC=100",
            "*RESTART: each load case is computed from its beginning",
        ),
        (steady, "*HEAT TRANSFER, END=SS\n10, 100", "*HEAT TRANSFER: END=SS: the end of the period"),
        (
            "*STEP, INC=100",
            "*STEP\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\n",
            "*INITIAL CONDITIONS: the card must be before *STEP",
        ),
        (
            "*END STEP\n",
            "*END STEP\n*STEP\n*END STEP\n",
            "*STEP: a second step: an FE input file has one load case",
        ),
        (steady, "*STATIC", "*STATIC: this card is not supported: only heat-transfer steps are read"),
        (
            "*CFLUX",
            "*TEMPERATURE\nALL, 21\n*CFLUX",
            "*TEMPERATURE: this card is not supported: temperatures are computed",
        ),
        (
            "*CFLUX",
            "*RADIATE\n1, R1, 20, 0.9\n*CFLUX",
            "*RADIATE: this card is not supported: radiation is not linear",
        ),
        (
            "*CFLUX",
            "*AMPLITUDE, NAME=A\n0, 0, 1, 1\n*CFLUX",
            "*AMPLITUDE: this card is not supported: only loads that are constant",
        ),
        (
            "*FILM\n",
            "*FILM, AMPLITUDE=A\n",
            "*FILM: the parameter AMPLITUDE is not understood (known here: OP)",
        ),
        ("1, F1, 25", "1, F5, 25", "*FILM: `F5` is not a side of a tetrahedron: F1, F2, F3 or F4"),
        (
            "*DFLUX",
            "1, F1, 26, 0.1\n*DFLUX",
            "side F1 of element 1 has a film already (line 29); remove one of the two",
        ),
        ("BODY, S2", "TOP, S, 1\nBODY, S2", "*DFLUX: surface set TOP is not defined (there is none)"),
        (
            "4, 11, 100",
            "4, 1, 100",
            "*CFLUX: `1` is not a direction in which heat enters at a node: write 11",
        ),
        ("2, 11, 11, 21.5", "2, 1, 2", "*BOUNDARY: node 2 is fixed in some directions only"),
        (
            steady,
            "*HEAT TRANSFER",
            "a transient step needs one line: step in s, period in s (or write STEADY STATE)",
        ),
        (steady, "*HEAT TRANSFER\n1e-9, 3600", "*HEAT TRANSFER: more than 100000 steps"),
        (
            steady,
            "*HEAT TRANSFER, STEADY STATE, SOLVER=PARDISO",
            "SOLVER=PARDISO: the file cannot choose the solver",
        ),
        (steady, "", "*FILM: the card must be after *HEAT TRANSFER"),
        ("*HEADING", "*INCLUDE, INPUT=nomesh.inc\n*HEADING", "case.inp:1: *INCLUDE: cannot read"),
        (
            "*HEADING",
            "*INCLUDE, INPUT=case.inp\n*HEADING",
            "case.inp is included more than 2 times: does it include itself?",
        ),
        ("*HEADING", "1, 2\n*HEADING", "case.inp:1: this line is before the first card"),
    ] {
        let said = with(from, to);
        assert!(said.contains(wanted), "{to}: wanted: {wanted}\nsaid: {said}");
    }
    let no_heat = FILE.replace("*SPECIFIC HEAT\n5e8\n", "").replace(steady, transient);
    assert!(said(&no_heat).contains("IRON has no *SPECIFIC HEAT and *DENSITY"), "{}", said(&no_heat));
    let no_step = &FILE[..FILE.find("*STEP").unwrap()];
    assert!(said(no_step).contains("the file ends without a step"), "{}", said(no_step));
    let long = FILE.replace("BASE", &"A".repeat(81));
    assert!(said(&long).contains("longer than 80 characters"), "{}", said(&long));
    assert!(said("").contains("the FE input file is empty"));
    for (text, is_without) in
        [("[machine]\nname = \"m\"\n", true), ("time,bed\n0,20.1\n", true), ("1, 2\n*NODE\n", false)]
    {
        let (_directory, path) = place("case.inp");
        std::fs::write(&path, text).unwrap();
        let faults = read(&path).unwrap_err();
        assert_eq!(faults.is_without_cards(&path), is_without, "{faults}");
        assert_eq!(
            faults.to_string().contains("no line begins with a card such as *NODE"),
            is_without,
            "{faults}"
        );
    }
    assert!(
        read(&PathBuf::from("no_such_file.inp"))
            .unwrap_err()
            .to_string()
            .contains("cannot read no_such_file.inp")
    );
}

#[test]
fn a_card_after_the_step_is_said_to_be_in_a_wrong_place_and_not_to_be_unknown() {
    for (card, belongs) in [
        ("*BOUNDARY\n1, 1, 3", "before *END STEP"),
        ("*FILM\n1, F2, 25, 0.008", "between *STEP and *END STEP"),
        ("*NSET, NSET=TOP\n4", "before *STEP"),
    ] {
        let said = with("*END STEP\n", &format!("*END STEP\n{card}\n"));
        let keyword = card.split(['\n', ',']).next().unwrap();
        assert_eq!(
            said.lines().next(),
            Some(format!("case.inp:40: {keyword}: the card must be {belongs}").as_str())
        );
        assert!(!said.contains("did you mean"), "{said}");
    }
}

#[test]
fn everything_that_is_wrong_is_said_at_once_and_the_same_only_once() {
    let input = FILE
        .replace("1, 0, 0, 0\n2, 100, 0, 0", "1, 0,0, 0, 0\n2, 100,0, 0, 0")
        .replace("*EXPANSION", "*EXPANSON");
    let said = said(&input);
    assert!(said.contains("case.inp:4: *NODE: 5 values, but 4 are required"), "{said}");
    assert!(said.contains("(also in 1 more lines)"), "{said}");
    assert!(said.contains("*EXPANSON: no such card"), "{said}");
    assert_eq!(said.lines().count(), 2, "{said}");
}

#[test]
fn a_film_inside_the_structure_is_refused() {
    let two = FILE
        .replace("4, 0, 0, 100\n", "4, 0, 0, 100\n5, 100, 100, 100\n")
        .replace("1, 1, 2, 3, 4\n", "1, 1, 2, 3, 4\n2, 2, 5, 3, 4\n")
        .replace("1, F1, 25", "1, F3, 25");
    let said = said(&two);
    assert!(
        said.contains("*FILM: side F3 of element 1 lies inside the structure, between two elements"),
        "{said}"
    );
}

#[test]
fn a_surface_that_gmsh_names_by_flat_elements_has_nodes_and_takes_films() {
    let flat = FILE
        .replace(
            "*NSET, NSET=BASE",
            "*ELEMENT, type=CPS3, ELSET=Surface1\n7, 1, 3, 2\n*ELSET, ELSET=FOOT\n7,\n*NSET, NSET=BASE",
        )
        .replace("1, F1, 25, 0.008", "FOOT, F, 25, 0.008");
    let input = read_text(&flat).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(input.load, read_text(FILE).unwrap().load);
    assert_eq!(input.mesh.node_sets["FOOT"], [0, 1, 2]);
    assert_eq!(input.mesh.elements.len(), 1);
    let named = FILE
        .replace("*NSET, NSET=BASE", "*SURFACE, NAME=FOOT, TYPE=ELEMENT\nBODY, S1\n*NSET, NSET=BASE")
        .replace("1, F1, 25, 0.008", "FOOT, F, 25, 0.008");
    assert_eq!(read_text(&named).unwrap_or_else(|faults| panic!("{faults}")).load, input.load);
}

mod dialects;
mod scales;
mod sources;

mod any_text {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A file with a lost, doubled or shortened line is either accepted or rejected with a message.
        #[test]
        fn a_damaged_file_never_panics(line in 0_usize..40, cut in 0_usize..12, doubled: bool) {
            let mut lines: Vec<&str> = FILE.lines().collect();
            let line = line % lines.len();
            let short = lines[line];
            lines[line] = &short[..cut.min(short.len())];
            if doubled {
                lines.insert(line, short);
            }
            if let Err(faults) = read_text(&lines.join("\n")) {
                prop_assert!(!faults.to_string().is_empty());
            }
        }
    }
}
