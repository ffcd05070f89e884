//! Turns of corrected positions and of the heartbeat: repetitions are counted, and all turns are replayed.

use proptest::prelude::*;

use super::*;
use crate::gateway::store::log::outputs::{
    ControllerSnapshot, ControllerState, Entry, HEADER, HeartbeatSnapshot, HeartbeatTurn, OutputLogReader,
    OutputReplay, PositionSnapshot, Replayed, Turn,
};
use isotherm_core::output::{
    Beat, Condition, HeartbeatController, PositionAction, PositionController, PositionDecision,
    PositionDemand, PositionResult, PositionTurn, Trouble,
};
use isotherm_core::quantity::Micron;
use isotherm_profile::OutputId;

/// Readout and heartbeat, whose rows are in memory.
struct Bench {
    log: OutputsLog,
    jobs: Receiver<QueuedJob>,
    position: PositionController,
    heartbeat: HeartbeatController,
    decision: Option<PositionDecision>,
    now: Moment,
    /// Turns with an action, or with a change of a controller.
    turns: u64,
}

fn micron(value: f64) -> Micron {
    Micron::new(value).unwrap()
}

impl Bench {
    fn new(now: Moment) -> Bench {
        let (queue, jobs) = sync_channel(OUTPUT_QUEUE);
        let log = OutputsLog::of(["readout_z", "heartbeat"].map(str::to_owned), (1, 0), queue);
        let (position, heartbeat) = Default::default();
        Bench { log, jobs, position, heartbeat, decision: None, now, turns: 0 }
    }

    /// Runs one turn of 100 ms with random faults.
    fn continues(&mut self, chance: u16) {
        self.now = self.now.after(Duration::from_millis(100));
        if chance.is_multiple_of(8) {
            let cz = |value: u16| micron(f64::from(value % 3));
            let decision = PositionDecision { cz: cz(chance >> 3), target: cz(chance >> 5), at: self.now };
            self.decision = (chance >> 8 > 8).then_some(decision);
        }
        let demand = PositionDemand {
            read_at: self.now,
            is_usable: chance >> 4 != 5,
            decision: self.decision,
            interlock: if chance % 100 < 10 { Condition::NotMet } else { Condition::Met },
            backs_off: chance % 100 == 17,
            may_show_dashes: chance.is_multiple_of(2),
        };
        let before = self.position;
        let (action, _) = self.position.next(&demand, micron(1.0), self.now);
        let result = match action {
            PositionAction::Correct(_) if chance % 50 == 3 => Some(PositionResult::NotShown),
            PositionAction::Correct(_) if chance % 50 == 4 => Some(PositionResult::Failed {
                trouble: Trouble::Link,
                may_have_arrived: chance.is_multiple_of(4),
            }),
            PositionAction::Correct(_) | PositionAction::ShowDashes => Some(PositionResult::Written),
            _ => None,
        };
        let turn = PositionTurn { demand, action, result };
        self.position.result(&turn, self.now);
        let state = ControllerState::Position;
        let ended =
            TurnRecord { before: state(before), turn: Turn::Position(turn), after: state(self.position) };
        self.turns += u64::from(!ended.turn.is_idle() || !ended.before.is_like(&ended.after));
        let snapshot =
            || ControllerSnapshot::Position(PositionSnapshot { step: micron(1.0), position: before });
        self.log.turned(CountedWrite::Position(OutputId(0)), ended, snapshot, self.now);
        if result == Some(PositionResult::Written) {
            self.log.wrote(CountedWrite::Position(OutputId(0)), self.now);
        }
        self.beats([Beat::Silent, Beat::Stands, Beat::Counts, Beat::Counts][usize::from(chance >> 14)]);
    }

    fn beats(&mut self, beat: Beat) {
        let before = self.heartbeat;
        let Some(count) = self.heartbeat.next(beat, 9) else { return };
        self.turns += 1;
        let (turn, state) = (HeartbeatTurn { beat, count: Some(count) }, ControllerState::Heartbeat);
        let (turn, after) = (Turn::Heartbeat(turn), state(self.heartbeat));
        let snapshot = || ControllerSnapshot::Heartbeat(HeartbeatSnapshot { highest: 9, heartbeat: before });
        self.log.turned(
            CountedWrite::Heartbeat,
            TurnRecord { before: state(before), turn, after },
            snapshot,
            self.now,
        );
        self.log.wrote(CountedWrite::Heartbeat, self.now);
    }

