//! Tests on a structure with a known solution: a beam in which some nodes of each block have exactly its temperature.

use super::bounded::bounded;
use super::multi_case::{Effort, Tolerance, multi_case, noise_um};
use super::patent::patent;
use super::*;
use crate::problem::{Block, Load};

const BLOCKS: usize = 4;
const EACH: usize = 30;
const GUIDE: usize = 9;
const TOLERANCE: Tolerance = Tolerance { noise: 0.1, enough: 1e-3 };

/// Matrix P in which the displacement of the guideway grows with the height above the warmed block, equally in all
/// components.
fn p() -> Vec<Vec<f64>> {
    let row = |point: usize, block: usize| {
        let (height, at) = (point as f64 / GUIDE as f64, block as f64 / BLOCKS as f64);
        1e-3 * ((height - at).max(0.0).powi(2) - 0.3 * (block % 2) as f64 * height)
    };
    (0..3 * GUIDE).map(|row_at| (0..BLOCKS).map(|block| row(row_at / 3, block)).collect()).collect()
}

fn blocks() -> Vec<Block> {
    (0..BLOCKS)
        .map(|block| {
            let nodes: Vec<usize> = (block * EACH..(block + 1) * EACH).collect();
            let (y, z) = ((block / 2) as f64 * 500.0, (block % 2) as f64 * 300.0);
            Block { name: format!("BLK{block}"), candidates: nodes.clone(), nodes, centre: [0.0, y, z] }
        })
        .collect()
}

/// Load with the displacement that the nodes `right` of the blocks give.
fn load(name: &str, right: [usize; BLOCKS], warm: impl Fn(usize) -> f64) -> Load {
    let rise: Vec<f64> = (0..BLOCKS * EACH).map(warm).collect();
    let theta: Vec<f64> = right.iter().enumerate().map(|(block, node)| rise[block * EACH + node]).collect();
    let moved = |row: &Vec<f64>| row.iter().zip(&theta).map(|(each, theta)| each * theta).sum();
    Load { name: name.to_owned(), moved_mm: p().iter().map(moved).collect(), rise }
}

const RIGHT: [usize; BLOCKS] = [7, 21, 3, 16];

fn problem() -> Problem {
    let even = |node: usize| 1.0 + (node % EACH) as f64 * 0.2 + (node / EACH) as f64;
    let crossed = |node: usize| 3.0 + ((node % EACH) as f64 * 0.9).sin() + 0.05 * (node % EACH) as f64;
    let third = |node: usize| 2.0 + ((node % EACH) as f64 * 0.37 + (node / EACH) as f64).cos();
    let repeated = |node: usize| 1.0 + (node % 10) as f64 * 0.3;
    let loads = [
        load("even", RIGHT, even),
        load("crossed", RIGHT, crossed),
        load("third", RIGHT, third),
        load("repeated", RIGHT, repeated),
    ];
    Problem::new(blocks(), &p(), &loads, &[2])
}

/// The criterion is the effect of a noise of 0.1 K. A small part of it is negligible.
#[test]
fn nodes_for_all_cases_together_leave_nothing_that_counts_where_some_leave_nothing() {
    let problem = problem();
    let found = multi_case(&problem, &[0, 1, 2, 3], TOLERANCE, Effort::SHORT);
    let right: Vec<usize> = RIGHT.to_vec();
    for target in &problem.targets {
        assert!(problem.rms_of(target, &right) < 1e-4, "the truth of {}", target.name);
        let left = problem.rms_of(target, &found);
        assert!(left < 0.3 * noise_um(&problem, 0.1), "{}: {left}", target.name);
        assert!(left < 0.1 * problem.rms(target, &target.mean), "{}: {left}", target.name);
    }
}

#[test]
fn one_case_alone_does_not_tell_nodes_of_one_temperature_apart() {
    let problem = problem();
    let target = &problem.targets[3];
    let alone = nearest(target, &bounded(&problem, target));
    assert!(problem.rms_of(target, &alone) < 1e-3);
    let together = multi_case(&problem, &[0, 1, 2, 3], TOLERANCE, Effort::SHORT);
    for other in &problem.targets[..3] {
        let (alone, together) = (problem.rms_of(other, &alone), problem.rms_of(other, &together));
        assert!(together < 0.5 * alone, "{}: {together} {alone}", other.name);
    }
}

/// The random search has one start and one change. Therefore the placements from which it starts must be sufficient.
#[test]
fn of_one_case_no_more_is_left_than_by_the_patent_or_by_bounded_least_squares() {
    let problem = problem();
    for (case, target) in problem.targets.iter().enumerate() {
        let by_patent = nearest(target, &patent(&problem, target, TOLERANCE.enough).theta);
        let by_bounded = nearest(target, &bounded(&problem, target));
        let found = multi_case(&problem, &[case], TOLERANCE, Effort { starts: 1, changes: 1 });
        let left = problem.rms_of(target, &found);
        for known in [by_patent, by_bounded] {
            assert!(left <= problem.rms_of(target, &known) + 1e-9, "{}: {left}", target.name);
        }
    }
}

#[test]
fn bounded_least_squares_find_the_temperatures_behind_a_displacement() {
    let problem = problem();
    for target in &problem.targets {
        assert!(problem.rms(target, &bounded(&problem, target)) < 1e-3, "{}", target.name);
    }
}

#[test]
fn every_round_of_the_patent_leaves_less_and_none_leaves_less_than_the_bounds_allow() {
    let problem = problem();
    for target in &problem.targets {
        let found = patent(&problem, target, 1e-3);
        let mut before = problem.rms(target, &target.mean);
        for round in &found.rounds {
            assert!(
                round.rms_um < before && round.likeness > 0.0 && round.likeness < 1.0 + 1e-9,
                "{round:?}"
            );
            before = round.rms_um;
        }
        assert!(
            found.rounds.len() > 2 && before < 0.2 * problem.rms(target, &target.mean),
            "{}: {before}",
            target.name
        );
        for (theta, (low, high)) in found.theta.iter().zip(&target.bounds) {
            assert!((*low..=*high).contains(theta));
        }
    }
}

#[test]
fn the_patent_stops_at_once_where_the_means_are_near_enough() {
    let problem = problem();
    let target = &problem.targets[0];
    let found = patent(&problem, target, 1e6);
    assert!(found.rounds.is_empty());
    assert_eq!(found.theta, target.mean);
}

#[test]
fn patterns_are_the_whole_its_sides_its_corners_and_each_block_once() {
    let names: Vec<String> = patterns::patterns(&blocks()).into_iter().map(|pattern| pattern.name).collect();
    assert_eq!(names[0], "whole");
    for wanted in ["low y", "high y", "low z", "high z", "low y, low z", "high y, high z"] {
        assert!(names.iter().any(|name| name == wanted), "{wanted} is not in {names:?}");
    }
    let sets: Vec<Vec<bool>> =
        patterns::patterns(&blocks()).into_iter().map(|pattern| pattern.warmed).collect();
    for (place, set) in sets.iter().enumerate() {
        assert!(!sets[..place].contains(set), "twice: {set:?}");
    }
}
