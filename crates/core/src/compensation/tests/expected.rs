//! Tests of the expected error of the model in use.

use super::super::model::{Envelope, Expected, Growth, Input, Outside};
use super::probes::{probe, probed_axis, zeroing_machine};
use super::*;
use crate::compensation::model::envelope::Identified;
use crate::compensation::settings::{Filter, ProbeSettings};
use crate::quantity::of;

const HOUR: f64 = 3600.0;

fn growth(per_hour: f64, at_once: f64) -> Growth {
    Growth::new(per_hour, at_once).unwrap()
}

/// Adds an expected error to a model: its variance σ² grows by 1 µm² per hour since the datum, and by 1/4 µm² per hour
/// since a probing.
fn expecting(model: Model) -> Model {
    let expected = Expected { since_datum: growth(1.0, 0.0), since_touch: Some(growth(0.25, 0.0)) };
    Model { expected: Some(expected), ..model }
}

fn rise(reference: Reference) -> Model {
    expecting(linear("rise", 0.0, &[term(BED, 2.4, reference)]))
}

#[track_caller]
fn expects(decision: Decision, hours: f64) {
    let found = decision.expected.unwrap().get();
    assert!((found * found - hours).abs() < 1e-9, "{} h, not {hours} h", found * found);
}

#[test]
fn hours_count_from_what_the_model_is_measured_from() {
    // The machine starts at 0 h, and its references are complete 30 s later. It is zeroed at 2 h, complete 30 s later.
    let after_start = 3.0 - 30.0 / HOUR;
    let after_zero = 1.0 - 30.0 / HOUR;
    for (what, axis, hours) in [
        ("a number", axis(vec![rise(Reference::Fixed(of(20.0)))]), 3.0),
        ("a formula", axis(vec![expecting(bed_only())]), 3.0),
        ("start", axis(vec![rise(Reference::Start)]), after_start),
        ("zero", axis(vec![rise(Reference::Zero)]), after_zero),
        (
            "the axis's datum",
            AxisSettings { datum: Datum::Zero, ..axis(vec![rise(Reference::Fixed(of(20.0)))]) },
            after_zero,
        ),
    ] {
        let mut rig = Rig::with(zeroing_machine(), axis);
        rig.step();
        rig.after(30.0);
        rig.after(2.0 * HOUR - 30.0);
        rig.compensation.zero(rig.now);
        rig.after(30.0);
        let found = rig.after(HOUR - 30.0).expected.unwrap().get();
        assert!((found * found - hours).abs() < 1e-9, "{what}: {} h, not {hours} h", found * found);
    }
}

#[test]
fn a_probing_that_was_learned_from_makes_it_smaller_also_after_a_restart() {
    let settings = AxisSettings { models: vec![rise(Reference::Zero)], ..probed_axis(probe()) };
    let mut rig = Rig::with(zeroing_machine(), settings.clone());
    rig.step();
    rig.after(30.0);
    let raw = rig.after(4.0 * HOUR - 1.0).raw.unwrap().get();
    expects(rig.probe(30.0, raw), 4.0);
    assert!(rig.refused().is_some(), "it is rejected");
    expects(rig.probe(2.0, raw), 0.0);
    let first = scale(&[2.0 * 2.0 / (4.0 + 1.0 / HOUR + OWN)]);
    expects(rig.after(2.0 * HOUR), 0.5 * first);
    rig.restart(settings.clone());
    expects(rig.after(2.0 * HOUR), first);
    let mut running = Compensation::new(zeroing_machine(), vec![settings], rig.compensation.running());
    std::mem::swap(&mut running, &mut rig.compensation);
    expects(*rig.compensation.decision(0).unwrap(), first);
    // The learned correction is discarded, and so are its certainty and the scale.
    rig.control.forget = true;
    expects(rig.after(HOUR), 9.0 + 1.0 / HOUR);
    rig.probe(2.0, raw);
    rig.compensation.zero(rig.now);
    rig.after(30.0);
    // A new datum changes the hours, not the scale.
    expects(rig.after(HOUR), scale(&[2.0 * 2.0 / (9.0 + 2.0 / HOUR + OWN)]));
}

/// Variance of a probing itself if the profile gives no `repeat`, µm².
const OWN: f64 = Filter::REPEAT * Filter::REPEAT;

/// Returns the factor φ of the variance after touches with these ratios: squared residual divided by the sum of the
/// expected variance and [`OWN`].
fn scale(ratios: &[f64]) -> f64 {
    let touches = f64::from(u32::try_from(ratios.len()).unwrap());
    (8.0 + ratios.iter().sum::<f64>()) / (8.0 + touches)
}

