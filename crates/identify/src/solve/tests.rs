use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use super::Net;
use crate::gram::Gram;

proptest! {
    /// Optimality conditions: the gradient of an active column equals its penalties, and that of an inactive column is
    /// smaller.
    #[test]
    fn the_elastic_net_meets_its_conditions_also_from_another_answer_on(
        cells in prop::collection::vec(-1.0..1.0f64, 30 * 8),
        wanted in prop::collection::vec(-5.0..5.0f64, 30),
        first in 0.01..1.0f64,
        l2 in 0.003..0.3f64,
    ) {
        // Each second column is nearly equal to the column before it.
        let matrix = DMatrix::from_fn(30, 8, |row, column| {
            cells[row * 8 + column / 2] + 0.01 * cells[row * 8 + 7 - column / 2] * f64::from(u8::from(column % 2 == 1))
        });
        let wanted = DVector::from_vec(wanted);
        let gram = Gram {
            square: matrix.tr_mul(&matrix),
            cross: matrix.tr_mul(&wanted),
            power: wanted.norm_squared(),
            rows: 30.0,
        };
        let (scaled, _) = gram.scaled();
        let mut net = Net::new(&scaled, l2);
        for l1 in [first, 0.3 * first, 0.03 * first, 2.0 * first] {
            let gains = net.at(l1);
            let pull = &scaled.cross - &scaled.square * gains - gains * l2;
            for column in 0..8 {
                if gains[column].abs() > 0.0 {
                    prop_assert!((pull[column] - l1 * gains[column].signum()).abs() < 1e-6, "{gains} {pull}");
                } else {
                    prop_assert!(pull[column].abs() <= l1 * (1.0 + 1e-5), "{gains} {pull}");
                }
            }
        }
    }
}
