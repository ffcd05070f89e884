//! Tests of the judgement of a candidate, and of the decision about its adoption.

use std::time::Duration;

use super::*;

const DAY: Duration = Duration::from_hours(24);

fn day(number: u32, in_use: f64, candidate: f64) -> JudgedDay {
    JudgedDay { begins: Moment::default().after(DAY * (number + 1)), touches: 8, in_use, candidate }
}

fn judged(days: &[(f64, f64)]) -> Judgement {
    let mut judgement = Judgement::default();
    for (number, (in_use, candidate)) in (0..).zip(days) {
        assert!(judgement.judge(day(number, *in_use, *candidate)));
    }
    judgement
}

const PERSON: Occasion = Occasion { confirmed: true, at_datum: false };
const DATUM: Occasion = Occasion { confirmed: false, at_datum: true };

#[test]
fn each_row_of_the_table_of_steps() {
    let step = |judgement: &Judgement, policy, occasion| match judgement.decide(policy, occasion) {
        Step::Keep => "keep",
        Step::Propose(_) => "propose",
        Step::WaitForDatum(_) => "wait",
        Step::Adopt(_) => "adopt",
    };
    let (none, worse, equal) = (judged(&[]), judged(&[(4.0, 9.0)]), judged(&[(4.0, 4.0)]));
    let better = judged(&[(9.0, 4.0)]);
    for policy in [Policy::Propose, Policy::Auto] {
        for occasion in [Occasion::default(), PERSON, DATUM] {
            for judgement in [&none, &worse, &equal] {
                assert_eq!(step(judgement, policy, occasion), "keep", "{judgement:?} {occasion:?}");
            }
        }
        assert_eq!(step(&better, policy, PERSON), "adopt");
    }
    assert_eq!(step(&better, Policy::Propose, Occasion::default()), "propose");
    assert_eq!(step(&better, Policy::Propose, DATUM), "propose", "an operator decides, not the datum");
    assert_eq!(step(&better, Policy::Auto, Occasion::default()), "wait");
    assert_eq!(step(&better, Policy::Auto, DATUM), "adopt");
}

#[test]
fn a_candidate_that_is_the_model_in_use_is_not_better_by_rounding() {
    let judgement = judged(&[(4.0, 4.0_f64.next_down()), (0.1 + 0.2, 0.3)]);
    assert!(judgement.gain().is_some() && !judgement.is_better(), "{judgement:?}");
    assert!(judged(&[(4.0, 3.99)]).is_better());
}

#[test]
fn the_last_five_judged_days_decide_and_not_one_of_them() {
    // One bad day of the model in use is not enough if the candidate was worse on the others.
    let judgement = judged(&[(1.0, 3.0), (1.0, 3.0), (1.0, 3.0), (1.0, 3.0), (8.0, 1.0)]);
    assert!(!judgement.is_better());
    let mut judgement = judged(&[(0.0, 100.0), (9.0, 4.0), (9.0, 4.0), (9.0, 4.0), (9.0, 4.0)]);
    assert!(!judgement.is_better());
    assert!(judgement.judge(day(9, 9.0, 4.0)));
    assert_eq!(judgement.days().len(), 5, "the first day is forgotten");
    let gain = judgement.gain().unwrap();
    assert!(judgement.is_better() && (gain.days, gain.touches) == (5, 40));
    assert_eq!(gain.since, day(1, 0.0, 0.0).begins);
    assert!((gain.in_use.get() - 3.0).abs() < 1e-12 && (gain.candidate.get() - 2.0).abs() < 1e-12);
}

#[test]
fn after_an_adoption_the_next_candidate_must_be_better_than_the_adopted_one() {
    let mut judgement = judged(&[(9.0, 4.0), (9.0, 4.0)]);
    judgement.adopted();
    assert!(!judgement.is_better());
    // The next candidate is a little better on one day, and then worse.
    assert!(judgement.judge(day(5, 4.0, 3.9)));
    assert!(judgement.is_better());
    assert!(judgement.judge(day(6, 4.0, 5.0)));
    assert!(!judgement.is_better());
    judgement.clear();
    assert_eq!(judgement.gain(), None);
}

#[test]
fn a_day_counts_once_and_only_with_touches_and_numbers() {
    let mut judgement = judged(&[(9.0, 4.0)]);
    let good = day(7, 9.0, 4.0);
    for wrong in [
        day(0, 9.0, 4.0),
        JudgedDay { touches: 0, ..good },
        JudgedDay { in_use: f64::NAN, ..good },
        JudgedDay { candidate: f64::INFINITY, ..good },
        JudgedDay { candidate: -1.0, ..good },
    ] {
        assert!(!judgement.judge(wrong), "{wrong:?}");
    }
    assert!(judgement.judge(good));
    assert_eq!(judgement.days().len(), 2);
}

#[test]
fn the_runs_of_one_day_are_one_day_and_each_touch_counts_once() {
    let mut judgement = judged(&[(4.0, 9.0), (4.0, 9.0), (4.0, 9.0), (4.0, 9.0)]);
    // Six datums on the fifth day, two hours apart.
    for number in 0..6 {
        let begins = day(4, 0.0, 0.0).begins.after(DAY * number / 12);
        assert!(judgement.judge(JudgedDay { begins, touches: 1, in_use: 16.0, candidate: 1.0 }));
        assert!(!judgement.judge(JudgedDay { begins, touches: 1, in_use: 16.0, candidate: 1.0 }), "once");
    }
    let begins = day(4, 0.0, 0.0).begins.after(DAY / 2);
    assert!(judgement.judge(JudgedDay { begins, touches: 2, in_use: 0.0, candidate: 1.0 }));
    let gain = judgement.gain().unwrap();
    assert_eq!((gain.days, gain.touches), (5, 4 * 8 + 8));
    let last = judgement.days().last().unwrap();
    assert!((last.in_use - 12.0).abs() < 1e-12 && (last.candidate - 1.0).abs() < 1e-12, "{last:?}");
    assert!(!judgement.is_better(), "one good day is not enough: {gain:?}");
}

#[test]
fn a_judgement_is_the_same_after_it_was_saved() {
    let judgement = judged(&[(9.25, 4.125), (1.0 / 3.0, 0.1)]);
    let saved = serde_json::to_string(&judgement).unwrap();
    assert_eq!(serde_json::from_str::<Judgement>(&saved).unwrap(), judgement);
}
