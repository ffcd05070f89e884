//! Comparison of the modes with the full finite-element model.

use std::collections::BTreeMap;

use super::*;
use crate::bodies::{Column, Warming};
use crate::body::{Film, SILENT};
use crate::fe_input::SurfaceNames;
use crate::heat::temperatures;
use crate::mesh::Kind;
use crate::structure::Structure;

const COLD: f64 = 20.0;

/// Column with films outside, inside and around its foot, and heat at its front and its top.
fn plant(kind: Kind) -> FeInput {
    let Column { mesh, materials } = Column::new(160.0, kind);
    let column = Column { mesh, materials };
    let load = column.load(Warming::All);
    let name = |film: &Film| if film.coefficient > 0.05 { "coolant" } else { "air" }.to_owned();
    let films = load.films.iter().map(name).collect();
    let fluxes = load.fluxes.iter().map(|flux| match flux {
        Flux::Face(_, heat) if *heat > 3.0 => "spindle".to_owned(),
        _ => "motor".to_owned(),
    });
    let surfaces = SurfaceNames { films, fluxes: fluxes.collect() };
    let Column { mesh, materials } = column;
    FeInput { name: "plant".to_owned(), mesh, materials, load, surfaces, supports: vec![] }
}

/// Load case with one input: 100 W in a port, or 5 K in a sink.
fn step(plant: &FeInput, input: &str, modes: &Modes) -> LoadCase {
    let mut load = plant.load.clone();
    for (film, name) in load.films.iter_mut().zip(&plant.surfaces.films) {
        film.sink = COLD + if name == input { 5.0 } else { 0.0 };
    }
    let fluxes = load.fluxes.iter().zip(&plant.surfaces.fluxes).filter(|(_, name)| *name == input);
    load.fluxes = fluxes.map(|(flux, _)| *flux).collect();
    if modes.ports.contains_key(input) {
        let nodes = vec![0.0; plant.mesh.nodes.len()];
        let system = Heat::of(&plant.mesh, &plant.materials, &load).unwrap().conduction;
        let mut heat = nodes;
        add_fluxes(&plant.mesh, &load.fluxes, &system, &mut heat);
        let all: f64 = heat.iter().sum();
        for flux in &mut load.fluxes {
            let Flux::Face(_, heat) = flux else { continue };
            *heat *= 100_000.0 / all;
        }
    }
    load
}

/// Rises of all nodes by the modes for the same input, after this time in seconds.
fn answer(modes: &Modes, input: &str, seconds: f64) -> Vec<f64> {
    let (drives, size) = match modes.ports.get(input) {
        Some(port) => (port, 100.0),
        None => (&modes.sinks[input], 5.0),
    };
    let mut rises = vec![0.0; modes.shapes[0].len()];
    for ((rate, drive), shape) in modes.rates.iter().zip(drives).zip(&modes.shapes) {
        let amount = size * drive * -(-rate * seconds).exp_m1() / rate;
        rises.iter_mut().zip(shape).for_each(|(rise, value)| *rise += amount * value);
    }
    rises
}

#[test]
fn every_input_does_to_every_node_and_the_guideway_what_it_does_to_the_whole() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let plant = plant(kind);
        let modes = Modes::of(&plant, SILENT).unwrap();
        let sets = &plant.mesh.node_sets;
        let structure = Structure::new(&plant.mesh, &plant.materials, &sets["BASE"], SILENT).unwrap();
        let adjoint = structure.guideway(&sets["GUIDE"], SILENT);
        for input in ["air", "coolant", "spindle", "motor"] {
            let load = step(&plant, input, &modes);
            // The full model uses implicit steps. They must be short, because their own error would be visible
            // otherwise.
            for (period, steps) in [(60.0, 60.0), (600.0, 120.0), (3600.0, 120.0), (28_800.0, 240.0)] {
                let case = Case::Transient { step: period / steps, period };
                let load = LoadCase { case, ..load.clone() };
                let whole = temperatures(&plant.mesh, &plant.materials, &load, SILENT).unwrap();
                let reduced = answer(&modes, input, period);
                let most = whole.iter().fold(0.0, |most: f64, rise| most.max(rise.abs()));
                let far = whole.iter().zip(&reduced).map(|(whole, reduced)| (whole - reduced).abs());
                let far = far.fold(0.0, f64::max);
                assert!(far < 0.01 * most + 0.02, "{input}, {period} s: {far} K of {most}");
                let moved = |rises: &[f64]| adjoint.displacements(rises);
                let (whole, reduced) = (moved(&whole), moved(&reduced));
                let most = whole.iter().fold(0.0, |most: f64, mm| most.max(mm.abs()));
                let far = whole.iter().zip(&reduced).map(|(whole, reduced)| (whole - reduced).abs());
                let far = far.fold(0.0, f64::max);
                assert!(far < 0.01 * most + 5e-5, "{input}, {period} s: {far} mm of {most}");
            }
        }
    }
}

