//! The control loop must not wait for an allocator: a steady step asks it for nothing.
#![allow(clippy::expect_used, reason = "a test may stop at what cannot be")]

use std::time::Duration;

use isotherm_core::compensation::model::envelope::Identified;
use isotherm_core::compensation::model::network::{
    Activation, Layer, Layers, Net, Network, Node, Radial, Scaling,
};
use isotherm_core::compensation::model::stand_ins::Described;
use isotherm_core::compensation::model::{
    Envelope, Expression, Formula, Input, Kind, Linear, Matrix, Model, Outside, Reference, Slope, StandIns,
    Symbol, Term,
};
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, Filter, GainSettings, GuardSettings, Levels, MachineSettings, OnFault, OnWorse,
    ProbeSettings,
};
use isotherm_core::compensation::{Compensation, Control, Measured, Permit, Remembered, Snapshot};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Reading, Reason, SignalId};

/// A number as the quantity that is asked for.
fn of<Quantity: TryFrom<f64, Error = &'static str>>(value: f64) -> Quantity {
    Quantity::try_from(value).expect("finite")
}

fn compensation() -> Compensation {
    let rise = |place, reference, lag| Input::of(SignalId(place), reference, lag);
    let term = |place, reference, lag| Term { input: rise(place, reference, lag), gain: of(2.4) };
    let half_an_hour = Some(Duration::from_secs(1800));
    let terms = vec![
        term(0, Reference::Start, None),
        term(1, Reference::Zero, half_an_hour),
        term(2, Reference::Fixed(of(20.0)), half_an_hour),
    ];
    let inclined = vec![Term { input: rise(1, Reference::Start, half_an_hour), gain: of(2.4) }];
    let slope = Some(Slope { position: SignalId(2), reference: of(20.0), travel: None, terms: inclined });
    let resolve = |name: &str| match name {
        "A" => Some(Symbol::Signal(SignalId(0))),
        "t" => Some(Symbol::Time),
        _ => None,
    };
    let expression = Expression::parse("2.4 * max(A - (2e-5*t + 23.4), 0)", &resolve).expect("a formula");
    let input = |place| Input::of(SignalId(place), Reference::Fixed(of(20.0)), None);
    let late = Input::of(SignalId(0), Reference::Fixed(of(20.0)), half_an_hour);
    let matrix =
        Matrix::new("m.json", vec![late, input(1)], SignalId(2), vec![of(0.0), of(20.5)], vec![of(0.5); 4]);
    let node = Node { centre: vec![1.0], width: 2.0, weight: 3.0 };
    let scaling = Scaling::new(&[20.0], &[4.0]).expect("scaling");
    let radial = Radial::new(scaling.clone(), vec![node], 0.0, (0.0, 1.0)).expect("nodes");
    let layer = Layer { weights: vec![vec![1.5]], bias: vec![0.5], activation: Activation::Tanh };
    let layers = Layers::new(scaling, vec![layer], (0.0, 1.0)).expect("layers");
    let network = |net| Kind::Network(Network::new("n.json", net, vec![input(1)]).expect("one input"));
    let known = Identified { input: input(1), mean: 1.0, range: (0.0, 1.5) };
    let envelope = Envelope::new(vec![known], &[vec![1.0]], None, Outside::Hold).expect("a region");
    let probe = Some(ProbeSettings {
        limit: of(10.0),
        filter: Filter::Weighed { repeat: 0.5, walk: 4.0 },
        max_error: of(100.0),
        warn: None,
        gains: Some(GainSettings { forgetting: 0.98, limit: 0.2 }),
        worse: OnWorse::Warn,
    });
    let axis = AxisSettings {
        name: "z".to_owned(),
        models: vec![
            Model::new("rises".to_owned(), Kind::Linear(Linear { offset: of(0.0), terms, slope })),
            Model::new("bed only".to_owned(), Kind::Formula(Formula { expression })),
        ],
        guard: GuardSettings {
            limit: of(40.0),
            step: of(1.0),
            rate: of(0.5),
            deadband: of(0.1),
            count: Some(of(0.1)),
        },
        every: Duration::from_secs(10),
        on_fault: OnFault::Ramp { after: Duration::from_secs(60) },
        levels: Levels::default(),
        datum: Datum::Zero,
        intercept_slope: None,
        probe,
        learned: None,
    };
    let machine = MachineSettings {
        on: Some(SignalId(3)),
        zero: Some(SignalId(4)),
        settle: Duration::from_secs(30),
        signals: 5,
    };
    let of_files =
        [Kind::Matrix(matrix.expect("a matrix")), network(Net::Radial(radial)), network(Net::Layers(layers))];
    let of_file = |kind| {
        let model = Model { envelope: Some(envelope.clone()), ..Model::new("file".to_owned(), kind) };
        AxisSettings { models: vec![model], ..axis.clone() }
    };
    let said = |signal, other, lag| Described {
        signal: SignalId(signal),
        threshold: 0.3,
        stands_in: true,
        terms: vec![Described::term(SignalId(other), lag, 0.5), Described::term(SignalId(2), None, 0.5)],
    };
    let stand_ins = StandIns::new(vec![said(0, 1, None), said(1, 0, half_an_hour)], 1);
    let linear =
        Linear { offset: of(0.0), terms: vec![term(0, Reference::Start, half_an_hour)], slope: None };
    let watched =
        Model { stand_ins: Some(stand_ins), ..Model::new("watched".to_owned(), Kind::Linear(linear)) };
    let watched = AxisSettings { models: vec![watched], ..axis.clone() };
    let axes = of_files.into_iter().map(of_file).chain([axis.clone(), watched]).collect();
    Compensation::new(machine, axes, Remembered::default())
}

