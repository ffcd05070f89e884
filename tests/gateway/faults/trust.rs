//! Days with an unreliable computer. Its clock is set while the gateway runs and between two runs. The gateway is
//! killed. Its state is damaged, replaced by an older one or lost, its directory is removed, and operators send
//! commands. The faults are random with a seed. No row of the log, no event and no micrometre is lost.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use isotherm::observe::status::Command;
use isotherm_core::quantity::{Moment, time};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::faults::clocks::slow;
use crate::faults::keeping::kept_in;
use crate::faults::law;
use crate::faults::rig::{Trace, World, block_on, somebody};

/// Variable with the duration in hours; `tests/run long` sets three days.
const HOURS: &str = "TEST_TRUST_HOURS";
const SECOND: Duration = Duration::from_secs(1);
/// Period of the axis, which is the time between two rows of the log.
const PERIOD: Duration = Duration::from_secs(2);
/// Errors to which the time of day is set, s.
const WRONG: [i64; 10] =
    [0, 0, 0, 3600, -3600, 86_400, -86_400, 366 * 86_400, -10 * 365 * 86_400, -56 * 365 * 86_400];

/// Unreliable computer.
struct Computer {
    world: World,
    home: tempfile::TempDir,
    random: Pcg32,
    /// Number of directories that were removed.
    taken: usize,
    /// Older copies of the state.
    copies: Vec<(PathBuf, Vec<u8>)>,
    seen: BTreeMap<(String, String), u64>,
    what: BTreeMap<&'static str, u32>,
}

impl Computer {
    fn directory(&self) -> PathBuf {
        self.home.path().join("state")
    }

    fn count(&mut self, what: &'static str) {
        *self.what.entry(what).or_default() += 1;
    }

    fn wrong_time(&mut self) -> i64 {
        WRONG[self.random.random_range(0..WRONG.len())]
    }

    /// Files with these endings in the state directory.
    fn documents(&self, endings: &[&str]) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.directory()).into_iter().flatten().flatten();
        let paths = entries.map(|entry| entry.path());
        let has =
            |path: &PathBuf| endings.iter().any(|ending| path.extension().is_some_and(|is| is == *ending));
        paths.filter(has).collect()
    }

    /// Damages the computer while no gateway runs.
    fn is_maltreated(&mut self) {
        if self.random.random_range(0..3) == 0 {
            let wrong = self.wrong_time();
            let now = self.world.clock.now();
            self.world.clock.set_time_of_day(offset(now, wrong));
            self.world.clock.check_time_of_day();
            self.count("clock set between two runs");
        }
        match self.random.random_range(0..6) {
            0 => {
                for path in self.documents(&["json", "number"]) {
                    let mut bytes = fs::read(&path).unwrap();
                    let place = self.random.random_range(0..bytes.len());
                    bytes[place] ^= 1 << self.random.random_range(0..7);
                    fs::write(&path, bytes).unwrap();
                }
                self.count("state damaged");
            }
            1 if !self.copies.is_empty() => {
                self.copies.iter().for_each(|(path, bytes)| fs::write(path, bytes).unwrap());
                self.count("state of before");
            }
            2 => self.loses_its_directory(),
            _ => {}
        }
        // A number that is as old as its document is not detected.
        let copies =
            self.documents(&["json"]).into_iter().map(|path| (path.clone(), fs::read(&path).unwrap()));
        self.copies = copies.collect();
    }

    fn loses_its_directory(&mut self) {
        self.taken += 1;
        fs::rename(self.directory(), self.home.path().join(format!("taken-{}", self.taken))).unwrap();
        self.count("directory lost between two runs");
    }

    /// One life of a gateway. An operator watches it, and arms it if it asks for that.
    async fn lives(&mut self, left: Duration) -> Trace {
        let span = (SECOND * self.random.random_range(300..3600)).min(left);
        let is_killed = self.random.random_range(0..5) < 3;
        let mut acts: Vec<(Duration, Option<i64>, Option<Command>)> = Vec::new();
        for minute in 1..=5 {
            acts.push((SECOND * 60 * minute, None, Some(Command::Arm)));
        }
        for _ in 0..self.random.random_range(0..4) {
            let at = SECOND * self.random.random_range(10..u32::try_from(span.as_secs()).unwrap());
            match self.random.random_range(0..4) {
                0 => acts.push((at, None, Some(Command::Zero))),
                1 => {
                    acts.push((at, None, Some(Command::Disarm)));
                    acts.push((at + SECOND * 30, None, Some(Command::Arm)));
                }
                _ => acts.push((at, Some(self.wrong_time()), None)),
            }
        }
        acts.sort_by_key(|act| act.0);
        *self.what.entry("clock set while it ran").or_default() +=
            u32::try_from(acts.iter().filter(|act| act.1.is_some()).count()).unwrap();
        self.count(if is_killed { "killed" } else { "stopped" });
        let mut trial = self.world.gateway().options(kept_in(Some(self.home.path().join("state"))));
        for (at, wrong, command) in acts {
            trial = trial.at(at, move |stage| {
                if let Some(wrong) = wrong {
                    stage.clock.set_time_of_day(offset(stage.clock.now(), wrong));
                }
                if let Some(command) = command {
                    // If the axis is already armed, or still waits, the answer says so.
                    let _ = stage.source.command(command, None, &somebody());
                }
            });
        }
        if is_killed { trial.killed_after(span).await } else { trial.run(span).await }
    }

    fn lived_well(&mut self, trace: &Trace) {
        law::holds(trace);
        assert!(!trace.outcome.failed, "{}", trace.lines());
        assert_eq!(trace.reported("logs-deleted"), 0, "{}", trace.lines());
        for event in &trace.events {
            *self.seen.entry((event.kind.to_string(), event.text.clone())).or_default() += 1;
        }
        let asked = trace.samples.iter().rfind(|sample| sample.at <= trace.stopped.0).unwrap();
        let axis = &asked.status.axes[0];
        assert_eq!(asked.status.log_dropped, 0);
        if axis.state == "active" {
            let apart = (axis.cz_um - axis.verified_um.unwrap()).abs();
            assert!(apart <= 1.0 + 1e-6, "{apart} µm\n{}", trace.lines());
        }
    }

    /// Files with this ending in all its directories.
    fn files(&self, ending: &str) -> Vec<PathBuf> {
        let homes = fs::read_dir(self.home.path()).unwrap().flatten();
        let entries = homes.flat_map(|home| fs::read_dir(home.path()).unwrap().flatten());
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        files.retain(|path| path.file_name().unwrap().to_str().unwrap().ends_with(ending));
        files.sort();
        files
    }
}

