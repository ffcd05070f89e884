use super::*;

#[test]
fn two_rails_are_one_line_in_their_middle() {
    let rail = |x: f64| [0.0, 300.0, 600.0].map(|y| [x, y, 5.0]);
    let guide: Vec<[f64; 3]> = rail(-190.0).into_iter().chain(rail(190.0)).collect();
    let line = GuideLine::new(&guide, None);
    assert_eq!((line.axis, line.rails), (1, 2));
    assert_eq!(line.guide_mm, [0.0, 300.0, 600.0]);
    let values: Vec<f64> = (0..18).map(f64::from).collect();
    // Nodes 0 and 3 are at the first point. Their z components are in rows 2 and 11.
    assert_eq!(line.mean(&values, 2), [6.5, 9.5, 12.5]);
}

#[test]
fn rails_with_nodes_at_other_heights_are_interpolated_to_all_heights() {
    let guide = [
        [-100.0, 0.0, 0.0],
        [-100.0, 200.0, 0.0],
        [100.0, 0.0, 0.0],
        [100.0, 100.0, 0.0],
        [100.0, 200.0, 0.0],
    ];
    let line = GuideLine::new(&guide, None);
    assert_eq!(line.guide_mm, [0.0, 100.0, 200.0]);
    let moved = [0.0, 4.0, 0.0, 0.0, 0.0].map(|x| [x, 0.0, 0.0]).concat();
    assert_eq!(line.mean(&moved, 0), [0.0, 1.0, 2.0]);
}

#[test]
fn a_single_line_of_nodes_is_one_rail() {
    let guide = [[0.0, 3.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]];
    let line = GuideLine::new(&guide, None);
    assert_eq!((line.rails, line.guide_mm), (1, vec![1.0, 2.0, 3.0]));
}
