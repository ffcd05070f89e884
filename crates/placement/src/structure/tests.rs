use nalgebra::DMatrix;

use super::*;
use crate::bodies::{SIZE, at, block, iron};
use crate::body::SILENT;
use crate::mesh::{Element, Kind, NodeId};

/// Displacements of every node in mm under rises of every node in K, by one solution with the forces.
fn displacements(structure: &Structure<'_>, rises: &[f64]) -> Vec<[f64; 3]> {
    let mut forces = Mat::<f64>::zeros(structure.factor.rows(), 1);
    for_each_point(structure.mesh, |element, point, count| {
        let nodes = &structure.mesh.elements[element].nodes;
        let push = structure.push(element) * point.volume;
        let rise: f64 = (0..count).map(|node| point.value[node] * rises[nodes[node]]).sum();
        for (node, gradient) in nodes.iter().zip(&point.gradient) {
            let Some(number) = structure.factor.free()[*node] else { continue };
            for axis in 0..3 {
                forces[(3 * number + axis, 0)] += push * rise * gradient[axis];
            }
        }
    });
    structure.factor.solve(forces.as_mut());
    let at = |node: &Option<usize>| match node {
        Some(number) => [0, 1, 2].map(|axis| forces[(3 * number + axis, 0)]),
        None => [0.0; 3],
    };
    structure.factor.free().iter().map(at).collect()
}

/// Largest stress at any integration point, MPa.
fn worst_stress(mesh: &Mesh, materials: &Materials, moved: &[[f64; 3]], rises: &[f64]) -> f64 {
    let mut worst: f64 = 0.0;
    for_each_point(mesh, |element, point, count| {
        let material = materials.of(element);
        let nodes = &mesh.elements[element].nodes;
        let rise: f64 = (0..count).map(|node| point.value[node] * rises[nodes[node]]).sum();
        let slope = |along: usize, of: usize| -> f64 {
            (0..count).map(|node| point.gradient[node][along] * moved[nodes[node]][of]).sum()
        };
        let shear = material.young / (2.0 * (1.0 + material.poisson));
        let bulk = 2.0 * shear * material.poisson / (1.0 - 2.0 * material.poisson);
        let spread = slope(0, 0) + slope(1, 1) + slope(2, 2) - 3.0 * material.expansion * rise;
        for a in 0..3 {
            let own = slope(a, a) - material.expansion * rise;
            worst = worst.max((2.0 * shear * own + bulk * spread).abs());
            worst = worst.max((shear * (slope(a, (a + 1) % 3) + slope((a + 1) % 3, a))).abs());
        }
    });
    worst
}

/// A tetrahedron on a fixed face can expand in one direction only. It does so by (1 + ν)/(1 − ν) times the free
/// expansion.
#[test]
fn a_tetrahedron_on_a_fixed_face_grows_upwards_as_poisson_has_it() {
    let xyz = vec![[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 7.0, 0.0], [2.0, 3.0, 5.0]];
    let elements = vec![Element { id: 1, kind: Kind::Tet4, nodes: vec![0, 1, 2, 3] }];
    let mesh = Mesh { nodes: (1..=4).map(NodeId).collect(), xyz, elements, ..Mesh::default() };
    let materials = iron(&mesh);
    let structure = Structure::new(&mesh, &materials, &[0, 1, 2], SILENT).unwrap();
    let moved = displacements(&structure, &[10.0; 4])[3];
    let wanted = [0.0, 0.0, 5.0 * 1.1e-4 * 1.26 / 0.74];
    assert!((0..3).all(|axis| (moved[axis] - wanted[axis]).abs() < 1e-15), "{moved:?}, not {wanted:?}");
}

/// A body whose temperature increases with height has no stress. It bends to a quadratic field. This field leaves three
/// corners of the foot, which are on one circle, in place except for a shift.
#[test]
fn quadratic_elements_reproduce_a_quadratic_field_of_displacements_without_stress() {
    let mesh = block(Kind::Tet10);
    let materials = iron(&mesh);
    let fixed = [[0.0; 3], [SIZE[0], 0.0, 0.0], [0.0, SIZE[1], 0.0]].map(|corner| at(&mesh, corner));
    let structure = Structure::new(&mesh, &materials, &fixed, SILENT).unwrap();
    let slope = 0.2;
    let rises: Vec<f64> = mesh.xyz.iter().map(|[_, _, z]| slope * z).collect();
    let moved = displacements(&structure, &rises);
    let bend = 1.1e-5 * slope;
    let radius_squared = (SIZE[0] * SIZE[0] + SIZE[1] * SIZE[1]) / 4.0;
    for (moved, [x, y, z]) in moved.iter().zip(&mesh.xyz) {
        let (x, y) = (x - SIZE[0] / 2.0, y - SIZE[1] / 2.0);
        let wanted = [bend * z * x, bend * z * y, bend * (z * z - x * x - y * y + radius_squared) / 2.0];
        for axis in 0..3 {
            assert!((moved[axis] - wanted[axis]).abs() < 1e-12, "{moved:?}, not {wanted:?}");
        }
    }
    assert!(worst_stress(&mesh, &materials, &moved, &rises) < 1e-8);
}

