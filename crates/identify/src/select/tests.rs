//! A plant whose truth is known: the bearing and the spindle nose warm alike and bend the column after 25 minutes, the
//! oil acts at once, the guard and the lamp do nothing.

use std::path::PathBuf;
use std::time::Duration;

use super::*;
use crate::dataset::{Column, Dataset, Kind, Run};
use crate::setup::Choice;
use isotherm_core::quantity::Moment;

const NAMES: [&str; 6] = ["guard", "bearing", "nose", "oil", "lamp", "z_error_um"];

/// Repeatable noise between −1 and 1.
fn noise(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    f64::from(u32::try_from(*seed >> 33).unwrap()) / f64::from(1_u32 << 30) - 1.0
}

fn day(number: u32) -> Run {
    let mut seed = u64::from(number) + 7;
    let mut values = vec![Vec::new(); NAMES.len()];
    let (mut bearing, mut bent, mut oil, mut guard, mut lamp) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let times: Vec<Moment> = (0..360).map(|minute| Moment::from_nanos(minute * 60_000_000_000)).collect();
    for minute in 0..360_u32 {
        let power =
            if (minute / (60 + 10 * number)).is_multiple_of(2) { 8.0 + f64::from(number) } else { 0.0 };
        let pump = if (minute / (35 + 7 * number)) % 2 == 1 { 6.0 } else { 0.0 };
        bearing += (power - bearing) / 15.0;
        bent += (bearing - bent) / 25.0;
        oil += (pump - oil) / 20.0;
        guard += 0.08 * noise(&mut seed);
        lamp += 0.08 * noise(&mut seed);
        let error = 3.0 * bent - 2.0 * oil + 0.05 * noise(&mut seed);
        let nose = bearing + 0.4 * noise(&mut seed);
        for (column, value) in values.iter_mut().zip([guard, bearing, nose, oil, lamp]) {
            // A reading never stands quite still.
            column.push(20.0 + value + 0.01 * noise(&mut seed));
        }
        values[5].push(error);
    }
    Run::recorded(format!("day {number}"), PathBuf::from("day.csv"), times, values)
}

fn week() -> Dataset {
    let kind = |name: &str| if name.ends_with("um") { Kind::Displacement } else { Kind::Temperature };
    let columns = NAMES.iter().map(|name| Column { name: (*name).to_owned(), kind: kind(name) }).collect();
    Dataset { columns, runs: (0..6).map(day).collect(), ..Dataset::default() }
}

fn choice() -> Choice {
    Choice { error: Some("z_error_um".to_owned()), resample: Duration::from_secs(60), ..Choice::default() }
}

fn found(settings: &Settings) -> Selected {
    let week = week();
    let pointed = points(&week, &choice()).unwrap();
    select(&pointed, settings, &|_, _| {}).unwrap()
}

#[test]
fn the_points_that_make_the_error_are_kept_and_no_other() {
    let found = found(&Settings::default());
    let mut kept = found.recommended.points.clone();
    kept.sort();
    assert_eq!(kept, ["bearing", "oil"], "{}", found.recommended.why);
    assert_eq!(found.recommended.k, 2);
    assert!(
        found.recommended.chosen_in.values().all(|times| *times >= 5),
        "{:?}",
        found.recommended.chosen_in
    );
    assert_eq!(found.recommended.alike["bearing"], ["nose"]);
    let (bare, two) = (&found.by_count[0], &found.by_count[2]);
    assert!(two.means.mean_rmse_um < 0.1 * bare.means.mean_rmse_um, "{two:?} {bare:?}");
}

#[test]
fn without_points_the_error_is_that_of_the_bare_machine() {
    let found = found(&Settings::default());
    let bare: f64 = found.runs.iter().map(|run| run.uncompensated_rmse_um).sum::<f64>() / 6.0;
    assert!((found.by_count[0].means.mean_rmse_um - bare).abs() < 1e-12);
    assert_eq!(found.by_count.len(), 6);
    assert_eq!(found.all_points.k, 5);
    // Each of five points in turn ends where all of them are.
    assert!((found.by_count[5].means.mean_rmse_um - found.all_points.means.mean_rmse_um).abs() < 1e-9);
    assert!(found.all_points.points.contains(&"lamp".to_owned()));
}

#[test]
fn twins_are_one_group_and_thresholds_are_those_asked_for() {
    let found = found(&Settings { groups: vec![0.95, 0.0], ..Settings::default() });
    let group = |place: usize, name: &str| {
        found.groups[place].groups.iter().find(|group| group.iter().any(|own| own == name)).unwrap().len()
    };
    assert_eq!((group(0, "nose"), group(0, "oil"), group(0, "lamp")), (2, 1, 1));
    assert_eq!(found.groups[1].groups.len(), 1);
    assert_eq!(found.groups[1].groups[0].len(), 5);
}

