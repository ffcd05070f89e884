//! Identification with an existing model as the prior.

use std::time::Duration;

use isotherm_identify::method::{Method, PriorTerm, Settings};
use isotherm_identify::setup::ready;
use isotherm_identify::{Identified, assessed_on_others, identify};

use super::rig::{self, dataset, found};
use super::speed;
use super::whitened::{days, logs};

fn term(signal: &str, minutes: u64, gain: f64) -> PriorTerm {
    let lag = (minutes > 0).then(|| Duration::from_mins(minutes));
    PriorTerm { signal: signal.to_owned(), lag, squared: false, gain }
}

fn towards(prior: Vec<PriorTerm>) -> Settings {
    Settings { prior: Some(prior), ..Settings::default() }
}

fn as_prior(found: &Identified) -> Vec<PriorTerm> {
    let term = |term: &isotherm_identify::identified::TermFound| PriorTerm {
        signal: term.signal.clone(),
        lag: Some(Duration::from_secs_f64(term.lag_s)).filter(|lag| !lag.is_zero()),
        squared: term.squared,
        gain: term.gain,
    };
    found.terms.iter().map(term).collect()
}

#[test]
fn one_day_after_others_leaves_less_with_their_model_as_the_prior() {
    let all = logs(&days(7, 31, 1.0));
    let prior = as_prior(&found(4, &all[..4], &Settings::default()));
    let dataset = dataset(&all[4..]).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let left = |settings: &Settings| -> f64 {
        (0..3)
            .flat_map(|run| assessed_on_others(&ready, settings, &[run]).unwrap())
            .map(|score| score.range_um)
            .sum()
    };
    let (with, without) = (left(&towards(prior)), left(&Settings::default()));
    assert!(with < 0.8 * without, "{with} µm with, {without} µm without");
}

#[test]
fn a_prior_of_zeros_is_a_weaker_penalty_also_for_speeds() {
    let logs: Vec<String> = speed::days(2).iter().map(|day| speed::log(day, |_| false)).collect();
    let without = speed::by(&logs, &Settings::default());
    assert!(without.terms.iter().any(|term| term.squared), "{:?}", without.terms);
    let with = speed::by(&logs, &towards(vec![term("s0", 0, 0.0)]));
    assert_eq!(with.terms.len(), without.terms.len());
    let of_square = |found: &Identified| -> f64 {
        found.terms.iter().filter(|term| term.squared).map(|term| term.gain).sum()
    };
    let share = of_square(&with) / of_square(&without);
    assert!((0.8..1.6).contains(&share), "the scale of a speed is the same: {share}");
}

#[test]
fn a_lag_that_only_the_prior_has_is_learnt_through_too() {
    let found = found(4, &logs(&days(1, 3, 0.0)), &towards(vec![term("s0", 12, -3.0), term("s2", 0, 1.5)]));
    let own = found.terms.iter().find(|term| term.signal == "s0" && (term.lag_s - 720.0).abs() < 1e-9);
    assert!(own.is_some_and(|term| term.gain < -1.0), "{:?}", found.terms);
    let reported = found.notes.remarks.join("; ");
    assert!(reported.contains("one run") && !reported.contains("even tenths"), "{reported}");
}

#[test]
fn terms_of_the_prior_of_which_there_is_no_input_are_named() {
    let dataset = dataset(&logs(&days(1, 3, 0.0))).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let settings = towards(vec![term("s0", 0, 1.0), term("bed", 0, 1.0), term("oil", 6, 1.0)]);
    let why = identify(&ready, &settings, None, false, &|_, _| {}).unwrap_err();
    assert!(why.contains("bed, oil") && why.contains("--prior") && !why.contains("s0"), "{why}");
}

#[test]
fn an_option_of_which_a_method_makes_nothing_is_refused() {
    let dataset = dataset(&logs(&days(3, 3, 0.0))).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let why = |settings: &Settings| identify(&ready, settings, None, false, &|_, _| {}).unwrap_err();
    let said = why(&Settings { terms: Some(4), ..Settings::default() });
    assert!(said.contains("--terms") && said.contains("whitened") && said.contains("sparse-lag"), "{said}");
    for settings in [
        Settings { sensors: Some(2), method: Method::Ols, ..Settings::default() },
        Settings { method: Method::Ols, ..towards(Vec::new()) },
        Settings { lags: vec![None], method: Method::Ols, ..Settings::default() },
        Settings { first: vec!["s0".to_owned()], method: Method::Ols, ..Settings::default() },
    ] {
        assert!(why(&settings).contains("ols"), "{}", why(&settings));
    }
    let both = Settings { sensors: Some(2), ..towards(vec![term("s0", 0, 1.0)]) };
    assert!(why(&both).contains("--sensors") && why(&both).contains("--prior"));
}

#[test]
fn a_prior_that_leaves_more_than_no_compensation_is_refused_with_both_errors() {
    let dataset = dataset(&logs(&days(1, 3, 0.0))).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let of = |gain: f64| identify(&ready, &towards(vec![term("s0", 25, gain)]), None, false, &|_, _| {});
    // The true gain of Cz is -3.0 µm/°C.
    assert!(of(-3.0).is_ok());
    let why = of(3.0).unwrap_err();
    assert!(why.contains("the model of --prior") && why.contains("without compensation"), "{why}");
}

#[test]
fn one_or_two_days_are_drawn_towards_the_prior_by_a_smaller_penalty_than_towards_zero() {
    // Both penalties are fixed. Towards zero, it is 0.3; towards a prior of zeros, it is 0.1.
    let logs = logs(&days(2, 5, 0.0));
    let size = |settings: &Settings| -> f64 {
        found(4, &logs, settings).terms.iter().map(|term| term.gain * term.gain).sum()
    };
    let (towards_zero, towards_prior) =
        (size(&Settings::default()), size(&towards(vec![term("s0", 0, 0.0)])));
    assert!(towards_prior > towards_zero, "{towards_prior} {towards_zero}");
}
