use proptest::prelude::*;

use super::*;

/// Difference between wall-clock time and the gateway's monotonic time, ms.
const SHIFT: u64 = 7_200_000;

fn shift() -> Shift {
    Shift::between(at(0), at(SHIFT))
}

/// Returns the monotonic time this many milliseconds after the start.
fn at(ms: u64) -> Moment {
    Moment::from_nanos((1_000_000_000 + ms) * 1_000_000)
}

/// Returns the wall-clock time that belongs to [`at`].
fn wall(ms: u64) -> Moment {
    at(ms).shifted(shift())
}

fn report(error_um: f64) -> MeasuredReport {
    error_um.into()
}

fn timed(error_um: f64, ms: u64) -> MeasuredReport {
    MeasuredReport { time: Some(wall(ms)), ..report(error_um) }
}

fn named(error_um: f64, id: &str) -> MeasuredReport {
    MeasuredReport { id: Some(id.to_owned()), ..report(error_um) }
}

fn again(report: MeasuredReport) -> MeasuredReport {
    MeasuredReport { redelivered: true, ..report }
}

/// Checks a report that arrives at `ms`, and stores it if it is accepted.
fn arrives(
    taken: &mut TakenReports,
    report: &MeasuredReport,
    ms: u64,
    datum: Option<u64>,
) -> Result<(), Rejected> {
    taken.check(report, (at(ms), shift()), datum.map(at))?;
    taken.take(report.clone(), at(ms));
    Ok(())
}

/// Returns the reports after they were saved and restored.
fn kept(taken: &TakenReports) -> TakenReports {
    let text = serde_json::to_string(taken).unwrap();
    serde_json::from_str::<TakenReports>(&text).unwrap().newest()
}

#[test]
fn each_measurement_is_taken_once() {
    let same_id = |id: &str| Err(Rejected::SameId(id.to_owned()));
    let same_time = |ms| Err(Rejected::SameTime(wall(ms)));
    let same_error = |ms| Err(Rejected::SameError(Duration::from_millis(ms)));
    let new = Ok(());
    // Report taken 5 s ago, arriving report, and result.
    let table = [
        (named(3.0, "a"), named(3.0, "a"), same_id("a")),
        (named(3.0, "a"), again(named(3.0, "a")), same_id("a")),
        (named(3.0, "a"), named(4.0, "a"), same_id("a")),
        (named(3.0, "a"), named(3.0, "b"), new.clone()),
        (named(3.0, "a"), again(named(3.0, "b")), new.clone()),
        (timed(3.0, 0), timed(3.0, 0), same_time(0)),
        (timed(3.0, 0), timed(3.000_000_05, 0), same_time(0)),
        (timed(3.0, 0), timed(3.1, 0), new.clone()),
        (timed(3.0, 0), timed(3.0, 1), new.clone()),
        (timed(3.0, 0), again(timed(3.0, 1)), new.clone()),
        (timed(3.0, 0), MeasuredReport { id: Some("b".to_owned()), ..timed(3.0, 0) }, same_time(0)),
        (named(3.0, "a"), MeasuredReport { id: Some("a".to_owned()), ..timed(3.0, 1) }, same_id("a")),
        (timed(3.0, 0), named(3.0, "b"), new.clone()),
        (report(3.0), report(3.0), same_error(5_000)),
        (report(0.0), report(-0.0), same_error(5_000)),
        (report(3.0), report(3.1), new.clone()),
        (report(3.0), again(report(3.1)), Err(Rejected::Redelivered)),
        (report(3.0), timed(3.0, 0), new.clone()),
        (named(3.0, "a"), report(3.0), same_error(5_000)),
    ];
    for (first, second, expected) in table {
        let mut taken = TakenReports::default();
        assert_eq!(arrives(&mut taken, &first, 1_000, None), Ok(()), "{first}");
        let mut taken = kept(&taken);
        assert_eq!(arrives(&mut taken, &second, 6_000, None), expected, "{first}; {second}");
    }
    let mut none = TakenReports::default();
    assert_eq!(arrives(&mut none, &again(report(3.0)), 0, None), Err(Rejected::Redelivered));
}

#[test]
fn an_equal_error_counts_again_once_it_has_not_arrived_for_ten_seconds() {
    let mut taken = TakenReports::default();
    let expected =
        [(0, true), (9_999, false), (19_998, false), (29_998, true), (29_999, false), (39_999, true)];
    for (ms, is_taken) in expected {
        assert_eq!(arrives(&mut taken, &report(3.0), ms, None).is_ok(), is_taken, "{ms}");
    }
}

#[test]
fn a_measurement_of_before_the_datum_or_of_the_future_is_rejected() {
    let before = |time, datum| Err(Rejected::BeforeDatum { time: wall(time), datum: wall(datum) });
    let table = [
        (timed(1.0, 4_999), Some(5_000), before(4_999, 5_000)),
        (MeasuredReport { id: Some("a".to_owned()), ..timed(1.0, 0) }, Some(5_000), before(0, 5_000)),
        (timed(1.0, 5_000), Some(5_000), Ok(())),
        (timed(1.0, 0), None, Ok(())),
        (named(1.0, "a"), Some(5_000), Ok(())),
        (report(1.0), Some(5_000), Ok(())),
        (timed(1.0, 30_000), Some(5_000), Ok(())),
        (timed(1.0, 30_001), Some(5_000), Err(Rejected::Ahead { time: wall(30_001), now: wall(20_000) })),
    ];
    for (report, datum, expected) in table {
        assert_eq!(arrives(&mut TakenReports::default(), &report, 20_000, datum), expected, "{report}");
    }
}

