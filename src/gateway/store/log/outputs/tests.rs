use std::time::Duration;

use proptest::prelude::*;

use super::cells::PLAIN;
use super::*;
use isotherm_core::output::{
    Action, Beat, CommitTrigger, Condition, Controller, Demand, Fact, Input, Mode, NotSent, OutputDecision,
    Rules, SetController, SetSettings, SetWords, Settings, State, Strobe, Verify, Who,
};
use isotherm_core::quantity::{Counts, Moment};

const NOON: Moment = Moment::from_nanos(1_767_614_400_000_000_000);
const MOMENTS: [Moment; 4] =
    [NOON, Moment::from_nanos(1), Moment::from_nanos(1_767_614_400_123_456_789), Moment::END];
const VALUES: [i64; 5] = [0, -1, 120, i64::MIN, i64::MAX];

fn settings(is_shared: bool) -> Settings {
    Settings {
        step: Counts(2),
        limit: Counts(40),
        bias: Counts(0),
        range: (Counts(-32768), Counts(32767)),
        late: Duration::from_millis(4001),
        remembered: Duration::from_secs(40),
        every: Duration::from_secs(1),
        refresh: (!is_shared).then_some(Duration::from_secs(10)),
        is_shared,
        verify: Verify::Reading,
        applied: None,
        rules: Rules::default(),
    }
}

fn inputs() -> Vec<Input> {
    let demand = |at: Moment, value: i64, armed| {
        let decision = |target, mode| {
            Some(OutputDecision { offset: Counts(value), target, at: NOON, not_after: at, mode })
        };
        let of = |interlock, decision| {
            Input::Demand(Demand { armed, interlock, decision, restarts: 7, pauses: 0 })
        };
        [
            of(Condition::Met, decision(Some(Counts(value.wrapping_neg())), Mode::Follow)),
            of(Condition::NotMet, decision(None, Mode::Hold)),
            of(Condition::Unknown, decision(None, Mode::Finish)),
        ]
    };
    let none = Demand { armed: None, interlock: Condition::Met, decision: None, restarts: 0, pauses: 3 };
    let reported = MOMENTS.into_iter().flat_map(|at| {
        let valued = VALUES.into_iter().flat_map(move |value| {
            let towards = Some(Counts(value.wrapping_neg()));
            let facts = [
                Fact::Decided { offset: Counts(value), target: None, not_after: at },
                Fact::Decided { offset: Counts(value), target: towards, not_after: at },
                Fact::Read { found: Counts(value), asked: at },
                Fact::Piggybacked { value: Counts(value), left: at, is_done: true },
                Fact::Piggybacked { value: Counts(value), left: at, is_done: false },
            ];
            let armed = [None, Some(Who::Person), Some(Who::Policy)];
            let demands = armed.into_iter().flat_map(move |armed| demand(at, value, armed));
            facts
                .map(Input::Fact)
                .into_iter()
                .chain(demands)
                .chain([Input::Applied { found: Some(value), asked: at }])
        });
        let facts = [Fact::Done { left: at }, Fact::Unknown { left: at }].map(Input::Fact);
        let applied = [Input::Applied { found: None, asked: at }, Input::AppliedNoAnswer { asked: at }];
        valued.chain(facts).chain(applied)
    });
    PLAIN.map(|(_, input)| input).into_iter().chain([Input::Demand(none)]).chain(reported).collect()
}

fn actions() -> Vec<Action> {
    let reported = MOMENTS.into_iter().flat_map(|at| {
        let writes = VALUES.into_iter().flat_map(move |value| {
            [false, true].map(|is_repeat| Action::Write { value: Counts(value), not_after: at, is_repeat })
        });
        writes.chain([Action::Nothing { until: at }])
    });
    [Action::Read, Action::Keep].into_iter().chain(reported).collect()
}

fn rows(log: &str) -> Result<Vec<OutputRow>, String> {
    let mut reader = OutputLogReader::open(log.as_bytes(), "day").map_err(|error| error.to_string())?;
    let mut rows = Vec::new();
    while let Some(row) = reader.next_row().map_err(|error| error.to_string())? {
        rows.push(row);
    }
    Ok(rows)
}

