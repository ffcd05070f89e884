use nalgebra::DMatrix;

use super::*;
use crate::bodies::{SIZE, at, block, calm, iron, on_surface};
use crate::body::{Film, SILENT};
use crate::mesh::Kind;

fn rises(mesh: &Mesh, load: &LoadCase) -> Vec<f64> {
    temperatures(mesh, &iron(mesh), load, SILENT).unwrap()
}

/// Outer faces with all corners at `value` along `axis`.
fn faces(mesh: &Mesh, axis: usize, value: f64) -> Vec<Face> {
    let mut faces = mesh.outer_faces();
    faces.retain(|face| {
        let element = &mesh.elements[face.element];
        let nodes = element.kind.face(face.side).iter().map(|place| element.nodes[*place]);
        nodes.into_iter().all(|node| (mesh.xyz[node][axis] - value).abs() < 1e-9)
    });
    assert!(!faces.is_empty());
    faces
}

#[test]
fn conduction_through_a_bar_between_two_temperatures_is_exactly_linear() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mesh = block(kind);
        let mut load = calm(&mesh, Case::Steady);
        for (node, [x, _, _]) in mesh.xyz.iter().enumerate() {
            if *x < 1e-9 || *x > SIZE[0] - 1e-9 {
                load.held.push((node, 20.0 + x));
            }
        }
        for (rise, [x, _, _]) in rises(&mesh, &load).iter().zip(&mesh.xyz) {
            assert!((rise - x).abs() < 1e-10, "{rise} at {x}");
        }
    }
}

/// The thermal resistances of the film and of the bar are in series.
#[test]
fn a_bar_with_a_film_at_one_end_and_a_flux_at_the_other_has_the_temperatures_of_its_resistances() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mesh = block(kind);
        let mut load = calm(&mesh, Case::Steady);
        let film = |face| Film { face, sink: 25.0, coefficient: 0.02 };
        load.films = faces(&mesh, 2, 0.0).into_iter().map(film).collect();
        load.fluxes = faces(&mesh, 2, SIZE[2]).into_iter().map(|face| Flux::Face(face, 1.5)).collect();
        for (rise, [_, _, z]) in rises(&mesh, &load).iter().zip(&mesh.xyz) {
            let wanted = 5.0 + 1.5 / 0.02 + 1.5 * z / 50.0;
            assert!((rise - wanted).abs() < 1e-9, "{rise}, not {wanted}");
        }
    }
}

#[test]
fn quadratic_elements_reproduce_a_quadratic_field_of_temperature() {
    let mesh = block(Kind::Tet10);
    let field = |[x, y, z]: [f64; 3]| 0.02 * x * x - 0.01 * y * y + 0.03 * z * z + 0.015 * x * y - 0.2 * z;
    let mut load = calm(&mesh, Case::Steady);
    load.held = on_surface(&mesh).into_iter().map(|node| (node, 20.0 + field(mesh.xyz[node]))).collect();
    let curvature = 0.04 - 0.02 + 0.06;
    load.fluxes = (0..mesh.elements.len()).map(|element| Flux::Volume(element, -50.0 * curvature)).collect();
    assert!(load.held.len() < mesh.nodes.len(), "some nodes are inside");
    for (rise, xyz) in rises(&mesh, &load).iter().zip(&mesh.xyz) {
        assert!((rise - field(*xyz)).abs() < 1e-9, "{rise} at {xyz:?}");
    }
}

#[test]
fn heat_that_cannot_leave_warms_a_body_by_its_capacity_whatever_the_steps() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mesh = block(kind);
        for (step, period) in [(10.0, 100.0), (30.0, 100.0), (100.0, 100.0)] {
            let mut load = calm(&mesh, Case::Transient { step, period });
            load.fluxes = (0..mesh.elements.len()).map(|element| Flux::Volume(element, 0.145)).collect();
            for rise in rises(&mesh, &load) {
                assert!((rise - 0.145 * 100.0 / 3.625).abs() < 1e-9, "{rise}");
            }
        }
    }
}

#[test]
fn what_enters_at_a_node_leaves_by_the_film() {
    let mesh = block(Kind::Tet10);
    let mut load = calm(&mesh, Case::Steady);
    load.nodal = vec![(at(&mesh, SIZE), 120.0)];
    let film = |face| Film { face, sink: 20.0, coefficient: 0.01 };
    load.films = mesh.outer_faces().into_iter().map(film).collect();
    let rises = rises(&mesh, &load);
    let mut leaves = 0.0;
    for film in &load.films {
        for_each_face_point(&mesh, film.face, |nodes, value, area| {
            let rise: f64 = nodes.iter().enumerate().map(|(place, node)| value[place] * rises[*node]).sum();
            leaves += film.coefficient * area * rise;
        });
    }
    assert!((leaves - 120.0).abs() < 1e-8, "{leaves}");
}

/// A node with a prescribed temperature that differs from its initial one gives heat to its neighbours from the first
/// step on.
#[test]
fn a_body_ends_at_the_temperature_at_which_it_is_held() {
    let mesh = block(Kind::Tet10);
    let mut load = calm(&mesh, Case::Transient { step: 50.0, period: 5000.0 });
    load.held =
        (0..mesh.nodes.len()).filter(|node| mesh.xyz[*node][0] < 1e-9).map(|node| (node, 33.0)).collect();
    for rise in rises(&mesh, &load) {
        assert!((rise - 13.0).abs() < 1e-6, "{rise}");
    }
}

#[test]
fn conduction_is_symmetric_and_leaves_one_field_without_flow() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mesh = block(kind);
        let mut conduction = DMatrix::<f64>::zeros(mesh.nodes.len(), mesh.nodes.len());
        for_each_point(&mesh, |element, point, count| {
            let nodes = &mesh.elements[element].nodes;
            for (a, b) in (0..count).flat_map(|a| (0..count).map(move |b| (a, b))) {
                conduction[(nodes[a], nodes[b])] += point.volume * dot(point.gradient[a], point.gradient[b]);
            }
        });
        let most = conduction.amax();
        assert!((&conduction - conduction.transpose()).amax() < 1e-13 * most);
        let mut modes = conduction.symmetric_eigenvalues().as_slice().to_vec();
        modes.sort_by(f64::total_cmp);
        assert!(modes[0].abs() < 1e-10 * most && modes[1] > 1e-6 * most, "{:?}", &modes[..3]);
    }
}

#[test]
fn a_steady_case_without_a_way_out_for_heat_is_refused() {
    let mesh = block(Kind::Tet4);
    let load = calm(&mesh, Case::Steady);
    let why = temperatures(&mesh, &iron(&mesh), &load, SILENT).unwrap_err().to_string();
    assert!(why.contains("nothing determines the temperature of the part with node 1"), "{why}");
}

#[test]
fn a_transient_case_without_capacity_is_refused() {
    let mesh = block(Kind::Tet4);
    let load = calm(&mesh, Case::Transient { step: 1.0, period: 1.0 });
    let mut materials = iron(&mesh);
    materials.list[0].capacity = None;
    let why = temperatures(&mesh, &materials, &load, SILENT).unwrap_err();
    assert_eq!(why, HeatError::NoCapacity("FC300".to_owned()));
}
