use super::*;
use crate::compensation::model::network::{Activation, Layer, Layers, Net, Scaling};
use crate::compensation::model::{Input, Matrix, Network, TimeConstant};
use crate::quantity::of;

/// Janeczko's example: K = 11.5e-6 1/K, L = 300 mm, C = 1800 s.
const GAIN: f64 = 11.5e-6 * 300.0 * 1000.0;
const CONSTANT: f64 = 1800.0;

fn lagging(reference: Reference) -> Term {
    lagged(BED, GAIN, reference, Some(seconds(CONSTANT)))
}

fn lagged_axis(reference: Reference) -> AxisSettings {
    axis(vec![linear("lag", 0.0, &[lagging(reference)])])
}

fn raw(decision: Decision) -> f64 {
    decision.raw.unwrap().get()
}

fn settled(share: f64) -> f64 {
    1.0 - (-share).exp()
}

/// Steps to each of the times in `wanted`, s, with the lengths of the steps in `spans`, repeated. `bed` gives the
/// temperature at a time. Returns the model's value at each of these times.
fn follow(rig: &mut Rig, spans: &[f64], bed: impl Fn(f64) -> f64, wanted: &[f64]) -> Vec<f64> {
    let (mut time, mut spans, mut found) = (0.0, spans.iter().cycle(), Vec::new());
    rig.show(bed(0.0), 0.0).step();
    for end in wanted {
        while time < *end {
            let span: f64 = spans.next().unwrap().min(end - time);
            time += span;
            // Every step updates the axis: the test is of the lag, not of the axis's period.
            rig.compensation.axes[0].due = None;
            rig.show(bed(time), 0.0).after(span);
        }
        found.push(raw(*rig.compensation.decision(0).unwrap()));
    }
    found
}

const IRREGULAR: [f64; 5] = [0.3, 9.7, 47.0, 1e-3, 120.0];

#[test]
fn m4_the_step_whatever_the_interval() {
    for spans in [&[1.0][..], &[10.0], &[60.0], &[3600.0], &IRREGULAR] {
        let mut rig = Rig::new(lagged_axis(Reference::Fixed(of(20.0))));
        let found = follow(&mut rig, spans, |_| 25.0, &[600.0, 1800.0, 3600.0, 90_000.0]);
        for (found, wanted) in found.iter().zip([4.889835, 10.904080, 14.915466, 17.25]) {
            assert!((found - wanted).abs() < 1e-6, "{spans:?}: {found} {wanted}");
        }
    }
}

#[test]
fn m4_the_ramp_whatever_the_interval() {
    for spans in [&[1.0][..], &[10.0], &[60.0], &[3600.0], &IRREGULAR] {
        for reference in [Reference::Fixed(of(20.0)), Reference::Start] {
            let mut rig = Rig::new(lagged_axis(reference));
            let found = follow(&mut rig, spans, |time| 20.0 + 0.001 * time, &[600.0, 1800.0, 3600.0]);
            for (found, wanted) in found.iter().zip([0.309659, 2.284531, 7.050432]) {
                assert!((found - wanted).abs() < 1e-6, "{spans:?}: {found} {wanted}");
            }
        }
    }
}

/// Models of the kinds that are read from files (matrix and network), each with one lagged input and one gain.
fn lagging_files(reference: Reference) -> [Model; 2] {
    let input = Input::of(BED, reference, Some(seconds(CONSTANT)));
    let layer = Layer { weights: vec![vec![GAIN]], bias: vec![0.0], activation: Activation::Linear };
    let layers = Layers::new(Scaling::new(&[0.0], &[1.0]).unwrap(), vec![layer], (0.0, 1.0)).unwrap();
    let network = Network::new("n.json", Net::Layers(layers), vec![input]).unwrap();
    let matrix =
        Matrix::new("m.json", vec![input], BUTTON, vec![of(0.0), of(9.0)], vec![of(GAIN); 2]).unwrap();
    [Kind::Matrix(matrix), Kind::Network(network)].map(|kind| Model::new("file".to_owned(), kind))
}

