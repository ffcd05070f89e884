use std::time::Duration;

use super::*;
use crate::compensation::model::{Expression, Formula, Input, Kind, Linear, Slope, Symbol, Term};
use crate::compensation::substitution::SubstituteSource;
use crate::quantity::{Moment, of};
use crate::reading::Reason;

const BED: usize = 0;
const COLUMN: usize = 1;

/// Linear model of two temperatures, with gains of −2 µm/°C and +0.5 µm/°C. Both rises are counted from 20 °C.
fn linear(lag: Option<Duration>) -> Model {
    let term = |place, gain: f64| Term {
        input: Input::of(SignalId(place), Reference::Fixed(of(20.0)), lag),
        gain: of(gain),
    };
    let terms = vec![term(BED, -2.0), term(COLUMN, 0.5)];
    Model::new("warm".to_owned(), Kind::Linear(Linear { offset: of(7.0), terms, slope: None }))
}

fn contributions(model: &Model, values: &[f64]) -> Vec<(usize, f64)> {
    contributions_with(model, values, &[], false)
}

fn contributions_with(
    model: &Model,
    values: &[f64],
    substitutions: &[Substitution],
    splits_slope: bool,
) -> Vec<(usize, f64)> {
    let now = Moment::from_nanos(0);
    let reading = |value: &f64| match value.is_nan() {
        true => Reading::bad(now, Reason::Timeout),
        false => Reading::good(*value, now),
    };
    let readings: Vec<Reading> = values.iter().map(reading).collect();
    let snapshot = Snapshot { substitutions, ..Snapshot::new(now, &readings) };
    let machine = Machine::default();
    let found = model.contributions(&Inputs { snapshot, machine: &machine, lags: &[], splits_slope });
    found.iter().map(|part| (part.signal.0, part.cz.get())).collect()
}

fn assert_near(found: &[(usize, f64)], expected: &[(usize, f64)]) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for ((signal, cz), (wanted, number)) in found.iter().zip(expected) {
        assert!(signal == wanted && (cz - number).abs() < 1e-6 * number.abs().max(1.0), "{found:?}");
    }
}

#[test]
fn the_signal_that_moves_the_axis_comes_first() {
    for lag in [None, Some(Duration::from_secs(5400))] {
        let model = linear(lag);
        assert_near(&contributions(&model, &[24.0, 30.0]), &[(BED, -8.0), (COLUMN, 5.0)]);
        assert_near(&contributions(&model, &[21.0, 30.0]), &[(COLUMN, 5.0), (BED, -2.0)]);
        assert_near(&contributions(&model, &[1e9, 30.0]), &[(BED, -2e9 + 40.0), (COLUMN, 5.0)]);
        assert_near(&contributions(&model, &[20.0, 20.0]), &[(BED, 0.0), (COLUMN, 0.0)]);
    }
}

#[test]
fn a_model_without_a_value_has_no_contributions() {
    assert_near(&contributions(&linear(None), &[24.0, f64::NAN]), &[]);
    let mut from_start = linear(None);
    let Kind::Linear(model) = &mut from_start.kind else { unreachable!() };
    model.terms[0].input.reference = Reference::Start;
    assert_near(&contributions(&from_start, &[24.0, 30.0]), &[]);
}

#[test]
fn the_signals_of_a_formula_count_from_zero_without_a_machine_start() {
    let symbol = |name: &str| match name {
        "bed" => Some(Symbol::Signal(SignalId(BED))),
        "column" => Some(Symbol::Signal(SignalId(COLUMN))),
        _ => None,
    };
    let expression = Expression::parse("2 * bed - column", &symbol).unwrap();
    let model = Model::new("formula".to_owned(), Kind::Formula(Formula { expression }));
    assert_near(&contributions(&model, &[3.0, 10.0]), &[(COLUMN, -10.0), (BED, 6.0)]);
}

/// The sensor of the bed is lost. The axis follows the model with the value of its stand-in.
#[test]
fn a_sensor_with_a_stand_in_contributes_the_value_of_the_stand_in() {
    let source = SubstituteSource::Predictors { value: Some(24.0), rise: 4.0 };
    let (signal, since) = (SignalId(BED), Moment::from_nanos(0));
    let stand_in = [Substitution { signal, frozen: false, since, source }];
    for lag in [None, Some(Duration::from_secs(5400))] {
        let found = contributions_with(&linear(lag), &[f64::NAN, 30.0], &stand_in, false);
        assert_near(&found, &[(BED, -8.0), (COLUMN, 5.0)]);
    }
}

/// The control applies the slope itself. The gateway does not need the position.
#[test]
fn a_slope_that_the_control_applies_needs_no_position() {
    let mut model = linear(None);
    let Kind::Linear(line) = &mut model.kind else { unreachable!() };
    line.slope = Some(Slope { position: SignalId(2), reference: of(0.0), travel: None, terms: Vec::new() });
    let values = [24.0, 30.0, f64::NAN];
    assert_near(&contributions_with(&model, &values, &[], true), &[(BED, -8.0), (COLUMN, 5.0)]);
    assert_near(&contributions_with(&model, &values, &[], false), &[]);
}
