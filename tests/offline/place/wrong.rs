//! Wrong input is rejected with a message, and gives no result.

use std::path::Path;

use crate::place::column::{Warming, changed, place, write_inputs};
use crate::place::process::file;

fn home() -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    write_inputs(home.path(), &[Warming::Air]);
    home
}

#[track_caller]
fn refused(home: &Path, arguments: &[&str], words: &[&str]) {
    let answer = place(home, arguments);
    assert!(matches!(answer.code, Some(1 | 2)), "{:?}: {}", answer.code, answer.said);
    assert!(answer.out.is_empty(), "no numbers: {}", answer.out);
    for word in words {
        assert!(answer.said.contains(word), "`{word}` is not in: {}", answer.said);
    }
}

#[test]
fn a_set_that_is_not_there_is_reported_with_those_that_are() {
    let home = home();
    refused(home.path(), &["air.inp", "--guide", "RAIL"], &["no node set RAIL", "GUIDE", "--guide"]);
    refused(home.path(), &["air.inp", "--fixed", "FOOT"], &["no node set FOOT", "BASE", "--fixed"]);
    refused(home.path(), &["air.inp", "--candidates", "OUTER"], &["no node set OUTER", "--candidates"]);
    refused(home.path(), &["air.inp", "--blocks", "PART"], &["no node set begins with PART", "--cut z=450"]);
}

#[test]
fn a_structure_that_nothing_fixes_is_reported_with_both_ways_to_fix_it() {
    let home = home();
    changed(home.path(), |text| text.replace("NSET=BASE", "NSET=FOOT"));
    refused(home.path(), &["air.inp"], &["no node set BASE", "FOOT", "--fixed", "*BOUNDARY"]);
}

#[test]
fn a_cut_that_is_none_is_reported_with_what_would_be_one() {
    let home = home();
    refused(home.path(), &["air.inp", "--cut", "height=3"], &["is not a cut", "z=450"]);
    refused(home.path(), &["air.inp", "--cut", "y=3,5"], &["is not a cut"]);
    refused(home.path(), &["air.inp", "--cut", "y=9000"], &["divides no block", "from 0 to 1500 mm"]);
    refused(home.path(), &["air.inp", "--cut", "y=700:BLK9"], &["this block does not exist", "BLK1, BLK2"]);
}

#[test]
fn blocks_that_overlap_or_leave_nodes_out_are_reported_by_their_nodes() {
    let home = home();
    // The first line of the first block is also in the second one; then it is in none.
    let line = |text: &str| {
        let at = text.find("*NSET, NSET=BLK1\n").unwrap() + "*NSET, NSET=BLK1\n".len();
        text[at..].lines().next().unwrap().to_owned()
    };
    changed(home.path(), |text| {
        let line = line(&text);
        text.replace("*NSET, NSET=BLK2\n", &format!("*NSET, NSET=BLK2\n{line}\n"))
    });
    refused(home.path(), &["air.inp"], &["BLK1 and BLK2 have 10 nodes (", "in common", "exactly one block"]);
    let home = self::home();
    changed(home.path(), |text| {
        let line = line(&text);
        text.replace(&format!("*NSET, NSET=BLK1\n{line}\n"), "*NSET, NSET=BLK1\n")
    });
    refused(home.path(), &["air.inp"], &["10 nodes (", "are in no block (BLK1, ", "to their block"]);
}

#[test]
fn a_block_too_small_for_the_margin_says_what_helps() {
    let home = home();
    refused(
        home.path(),
        &["air.inp", "--margin", "900"],
        &["900 mm away from every other block", "--margin"],
    );
    refused(home.path(), &["air.inp", "--margin", "20,5"], &["decimal point"]);
    refused(home.path(), &["air.inp", "--candidates", "BASE"], &["may carry a sensor", "--candidates"]);
}