fn replayed(log: &str) -> Vec<(u64, Replayed)> {
    let mut replay = OutputReplay::default();
    rows(log).unwrap().iter().map(|row| (row.line, replay.row(row))).collect()
}

/// Log of two outputs with random inputs. Most of the time they execute the requested actions.
fn log_of(chances: &[u8]) -> (String, [Controller; 2]) {
    let settings = [settings(false), settings(true)];
    let mut running =
        settings.map(|settings| Controller::new(&settings, State::new(&settings, None, NOON), 0, NOON));
    let mut known = [None; 2];
    let mut asked = [Action::Nothing { until: NOON }; 2];
    let mut recorder = OutputRecorder::default();
    let mut log = HEADER.as_bytes().to_vec();
    let any = inputs();
    for (place, chance) in chances.iter().enumerate() {
        let which = place % 2;
        let now = NOON.after(Duration::from_millis(37 * u64::try_from(place).unwrap()));
        let before = running[which];
        let found = before.state().kept().stood.unwrap_or_default() + Counts(i64::from(*chance == 7));
        let decision = OutputDecision {
            offset: Counts(i64::from(*chance) / 8),
            target: chance.is_multiple_of(3).then_some(Counts(i64::from(*chance) / 4)),
            at: now,
            not_after: now.after(Duration::from_secs(1)),
            mode: [Mode::Follow, Mode::Hold, Mode::Finish][usize::from(*chance) % 3],
        };
        let demand = Demand {
            armed: Some(Who::Person),
            interlock: if *chance == 50 { Condition::NotMet } else { Condition::Met },
            decision: Some(decision).filter(|_| *chance % 8 == 2),
            restarts: 0,
            pauses: 0,
        };
        let input = match (asked[which], chance % 8) {
            (_, 0) => any[usize::from(*chance) % any.len()],
            (Action::Read, _) => Input::Fact(Fact::Read { found, asked: now }),
            (Action::Keep, 1) => Input::Fact(Fact::NotKept),
            (Action::Keep, _) => Input::OnDisk,
            (Action::Write { .. }, 1) => Input::Fact(Fact::Unknown { left: now }),
            (Action::Write { .. }, 5) if *chance > 100 => Input::NotSent(NotSent::TooLate),
            (Action::Write { .. }, _) => Input::Fact(Fact::Done { left: now }),
            (Action::Nothing { .. }, 1 | 2) => Input::Demand(demand),
            (Action::Nothing { .. }, 3) => Input::TurnEnds,
            (Action::Nothing { .. }, _) => Input::Fact(Fact::Look),
        };
        let action = running[which].step(&settings[which], input, now);
        let _ = running[which].take_events();
        asked[which] = running[which].action();
        if matches!(action, Action::Nothing { .. }) && before == running[which] {
            continue;
        }
        let name = ["cnc_z", "the plc's, \"z\""][which];
        if known[which] != Some(before) && (known[which].is_none() || *chance == 9) {
            let (state, policy) = (*before.state(), *before.policy());
            let beginning = ResumeState { settings: settings[which], state, policy };
            log.extend_from_slice(recorder.begin(now, name, &beginning));
        }
        known[which] = Some(running[which]);
        log.extend_from_slice(recorder.step(now, name, input, action));
    }
    (String::from_utf8(log).unwrap(), running)
}

#[test]
fn every_fact_and_every_action_is_read_as_it_was_written() {
    let mut recorder = OutputRecorder::default();
    let mut log = HEADER.to_owned();
    let (inputs, actions) = (inputs(), actions());
    let pairs: Vec<_> =
        inputs.iter().zip(actions.iter().cycle()).chain(inputs.iter().cycle().zip(&actions)).collect();
    for (place, (input, action)) in pairs.iter().enumerate() {
        let row = recorder.step(MOMENTS[place % 3], "cnc_z", **input, **action);
        log += std::str::from_utf8(row).unwrap();
    }
    let rows = rows(&log).unwrap();
    assert_eq!(rows.len(), pairs.len());
    for (place, (row, (input, action))) in rows.iter().zip(pairs).enumerate() {
        assert_eq!(row.entry, Entry::Step { input: *input, action: *action }, "line {}", row.line);
        assert_eq!((row.now, row.output.as_str()), (MOMENTS[place % 3], "cnc_z"));
    }
}

