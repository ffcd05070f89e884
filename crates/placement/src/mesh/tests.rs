use super::*;

/// Two tetrahedra with one common face.
fn pair() -> Mesh {
    let element = |id, nodes: [usize; 4]| Element { id, kind: Kind::Tet4, nodes: nodes.to_vec() };
    Mesh {
        nodes: [1, 2, 5, 7, 9].map(NodeId).to_vec(),
        xyz: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]],
        elements: vec![element(1, [0, 1, 2, 3]), element(2, [1, 4, 2, 3])],
        ..Mesh::default()
    }
}

#[test]
fn the_common_face_of_two_elements_is_not_outside() {
    let mesh = pair();
    let outer = mesh.outer_faces();
    assert_eq!(outer.len(), 6);
    assert!(outer.iter().all(|face| mesh.face_key(&mesh.elements[face.element], face.side) != [1, 2, 3]));
    assert_eq!(mesh.skin(), [0, 1, 2, 3, 4]);
}

#[test]
fn a_node_is_found_by_its_number_in_the_file() {
    assert_eq!(pair().place(NodeId(7)), Some(3));
    assert_eq!(pair().place(NodeId(6)), None);
}