fn offset(now: Moment, seconds: i64) -> Moment {
    let span = Duration::from_secs(seconds.unsigned_abs());
    if seconds < 0 { now.before(span) } else { now.after(span) }
}

/// Time that the rows of a log cover without a gap, for all its runs together; and the number of runs.
fn covered(log: &Path) -> (Duration, u32) {
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_path(log).unwrap();
    let memory = reader.headers().unwrap().iter().position(|name| name == "machine_memory").unwrap();
    let (mut covered, mut runs, mut last) = (Duration::ZERO, 0, None);
    for row in reader.records().map(Result::unwrap) {
        let now = time::parse(&row[0]).unwrap();
        if row[memory].is_empty() {
            let last: Moment = last.unwrap();
            let gap = now.since(last);
            assert!(
                now >= last && gap <= PERIOD,
                "{}: {gap:?} without a row before {}",
                log.display(),
                &row[0]
            );
            covered += gap;
        } else {
            runs += 1;
        }
        last = Some(now);
    }
    (covered, runs)
}

#[test]
fn days_of_wrong_clocks_kills_and_lost_state_lose_no_row_no_event_and_no_micrometre() {
    let hours = std::env::var(HOURS).map_or(6, |hours| hours.parse().unwrap());
    let mut left = Duration::from_hours(hours);
    let home = tempfile::tempdir().unwrap();
    fs::create_dir(home.path().join("state")).unwrap();
    let (computer, lived, lives) = block_on(async {
        let world = World::new(&slow(), "").await;
        let mut computer = Computer {
            world,
            home,
            random: Pcg32::seed_from_u64(20),
            taken: 0,
            copies: Vec::new(),
            seen: BTreeMap::new(),
            what: BTreeMap::new(),
        };
        let (mut lived, mut lives) = (Duration::ZERO, 0);
        while left > SECOND * 300 {
            let trace = computer.lives(left).await;
            computer.lived_well(&trace);
            let span = trace.stopped.1.since(trace.begin);
            left = left.saturating_sub(span);
            lived += span;
            lives += 1;
            computer.is_maltreated();
        }
        (computer, lived, lives)
    });
    let mut logs = computer.files(".csv");
    logs.retain(|log| !log.to_str().unwrap().ends_with(".outputs.csv"));
    let covered: Vec<(Duration, u32)> = logs.iter().map(|log| covered(log)).collect();
    let rows: Duration = covered.iter().map(|(span, _)| *span).sum();
    let begun: u32 = covered.iter().map(|(_, runs)| *runs).sum();
    println!(
        "{lived:?} in {lives} lives, {} files of logs with {begun} beginnings: {:?}",
        logs.len(),
        computer.what
    );
    // At each beginning and each end, less than a period is missing.
    let lost = lived.saturating_sub(rows);
    assert!(lost <= PERIOD * 2 * begun, "{lost:?} of {lived:?} are not in the logs, {begun} beginnings");
    let mut kept: BTreeMap<(String, String), u64> = BTreeMap::new();
    for file in computer.files(".events.jsonl") {
        for line in fs::read_to_string(&file).unwrap().lines() {
            let event: serde_json::Value = serde_json::from_str(line).unwrap();
            let text = |key: &str| event[key].as_str().unwrap_or_default().to_owned();
            *kept.entry((text("kind"), text("text"))).or_default() += 1;
        }
    }
    for (event, count) in &computer.seen {
        let kept = kept.get(event).copied().unwrap_or_default();
        assert!(kept >= *count, "{event:?} happened {count} times, and is kept {kept} times");
    }
}