#[test]
fn files_of_other_structures_or_of_one_name_are_reported() {
    let home = home();
    let input = std::fs::read_to_string(home.path().join("air.inp")).unwrap();
    let mesh = std::fs::read_to_string(home.path().join("structure.inc")).unwrap();
    file(home.path(), "stiffer.inc", &mesh.replace("110000", "120000"));
    file(home.path(), "other.inp", &input.replace("structure.inc", "stiffer.inc"));
    refused(
        home.path(),
        &["air.inp", "other.inp"],
        &["air and other are not the same structure", "materials differ"],
    );
    refused(home.path(), &["air.inp", "air.inp"], &["a second load case with the name air"]);
    refused(
        home.path(),
        &["air.inp", "--method", "patent", "--case", "night"],
        &["no such load case", "air"],
    );
    refused(home.path(), &["nowhere.inp"], &["nowhere.inp"]);
}

#[test]
fn files_with_different_supports_are_refused() {
    let home = home();
    let input = std::fs::read_to_string(home.path().join("air.inp")).unwrap();
    let (include, rest) = input.split_once('\n').unwrap();
    for (name, set) in [("foot", "BASE"), ("back", "BLK1")] {
        file(home.path(), &format!("{name}.inp"), &format!("{include}\n*BOUNDARY\n{set}, 1, 3\n{rest}"));
    }
    let words = ["foot and back fix different nodes", "the same *BOUNDARY in both", "--fixed"];
    refused(home.path(), &["foot.inp", "back.inp"], &words);
    refused(home.path(), &["air.inp", "foot.inp", "back.inp"], &words);
    let plant = ["foot.inp", "--plant", "back.inp", "--modes", "modes.json"];
    refused(home.path(), &plant, &words);
}

#[test]
fn kelvin_and_celsius_in_one_file_are_refused() {
    let home = home();
    let input = std::fs::read_to_string(home.path().join("air.inp")).unwrap();
    let kelvin = input.replace(", F1, 20, ", ", F1, 293.15, ");
    assert_ne!(input, kelvin);
    file(home.path(), "kelvin.inp", &kelvin);
    let words = ["kelvin.inp:", "*FILM: the sink temperature is 293.15", "plausible in kelvin only"];
    refused(home.path(), &["kelvin.inp"], &words);
}

#[test]
fn a_mesh_of_another_format_is_named_with_its_command() {
    let home = home();
    file(home.path(), "column.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n");
    let words = ["column.msh is a Gmsh mesh", "`gmsh column.msh -save ", "*INCLUDE, INPUT=column.inp"];
    refused(home.path(), &["column.msh"], &words);
}

#[test]
fn a_rider_and_a_plant_that_are_none_are_reported() {
    let home = home();
    refused(home.path(), &["air.inp", "--rider", "head"], &["`head` is not a rider", "head:z=-4.95"]);
    refused(home.path(), &["air.inp", "--rider", "head:w=1"], &["is not a rider"]);
    refused(home.path(), &["air.inp", "--plant", "air.inp"], &["--modes"]);
    refused(home.path(), &["--example", "there", "air.inp"], &["--example"]);
    file(home.path(), "motor.inp", "*HEADING\nmine\n");
    refused(home.path(), &["--example", "."], &["motor.inp exists already", "name another directory"]);
    assert!(!home.path().join("mesh.inp").exists(), "all of it or nothing");
    refused(home.path(), &[], &["CASE.inp"]);
    let other = home.path().join("air.inp");
    let text = std::fs::read_to_string(&other).unwrap().replace("structure.inc", "other.inc");
    file(home.path(), "plant.inp", &text);
    let mesh = std::fs::read_to_string(home.path().join("structure.inc")).unwrap();
    file(home.path(), "other.inc", &mesh.replace("110000", "210000"));
    let asked = ["air.inp", "--plant", "plant.inp", "--modes", "modes.json"];
    refused(home.path(), &asked, &["air and plant are not the same structure", "their materials differ"]);
    let engine = ["air.inp", "--plant", "air.inp", "--modes", "modes.json", "--engine", "ccx"];
    refused(
        home.path(),
        &engine,
        &["--modes needs isotherm's own finite elements", "leave --engine ccx out"],
    );
}
