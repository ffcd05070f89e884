//! On a structure where the truth is known: a beam whose blocks really have one temperature each at some nodes.

use super::bounded::bounded;
use super::multi_case::{Effort, Tolerated, multi_case, noise_um};
use super::patent::patent;
use super::*;
use crate::problem::{Block, Load};

const BLOCKS: usize = 4;
const EACH: usize = 30;
const GUIDE: usize = 9;
const TOLERATED: Tolerated = Tolerated { noise: 0.1, enough: 1e-3 };

/// Bends more the higher it is warmed; every component alike.
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

/// A load whose true displacement is what the nodes `right` of each block tell.
fn load(name: &str, right: [usize; BLOCKS], warm: impl Fn(usize) -> f64) -> Load {
    let rise: Vec<f64> = (0..BLOCKS * EACH).map(warm).collect();
    let theta: Vec<f64> = right.iter().enumerate().map(|(block, node)| rise[block * EACH + node]).collect();
    let told = |row: &Vec<f64>| row.iter().zip(&theta).map(|(each, theta)| each * theta).sum();
    Load { name: name.to_owned(), moved_mm: p().iter().map(told).collect(), rise }
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

/// What noise of a tenth of a kelvin does is the yardstick: less than a part of it is as good as nothing.
#[test]
fn nodes_for_all_cases_together_leave_nothing_that_counts_where_some_leave_nothing() {
    let problem = problem();
    let found = multi_case(&problem, &[0, 1, 2, 3], TOLERATED, Effort::SHORT);
    let right: Vec<usize> = RIGHT.to_vec();
    for aim in &problem.aims {
        assert!(problem.rms_of(aim, &right) < 1e-4, "the truth of {}", aim.name);
        let left = problem.rms_of(aim, &found);
        assert!(left < 0.3 * noise_um(&problem, 0.1), "{}: {left}", aim.name);
        assert!(left < 0.1 * problem.rms(aim, &aim.mean), "{}: {left}", aim.name);
    }
}

#[test]
fn one_case_alone_does_not_tell_nodes_of_one_temperature_apart() {
    let problem = problem();
    let aim = &problem.aims[3];
    let alone = nearest(aim, &bounded(&problem, aim));
    assert!(problem.rms_of(aim, &alone) < 1e-3);
    let together = multi_case(&problem, &[0, 1, 2, 3], TOLERATED, Effort::SHORT);
    for other in &problem.aims[..3] {
        let (alone, together) = (problem.rms_of(other, &alone), problem.rms_of(other, &together));
        assert!(together < 0.5 * alone, "{}: {together} {alone}", other.name);
    }
}

/// The search by chance is hardly begun: what it starts from must do.
#[test]
fn of_one_case_no_more_is_left_than_by_the_patent_or_by_bounded_least_squares() {
    let problem = problem();
    for (case, aim) in problem.aims.iter().enumerate() {
        let by_patent = nearest(aim, &patent(&problem, aim, TOLERATED.enough).theta);
        let by_bounded = nearest(aim, &bounded(&problem, aim));
        let found = multi_case(&problem, &[case], TOLERATED, Effort { starts: 1, changes: 1 });
        let left = problem.rms_of(aim, &found);
        for known in [by_patent, by_bounded] {
            assert!(left <= problem.rms_of(aim, &known) + 1e-9, "{}: {left}", aim.name);
        }
    }
}

#[test]
fn bounded_least_squares_find_the_temperatures_behind_a_displacement() {
    let problem = problem();
    for aim in &problem.aims {
        assert!(problem.rms(aim, &bounded(&problem, aim)) < 1e-3, "{}", aim.name);
    }
}

#[test]
fn every_round_of_the_patent_leaves_less_and_none_leaves_less_than_the_bounds_allow() {
    let problem = problem();
    for aim in &problem.aims {
        let found = patent(&problem, aim, 1e-3);
        let mut before = problem.rms(aim, &aim.mean);
        for round in &found.rounds {
            assert!(
                round.rms_um < before && round.likeness > 0.0 && round.likeness < 1.0 + 1e-9,
                "{round:?}"
            );
            before = round.rms_um;
        }
        assert!(
            found.rounds.len() > 2 && before < 0.2 * problem.rms(aim, &aim.mean),
            "{}: {before}",
            aim.name
        );
        for (theta, (low, high)) in found.theta.iter().zip(&aim.bounds) {
            assert!((*low..=*high).contains(theta));
        }
    }
}

#[test]
fn the_patent_stops_at_once_where_the_means_are_near_enough() {
    let problem = problem();
    let aim = &problem.aims[0];
    let found = patent(&problem, aim, 1e6);
    assert!(found.rounds.is_empty());
    assert_eq!(found.theta, aim.mean);
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
