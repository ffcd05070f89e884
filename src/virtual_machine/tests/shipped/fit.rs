//! Least squares with any number of columns.

/// Best fit, and the RMS of its residuals.
#[derive(Debug)]
pub(super) struct Fit {
    pub(super) coefficients: Vec<f64>,
    pub(super) rms: f64,
}

/// Finds coefficients for `Σ column · coefficient ≈ target`, with one row for each sample. Columns are scaled first,
/// because µm, K and mm·K differ by factors of thousands.
pub(super) fn least_squares(rows: &[Vec<f64>], target: &[f64]) -> Fit {
    let columns = rows[0].len();
    let norm = |column: usize| rows.iter().map(|row| row[column].powi(2)).sum::<f64>().sqrt().max(1e-12);
    let norms: Vec<f64> = (0..columns).map(norm).collect();
    let mut system = vec![vec![0.0; columns + 1]; columns];
    for (row, target) in rows.iter().zip(target) {
        for (i, line) in system.iter_mut().enumerate() {
            let own = row[i] / norms[i];
            for (j, norm) in norms.iter().enumerate() {
                line[j] += own * row[j] / norm;
            }
            line[columns] += own * target;
        }
    }
    let scaled = solve(system);
    let coefficients: Vec<f64> = scaled.iter().zip(&norms).map(|(value, norm)| value / norm).collect();
    let rms = rms(&left(rows, &coefficients, target));
    Fit { coefficients, rms }
}

/// Residuals with these coefficients.
pub(super) fn left(rows: &[Vec<f64>], coefficients: &[f64], target: &[f64]) -> Vec<f64> {
    let of = |row: &Vec<f64>| row.iter().zip(coefficients).map(|(x, c)| x * c).sum::<f64>();
    rows.iter().zip(target).map(|(row, target)| target - of(row)).collect()
}

/// Root mean square.
pub(super) fn rms(values: &[f64]) -> f64 {
    let count = f64::from(u32::try_from(values.len()).unwrap());
    (values.iter().map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// Gaussian elimination with pivoting. The last column is the right-hand side.
fn solve(mut system: Vec<Vec<f64>>) -> Vec<f64> {
    let size = system.len();
    for column in 0..size {
        let pivot =
            (column..size).max_by(|a, b| system[*a][column].abs().total_cmp(&system[*b][column].abs()));
        system.swap(column, pivot.unwrap());
        let line = system[column].clone();
        assert!(line[column].abs() > 1e-14, "two columns are the same");
        for (row, other) in system.iter_mut().enumerate() {
            if row != column {
                let factor = other[column] / line[column];
                other.iter_mut().zip(&line).for_each(|(value, pivot)| *value -= factor * pivot);
            }
        }
    }
    (0..size).map(|row| system[row][size] / system[row][row]).collect()
}

#[test]
fn least_squares_finds_what_the_samples_were_made_of() {
    let rows: Vec<Vec<f64>> =
        (0..50).map(f64::from).map(|x| vec![x, 1000.0 * (x * 0.3).sin(), 1.0]).collect();
    let target: Vec<f64> = rows.iter().map(|row| 2.5 * row[0] - 0.004 * row[1] + 7.0).collect();
    let fit = least_squares(&rows, &target);
    for (found, made) in fit.coefficients.iter().zip([2.5, -0.004, 7.0]) {
        assert!((found - made).abs() < 1e-9, "{found} {made}");
    }
    assert!(fit.rms < 1e-9);
}