#[test]
fn m4_an_input_of_a_matrix_or_a_network_lags_as_a_term_does() {
    for model in lagging_files(Reference::Fixed(of(20.0))) {
        for spans in [&[1.0][..], &[60.0], &IRREGULAR] {
            let mut rig = Rig::new(axis(vec![model.clone()]));
            let found = follow(&mut rig, spans, |_| 25.0, &[600.0, 1800.0, 3600.0]);
            for (found, wanted) in found.iter().zip([4.889835, 10.904080, 14.915466]) {
                assert!((found - wanted).abs() < 1e-6, "{spans:?}: {found} {wanted}");
            }
        }
    }
}

#[test]
fn a_lagging_input_is_remembered_over_an_hour_without_the_gateway() {
    let warming = |time: f64| 20.0 + 0.001 * time;
    for model in lagging_files(Reference::Start) {
        let mut rig = Rig::new(axis(vec![model.clone()]));
        let whole = follow(&mut rig, &[10.0], warming, &[7200.0]);
        let mut rig = Rig::new(axis(vec![model.clone()]));
        follow(&mut rig, &[10.0], warming, &[1800.0]);
        let kept = serde_json::to_string(&rig.compensation.remembered()).unwrap();
        let remembered: Remembered = serde_json::from_str(&kept).unwrap();
        rig.compensation =
            Compensation::new(rig.compensation.settings.clone(), vec![axis(vec![model])], remembered);
        rig.now = Moment::from_nanos(0).after(seconds(5400.0));
        rig.show(warming(5400.0), 0.0).step();
        let last = rig.show(warming(7200.0), 0.0).after(1800.0);
        assert!((raw(last) - whole[0]).abs() < 1e-9, "{last:?} {whole:?}");
    }
}

#[test]
fn a_gap_is_a_straight_line_neither_skipped_nor_reset() {
    let warming = |time: f64| 20.0 + 0.002 * time;
    let mut straight = Rig::new(lagged_axis(Reference::Start));
    let whole = follow(&mut straight, &[10.0], warming, &[7200.0]);
    let mut broken = Rig::new(lagged_axis(Reference::Start));
    follow(&mut broken, &[10.0], warming, &[1800.0]);
    let blind = broken.show(f64::NAN, 0.0).run(3600.0);
    assert!(blind.iter().all(|decision| decision.raw.is_none()), "it is not guessed at");
    broken.show(warming(5400.0), 0.0).step();
    broken.run(0.0);
    broken.show(warming(7200.0), 0.0);
    broken.compensation.axes[0].due = None;
    assert!((raw(broken.after(1800.0)) - whole[0]).abs() < 1e-9);
}

#[test]
fn an_hour_without_the_gateway_changes_less_than_rounding_does() {
    let warming = |time: f64| 20.0 + 0.001 * time;
    let mut rig = Rig::new(lagged_axis(Reference::Start));
    let whole = follow(&mut rig, &[10.0], warming, &[9000.0]);
    let mut rig = Rig::new(lagged_axis(Reference::Start));
    let before = follow(&mut rig, &[10.0], warming, &[1800.0]);
    let kept = serde_json::to_string(&rig.compensation.remembered()).unwrap();
    let remembered: Remembered = serde_json::from_str(&kept).unwrap();
    assert_eq!(remembered, rig.compensation.remembered(), "every digit");
    let settings = vec![rig.compensation.axes[0].settings.clone()];
    rig.compensation = Compensation::new(rig.compensation.settings.clone(), settings, remembered);
    rig.now = Moment::from_nanos(0).after(seconds(5400.0));
    let mut last = rig.found(before[0]).show(warming(5400.0), 0.0).step();
    while rig.now < Moment::from_nanos(0).after(seconds(9000.0)) {
        rig.values[0] = warming(rig.now.as_secs_f64() + 10.0);
        let decision = rig.after(10.0);
        assert!((decision.cz - last.cz).abs().get() <= 1.0 + 1e-9, "never a step above `step`");
        last = decision;
    }
    assert!((raw(last) - whole[0]).abs() < 1e-9, "{last:?} {whole:?}");
    assert!((last.cz.get() - whole[0]).abs() < 0.2);
}

