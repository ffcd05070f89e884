//! Unchecked bytes for every parser: the inputs that the fuzzer has kept (`tests/fuzz` describes how to find more), and
//! random mutations of them. The mutations are the same in every run.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::path::{Path, PathBuf};
use std::time::Duration;

use isotherm::clock::Clock;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

#[path = "../corpus/targets.rs"]
mod targets;

/// Number of mutations for each target. `INPUTS` in the environment sets another number, and `TARGET` selects one
/// target.
const BY_CHANCE: usize = 300;

fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(name);
    let entries = std::fs::read_dir(&directory).unwrap_or_else(|error| panic!("{directory:?}: {error}"));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
}

#[test]
fn every_input_that_the_fuzzer_kept_is_still_taken_without_a_panic() {
    for (name, target) in targets::TARGETS {
        let inputs = corpus(name);
        assert!(inputs.len() >= 3, "the corpus of {name} is gone");
        for (path, bytes) in inputs {
            let taken = std::panic::catch_unwind(|| target(&bytes));
            assert!(taken.is_ok(), "{} makes {name} panic", path.display());
        }
    }
}

/// A kept input with some bytes changed, inserted or removed, or joined with a part of another input.
fn mutated(inputs: &[(PathBuf, Vec<u8>)], random: &mut Pcg32) -> Vec<u8> {
    let mut pick = |below: usize| random.random_range(0..below.max(1));
    let mut bytes = inputs[pick(inputs.len())].1.clone();
    for _ in 0..=pick(6) {
        let at = pick(bytes.len() + 1).min(bytes.len());
        match pick(5) {
            0 if at < bytes.len() => bytes[at] = u8::try_from(pick(256)).unwrap(),
            1 => bytes.insert(at, [0, 1, 0x7f, 0x80, 0xff][pick(5)]),
            2 if at < bytes.len() => drop(bytes.remove(at)),
            3 => {
                let other = &inputs[pick(inputs.len())].1;
                let cut = pick(other.len() + 1).min(other.len());
                bytes.truncate(at);
                bytes.extend_from_slice(&other[cut..]);
            }
            _ => bytes.truncate(at),
        }
    }
    bytes
}

#[test]
fn inputs_made_of_them_by_chance_are_taken_too() {
    let variable = |name| std::env::var(name).ok();
    let count = variable("INPUTS").map_or(BY_CHANCE, |count| count.parse().unwrap());
    let longest = variable("TEST_INPUTS_FOR").map(|seconds| Duration::from_secs(seconds.parse().unwrap()));
    let count = if longest.is_some() { usize::MAX } else { count };
    let clock = Clock::wall();
    for (name, target) in targets::TARGETS {
        if variable("TARGET").is_some_and(|only| only != name) {
            continue;
        }
        let inputs = corpus(name);
        let mut random = Pcg32::seed_from_u64(7);
        let (begun, mut taken) = (clock.now(), 0);
        while taken < count && longest.is_none_or(|longest| clock.now().since(begun) < longest) {
            let bytes = mutated(&inputs, &mut random);
            let held = std::panic::catch_unwind(|| target(&bytes));
            assert!(held.is_ok(), "{bytes:02x?} makes {name} panic");
            taken += 1;
        }
        println!("{name}: {taken} inputs in {:.1} s", clock.now().since(begun).as_secs_f64());
    }
}