#[test]
fn a_row_looks_like_this() {
    let mut recorder = OutputRecorder::default();
    let at = NOON.after(Duration::from_micros(1500));
    let input = Input::Fact(Fact::Read { found: Counts(120), asked: NOON });
    let action = Action::Write { value: Counts(121), not_after: at, is_repeat: false };
    assert_eq!(
        std::str::from_utf8(recorder.step(at, "cnc_z", input, action)).unwrap(),
        "2026-01-05T12:00:00.001500000Z,cnc_z,read,120,2026-01-05T12:00:00.000000000Z,write,121,\
         2026-01-05T12:00:00.001500000Z,\n"
    );
    let turn = Turn::Heartbeat(HeartbeatTurn { beat: Beat::Counts, count: Some(7) });
    assert_eq!(
        std::str::from_utf8(recorder.turn(at, "heartbeat", &turn, 59)).unwrap(),
        "2026-01-05T12:00:00.001500000Z,heartbeat,heartbeat,59,,write,,,\"{\"\"beat\"\":\"\"counts\"\",\"\"count\"\":7}\"\n"
    );
}

#[test]
fn what_is_only_counted_is_passed_over() {
    let mut recorder = OutputRecorder::default();
    let mut log = HEADER.as_bytes().to_vec();
    log.extend_from_slice(b"2026-01-05T12:00:00Z,readout_z,cz,-1.5,,,,,\n");
    log.extend_from_slice(recorder.fault(NOON, "readout_z", "no answer, \"late\""));
    log.extend_from_slice(recorder.writes(NOON, "heartbeat", 60, NOON));
    log.extend_from_slice(recorder.failures(NOON, "set block", 1, NOON));
    let log = String::from_utf8(log).unwrap();
    assert_eq!(replayed(&log), [2, 3, 4, 5].map(|line| (line, Replayed::Nothing)));
}

proptest! {
    #[test]
    fn whatever_an_output_was_given_its_log_gives_its_actions_again(
        chances in prop::collection::vec(any::<u8>(), 1..400)
    ) {
        let (log, running) = log_of(&chances);
        let mut replay = OutputReplay::default();
        for row in rows(&log).unwrap() {
            let came = replay.row(&row);
            prop_assert!(matches!(came, Replayed::Same | Replayed::Nothing), "line {}: {came:?}\n{log}", row.line);
        }
        for controller in running {
            let texts = (serde_json::to_string(controller.state()), serde_json::to_string(controller.policy()));
            let state = serde_json::from_str(&texts.0.unwrap()).unwrap();
            let again = Controller::resumed(state, serde_json::from_str(&texts.1.unwrap()).unwrap());
            prop_assert_eq!(again.moved(|at| at, NOON), controller.moved(|at| at, NOON));
        }
    }
}

/// Keys of the state of a register in every log so far.
const KEYS: &str = "account answered copies doing has_begun_on_disk is_interlocked is_rebooted is_unsaved is_waiting \
                    keeps_from must_read order pairs_from promised promised_until reads_from settles_at standing turns \
                    unanswered_change untaken verified waited_at was_like_our_own was_unsteady writes_from written_at";

#[test]
fn the_state_of_a_register_is_logged_as_by_earlier_versions() {
    let state = serde_json::to_value(State::new(&settings(true), None, NOON)).unwrap();
    let mut keys: Vec<&str> = state.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    assert_eq!(keys.join(" "), KEYS);
    for (is_rebooted, must_read) in [(false, false), (false, true), (true, true)] {
        let mut logged = state.clone();
        logged["is_rebooted"] = is_rebooted.into();
        logged["must_read"] = must_read.into();
        for key in ["is_unsaved", "has_begun_on_disk", "was_like_our_own", "was_unsteady"] {
            logged[key] = true.into();
            let read: State = serde_json::from_value(logged.clone()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), logged);
        }
    }
}

