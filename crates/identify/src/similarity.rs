//! Similarity of log columns: correlations over all runs, and groups of correlated columns. A rise is the value of a
//! column minus its reference.

use crate::bank::Bank;
use crate::statistics::mean;

/// Returns the correlation matrix of the rises of these inputs, over the rows of all runs. The last row and the last
/// column of the matrix belong to the error e.
pub(crate) fn correlations(bank: &Bank, inputs: &[usize]) -> Vec<Vec<f64>> {
    let columns = inputs.iter().filter_map(|input| bank.plain(*input));
    let series = columns.map(|column| bank.rises(column)).chain([bank.errors()]);
    let series: Vec<Vec<f64>> = series.map(|values| normalized(&values)).collect();
    let product =
        |one: &[f64], other: &[f64]| one.iter().zip(other).map(|(one, other)| one * other).sum::<f64>();
    series
        .iter()
        .map(|one| series.iter().map(|other| product(one, other).clamp(-1.0, 1.0)).collect())
        .collect()
}

/// Subtracts the mean from the values, and divides them by their norm. If the values are constant, the result is all
/// zeros.
fn normalized(values: &[f64]) -> Vec<f64> {
    let mean = mean(values);
    let length = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>().sqrt();
    let scale = if length > 1e-12 { 1.0 / length } else { 0.0 };
    values.iter().map(|value| (value - mean) * scale).collect()
}

/// Returns groups of members (columns, by their index in `correlations`). Any two members of a group have an
/// absolute correlation of at least `least`. The method is complete linkage: the similarity of two groups is
/// the absolute correlation of their least similar members. Each step joins the two most similar groups.
/// Members are sorted within their group, and groups are sorted by their first member.
pub(crate) fn groups(correlations: &[Vec<f64>], members: usize, least: f64) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = (0..members).map(|member| vec![member]).collect();
    let weakest = |one: &[usize], other: &[usize]| {
        let pairs = one.iter().flat_map(|a| other.iter().map(|b| correlations[*a][*b].abs()));
        pairs.fold(1.0_f64, f64::min)
    };
    loop {
        let mut best: Option<(f64, usize, usize)> = None;
        for one in 0..groups.len() {
            for other in one + 1..groups.len() {
                let alike = weakest(&groups[one], &groups[other]);
                if alike >= least && best.is_none_or(|(most, ..)| alike > most) {
                    best = Some((alike, one, other));
                }
            }
        }
        let Some((_, one, other)) = best else { break };
        let joined = groups.remove(other);
        groups[one].extend(joined);
        groups[one].sort_unstable();
    }
    groups
}

/// Returns the members (columns, by their index in `correlations`) in an order in which similar members are
/// adjacent. The members are sorted by groups of low correlation, and within each group by subgroups of
/// higher correlation.
pub(crate) fn order(correlations: &[Vec<f64>], members: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..members).collect();
    let levels: Vec<Vec<Vec<usize>>> =
        [0.3, 0.5, 0.7, 0.9].iter().map(|least| groups(correlations, members, *least)).collect();
    let place = |member: usize| -> Vec<usize> {
        levels
            .iter()
            .map(|groups| groups.iter().position(|group| group.contains(&member)).unwrap_or(0))
            .collect()
    };
    order.sort_by_key(|member| (place(*member), *member));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Correlations in which 0 and 1 are similar, 2 is opposite to them, and 3 is unrelated.
    fn four() -> Vec<Vec<f64>> {
        vec![
            vec![1.0, 0.95, -0.92, 0.1],
            vec![0.95, 1.0, -0.8, 0.2],
            vec![-0.92, -0.8, 1.0, 0.0],
            vec![0.1, 0.2, 0.0, 1.0],
        ]
    }

    #[test]
    fn every_two_of_a_group_are_correlated_at_least_so() {
        assert_eq!(groups(&four(), 4, 0.9), [vec![0, 1], vec![2], vec![3]]);
        assert_eq!(groups(&four(), 4, 0.7), [vec![0, 1, 2], vec![3]]);
        assert_eq!(groups(&four(), 4, 0.0), [vec![0, 1, 2, 3]]);
    }

    #[test]
    fn the_order_keeps_groups_together() {
        let mut apart = four();
        // 3 and 0 become almost equal.
        for (one, other) in [(0, 3), (3, 0)] {
            apart[one][other] = 0.99;
        }
        let order = order(&apart, 4);
        let place = |member| order.iter().position(|other| *other == member).unwrap();
        assert_eq!(place(3).abs_diff(place(0)), 1, "{order:?}");
    }
}
