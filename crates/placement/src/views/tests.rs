use super::*;
use crate::bodies::Column;
use crate::mesh::Kind;

#[test]
fn the_inside_of_a_hollow_column_is_not_seen_from_outside() {
    let mesh = Column::new(120.0, Kind::Tet4).mesh;
    let outside = outside(&mesh, &mesh.node_sets["BASE"]);
    let (low, high) = extent(&mesh);
    let skin = mesh.skin();
    for node in skin {
        let xyz = mesh.xyz[node];
        let on_hull = (0..3).any(|axis| xyz[axis] < low[axis] + 1e-6 || xyz[axis] > high[axis] - 1e-6);
        // The rails protrude from the front. Therefore the front is not on the hull everywhere.
        let at_front = xyz[2] > high[2] - 200.0;
        assert!(!on_hull || outside[node] || xyz[1] < 1e-6, "{xyz:?} lies outside and is not seen");
        assert!(on_hull || at_front || !outside[node], "{xyz:?} lies inside and is seen");
    }
}

#[test]
fn what_is_seen_is_the_nearest() {
    let mesh = Column::new(120.0, Kind::Tet4).mesh;
    let (_, high) = extent(&mesh);
    let heights: Vec<f64> = mesh.xyz.iter().map(|xyz| xyz[1]).collect();
    let top = View::new(&mesh, 1, true);
    let middle = top.at(top.size[0] / 2, top.size[1] / 2).unwrap();
    assert!((middle.of(&heights) - high[1]).abs() < 1e-6);
    assert!((heights[middle.nearest()] - high[1]).abs() < 1e-6);
}
