//! Comparison of the project's finite elements with CalculiX, an independent program: the same FE input files must give
//! the same numbers.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use isotherm_placement::body::{LoadCase, SILENT};
use isotherm_placement::ccx::{Ccx, CcxError};
use isotherm_placement::heat::temperatures;
use isotherm_placement::mesh::Kind;
use isotherm_placement::structure::Structure;

use crate::bodies;
use crate::support::calculix;

use bodies::{Column, Warming};
use calculix::{AGREED, Referee, answers, referees, relative};

fn engine(referee: Referee) -> Ccx {
    Ccx { program: referee.program.to_owned() }
}

#[test]
fn p_is_what_calculix_computes_by_unit_cases_of_each_block() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let column = Column::new(160.0, kind);
        let sets = &column.mesh.node_sets;
        let (fixed, guide) = (&sets["BASE"], &sets["GUIDE"]);
        let structure = Structure::new(&column.mesh, &column.materials, fixed, SILENT).unwrap();
        let adjoint = structure.guideway(guide, SILENT);
        let blocks: Vec<&Vec<usize>> =
            sets.iter().filter(|(name, _)| name.starts_with("BLK")).map(|(_, nodes)| nodes).collect();
        assert_eq!(blocks.len(), 8);
        let units: Vec<Vec<f64>> = (blocks.iter())
            .map(|block| {
                let mut rises = vec![0.0; column.mesh.nodes.len()];
                block.iter().for_each(|node| rises[*node] = 1.0);
                rises
            })
            .collect();
        let units: Vec<&[f64]> = units.iter().map(Vec::as_slice).collect();
        let ask = |referee: Referee| {
            let columns =
                engine(referee).displacements(&column.mesh, &column.materials, fixed, guide, &units);
            columns.unwrap_or_else(|error| panic!("{}: {error}", referee.name)).concat()
        };
        let ours: Vec<f64> = blocks.iter().flat_map(|block| adjoint.block(block)).collect();
        for (referee, theirs) in answers(&format!("P of a column of {}", kind.name()), ask) {
            let apart = relative(&ours, &theirs);
            assert!(apart < AGREED, "{}, {referee}: {apart:e}", kind.name());
        }
    }
}

#[test]
fn temperatures_and_displacements_of_every_case_are_what_calculix_computes() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let column = Column::new(160.0, kind);
        let sets = &column.mesh.node_sets;
        let structure = Structure::new(&column.mesh, &column.materials, &sets["BASE"], SILENT).unwrap();
        let adjoint = structure.guideway(&sets["GUIDE"], SILENT);
        let mut cases: Vec<(&str, LoadCase)> =
            Warming::EACH.map(|warming| (warming.name(), column.load(warming))).to_vec();
        cases.push(("held, nodal and in the volume", other_loads(&column)));
        for (name, load) in cases {
            let ours = temperatures(&column.mesh, &column.materials, &load, SILENT).unwrap();
            let ask = |referee: Referee| {
                let rises = engine(referee).temperatures(&column.mesh, &column.materials, &load);
                rises.unwrap_or_else(|error| panic!("{}: {error}", referee.name))
            };
            let highest = ours.iter().fold(20.0, |most: f64, rise| most.max(20.0 + rise));
            let question = format!("the temperatures of a column of {}", kind.name());
            for (referee, theirs) in answers(&question, ask) {
                for (ours, theirs) in ours.iter().zip(&theirs) {
                    let apart = (ours - theirs).abs();
                    assert!(
                        apart < AGREED * highest,
                        "{} {name}, {referee}: {ours} and {theirs}",
                        kind.name()
                    );
                }
                let apart = relative(&adjoint.displacements(&ours), &adjoint.displacements(&theirs));
                assert!(apart < AGREED, "{} {name}, {referee}: {apart:e}", kind.name());
            }
        }
    }
}

/// Load case of an hour with kinds of loads that the cases of the column do not contain.
fn other_loads(column: &Column) -> LoadCase {
    let mut load = column.load(Warming::SpindleHour);
    load.held = column.mesh.node_sets["BASE"].iter().map(|node| (*node, 23.0)).collect();
    load.nodal = column.mesh.node_sets["GUIDE"].iter().map(|node| (*node, 900.0)).collect();
    let volume = |element| isotherm_placement::body::Flux::Volume(element, 1e-3);
    load.fluxes.extend((0..40).map(volume));
    load
}

#[test]
fn a_referee_that_is_not_there_is_said_with_how_to_get_it() {
    let column = Column::new(400.0, Kind::Tet4);
    let load = column.load(Warming::Air);
    let missing = Ccx { program: "ccx_that_is_not_there".to_owned() };
    let error = missing.temperatures(&column.mesh, &column.materials, &load).unwrap_err();
    assert!(matches!(error, CcxError::Start { .. }));
    assert!(error.to_string().contains("calculix-ccx"), "{error}");
}

#[test]
fn a_file_that_calculix_gives_up_on_ends_with_what_it_said() {
    let mut column = Column::new(400.0, Kind::Tet4);
    let load = column.load(Warming::Spindle);
    column.materials.list[0].capacity = None;
    let mut load = LoadCase { case: column.load(Warming::SpindleHour).case, ..load };
    load.films.clear();
    for referee in referees("what CalculiX says when it gives up") {
        let error = engine(referee).temperatures(&column.mesh, &column.materials, &load).unwrap_err();
        let said = error.to_string();
        assert!(said.starts_with("CalculiX did not finish: ") && said.contains("density"), "{said}");
    }
}