#[test]
fn what_is_wrong_with_a_time_or_an_id_is_said_without_a_word_of_it() {
    let long = "x".repeat(65);
    for (time, id) in [
        (Some("noon"), None),
        (Some("2026-01-31T12:00:00"), None),
        (Some(""), None),
        (None, Some("")),
        (None, Some("two words")),
        (None, Some("line\nbreak")),
        (None, Some("ü")),
        (None, Some(long.as_str())),
    ] {
        let why = MeasuredReport::new(1.0, time, id).unwrap_err();
        let begins = if time.is_some() { "write `time` as 2026-" } else { "write `id` as 1 to 64 " };
        assert!(why.starts_with(begins), "{why}");
    }
    let good = MeasuredReport::new(1.5, Some("2026-01-31T13:00:00.5+01:00"), Some("part-17/2")).unwrap();
    assert_eq!(good.to_string(), "1.5 µm, time 2026-01-31T12:00:00.5Z, id part-17/2");
    assert!(good.is_identified() && !MeasuredReport::from(1.0).is_identified());
}

#[test]
fn every_reason_says_what_to_do() {
    let reasons = [
        Rejected::SameId("a".to_owned()),
        Rejected::SameTime(wall(0)),
        Rejected::Redelivered,
        Rejected::SameError(Duration::from_millis(1234)),
        Rejected::Forgotten(wall(0)),
        Rejected::BeforeDatum { time: wall(0), datum: wall(1) },
        Rejected::Ahead { time: wall(1), now: wall(0) },
    ];
    for reason in reasons {
        let said = reason.to_string();
        let does = ["give each", "measure again", "send a `time` or an `id`", "Set the clock"];
        assert!(does.iter().any(|does| said.contains(does)), "{said}");
    }
}

/// Measurement of a test day: the time at which it is first sent, and the pauses before each repetition.
#[derive(Clone, Debug)]
struct Sent {
    report: MeasuredReport,
    first: u64,
    pauses: Vec<u64>,
}

/// Measurements with an id or a time. Their errors are often equal.
fn sent(count: usize) -> impl Strategy<Value = Vec<Sent>> {
    let one = (0..3_i32, 0..3_u8, prop::collection::vec(1_000..7_200_000_u64, 0..4));
    prop::collection::vec(one, 1..count).prop_map(|all| {
        let one = |(place, (error, marks, pauses)): (usize, (i32, u8, Vec<u64>))| {
            let first = 60_000 * u64::try_from(place).unwrap();
            let id = (marks != 1).then(|| format!("id-{place}"));
            let report = MeasuredReport { id, ..timed(error.into(), first) };
            let time = report.time.filter(|_| marks != 0);
            Sent { report: MeasuredReport { time, ..report }, first: first + 500, pauses }
        };
        all.into_iter().enumerate().map(one).collect()
    })
}

proptest! {
    #[test]
    fn however_often_and_late_it_arrives_a_measurement_counts_once(all in sent(40), restarts in 1..20_usize) {
        let mut arrivals = Vec::new();
        for (place, one) in all.iter().enumerate() {
            let mut ms = one.first;
            arrivals.push((ms, place));
            for pause in &one.pauses {
                ms += pause;
                arrivals.push((ms, place));
            }
        }
        arrivals.sort_unstable();
        let (mut taken, mut counts) = (TakenReports::default(), vec![0; all.len()]);
        for (arrival, (ms, place)) in arrivals.into_iter().enumerate() {
            let is_first = counts[place] == 0;
            let report = MeasuredReport { redelivered: !is_first, ..all[place].report.clone() };
            counts[place] += u32::from(arrives(&mut taken, &report, ms, None).is_ok());
            if arrival.is_multiple_of(restarts) {
                taken = kept(&taken);
            }
        }
        prop_assert!(counts.iter().all(|count| *count == 1), "{:?}", counts);
    }

    #[test]
    fn with_a_time_it_counts_once_even_after_more_than_are_remembered(late in 0..400_usize, error in 0..2_i32) {
        let mut taken = TakenReports::default();
        let first = timed(error.into(), 0);
        prop_assert_eq!(arrives(&mut taken, &first, 500, None), Ok(()));
        for place in 0..u64::try_from(late).unwrap() {
            let ms = 60_000 * (place + 1);
            prop_assert_eq!(arrives(&mut taken, &timed(error.into(), ms), ms + 500, None), Ok(()));
        }
        prop_assert!(taken.0.len() <= KEPT);
        prop_assert!(arrives(&mut taken, &first, 600_000_000, None).is_err());
    }

    #[test]
    fn without_time_and_id_no_number_of_repetitions_counts(pauses in prop::collection::vec(0..9_999_u64, 1..50)) {
        let (mut taken, mut ms) = (TakenReports::default(), 0);
        prop_assert_eq!(arrives(&mut taken, &report(3.0), ms, None), Ok(()));
        for pause in pauses {
            ms += pause;
            prop_assert!(arrives(&mut taken, &report(3.0), ms, None).is_err());
        }
    }
}
