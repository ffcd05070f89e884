//! Choice between incomplete runs and incomplete columns. A model cannot use a row in which an input is
//! missing. If some runs lack a column, either these runs or the column must be left out. The choice with the
//! smaller error on held-out runs is used. A remark states both errors.

use crate::dataset::Dataset;
use crate::faults::{MISSING, missing};
use isotherm_profile::counted;

/// Maximum number of groups of runs for which the test also leaves out each group alone. With more groups,
/// the test only leaves out all groups together.
const MOST_GROUPS: usize = 6;
/// Limit of the ratio of two errors: the error without the runs, divided by the error without the columns. Below this
/// limit, the runs are left out. A smaller difference is not significant; in that case, all runs are kept.
const CLEARLY: f64 = 0.98;
/// Maximum number of runs that a remark lists.
const NAMED: usize = 5;

/// Runs that lack the same columns.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Group {
    columns: Vec<usize>,
    runs: Vec<usize>,
}

/// Function that returns the root mean square of the residual error on the given runs of a dataset, µm. Each run is
/// held out in turn. A column that any run lacks is not an input of the model. `None` if the model cannot be tested.
pub(crate) type Left<'a> = &'a dyn Fn(&Dataset, &[usize]) -> Option<f64>;

/// Leaves out the runs that lack some of the columns `inputs`, if the error is then clearly smaller than without these
/// columns. Both errors are calculated on the runs that have all columns. Adds a remark about the choice.
pub(crate) fn leave_out(dataset: &mut Dataset, inputs: &[usize], left: Left<'_>) {
    let groups = groups(dataset, inputs);
    let is_complete = |run: &usize| !groups.iter().any(|group| group.runs.contains(run));
    let complete: Vec<usize> = (0..dataset.runs.len()).filter(is_complete).collect();
    // One complete run cannot be tested by another one.
    if groups.is_empty() || complete.len() < 2 {
        return;
    }
    let mut choices = vec![groups.clone()];
    if (2..=MOST_GROUPS).contains(&groups.len()) {
        choices.extend(groups.iter().map(|group| vec![group.clone()]));
    }
    let without_columns = left(dataset, &complete);
    let tried = choices.into_iter().filter_map(|choice| {
        let runs = runs_of(&choice);
        let kept: Vec<usize> = (0..dataset.runs.len()).filter(|run| !runs.contains(run)).collect();
        let tested: Vec<usize> =
            complete.iter().filter_map(|run| kept.iter().position(|own| own == run)).collect();
        let rest = Dataset {
            columns: dataset.columns.clone(),
            runs: kept.iter().map(|run| dataset.runs[*run].clone()).collect(),
            ..Dataset::default()
        };
        Some((left(&rest, &tested)?, choice))
    });
    let Some((without_runs, choice)) = tried.min_by(|one, other| one.0.total_cmp(&other.0)) else { return };
    let are_runs_left_out = without_columns.is_none_or(|other| without_runs < CLEARLY * other);
    let runs = runs_of(&choice);
    let text = remark(dataset, &choice, (without_runs, without_columns), are_runs_left_out);
    dataset.remarks.push(text);
    if are_runs_left_out {
        let mut place = 0..;
        dataset.runs.retain(|_| place.next().is_none_or(|place| !runs.contains(&place)));
    }
}

fn runs_of(groups: &[Group]) -> Vec<usize> {
    groups.iter().flat_map(|group| group.runs.iter().copied()).collect()
}

/// Groups the incomplete runs by their missing columns. Only columns that at least half of the runs have are
/// considered. All other columns are left out in any case.
fn groups(dataset: &Dataset, inputs: &[usize]) -> Vec<Group> {
    let is_missing = |run: usize, column: usize| missing(&dataset.runs[run], column) > MISSING;
    let runs = 0..dataset.runs.len();
    let mut columns = inputs.to_vec();
    columns.sort_unstable();
    columns.dedup();
    columns.retain(|column| {
        let lacking = runs.clone().filter(|run| is_missing(*run, *column)).count();
        2 * lacking <= runs.len()
    });
    let mut groups: Vec<Group> = Vec::new();
    for run in runs {
        let lacking: Vec<usize> = columns.iter().copied().filter(|column| is_missing(run, *column)).collect();
        match groups.iter_mut().find(|group| group.columns == lacking) {
            _ if lacking.is_empty() => {}
            Some(group) => group.runs.push(run),
            None => groups.push(Group { columns: lacking, runs: vec![run] }),
        }
    }
    groups
}

