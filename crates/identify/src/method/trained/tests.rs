use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::neurons::{self, LENGTHS, length, tanh, train};
use super::{Fold, Samples, about_mean, radial};
use crate::statistics::count;
use isotherm_profile::network;

/// Five runs of forty rows with two rises. The target is the function `truth` of them, with a size of about 1.
fn runs(truth: &dyn Fn(f64, f64, &mut Pcg64Mcg) -> f64) -> Vec<Samples> {
    let mut chance = Pcg64Mcg::seed_from_u64(5);
    let mut run = || {
        let (ends, paces): (Vec<f64>, Vec<f64>) =
            (0..2).map(|_| (chance.random_range(-2.0..2.0), chance.random_range(5.0..30.0))).unzip();
        let rises =
            DMatrix::from_fn(40, 2, |row, input| ends[input] * (1.0 - (-count(row) / paces[input]).exp()));
        let target = rises.row_iter().map(|row| truth(row[0], row[1], &mut chance)).collect::<Vec<f64>>();
        Samples { rises, target: DVector::from_vec(target) }
    };
    (0..5).map(|_| run()).collect()
}

fn folds(runs: &[Samples]) -> Vec<Fold<'_>> {
    let fold = |(number, out): (u64, usize)| {
        let rest: Vec<&Samples> =
            runs.iter().enumerate().filter(|(run, _)| *run != out).map(|(_, run)| run).collect();
        Fold { number, training: Samples::stacked(&rest), held: vec![&runs[out]] }
    };
    (0..).zip(0..runs.len()).map(fold).collect()
}

fn stacked(runs: &[Samples]) -> Samples {
    Samples::stacked(&runs.iter().collect::<Vec<_>>())
}

fn curved(a: f64, b: f64, _: &mut Pcg64Mcg) -> f64 {
    (1.5 * a).tanh() + 0.3 * a * b
}

#[test]
fn every_round_of_training_leaves_less_until_little_is_left() {
    let all = stacked(&runs(&curved));
    let left = |lengths: &[usize]| -> Vec<f64> {
        let networks = train(&all, 6, &[1], lengths).remove(0);
        networks.iter().map(|network| (network.output(&all.rises) - &all.target).norm_squared()).collect()
    };
    let left = left(&[1, 100, 1500]);
    assert!(left[1] < 0.5 * left[0] && left[2] < 0.5 * left[1], "{left:?}");
    assert!(left[2] < 0.02 * all.target.norm_squared(), "{left:?}");
}

#[test]
fn training_stops_at_once_where_there_is_nothing_to_learn_and_goes_on_where_there_is() {
    let noise = |_: f64, _: f64, chance: &mut Pcg64Mcg| chance.random_range(-1.0..1.0);
    let of = |runs: &[Samples]| length(&folds(runs), 6, 1);
    let (noisy, clear) = (of(&runs(&noise)), of(&runs(&curved)));
    assert!(noisy <= LENGTHS[2] && clear >= LENGTHS[6], "{noisy} rounds of noise, {clear} of a clear case");
}

#[test]
fn the_length_that_is_chosen_leaves_least_on_the_runs_that_were_left_out() {
    let noisy = |a: f64, b: f64, chance: &mut Pcg64Mcg| 0.5 * a - 0.4 * b + chance.random_range(-1.5..1.5);
    let runs = runs(&noisy);
    let folds = folds(&runs);
    let chosen = length(&folds, 6, 3);
    let left = |length: usize| -> f64 {
        let one = |fold: &Fold<'_>| {
            let seeds = [0, 1].map(|member| 3000 + 100 * member + fold.number);
            let networks = train(&fold.training, 6, &seeds, &[length]).concat();
            fold.left(|rises| (networks[0].output(rises) + networks[1].output(rises)) / 2.0)
        };
        folds.iter().map(one).sum()
    };
    for length in LENGTHS {
        assert!(left(chosen) <= left(length) + 1e-9, "{length} leaves less than {chosen}");
    }
}

#[test]
fn the_tanh_of_the_training_is_that_of_the_gateway_to_the_last_digits() {
    let near = (-40_000..=40_000).map(|step| f64::from(step) * 1e-3);
    for x in near.chain([0.0, 1e-300, -1e-9, 1e9, f64::INFINITY, f64::NEG_INFINITY]) {
        assert!((tanh(x) - x.tanh()).abs() < 5e-16, "tanh {x}: {} is not {}", tanh(x), x.tanh());
    }
}

#[test]
fn what_is_left_is_judged_about_its_own_mean() {
    let left = DVector::from_vec(vec![4.0, 6.0, 5.0]);
    assert!((about_mean(&left) - 2.0).abs() < 1e-12);
}

#[test]
fn the_file_is_the_mean_of_its_networks_and_says_nothing_without_a_rise() {
    let runs = runs(&curved);
    let (all, folds) = (stacked(&runs), folds(&runs));
    let members = neurons::fit(&all, &folds, 3, 1);
    let bumps = radial::fit(&all, &folds, 20, 1);
    for mut file in [neurons::file(&members), radial::file(&bumps)] {
        file["format"] = "isotherm-network".into();
        file["version"] = 1.into();
        file["inputs"] = serde_json::json!({ "mean": [0.0, 0.0], "scale": [1.0, 1.0] });
        file["output"] = serde_json::json!({ "mean": 0.0, "scale": 1.0 });
        let (net, _) = network::parse(file.to_string().as_bytes()).unwrap();
        assert!(net.output(&[0.0, 0.0]).abs() < 1e-9, "{}", net.what());
        let is_radial = net.what().contains("100 nodes");
        let mean = members.iter().map(|member| member.output(&all.rises)).sum::<DVector<f64>>() / 5.0;
        let direct = if is_radial { bumps.output(&all.rises) } else { mean };
        for (row, direct) in all.rises.row_iter().zip(direct.iter()) {
            let said = net.output(&[row[0], row[1]]);
            assert!((said - direct).abs() < 1e-8, "{}: {said} is not {direct}", net.what());
        }
    }
}

#[test]
fn more_centres_than_rows_or_rows_all_alike_still_give_an_answer() {
    let twins = Samples { rises: DMatrix::from_element(12, 2, 1.0), target: DVector::from_element(12, 3.0) };
    let bumps = radial::fit(&twins, &[], 20, 1);
    let said = bumps.output(&twins.rises);
    assert!(said.iter().all(|value| (value - 3.0).abs() < 0.1), "{said}");
}