#[test]
fn a_step_allocates_nothing() {
    let mut compensation = compensation();
    let mut seen = Vec::with_capacity(6);
    let (mut taught, mut stood_in) = (false, false);
    let mut look = |at: u32| {
        let now = Moment::from_nanos(u64::from(at) * 10_000_000_000);
        let level = f64::from(u8::from(at % 50 > 10));
        let bed = if at % 90 > 60 { Reading::bad(now, Reason::Timeout) } else { Reading::good(25.0, now) };
        let other = if at % 40 > 30 { Reading::bad(now, Reason::Stale) } else { Reading::good(22.0, now) };
        let level = Reading::good(level, now);
        let readings = [bed, other, Reading::good(21.0, now), level, level];
        let permit = if at % 300 > 280 { Permit::Stopping } else { Permit::Armed };
        let take_over = at.is_multiple_of(100).then(|| of(5.0));
        let error = of(f64::from(at % 7) - 3.0);
        let measured = at.is_multiple_of(6).then_some(Measured { error, acting: Some(of(5.0)) });
        let forget = at.is_multiple_of(700);
        let control = Control { permit, take_over, measured, forget, ..Control::default() };
        compensation.step(&Snapshot::new(now, &readings), &[control; 5]);
        if at.is_multiple_of(70) {
            compensation.zero(now);
        }
        taught |= compensation.probe(3).is_some_and(|probe| probe.history().len() == 48);
        for decision in compensation.decisions() {
            stood_in |= decision.stood_in.is_some();
            if !seen.contains(&decision.state.name()) && seen.len() < seen.capacity() {
                seen.push(decision.state.name());
            }
        }
    };
    look(0);
    let allocated = allocation_counter::measure(|| (1..5000).for_each(&mut look));
    assert_eq!(allocated.count_total, 0, "{allocated:?}");
    assert!(stood_in, "nobody stood in");
    assert!(taught, "nothing was learned");
    for state in ["active", "degraded", "holding", "ramping", "zeroed"] {
        assert!(seen.contains(&state), "{state} was not visited: {seen:?}");
    }
}

/// An axis whose first sensor is known to the two others.
fn watched() -> Compensation {
    let rise = |place, lag| Input::of(SignalId(place), Reference::Start, lag);
    let half_an_hour = Some(Duration::from_secs(1800));
    let terms = [rise(0, None), rise(0, half_an_hour), rise(1, None)];
    let terms = terms.map(|input| Term { input, gain: of(2.4) }).to_vec();
    let stood_in = Described {
        signal: SignalId(0),
        threshold: 0.3,
        stands_in: true,
        terms: vec![Described::term(SignalId(1), None, 0.5), Described::term(SignalId(2), half_an_hour, 0.5)],
    };
    let known = |place| Identified { input: rise(place, None), mean: 1.0, range: (-1.0, 90.0) };
    let covariance = [vec![1.0, 0.0], vec![0.0, 1.0]];
    let envelope = Envelope::new(vec![known(0), known(1)], &covariance, Some(1000.0), Outside::Shrink);
    let model = Model {
        stand_ins: Some(StandIns::new(vec![stood_in], 1)),
        envelope: Some(envelope.expect("a region")),
        ..Model::new("watched".to_owned(), Kind::Linear(Linear { offset: of(0.0), terms, slope: None }))
    };
    let guard = GuardSettings {
        limit: of(400.0),
        step: of(20.0),
        rate: of(5.0),
        deadband: of(0.1),
        count: Some(of(0.1)),
    };
    let axis = AxisSettings {
        name: "z".to_owned(),
        models: vec![model],
        guard,
        every: Duration::from_secs(10),
        on_fault: OnFault::Hold,
        levels: Levels::default(),
        datum: Datum::Model,
        intercept_slope: None,
        probe: None,
        learned: None,
    };
    let machine = MachineSettings { signals: 3, ..MachineSettings::default() };
    Compensation::new(machine, vec![axis], Remembered::default())
}

#[test]
fn a_substitution_and_its_end_allocate_nothing() {
    let mut compensation = watched();
    let control = Control { permit: Permit::Armed, ..Control::default() };
    let (mut suspected, mut stood_in) = (0, 0);
    let mut look = |at: u32| {
        let now = Moment::from_nanos(u64::from(at) * 10_000_000_000);
        let rise = f64::from(at) / 120.0;
        // The first sensor reads the same for five hours of each six, and the third one is lost for some of them.
        let frozen = if at % 2160 > 360 { 20.0 } else { 20.0 + rise };
        let third = match at % 2160 > 1400 {
            true => Reading::bad(now, Reason::Timeout),
            false => Reading::good(22.0 + rise, now),
        };
        let readings = [Reading::good(frozen, now), Reading::good(21.0 + rise, now), third];
        compensation.step(&Snapshot::new(now, &readings), &[control]);
        let found = compensation.rejected(0).find(|found| found.frozen);
        suspected += u32::from(found.is_some_and(|found| found.others.is_none()));
        stood_in += u32::from(found.is_some_and(|found| found.others.is_some()));
    };
    look(0);
    let allocated = allocation_counter::measure(|| (1..5000).for_each(&mut look));
    assert_eq!(allocated.count_total, 0, "{allocated:?}");
    assert!(suspected > 100 && stood_in > 100, "{suspected} {stood_in}");
}

#[test]
fn the_counter_counts() {
    let allocated = allocation_counter::measure(|| drop(std::hint::black_box(vec![0u8; 64])));
    assert_eq!(allocated.count_total, 1);
}