#[test]
fn a_uniform_rise_stays_one_and_what_comes_in_is_stored_or_goes_out() {
    let plant = plant(Kind::Tet10);
    let modes = Modes::of(&plant, SILENT).unwrap();
    // If all sinks are 1 K warmer, every node finally is too. In reverse, the heat that a mode loses flows into the
    // sinks only.
    for (place, (rate, uniform)) in modes.rates.iter().zip(&modes.uniform).enumerate() {
        let drawn: f64 = modes.sinks.values().map(|sink| sink[place]).sum();
        assert!(
            (rate * uniform - drawn).abs() < 1e-9 * rate.max(1.0),
            "mode {place}: {rate} {uniform} {drawn}"
        );
    }
    let everywhere =
        |node: usize| modes.shapes.iter().zip(&modes.uniform).map(|(s, u)| s[node] * u).sum::<f64>();
    assert!((0..modes.shapes[0].len()).all(|node| (everywhere(node) - 1.0).abs() < 1e-7));
    for (name, port) in &modes.ports {
        let stored: f64 = modes.uniform.iter().zip(port).map(|(uniform, port)| uniform * port).sum();
        assert!((stored - 1.0).abs() < 1e-9, "{name}: of a joule {stored} are stored");
    }
    let drawn: f64 = modes.uniform.iter().zip(&modes.sinks["coolant"]).map(|(one, sink)| one * sink).sum();
    let mut film = 0.0;
    for coolant in plant.load.films.iter().filter(|film| film.coefficient > 0.05) {
        film_heat(&plant.mesh, coolant, |_, heat| film += MILLI * heat);
    }
    assert!((drawn / film - 1.0).abs() < 1e-9, "film times area: {drawn} and {film} W/K");
    assert!(modes.rates.iter().all(|rate| *rate > 0.0), "nothing grows by itself");
    assert!(modes.rates.len() < 40, "{} modes", modes.rates.len());
}

#[test]
fn other_heat_and_one_name_for_two_things_are_refused() {
    let mut held = plant(Kind::Tet4);
    held.load.held = vec![(0, 20.0)];
    let error = Modes::of(&held, SILENT).unwrap_err().to_string();
    assert!(error.starts_with("*BOUNDARY is not allowed in the plant"), "{error}");
    let mut twice = plant(Kind::Tet4);
    twice.surfaces.films.iter_mut().for_each(|name| "motor".clone_into(name));
    let error = Modes::of(&twice, SILENT).unwrap_err().to_string();
    assert!(error.starts_with("`motor` is both a film and a flux"), "{error}");
}

#[test]
fn a_port_without_heat_is_refused() {
    let mut cold = plant(Kind::Tet4);
    cold.load.fluxes.iter_mut().for_each(|flux| match flux {
        Flux::Face(_, heat) | Flux::Volume(_, heat) => *heat = 0.0,
    });
    let error = Modes::of(&cold, SILENT).unwrap_err().to_string();
    assert!(error.contains("the sum of its fluxes is zero") && error.contains("*DFLUX"), "{error}");
}

#[test]
fn the_example_is_one_structure_whose_rails_are_heated_where_they_are() {
    let files: BTreeMap<String, String> = crate::example::files().into_iter().collect();
    let home = tempfile::tempdir().unwrap();
    for (name, text) in &files {
        std::fs::write(home.path().join(name), text).unwrap();
    }
    let plant = crate::fe_input::read(&home.path().join("plant.inp")).unwrap_or_else(|e| panic!("{e}"));
    let modes = Modes::of(&plant, SILENT).unwrap();
    let ports: Vec<&str> = modes.ports.keys().map(String::as_str).collect();
    assert_eq!(ports, ["cabinet_wall", "motor_foot", "rails_1", "rails_2", "rails_3", "rails_4", "rails_5"]);
    let sinks: Vec<&str> = modes.sinks.keys().map(String::as_str).collect();
    assert_eq!(sinks, ["air_high", "air_low", "covers", "foot", "inside"]);
    // Film coefficient times area; the foot is a closed surface.
    let foot: f64 = modes.uniform.iter().zip(&modes.sinks["foot"]).map(|(one, sink)| one * sink).sum();
    assert!((foot - 0.7 * 0.56 * 70.0).abs() < 1e-6, "{foot} W/K");
    for case in crate::example::cases() {
        let one = crate::fe_input::read(&home.path().join(format!("{case}.inp")));
        let one = one.unwrap_or_else(|e| panic!("{e}"));
        assert!(one.mesh == plant.mesh && one.materials == plant.materials, "{case}");
    }
}
