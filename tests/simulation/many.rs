//! Many seeds, divided among some threads.

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use crate::day::{self, Outcome, Without};
use crate::link::Counts;
use crate::scene::Scene;
use crate::time::Stopwatch;

/// Results of many seeds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Many {
    pub(crate) seeds: u64,
    pub(crate) hours: f64,
    pub(crate) took: Duration,
    pub(crate) counts: Counts,
    pub(crate) changes: u64,
    pub(crate) taken: u64,
    pub(crate) went_back: u64,
    /// Seeds that violated a law, with the description.
    pub(crate) broken: Vec<(u64, String)>,
}

impl Many {
    /// Runs each of these seeds for `span`. If a rule is removed, it ends with the first violation.
    pub(crate) fn run(
        scene: &Scene,
        seeds: &[u64],
        span: Duration,
        threads: usize,
        without: Without,
    ) -> Many {
        let (next, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
        let sum = Mutex::new(Many::default());
        let watch = Stopwatch::begin();
        thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    while let Some(seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if is_over.load(Ordering::Relaxed) {
                            break;
                        }
                        let outcome = day::run(scene, *seed, span, without);
                        is_over.fetch_or(
                            without != Without::Nothing && outcome.breach.is_some(),
                            Ordering::Relaxed,
                        );
                        sum.lock().unwrap_or_else(PoisonError::into_inner).add(*seed, outcome);
                    }
                });
            }
        });
        let sum = sum.into_inner().unwrap_or_else(PoisonError::into_inner);
        Many { took: watch.passed(), ..sum }
    }

    fn add(&mut self, seed: u64, outcome: Outcome) {
        let (sum, more) = (&mut self.counts, outcome.counts);
        sum.exchanges += more.exchanges;
        sum.writes += more.writes;
        sum.faults += more.faults;
        sum.runs += more.runs;
        sum.arrived_late += more.arrived_late;
        sum.settings += more.settings;
        sum.late_answers += more.late_answers;
        sum.foreign_answers += more.foreign_answers;
        sum.noticed += more.noticed;
        self.seeds += 1;
        self.hours += outcome.ran.as_secs_f64() / 3600.0;
        self.changes += outcome.changes;
        self.taken += outcome.taken;
        self.went_back += outcome.went_back;
        self.broken.extend(outcome.breach.map(|story| (seed, story)));
    }
}

impl fmt::Display for Many {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (seed, story) in self.broken.iter().take(3) {
            writeln!(f, "seed {seed}, its last events:\n{story}")?;
        }
        let Counts { exchanges, writes, faults, runs, arrived_late, .. } = self.counts;
        let Counts { settings, late_answers, foreign_answers, noticed, .. } = self.counts;
        writeln!(
            f,
            "{} seeds, {:.0} machine hours in {:.0} s: {:.0} a minute",
            self.seeds,
            self.hours,
            self.took.as_secs_f64(),
            self.hours / (self.took.as_secs_f64() / 60.0)
        )?;
        writeln!(
            f,
            "{exchanges} exchanges, {writes} writes, {} of them changes, {arrived_late} late, {} sets taken",
            self.changes, self.taken
        )?;
        if settings + late_answers > 0 {
            writeln!(
                f,
                "{settings} changes at a panel, {} registers that went back, {late_answers} answers later than a gateway waits",
                self.went_back
            )?;
        }
        if foreign_answers > 0 {
            writeln!(f, "{foreign_answers} answers to another master, which was noticed {noticed} times")?;
        }
        write!(f, "{faults} faults, {runs} starts of a gateway; violations: {}", self.broken.len())?;
        self.broken.iter().try_for_each(|(seed, _)| write!(f, ", seed {seed}"))
    }
}