#[test]
fn a_term_that_is_another_one_now_begins_anew() {
    let mut rig = Rig::new(lagged_axis(Reference::Fixed(of(20.0))));
    follow(&mut rig, &[10.0], |_| 25.0, &[1800.0]);
    let remembered = rig.compensation.remembered();
    let begin = |model: Model| {
        let settings = MachineSettings { signals: 4, ..MachineSettings::default() };
        let mut other = Rig::new(axis(vec![model.clone()]));
        other.compensation = Compensation::new(settings, vec![axis(vec![model])], remembered.clone());
        other.now = rig.now;
        raw(other.show(25.0, 25.0).step())
    };
    let same = lagging(Reference::Fixed(of(20.0)));
    assert!((begin(linear("lag", 0.0, &[same])) - 10.904080).abs() < 1e-6);
    for other in [
        linear("other", 0.0, &[same]),
        linear("lag", 0.0, &[Term { input: Input { signal: WHEELHEAD, ..same.input }, ..same }]),
        linear(
            "lag",
            0.0,
            &[Term { input: Input { lag: Some(TimeConstant::of(seconds(900.0))), ..same.input }, ..same }],
        ),
    ] {
        assert!(begin(other.clone()).abs() < 1e-12, "{other:?}");
    }
}

#[test]
fn a_machine_start_begins_the_term_anew() {
    let settings = MachineSettings { on: Some(ON), signals: 4, ..MachineSettings::default() };
    let mut rig = Rig::with(settings, lagged_axis(Reference::Start));
    rig.values[ON.0] = 1.0;
    rig.show(20.0, 0.0).step();
    rig.show(25.0, 0.0).run(7200.0);
    rig.values[ON.0] = 0.0;
    rig.after(10.0);
    rig.values[ON.0] = 1.0;
    assert!(raw(rig.after(10.0)).abs() < 1e-12, "the rise is zero at the start");
    let decision = rig.show(25.0, 0.0).after(600.0);
    assert!(raw(decision).abs() < 1e-12, "and 25 °C is where it began");
}

#[test]
fn a_zero_lets_the_structure_make_up_its_rest() {
    let mut rig = Rig::new(lagged_axis(Reference::Zero));
    rig.show(20.0, 0.0).step();
    // A step: both temperatures at the same time.
    rig.compensation.axes[0].due = None;
    rig.show(25.0, 0.0).step();
    let before = raw(rig.after(1800.0));
    assert!((before - 17.25 * settled(1.0)).abs() < 1e-5);
    rig.compensation.zero(rig.now);
    let (mut last, mut highest) = (rig.compensation.decision(0).unwrap().cz, 0.0f64);
    assert!(raw(rig.after(10.0)).abs() < 1e-9, "the rise is measured from here");
    for decision in rig.run(36_000.0) {
        assert!((decision.cz - last).abs().get() <= 1.0 + 1e-9);
        last = decision.cz;
        highest = highest.max(raw(decision));
    }
    let rest = 17.25 * (1.0 - settled(1.0));
    assert!((highest - rest).abs() < 0.05, "what was still to come comes: {highest} of {rest}");
}

#[test]
fn time_that_stands_or_runs_back_moves_no_structure() {
    let mut rig = Rig::new(lagged_axis(Reference::Fixed(of(20.0))));
    follow(&mut rig, &[10.0], |_| 25.0, &[1800.0]);
    let there = raw(*rig.compensation.decision(0).unwrap());
    rig.compensation.axes[0].due = None;
    assert!((raw(rig.show(90.0, 0.0).step()) - there).abs() < 1e-12);
    rig.now = Moment::from_nanos(0).after(seconds(600.0));
    assert!((raw(rig.show(25.0, 0.0).step()) - there).abs() < 1e-12);
    rig.compensation.axes[0].due = None;
    let later = raw(rig.show(25.0, 0.0).after(1800.0));
    assert!((later - (there + (17.25 - there) * settled(1.0))).abs() < 1e-9, "and then it goes on");
}

#[test]
fn a_lag_goes_on_while_its_axis_is_off() {
    let mut rig = Rig::new(lagged_axis(Reference::Fixed(of(20.0))));
    rig.permit(Permit::Off).show(25.0, 0.0).step();
    let decisions = rig.run(1800.0);
    assert!((raw(*decisions.last().unwrap()) - 10.904080).abs() < 1e-6);
}