#[test]
fn touches_widen_the_bar_on_a_day_unlike_the_commissioning_and_narrow_it_on_a_better_one() {
    for (residual, is_wider) in [(6.0, true), (0.01, false)] {
        // A share of nearly nothing: the residual stays the same from touch to touch.
        let probe = ProbeSettings { filter: Filter::Share(1e-9), ..probe() };
        let settings = AxisSettings { models: vec![rise(Reference::Zero)], ..probed_axis(probe) };
        let mut rig = Rig::with(zeroing_machine(), settings);
        rig.step();
        rig.after(30.0);
        let mut ratios = Vec::new();
        for touches in 1..=30_u32 {
            let raw = rig.after(HOUR - 1.0).raw.unwrap().get();
            // After the first touch, the variance grows by 0.25 µm² an hour; the first hour counts from the datum.
            let variance = if touches == 1 { 1.0 } else { 0.25 };
            let decision = rig.probe(residual, raw);
            assert_eq!(decision.expected_touches, touches.min(24));
            ratios.push(residual * residual / (variance + OWN));
        }
        let decision = rig.after(HOUR);
        let found = decision.expected.unwrap().get();
        let wanted = 0.25 * scale(&ratios[ratios.len() - 24..]);
        assert!((found * found / wanted - 1.0).abs() < 1e-6, "{found} {wanted}");
        assert_eq!(found > 0.5, is_wider);
    }
}

#[test]
fn a_probing_that_the_limit_cut_short_makes_nothing_more_certain() {
    let mut rig = Rig::new(AxisSettings { models: vec![rise(Reference::Start)], ..probed_axis(probe()) });
    rig.step();
    let raw = rig.after(HOUR).raw.unwrap().get();
    // Half of 24 µm, and 10 are the limit. The residual scales the error in spite of it.
    let hours = 1.0 + 1.0 / HOUR;
    expects(rig.probe(24.0, raw), hours * scale(&[24.0 * 24.0 / (hours + OWN)]));
    expects(rig.probe(-6.0, raw - 10.0), 0.0);
}

#[test]
fn each_model_has_its_own_or_none() {
    let models = vec![difference(), expecting(bed_only())];
    let mut rig = Rig::new(axis(models));
    rig.step();
    let preferred = rig.after(HOUR);
    assert_eq!((preferred.model, preferred.expected), (Some(0), None));
    let fallback = rig.show(27.5, f64::NAN).after(HOUR);
    assert_eq!(fallback.model, Some(1));
    expects(fallback, 2.0);
    assert_eq!(rig.show(f64::NAN, f64::NAN).after(HOUR).expected, None, "no model");
}

#[test]
fn without_a_probe_only_the_datum_counts_and_outside_the_envelope_nothing_does() {
    for outside in [Outside::Warn, Outside::Hold, Outside::Shrink] {
        let input = Input::of(BED, Reference::Fixed(of(0.0)), None);
        let known = Identified { input, mean: 25.0, range: (20.0, 30.0) };
        let envelope = Some(Envelope::new(vec![known], &[vec![1e4]], None, outside).unwrap());
        let mut rig = Rig::new(axis(vec![Model { envelope, ..rise(Reference::Start) }]));
        rig.step();
        expects(rig.after(HOUR), 1.0);
        assert_eq!(rig.show(31.0, 24.0).after(HOUR).expected, None, "{outside:?}");
        expects(rig.show(28.0, 24.0).after(HOUR), 3.0);
    }
}

#[test]
fn a_decision_of_before_there_was_such_a_thing_is_still_read() {
    let mut rig = Rig::new(axis(vec![rise(Reference::Start)]));
    rig.step();
    let mut kept = serde_json::to_value(rig.after(HOUR)).unwrap();
    assert!(kept.as_object_mut().unwrap().remove("expected").unwrap().is_number());
    assert!(kept.as_object_mut().unwrap().remove("expected_touches").unwrap().is_number());
    let read: Decision = serde_json::from_value(kept).unwrap();
    assert_eq!((read.expected, read.expected_touches), (None, 0));
}

#[test]
fn a_pause_counts_also_where_hours_count_from_the_start() {
    for reference in [Reference::Start, Reference::Fixed(of(20.0))] {
        let mut rig = Rig::new(axis(vec![rise(reference)]));
        rig.now = Moment::from_nanos(1_700_000_000_000_000_000);
        rig.step();
        rig.after(HOUR);
        let kept = serde_json::to_string(&rig.compensation.remembered()).unwrap();
        let kept: Remembered = serde_json::from_str(&kept).unwrap();
        let stop = Stop { by_the_clock: Some(seconds(2.0 * HOUR)) };
        let now = Moment::from_nanos(1_000_000_000_000_000_000);
        let kept = kept.resumed(rig.now, now, stop);
        rig.compensation =
            Compensation::new(rig.compensation.settings.clone(), vec![axis(vec![rise(reference)])], kept);
        rig.now = now;
        expects(rig.after(HOUR), 4.0);
    }
}