/// Returns the remark about the choice: whether runs or columns were left out, with the errors of both choices.
fn remark(
    dataset: &Dataset,
    choice: &[Group],
    (without_runs, without_columns): (f64, Option<f64>),
    are_runs_left_out: bool,
) -> String {
    let mut columns: Vec<&str> = Vec::new();
    for column in choice.iter().flat_map(|group| &group.columns) {
        let name = dataset.columns[*column].name.as_str();
        if !columns.contains(&name) {
            columns.push(name);
        }
    }
    let columns = columns.join(", ");
    let all = runs_of(choice);
    let mut runs: Vec<&str> = all.iter().take(NAMED).map(|run| dataset.runs[*run].name.as_str()).collect();
    let more = all.len().saturating_sub(NAMED);
    let counted_more = counted(more, "more run");
    if more > 0 {
        runs.push(&counted_more);
    }
    let (runs, share) = (runs.join(", "), 100.0 * MISSING);
    let without_columns = match without_columns {
        Some(error) => format!("{error:.2} µm without {columns}"),
        None => format!("a model without {columns} cannot be tested"),
    };
    match are_runs_left_out {
        true => format!(
            "left out: {runs}, where more than {share:.0} % of the values of {columns} are missing. The RMS error of \
             held-out runs is {without_runs:.2} µm without {runs}; {without_columns}"
        ),
        false => format!(
            "left out: {columns}, because more than {share:.0} % of the values are missing in {runs}. The RMS \
             error of held-out runs is {without_columns}, and {without_runs:.2} µm without {runs}"
        ),
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::dataset::{Column, Kind, Origin, Run, Series};
    use isotherm_core::quantity::Moment;

    /// Logs of five days with the columns `bed` and `nose`. The function returns whether a day has a column.
    fn logs(has: impl Fn(usize, usize) -> bool) -> Dataset {
        let column = |name: &str| Column { name: name.to_owned(), kind: Kind::Temperature };
        let column_of = |has: bool| Series::from(vec![if has { 20.0 } else { f64::NAN }; 10]);
        let day = |day: usize| Run {
            name: format!("day{day}"),
            file: PathBuf::from("day.csv"),
            times: (0..10).map(|row| Moment::from_nanos(row * 60_000_000_000)).collect(),
            values: Vec::from([0, 1].map(|column| column_of(has(day, column)))),
            origin: Origin::default(),
        };
        let columns = vec![column("bed"), column("nose")];
        Dataset { columns, runs: (0..5).map(day).collect(), ..Dataset::default() }
    }

    fn names(dataset: &Dataset) -> Vec<&str> {
        dataset.runs.iter().map(|run| run.name.as_str()).collect()
    }

    #[test]
    fn the_run_is_left_out_if_that_leaves_less_error() {
        let mut dataset = logs(|day, column| day != 2 || column != 1);
        let left = |dataset: &Dataset, tested: &[usize]| {
            assert_eq!(tested.len(), 4);
            Some(if dataset.runs.len() == 5 { 63.7 } else { 33.5 })
        };
        leave_out(&mut dataset, &[0, 1], &left);
        assert_eq!(names(&dataset), ["day0", "day1", "day3", "day4"]);
        let remark = &dataset.remarks[0];
        assert!(remark.contains("left out: day2") && remark.contains("of nose are missing"), "{remark}");
        assert!(remark.contains("33.50 µm") && remark.contains("63.70 µm without nose"), "{remark}");
    }

    #[test]
    fn the_column_is_left_out_if_the_run_is_worth_more() {
        let mut dataset = logs(|day, column| day != 2 || column != 1);
        leave_out(&mut dataset, &[0, 1], &|dataset, _| {
            Some(if dataset.runs.len() == 5 { 2.0 } else { 1.99 })
        });
        assert_eq!(dataset.runs.len(), 5);
        assert!(dataset.remarks[0].starts_with("left out: nose"), "{:?}", dataset.remarks);
    }

    #[test]
    fn one_of_several_incomplete_runs_may_be_left_out() {
        let mut dataset = logs(|day, column| (day, column) != (1, 0) && (day, column) != (2, 1));
        let left = |dataset: &Dataset, _: &[usize]| {
            let without_the_second = !dataset.runs.iter().any(|run| run.name == "day2");
            Some(if without_the_second && dataset.runs.len() == 4 { 1.0 } else { 5.0 })
        };
        leave_out(&mut dataset, &[0, 1], &left);
        assert_eq!(names(&dataset), ["day0", "day1", "day3", "day4"]);
    }

    #[test]
    fn logs_with_all_columns_are_not_changed() {
        let mut dataset = logs(|_, _| true);
        leave_out(&mut dataset, &[0, 1], &|_, _| panic!("nothing must be tested"));
        // A column that few runs have is no reason to leave the others out.
        dataset.runs.iter_mut().skip(2).for_each(|run| run.values[1] = Series::missing(10));
        leave_out(&mut dataset, &[0, 1], &|_, _| panic!("nothing must be tested"));
        assert_eq!((dataset.runs.len(), dataset.remarks.len()), (5, 0));
    }
}
