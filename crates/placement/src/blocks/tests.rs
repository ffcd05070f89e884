use proptest::prelude::*;

use super::*;
use crate::bodies::Column;

fn column() -> Mesh {
    Column::new(150.0, Kind::Tet4).mesh
}

#[test]
fn a_cut_is_read_as_it_is_written() {
    let cut: Cut = "x = -12.5 : blk3".parse().unwrap();
    assert_eq!(cut, Cut { axis: 0, at: -12.5, of: Some("blk3".to_owned()) });
    assert_eq!(cut.to_string(), "x=-12.5:blk3");
    for wrong in ["", "450", "w=450", "z=", "z=4,5", "z=inf"] {
        assert!(wrong.parse::<Cut>().unwrap_err().contains("write z=450"), "{wrong}");
    }
}

#[test]
fn a_cut_of_one_block_leaves_its_namesakes_alone() {
    let mesh = column();
    let named =
        |name: &str, nodes: std::ops::Range<usize>| Part { name: name.to_owned(), nodes: nodes.collect() };
    let half = mesh.nodes.len() / 2;
    let parts = [named("BLK1", 0..half), named("BLK10", half..mesh.nodes.len())];
    let cut = divided(&mesh, &parts, &"x=0:blk1".parse().unwrap()).unwrap();
    let names: Vec<&str> = cut.iter().map(|part| part.name.as_str()).collect();
    assert_eq!(names, ["BLK1a", "BLK1b", "BLK10"]);
}

#[test]
fn the_volumes_of_all_nodes_are_the_volume_of_the_body() {
    let box_of = |kind| {
        let column = Column::new(150.0, kind).mesh;
        volumes(&column).iter().sum::<f64>()
    };
    let (linear, quadratic) = (box_of(Kind::Tet4), box_of(Kind::Tet10));
    assert!((linear / quadratic - 1.0).abs() < 1e-9, "{linear} {quadratic}");
}

#[test]
fn candidates_keep_their_distance_from_every_other_block() {
    let mesh = column();
    let parts = parts(&mesh, "BLK", &[]).unwrap();
    let reach = Reach { margin: 100.0, allowed: vec![true; mesh.nodes.len()] };
    let blocks = blocks(&mesh, &parts, &reach).unwrap();
    for (place, block) in blocks.iter().enumerate() {
        for candidate in &block.candidates {
            let others = blocks.iter().enumerate().filter(|(other, _)| *other != place);
            for node in others.flat_map(|(_, other)| &other.nodes) {
                let apart = (0..3).map(|axis| (mesh.xyz[*candidate][axis] - mesh.xyz[*node][axis]).powi(2));
                assert!(apart.sum::<f64>().sqrt() >= 100.0 - 1e-9);
            }
        }
    }
}

proptest! {
    /// Any cuts leave every node in exactly one part.
    #[test]
    fn cuts_lose_no_node_and_double_none(planes in prop::collection::vec((0..3_usize, -300.0..1500.0_f64), 1..6)) {
        let mesh = column();
        let mut parts = vec![Part { name: "BLK".to_owned(), nodes: (0..mesh.nodes.len()).collect() }];
        for (axis, at) in planes {
            if let Ok(cut) = divided(&mesh, &parts, &Cut { axis, at, of: None }) {
                parts = cut;
            }
        }
        let mut nodes: Vec<usize> = parts.iter().flat_map(|part| part.nodes.iter().copied()).collect();
        nodes.sort_unstable();
        prop_assert_eq!(nodes, (0..mesh.nodes.len()).collect::<Vec<usize>>());
        prop_assert!(parts.iter().all(|part| !part.nodes.is_empty()));
    }
}