    fn rows(mut self) -> String {
        self.log.count_for_the_last_time(self.now);
        let mut text = HEADER.to_owned();
        for job in self.jobs.try_iter() {
            match *job {
                Job::OutputRow { row, .. } => text += std::str::from_utf8(&row).unwrap(),
                job => panic!("{job:?}"),
            }
        }
        text
    }
}

/// Number of turns that a replay confirms, including the counted ones.
fn replayed(text: &str) -> u64 {
    let mut reader = OutputLogReader::open(text.as_bytes(), "day").unwrap();
    let (mut replay, mut turns) = (OutputReplay::default(), 0);
    while let Some(row) = reader.next_row().unwrap() {
        match (replay.row(&row), &row.entry) {
            (Replayed::Same, Entry::Turn { repetitions, .. }) => turns += repetitions + 1,
            (Replayed::Nothing, Entry::Resumes(_) | Entry::Noted) => {}
            (other, _) => panic!("line {}: {other:?}\n{text}", row.line),
        }
    }
    turns
}

#[test]
fn a_readout_that_shows_the_same_cz_for_an_hour_has_a_row_a_minute() {
    let mut bench = Bench::new(noon());
    bench.continues(0xc808);
    (0..36_000).for_each(|_| bench.continues(65_021));
    assert!(bench.turns > 36_000, "{}", bench.turns);
    let turns = bench.turns;
    let text = bench.rows();
    assert_eq!(replayed(&text), turns);
    let rows = text.lines().count();
    assert!(rows < 5 * 60, "{rows} rows");
}

#[test]
fn turns_that_write_nothing_are_recorded_after_a_minute_too() {
    let mut bench = Bench::new(noon());
    bench.continues(0xc808);
    // The interlock is open.
    (0..3600 * 10).for_each(|_| bench.continues(0xc801));
    let turns = bench.turns;
    let text = bench.rows();
    assert_eq!(replayed(&text), turns);
    assert!(text.matches(",position,").count() >= 59, "{text}");
}

#[test]
fn a_turn_that_began_before_midnight_begins_the_controller_again_in_the_new_file() {
    let mut bench = Bench::new(noon().after(DAY / 2).before(Duration::from_millis(150)));
    bench.continues(0xc808);
    let before = bench.now;
    (0..5).for_each(|_| bench.continues(65_021));
    bench.now = before;
    bench.continues(0xc810);
    bench.continues(0xc801);
    let turns = bench.turns;
    let days: Vec<_> = bench
        .jobs
        .try_iter()
        .map(|job| match *job {
            Job::OutputRow { at, .. } => retention::day(at),
            job => panic!("{job:?}"),
        })
        .collect();
    assert!(days.is_sorted() && days[0] != days[days.len() - 1], "{days:?}");
    assert!(turns > 0);
}

#[test]
fn a_difference_is_reported_and_the_rows_behind_it_are_compared_too() {
    let mut bench = Bench::new(noon());
    bench.continues(0xc808);
    (0..150).for_each(|_| bench.continues(65_021));
    let text = bench.rows();
    // The heartbeat now has another highest count.
    let text = text.replacen(r#"""highest"":9"#, r#"""highest"":7"#, 1);
    let mut reader = OutputLogReader::open(text.as_bytes(), "day").unwrap();
    let mut replay = OutputReplay::default();
    let mut came = Vec::new();
    while let Some(row) = reader.next_row().unwrap() {
        came.push(replay.row(&row));
    }
    assert!(came.iter().any(|one| matches!(one, Replayed::Different { .. })), "{came:?}");
    assert!(came.iter().all(|one| *one != Replayed::Unknown), "{came:?}");
}

proptest! {
    #[test]
    fn whatever_happens_every_turn_of_a_readout_and_of_a_heartbeat_comes_out_again(
        chances in prop::collection::vec((any::<u16>(), 1..30_usize), 1..40), before_midnight in 0..60_u32,
    ) {
        let mut bench = Bench::new(noon().after(DAY / 2).before(Duration::from_secs(1) * before_midnight));
        for (chance, times) in chances {
            (0..times).for_each(|_| bench.continues(chance));
        }
        let turns = bench.turns;
        prop_assert_eq!(replayed(&bench.rows()), turns);
    }
}