#[test]
fn m5_a_slope_adds_its_share_by_the_distance() {
    let position = SignalId(3);
    let slope = Slope {
        position,
        reference: of(0.0),
        travel: None,
        terms: vec![term(BED, 0.007, Reference::Fixed(of(20.0)))],
    };
    let linear = Linear { offset: of(0.0), terms: Vec::new(), slope: Some(slope) };
    let model = |linear: &Linear| Model::new("slope".to_owned(), Kind::Linear(linear.clone()));
    let mut rig = Rig::new(axis(vec![model(&linear)]));
    rig.values[position.0] = -300.0;
    assert!((raw(rig.show(25.0, 0.0).step()) - -10.5).abs() < 1e-9);
    rig.values[position.0] = f64::NAN;
    assert_eq!(rig.after(10.0).lacks, Some(Unusable::Signal(position)));
    // M13: K0 = 5 µm, tanβ = 0.035 µm/mm, P0 = 0, P = −300.
    let terms = vec![term(WHEELHEAD, 1.0, Reference::Fixed(of(0.0)))];
    let mut rig = Rig::new(axis(vec![model(&Linear { terms, ..linear })]));
    rig.values[position.0] = -300.0;
    assert!((raw(rig.show(25.0, 5.0).step()) - -5.5).abs() < 1e-9);
}

#[test]
fn m7_a_wheel_and_a_headstock_added_up() {
    let fixed = Reference::Fixed(of(0.0));
    let terms: Vec<Term> = [(0, -0.632), (1, -1.772), (2, 3.066), (3, 1.20), (2, -0.99)]
        .map(|(place, gain)| term(SignalId(place), gain, fixed))
        .into();
    let mut rig = Rig::new(axis(vec![linear("Cw + Ch", 0.0, &terms)]));
    rig.values = [9.5, 3.0, 2.5, 9.5];
    let radius = raw(rig.step());
    assert!((radius - 5.270).abs() < 1e-9, "{radius}");
    assert!((2.0 * radius - 10.540).abs() < 1e-9);
}

#[test]
fn the_square_of_a_speed_lags_as_its_square() {
    let square = |lag| {
        let input = Input { squared: true, ..Input::of(BED, Reference::Fixed(of(0.0)), lag) };
        Rig::new(axis(vec![linear("square", 0.0, &[Term { input, gain: of(1.2e-7) }])]))
    };
    let whole = 1.2e-7 * 6000.0 * 6000.0;
    let now = raw(square(None).show(6000.0, 0.0).step());
    assert!((now - whole).abs() < 1e-12, "{now}");
    let mut late = square(Some(seconds(CONSTANT)));
    let found = follow(&mut late, &IRREGULAR, |_| 6000.0, &[600.0, 1800.0]);
    for (found, span) in found.iter().zip([600.0, 1800.0]) {
        assert!((found - whole * settled(span / CONSTANT)).abs() < 1e-9, "{found}");
    }
    let mut rising = square(None);
    rising.compensation.axes[0].settings.models = vec![linear(
        "from",
        0.0,
        &[Term { input: Input { squared: true, ..Input::of(BED, Reference::Start, None) }, gain: of(1.0) }],
    )];
    rising.show(3.0, 0.0).step();
    let found = raw(rising.show(5.0, 0.0).after(10.0));
    assert!((found - 16.0).abs() < 1e-12, "5² − 3², not (5 − 3)²: {found}");
}

#[test]
fn a_kept_lag_of_a_speed_is_not_that_of_its_square() {
    let plain = lagging(Reference::Fixed(of(0.0)));
    let squared = Term { input: Input { squared: true, ..plain.input }, ..plain };
    let settings = |term: Term| axis(vec![linear("lag", 0.0, &[term])]);
    let mut rig = Rig::new(settings(plain));
    rig.show(25.0, 0.0).run(600.0);
    let kept = rig.compensation.remembered();
    let first = |term| {
        let mut rig = Rig::new(settings(term));
        rig.compensation =
            Compensation::new(rig.compensation.settings.clone(), vec![settings(term)], kept.clone());
        raw(rig.show(25.0, 0.0).after(1200.0))
    };
    assert!(first(plain) > 1.0, "it goes on");
    assert!(first(squared).abs() < 1e-12, "it begins");
}
