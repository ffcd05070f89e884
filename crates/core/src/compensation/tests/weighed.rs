//! Tests of probings (measured errors) that are weighed by the certainty of the correction.

use super::super::probe::Refused;
use super::super::settings::{Filter, ProbeSettings};
use super::probes::{correction, learning, near, probe, probed_axis, zeroing_machine};
use super::*;
use crate::quantity::{Shift, Shifted, of};

const HOUR: f64 = 3600.0;

fn weighed() -> ProbeSettings {
    ProbeSettings { filter: Filter::Weighed { repeat: 0.5, walk: 4.0 }, ..probe() }
}

/// Returns an axis whose rise is counted from the bed's temperature at the last zero command.
fn rise() -> AxisSettings {
    AxisSettings {
        models: vec![linear("rise", 0.0, &[term(BED, 2.4, Reference::Zero)])],
        ..probed_axis(weighed())
    }
}

/// Axis whose datum is taken now, at 27.5 °C.
fn zeroed() -> Rig {
    let mut rig = Rig::new(rise());
    rig.now = Moment::from_nanos(1_700_000_000_000_000_000);
    rig.step();
    rig
}

/// Passes a probing `after` seconds later that shows this residual error of the model, µm. Returns the correction, µm.
fn touch(rig: &mut Rig, after: f64, residual: f64) -> f64 {
    let raw = rig.after(after - 1.0).raw.unwrap().get();
    correction(rig.probe(-residual, raw))
}

/// Learned correction, and its certainty.
fn kept(rig: &Rig) -> serde_json::Value {
    serde_json::to_value(rig.compensation.remembered()).unwrap()["axes"][0]["probe"]["models"][0].clone()
}

fn variance(rig: &Rig) -> f64 {
    kept(rig)["certainty"]["variance"].as_f64().unwrap()
}

#[test]
fn a_sequence_comes_out_as_by_hand() {
    let mut rig = zeroed();
    // P = 4, K = 4 / 4.25
    near(touch(&mut rig, HOUR, 2.0), 2.0 * 16.0 / 17.0);
    near(variance(&rig), 4.0 / 17.0);
    // Half an hour later P = 4/17 + 2 = 38/17, K = (38/17) / (38/17 + 1/4) = 152/169
    let before = correction(*rig.compensation.decision(0).unwrap());
    near(touch(&mut rig, HOUR / 2.0, -1.0), before - 152.0 / 169.0);
    near(variance(&rig), 38.0 / 17.0 * 17.0 / 169.0);
    // At once again: P as it was, 38/169; K = (38/169) / (38/169 + 1/4)
    let before = correction(*rig.compensation.decision(0).unwrap());
    let raw = rig.compensation.decision(0).unwrap().raw.unwrap().get();
    rig.control.measured = Some(Measured { error: um(-0.25), acting: Some(um(raw)) });
    near(correction(rig.step()), before + 0.25 * 152.0 / 321.0);
}

#[test]
fn at_the_datum_nothing_is_learned_and_hours_later_nearly_all() {
    for (hours, share) in [(0.0, 0.0), (0.01, 0.04 / 0.29), (1.0, 16.0 / 17.0), (100.0, 400.0 / 400.25)] {
        let mut rig = zeroed();
        rig.now = rig.now.after(seconds(hours * HOUR));
        let raw = rig.step().raw.unwrap().get();
        rig.control.measured = Some(Measured { error: um(-1.0), acting: Some(um(raw)) });
        near(correction(rig.step()), share);
    }
}

#[test]
fn a_probing_that_disagrees_waits_for_one_that_agrees() {
    // After an hour, 4·√4.25 = 8.2 µm are accepted. Two probings agree within 4·√2·0.5 = 2.8 µm.
    for (second, learned) in
        [(9.5, Some(9.5)), (11.7, Some(10.0)), (6.3, Some(6.3)), (12.0, None), (-9.0, None), (0.5, Some(0.5))]
    {
        let mut rig = zeroed();
        near(touch(&mut rig, HOUR, 9.0), 0.0);
        assert!(matches!(rig.refused(), Some(Refused::Doubted(most)) if (most.get() - 8.246).abs() < 1e-3));
        assert_eq!(rig.compensation.probe(0).unwrap().history().len(), 0);
        let found = touch(&mut rig, 60.0, second);
        match learned {
            None => {
                near(found, 0.0);
                assert!(matches!(rig.refused(), Some(Refused::Doubted(_))), "{second}");
                // The next one must agree with the newer one.
                assert!(
                    (touch(&mut rig, 60.0, second) - second).abs() < 0.1 * second.abs() + 2.0,
                    "{second}"
                );
            }
            Some(wanted) => assert!((found - wanted).abs() <= 0.07 * wanted, "{second}: {found}"),
        }
        assert_eq!(rig.refused(), None, "{second}");
        assert!(kept(&rig)["certainty"]["doubted"].is_null());
    }
}