#[test]
fn adjoints_say_the_same_as_displacements() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mesh = block(kind);
        let materials = iron(&mesh);
        let fixed: Vec<usize> = (0..mesh.nodes.len()).filter(|node| mesh.xyz[*node][1] < 1e-9).collect();
        let structure = Structure::new(&mesh, &materials, &fixed, SILENT).unwrap();
        let guide = [at(&mesh, SIZE), at(&mesh, [0.0, SIZE[1], 0.0]), fixed[0]];
        let adjoint = structure.guideway(&guide, SILENT);
        assert_eq!((adjoint.rows, adjoint.columns), (9, mesh.nodes.len()));
        let rises: Vec<f64> = mesh.xyz.iter().map(|[x, y, z]| 3.0 + (x * 0.1).sin() + y * z * 1e-3).collect();
        let moved = displacements(&structure, &rises);
        let seen = adjoint.displacements(&rises);
        let size = seen.iter().fold(0.0, |most: f64, moved| most.max(moved.abs()));
        assert!(size > 1e-4, "something moves");
        for (place, node) in guide.iter().enumerate() {
            for axis in 0..3 {
                assert!((seen[3 * place + axis] - moved[*node][axis]).abs() < 1e-12 * size.max(1.0));
            }
        }
        // The columns of any division into blocks sum to that of all nodes.
        let (low, high): (Vec<usize>, Vec<usize>) =
            (0..mesh.nodes.len()).partition(|node| mesh.xyz[*node][0] < 30.0);
        let all: Vec<usize> = (0..mesh.nodes.len()).collect();
        let (low, high, all) = (adjoint.block(&low), adjoint.block(&high), adjoint.block(&all));
        (0..9).for_each(|row| assert!((low[row] + high[row] - all[row]).abs() < 1e-15));
    }
}

#[test]
fn the_stiffness_is_symmetric_and_leaves_six_rigid_body_modes() {
    for kind in [Kind::Tet4, Kind::Tet10] {
        let mesh = block(kind);
        let size = 3 * mesh.nodes.len();
        let mut stiffness = DMatrix::<f64>::zeros(size, size);
        for_each_point(&mesh, |element, point, count| {
            let nodes = &mesh.elements[element].nodes;
            for a in 0..count {
                for b in 0..count {
                    let mut part = [[0.0; 3]; 3];
                    elastic(&mut part, point, [a, b], 47_000.0, 43_000.0);
                    for (row, column) in (0..3).flat_map(|row| (0..3).map(move |column| (row, column))) {
                        stiffness[(3 * nodes[a] + row, 3 * nodes[b] + column)] += part[row][column];
                    }
                }
            }
        });
        let most = stiffness.amax();
        let skew = (&stiffness - stiffness.transpose()).amax();
        assert!(skew < 1e-13 * most, "{skew} of {most}");
        let mut modes = stiffness.symmetric_eigenvalues().as_slice().to_vec();
        modes.sort_by(f64::total_cmp);
        assert!(modes[5].abs() < 1e-10 * most && modes[6] > 1e-6 * most, "{:?}", &modes[..8]);
    }
}

/// Returns the error message for a structure that the fixed nodes do not hold.
fn refusal(mesh: &Mesh, fixed: &[usize]) -> String {
    let materials = iron(mesh);
    Structure::new(mesh, &materials, fixed, SILENT).err().unwrap().to_string()
}

#[test]
fn a_structure_that_can_still_move_is_refused_with_how_it_moves() {
    let mesh = block(Kind::Tet10);
    assert!(refusal(&mesh, &[]).contains("no node is fixed"));
    let corner = at(&mesh, [0.0; 3]);
    assert!(refusal(&mesh, &[corner]).contains("which can still turn about a line along"));
    let edge = at(&mesh, [SIZE[0], 0.0, 0.0]);
    assert!(refusal(&mesh, &[corner, edge]).contains("which can still turn about a line along x"));
}

#[test]
fn a_part_that_hangs_on_the_rest_by_an_edge_only_is_refused() {
    let element = |id, nodes: [usize; 4]| Element { id, kind: Kind::Tet4, nodes: nodes.to_vec() };
    let mesh = Mesh {
        nodes: (1..=6).map(NodeId).collect(),
        xyz: vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, -1.0],
        ],
        elements: vec![element(7, [0, 1, 2, 3]), element(8, [0, 1, 4, 5])],
        ..Mesh::default()
    };
    let why = refusal(&mesh, &[0, 1, 2]);
    assert!(
        why.contains("the part with node 1 (4 nodes), which can still turn about a line along x"),
        "{why}"
    );
}