#[test]
fn correlation_has_the_sign_of_the_error_and_grades_lie_between_0_and_1() {
    let found = found(&Settings::default());
    let point = |name: &str| found.points.iter().find(|point| point.name == name).unwrap();
    assert!(point("bearing").correlation > 0.4, "{:?}", found.points);
    assert!(point("oil").correlation < 0.0, "{:?}", found.points);
    assert!(found.points.iter().all(|point| (0.0..=1.0).contains(&point.grey_grade)), "{:?}", found.points);
    assert!(found.points.windows(2).all(|pair| pair[0].correlation.abs() >= pair[1].correlation.abs()));
    assert!(point("bearing").grey_grade > point("lamp").grey_grade, "{:?}", found.points);
}

#[test]
fn partial_f_takes_the_sources_in_and_stops() {
    let found = found(&Settings::default());
    let first: Vec<&str> = found.stepwise.steps.iter().take(2).map(|step| step.point.as_str()).collect();
    assert!(first.iter().any(|point| ["bearing", "nose"].contains(point)), "{:?}", found.stepwise);
    assert!(
        found.stepwise.steps.iter().all(|step| !step.comes_in || step.chance < 0.01),
        "{:?}",
        found.stepwise
    );
    assert!((found.stepwise.samples - 72.0).abs() < 0.5, "{}", found.stepwise.samples);
    // Everything that is not in is not significant.
    assert!(found.stepwise.next.as_ref().is_some_and(|next| next.chance >= 0.01), "{:?}", found.stepwise);
}

/// The bearing stands still from the first of these rows of day 2 to before the second.
fn with_frozen_bearing(from: usize, to: usize) -> Dataset {
    let mut week = week();
    let at = week.runs[2].values[1].at(from);
    week.runs[2].values[1].change(|values| values[from..to].fill(at));
    week
}

#[test]
fn a_frozen_point_stays_in_and_its_rows_are_masked_unless_it_is_kept() {
    let week = with_frozen_bearing(30, 150);
    let masked = points(&week, &choice()).unwrap();
    assert_eq!(masked.notes.excluded, []);
    assert!(masked.campaign.inputs.iter().any(|input| input.name == "bearing"));
    let own = masked.notes.remarks.iter().find(|remark| remark.starts_with("bearing frozen from 0:30 h to"));
    assert!(own.is_some_and(|remark| remark.contains("masked")), "{:?}", masked.notes.remarks);
    let rows = masked.campaign.masked(2);
    assert!(!rows[30] && rows[31..150].iter().all(|masked| *masked) && !rows[150], "the first row is true");
    assert!(!masked.campaign.masked(1).contains(&true));
    let kept = points(&week, &Choice { keep: vec!["bearing".to_owned()], ..choice() }).unwrap();
    assert!(kept.notes.excluded.is_empty());
    assert!(
        kept.notes.remarks[0].contains("is used as requested, although it was found faulty: frozen from"),
        "{:?}",
        kept.notes.remarks
    );
    assert!(!kept.campaign.masked(2).contains(&true));
}

#[test]
fn a_point_that_was_frozen_for_most_of_a_run_is_rebuilt_so_that_the_run_stays() {
    let week = with_frozen_bearing(20, 360);
    let rebuilt = points(&week, &choice()).unwrap();
    assert_eq!(rebuilt.notes.excluded, []);
    let told = rebuilt.notes.remarks.join("; ");
    assert!(told.contains("to the end") && told.contains("rebuilt, mostly from nose"), "{told}");
    assert!(!rebuilt.campaign.masked(2).contains(&true));
}

#[test]
fn wrong_choices_are_reported_all_at_once_with_what_to_do() {
    let week = week();
    let said = |choice: &Choice| points(&week, choice).unwrap_err().to_string();
    let wrong = Choice { error: Some("z_eror_um".to_owned()), inputs: vec!["bering".to_owned()], ..choice() };
    let reported = said(&wrong);
    assert!(
        reported
            .contains("no log has a column `z_eror_um` that contains numbers; did you mean `z_error_um`?"),
        "{reported}"
    );
    assert!(reported.contains("`bering` that contains numbers; did you mean `bearing`?"), "{reported}");
    let reported = said(&Choice { inputs: vec!["oil".to_owned()], ..choice() });
    assert!(
        reported.contains("only 1 of the temperature points can be used") && reported.contains("--inputs"),
        "{reported}"
    );
    let mut one = week.clone();
    one.runs.truncate(1);
    let reported = points(&one, &choice()).unwrap_err().to_string();
    assert!(reported.contains("only one run") && reported.contains("--gap"), "{reported}");
}