#[test]
fn it_is_the_residuals_that_agree_wherever_cz_and_the_temperatures_went() {
    let mut rig = zeroed();
    near(touch(&mut rig, HOUR, 9.0), 0.0);
    rig.show(30.0, 24.0).after(60.0);
    let raw = rig.after(1.0).raw.unwrap().get();
    near(raw, 6.0);
    // 3 µm of the way remain.
    assert!(correction(rig.probe(-9.0 - 3.0, raw - 3.0)) > 8.5);
}

#[test]
fn a_doubt_outlives_a_restart_and_times_without_a_model() {
    let mut rig = zeroed();
    touch(&mut rig, HOUR, 9.0);
    rig.restart(rise());
    assert!(matches!(rig.refused(), Some(Refused::Doubted(_))));
    rig.show(f64::NAN, 24.0);
    rig.probe(-9.0, 0.0);
    assert_eq!(rig.refused(), Some(Refused::NoModel));
    rig.show(27.5, 24.0).after(10.0);
    rig.restart(rise());
    assert!(touch(&mut rig, 60.0, 9.0) > 8.5);
    assert_eq!(rig.refused(), None);
}

#[test]
fn with_a_new_datum_and_where_all_is_forgotten_a_doubt_is_over() {
    for forget in [true, false] {
        let mut rig = zeroed();
        touch(&mut rig, HOUR, 9.0);
        match forget {
            true => rig.control.forget = true,
            false => rig.compensation.zero(rig.now),
        }
        rig.after(1.0);
        near(touch(&mut rig, 60.0, 9.0), 0.0);
        assert!(matches!(rig.refused(), Some(Refused::Doubted(_))), "{forget}");
    }
}

#[test]
fn after_it_is_forgotten_a_correction_is_as_certain_as_its_datum_is_old() {
    let mut rig = zeroed();
    touch(&mut rig, HOUR, 2.0);
    rig.control.forget = true;
    near(correction(rig.after(0.0)), 0.0);
    // P = 8, two hours after the datum.
    near(touch(&mut rig, HOUR, 1.0), 8.0 / 8.25);
    rig.compensation.zero(rig.now);
    rig.after(10.0);
    near(touch(&mut rig, HOUR, 1.0), 4.0 / 4.25);
}

#[test]
fn the_datum_of_the_axis_counts_and_a_machine_that_is_measured_from_numbers_counts_from_its_start() {
    for (axis, hours) in
        [(probed_axis(weighed()), 3.0), (AxisSettings { datum: Datum::Zero, ..probed_axis(weighed()) }, 1.0)]
    {
        let mut rig = Rig::with(zeroing_machine(), axis);
        rig.step();
        rig.after(2.0 * HOUR - 30.0);
        rig.compensation.zero(rig.now);
        rig.after(30.0);
        let p = 4.0 * hours;
        near(touch(&mut rig, HOUR, 1.0), p / (p + 0.25));
    }
}

#[test]
fn a_pause_makes_a_correction_less_certain_also_where_the_clock_cannot_say_how_long_it_was() {
    // 60 s, a pause of one hour, 60 s; or the longest pause that is accepted.
    for (stop, hours) in [
        (Stop { by_the_clock: Some(seconds(HOUR)) }, 1.0 + 120.0 / HOUR),
        (Stop { by_the_clock: None }, 720.0 + 120.0 / HOUR),
    ] {
        for has_learned in [true, false] {
            let mut rig = zeroed();
            let before = if has_learned {
                touch(&mut rig, HOUR, 2.0);
                variance(&rig)
            } else {
                0.0
            };
            rig.after(60.0);
            // The second run counts time from another start.
            let now = Moment::from_nanos(1_000_000_000_000_000_000);
            let kept = serde_json::to_string(&rig.compensation.remembered()).unwrap();
            let kept: Remembered = serde_json::from_str(&kept).unwrap();
            let resumed = kept.resumed(rig.now, now, stop);
            rig.compensation = Compensation::new(rig.compensation.settings.clone(), vec![rise()], resumed);
            rig.now = now;
            let start = correction(rig.after(0.0));
            let p = before + 4.0 * hours;
            let found = touch(&mut rig, 60.0, 1.0) - start;
            assert!((found - p / (p + 0.25)).abs() < 1e-9, "{stop:?} {has_learned}: {found}");
        }
    }
}

