//! Grey relational grades (Deng 1982): how similar the curve of a point is to the curve of the error.
//!
//! Each curve is divided by its largest absolute value over all runs. The curve of a point is negated if its
//! correlation with the error is negative. Δi(k) = |error(k) − pointi(k)| is the distance of the two curves at row k.
//! Δmin and Δmax are the smallest and largest distance over all points and rows, and ζ = 0.5. Then ξi(k) = (Δmin +
//! ζ·Δmax) / (Δi(k) + ζ·Δmax). The grade of a point is the mean of ξi over the rows.

use crate::bank::Bank;
use crate::statistics::mean;

/// Distinguishing coefficient ζ of the method: weight of the largest distance in the grade.
const DISTINGUISHING: f64 = 0.5;

/// Returns the grey relational grade of each point. The last column of `correlations` belongs to the error.
pub(super) fn grades(bank: &Bank, points: &[usize], correlations: &[Vec<f64>]) -> Vec<f64> {
    let error = scaled(&bank.errors(), 1.0);
    let distances = |point: &usize| {
        let sign = if correlations[*point][points.len()] < 0.0 { -1.0 } else { 1.0 };
        let series = scaled(&bank.rises(bank.plain(*point).unwrap_or(0)), sign);
        error.iter().zip(&series).map(|(error, point)| (error - point).abs()).collect()
    };
    grades_of(&points.iter().map(distances).collect::<Vec<Vec<f64>>>())
}

fn grades_of(distances: &[Vec<f64>]) -> Vec<f64> {
    let all = || distances.iter().flatten().copied();
    let (least, most) = (all().fold(f64::MAX, f64::min), all().fold(0.0, f64::max));
    if most <= 0.0 {
        return vec![1.0; distances.len()];
    }
    let near = |distance: &f64| (least + DISTINGUISHING * most) / (distance + DISTINGUISHING * most);
    distances.iter().map(|own| mean(&own.iter().map(near).collect::<Vec<f64>>())).collect()
}

fn scaled(values: &[f64], sign: f64) -> Vec<f64> {
    let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let scale = if largest > 1e-12 { sign / largest } else { 0.0 };
    values.iter().map(|value| value * scale).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grade_is_dengs_by_hand() {
        // Δmin 0, Δmax 1, ζ 0.5: ξ = 0.5 / (Δ + 0.5).
        let grades = grades_of(&[vec![0.0, 0.5], vec![1.0, 0.5]]);
        assert!((grades[0] - f64::midpoint(1.0, 0.5)).abs() < 1e-12, "{grades:?}");
        assert!((grades[1] - f64::midpoint(1.0 / 3.0, 0.5)).abs() < 1e-12, "{grades:?}");
    }

    #[test]
    fn a_point_that_is_the_error_itself_has_the_grade_one() {
        assert_eq!(grades_of(&[vec![0.0, 0.0]]), [1.0]);
        let grades = grades_of(&[vec![0.0, 0.0], vec![0.2, 0.4]]);
        assert!((grades[0] - 1.0).abs() < 1e-12 && grades[1] < 1.0, "{grades:?}");
    }
}
