//! FE input files that CalculiX reads itself: `place` and CalculiX must give the same displacements.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::place::calculix::{Referee, answers, relative};
use crate::place::column::{Warming, place, write_inputs};
use crate::place::process::file;

/// Relative tolerance. CalculiX prints seven digits, and solves a coupled step by iteration.
const AGREED: f64 = 1e-5;

/// Writes a coupled load case whose supports are ten nodes at the top, although the mesh has a set named `BASE`. The
/// initial temperatures and sinks are in kelvin if `in_kelvin`.
fn write_coupled(home: &Path, name: &str, in_kelvin: bool) {
    write_inputs(home, &[Warming::Spindle]);
    let mesh = std::fs::read_to_string(home.join("structure.inc")).unwrap();
    let (_, top) = mesh.split_once("*NSET, NSET=BLK4\n").unwrap();
    let held = top.lines().next().unwrap().split(',').map(str::trim).filter(|node| !node.is_empty());
    let supports: String = held.map(|node| format!("{node}, 1, 3\n")).collect();
    let input = std::fs::read_to_string(home.join("spindle.inp")).unwrap();
    let (include, rest) = input.split_once('\n').unwrap();
    let coupled = "*COUPLED TEMPERATURE-DISPLACEMENT, STEADY STATE";
    let mut rest = rest
        .replace("*HEAT TRANSFER, STEADY STATE", coupled)
        .replace("*STEP, INC=1000000", "*STEP, NLGEOM=NO, INC=1000000")
        .replace("*END STEP", "*NODE PRINT, NSET=GUIDE\nU\n*END STEP");
    assert!(rest.contains(coupled) && rest.contains("NODE PRINT"), "{rest}");
    if in_kelvin {
        // All temperatures of this load case are 20 °C: `NODE, 20` and `ELEMENT, SIDE, 20, COEFFICIENT`.
        let lines = rest.lines().map(|line| {
            let film = line.split(", ").count() == 4 && line.contains(", F");
            match line.strip_suffix(", 20") {
                Some(node) => format!("{node}, 293.15\n"),
                None if film => format!("{}\n", line.replacen(", 20, ", ", 293.15, ", 1)),
                None => format!("{line}\n"),
            }
        });
        rest = lines.collect();
    }
    file(home, &format!("{name}.inp"), &format!("{include}\n*BOUNDARY\n{supports}{rest}"));
}

/// Displacements of the guideway by `place`, mm, with the node of each three of them.
fn placed(home: &Path, name: &str) -> (Vec<u64>, Vec<f64>) {
    let answer = place(home, &[format!("{name}.inp").as_str(), "--json"]);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let found: Value = serde_json::from_str(&answer.out).unwrap();
    let nodes = found["guide_nodes"].as_array().unwrap().iter().map(|node| node.as_u64().unwrap());
    let moved = found["cases"][name]["delta1_mm"].as_array().unwrap().iter();
    (nodes.collect(), moved.map(|moved| moved.as_f64().unwrap()).collect())
}

/// Displacements of these nodes that CalculiX computes from the file `case.inp` itself, mm.
fn computed(home: &Path, referee: Referee, nodes: &[u64]) -> Vec<f64> {
    let _ = std::fs::remove_file(home.join("case.dat"));
    let done = Command::new(referee.program).args(["-i", "case"]).current_dir(home).output().unwrap();
    let printed = String::from_utf8_lossy(&done.stdout);
    assert!(printed.contains("Job finished"), "{}: {printed}", referee.name);
    let results = std::fs::read_to_string(home.join("case.dat")).unwrap();
    let by_node: BTreeMap<u64, Vec<f64>> = results
        .lines()
        .filter_map(|line| {
            let mut fields = line.split_whitespace();
            let node = fields.next()?.parse().ok()?;
            Some((node, fields.filter_map(|field| field.parse().ok()).collect()))
        })
        .collect();
    nodes.iter().flat_map(|node| by_node[node].iter().copied()).collect()
}

#[test]
fn a_coupled_deck_with_its_own_supports_gives_the_displacements_of_calculix() {
    let home = tempfile::tempdir().unwrap();
    write_coupled(home.path(), "case", false);
    // The kept figures are found by the whole input, which is therefore one file.
    let mesh = std::fs::read_to_string(home.path().join("structure.inc")).unwrap();
    let input = std::fs::read_to_string(home.path().join("case.inp")).unwrap();
    file(home.path(), "case.inp", &input.replacen("*INCLUDE, INPUT=structure.inc\n", &mesh, 1));
    let (nodes, own) = placed(home.path(), "case");
    let ask = |referee: Referee| computed(home.path(), referee, &nodes);
    for (referee, theirs) in answers("displacements of a coupled deck", ask) {
        let apart = relative(&own, &theirs);
        assert!(apart < AGREED, "{referee}: {apart:e}");
    }
}

#[test]
fn a_deck_in_kelvin_gives_the_displacements_of_the_deck_in_celsius() {
    let home = tempfile::tempdir().unwrap();
    write_coupled(home.path(), "celsius", false);
    let (_, celsius) = placed(home.path(), "celsius");
    write_coupled(home.path(), "kelvin", true);
    let text = std::fs::read_to_string(home.path().join("kelvin.inp")).unwrap();
    assert!(text.contains(", 293.15\n") && text.contains(", 293.15, "), "all temperatures are in kelvin");
    let (_, kelvin) = placed(home.path(), "kelvin");
    let apart = relative(&celsius, &kelvin);
    assert!(apart < 1e-9, "{apart:e}");
}