#[test]
fn the_words_of_a_set_are_logged_as_by_earlier_versions() {
    let settings = SetSettings {
        members: Vec::new(),
        taking: CommitTrigger::AtOnce,
        has_number: false,
        timeout: None,
        refresh: None,
        words: SetWords::None,
    };
    let set = SetController::new(&settings, Vec::new(), (Strobe::new(false), true), NOON);
    let logged = serde_json::to_value(&set).unwrap();
    for key in ["beat", "control", "may_say_enabled", "written_at"] {
        assert!(logged.get(key).is_some(), "{key}: {logged}");
    }
    assert_eq!(serde_json::from_value::<SetController>(logged).unwrap(), set);
}

/// Log in which both outputs are armed and reach their targets.
fn some_log() -> String {
    let chances = [1, 10, 18, 26, 3, 3, 34, 5, 4, 9, 42, 6, 7, 3];
    log_of(&chances.into_iter().cycle().flat_map(|chance| [chance; 2]).take(800).collect::<Vec<_>>()).0
}

#[test]
fn an_action_that_was_changed_is_reported_with_its_line_and_both_actions() {
    let log = some_log();
    let line = log.lines().position(|line| line.contains(",write,")).unwrap();
    let tampered: Vec<String> = (log.lines().enumerate())
        .map(
            |(place, text)| if place == line { text.replace(",write,", ",repeat,") } else { text.to_owned() },
        )
        .collect();
    let came = replayed(&(tampered.join("\n") + "\n"));
    let different: Vec<_> =
        came.iter().filter(|(_, came)| matches!(came, Replayed::Different { .. })).collect();
    let [(reported, Replayed::Different { recorded, replayed })] = different.as_slice() else {
        panic!("{different:?}")
    };
    assert_eq!(*reported, u64::try_from(line).unwrap() + 1);
    assert!(recorded.starts_with("repeat ") && replayed.starts_with("write "), "{recorded} {replayed}");
    assert_eq!(recorded.trim_start_matches("repeat "), replayed.trim_start_matches("write "));
}

#[test]
fn what_cannot_be_read_is_reported_with_its_line_and_its_column() {
    let row = "2026-01-05T12:00:00Z,cnc_z,read,120,2026-01-05T12:00:00Z,nothing,,,\n";
    let wrong = |from: &str, to: &str| rows(&format!("{HEADER}{row}{}{row}", row.replace(from, to)));
    for (from, to, reported) in [
        (",120,", ",12O,", "day, line 3, column value: `12O` is not a register value"),
        (",120,", ",,", "day, line 3, column value: `read` needs a value, but has none"),
        (",read,", ",reed,", "day, line 3, column fact: `reed` is unknown"),
        (",nothing,", ",rest,", "day, line 3, column action: `rest` is unknown"),
        ("2026-01-05T12:00:00Z,cnc", "noon,cnc", "day, line 3, column time: `noon` is not a time"),
        (",nothing,,,", ",nothing", "day, line 3: the row has 6 cells, but the header has 9 column names"),
        (",read,", ",begin,", "day, line 3, column detail: "),
    ] {
        let error = wrong(from, to).unwrap_err();
        assert!(error.starts_with(reported), "{error}");
    }
    assert!(rows("time,bed\n1,2\n").unwrap_err().starts_with("day, line 1: this is not a log of outputs"));
}

#[test]
fn a_last_row_that_a_power_cut_left_half_written_is_left_out() {
    let log = some_log();
    let whole = rows(&log).unwrap().len();
    let begin = log.match_indices(",begin,").last().unwrap().0;
    let last = log.trim_end().rfind('\n').unwrap();
    for cut in [begin + 200, last + 3, last + 40] {
        let mut reader = OutputLogReader::open(&log.as_bytes()[..cut], "day").unwrap();
        let mut count = 0;
        while reader.next_row().unwrap().is_some() {
            count += 1;
        }
        assert!(count < whole && reader.warnings()[0].contains("the last row is incomplete"), "{cut}");
    }
}

#[test]
fn nobody_knows_from_where_an_output_goes_on_that_has_not_begun() {
    let log = some_log();
    let without = log.lines().filter(|line| !line.contains(",begin,")).collect::<Vec<_>>().join("\n") + "\n";
    assert!(replayed(&without).iter().all(|(_, came)| *came == Replayed::Unknown));
}