#[test]
fn what_an_older_program_kept_is_read_and_taken_for_uncertain() {
    let mut rig = zeroed();
    touch(&mut rig, HOUR, 2.0);
    let mut kept = serde_json::to_value(rig.compensation.remembered()).unwrap();
    kept["axes"][0]["probe"]["models"][0].as_object_mut().unwrap().remove("certainty").unwrap();
    kept["axes"][0].as_object_mut().unwrap().remove("datum_at");
    let kept: Remembered = serde_json::from_value(kept).unwrap();
    rig.compensation = Compensation::new(rig.compensation.settings.clone(), vec![rise()], kept);
    let before = correction(rig.after(1.0));
    near(before, 2.0 * 16.0 / 17.0);
    // Half of the limit of 10 µm, and the two hours since the datum.
    let p = 25.0 + 4.0 * (2.0 * HOUR + 1.0) / HOUR;
    near(touch(&mut rig, HOUR, 8.0) - before, 8.0 * p / (p + 0.25));
}

#[test]
fn what_was_learned_by_a_fixed_share_is_taken_for_uncertain() {
    let mut rig = zeroed();
    let by_share = AxisSettings { probe: Some(probe()), ..rise() };
    let kept = rig.compensation.remembered();
    rig.compensation = Compensation::new(rig.compensation.settings.clone(), vec![by_share], kept);
    let learned = touch(&mut rig, HOUR, 2.0);
    let kept = rig.compensation.remembered();
    rig.compensation = Compensation::new(rig.compensation.settings.clone(), vec![rise()], kept);
    near(correction(rig.after(1.0)), learned);
    let p = 25.0 + 4.0 * (HOUR + 1.0) / HOUR;
    near(touch(&mut rig, HOUR, 4.0) - learned, 4.0 * p / (p + 0.25));
}

#[test]
fn a_state_is_shifted_with_all_its_moments() {
    let mut rig = zeroed();
    touch(&mut rig, HOUR, 2.0);
    let shift = Shift::from_nanos(-77_000_000_000);
    let here = rig.compensation.running();
    let there = here.clone().shifted(shift);
    assert_ne!(here, there);
    assert_eq!(there.shifted(shift.reversed()), here);
}

#[test]
fn each_model_doubts_for_itself() {
    // One is measured from numbers since the start: 4·√(4·3 + ¼) = 14 µm. The other is measured from the zero an hour
    // ago.
    let young = linear("young", 0.0, &[term(BED, 2.4, Reference::Zero)]);
    let old = linear("old", 0.0, &[term(WHEELHEAD, 2.4, Reference::Fixed(of(24.0)))]);
    let mut rig = Rig::new(AxisSettings { models: vec![young, old], ..probed_axis(weighed()) });
    rig.step();
    rig.after(2.0 * HOUR - 10.0);
    rig.compensation.zero(rig.now);
    rig.after(10.0);
    near(touch(&mut rig, HOUR, 9.0), 0.0);
    assert!(matches!(rig.refused(), Some(Refused::Doubted(_))));
    rig.show(f64::NAN, 24.0);
    near(correction(rig.after(10.0)), 9.0 * 12.0 / 12.25);
}

#[test]
fn the_gains_learn_nothing_from_what_is_doubted() {
    let settings = ProbeSettings { filter: weighed().filter, ..learning() };
    let mut rig = Rig::new(AxisSettings { probe: Some(settings), ..rise() });
    rig.now = Moment::from_nanos(1_700_000_000_000_000_000);
    rig.step();
    rig.show(32.0, 24.0);
    touch(&mut rig, HOUR, 9.0);
    let gain = |rig: &Rig| rig.compensation.probe(0).unwrap().gains(0)[0];
    near(gain(&rig), 0.0);
    touch(&mut rig, 60.0, 9.0);
    assert!(gain(&rig) > 0.01, "{}", gain(&rig));
}
