//! What one update costs: decoding a reply, and stepping an axis.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use isotherm::codec::{DataType, Encoding, WordOrder};
use isotherm::compensation::model::{
    Expression, Formula, Kind, Linear, Model, Reference, Slope, Symbol, Term,
};
use isotherm::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm::quantity::{Micron, Moment};
use isotherm::reading::{Reading, SignalId};

fn decode(criterion: &mut Criterion) {
    let encoding = Encoding {
        data_type: DataType::I16,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: 0.1,
        offset: 0.0,
        bias: 0,
        bad: vec![-32768, 32767],
    };
    let reply: [u16; 8] = [275, 240, 231, 65_535, 288, 32_767, 305, 199];
    criterion.bench_function("decode a reply of 8 registers", |bencher| {
        bencher.iter(|| {
            black_box(&reply).chunks(1).map(|words| encoding.decode(words).unwrap_or(0.0)).sum::<f64>()
        });
    });
}

fn compensation(kind: &Kind, signals: usize, axes: usize) -> Compensation {
    let micron = |value| Micron::new(value).unwrap_or_default();
    let axis = AxisSettings {
        name: "z".to_owned(),
        models: vec![Model { name: "model".to_owned(), kind: kind.clone() }],
        guard: GuardSettings {
            limit: micron(40.0),
            step: micron(1.0),
            rate: 0.5,
            deadband: micron(0.1),
            count: Some(micron(0.1)),
        },
        every: Duration::from_secs(10),
        on_fault: OnFault::Ramp { after: Duration::from_secs(60) },
        levels: Levels::default(),
        datum: Datum::Model,
        apart: None,
    };
    let machine = MachineSettings { signals, ..MachineSettings::default() };
    Compensation::new(machine, vec![axis; axes], Remembered::default())
}

fn step(criterion: &mut Criterion, name: &str, kind: &Kind) {
    const SIGNALS: usize = 16;
    let mut compensation = compensation(kind, SIGNALS, 1);
    let control = [Control { permit: Permit::Armed, ..Control::default() }];
    let mut readings = [Reading::NEVER; SIGNALS];
    let mut now = Moment::from_nanos(0);
    let mut warmer = 0.0;
    criterion.bench_function(name, |bencher| {
        bencher.iter(|| {
            now = now.after(Duration::from_secs(10));
            warmer = (warmer + 0.01) % 10.0;
            readings.fill(Reading::good(20.0 + warmer, now));
            compensation.step(&Snapshot { now, readings: black_box(&readings) }, &control);
            black_box(compensation.decision(0).map(|decision| decision.cz))
        });
    });
}

fn steps(criterion: &mut Criterion) {
    let terms = (0..16).map(|place| Term {
        signal: SignalId(place),
        gain: 2.4,
        reference: if place % 2 == 0 { Reference::Start } else { Reference::Fixed(20.0) },
        lag: None,
    });
    let linear = Kind::Linear(Linear { offset: 0.0, terms: terms.collect(), slope: None });
    step(criterion, "step an axis of 16 linear terms", &linear);

    let resolve = |name: &str| match name {
        "A" => Some(Symbol::Signal(SignalId(0))),
        "Kz" => Some(Symbol::Constant(2.4)),
        "b" => Some(Symbol::Constant(2e-5)),
        "c" => Some(Symbol::Constant(23.4)),
        "t" => Some(Symbol::Time),
        _ => None,
    };
    if let Ok(expression) = Expression::parse("Kz * (A - (b*t + c))", &resolve) {
        step(criterion, "step an axis with a formula", &Kind::Formula(Formula { expression }));
    }
}

/// Three axes of thirty terms over thirty signals, each term with its lag, ten of them in a slope.
fn three_axes(criterion: &mut Criterion) {
    const SIGNALS: usize = 31;
    let term = |place: usize| Term {
        signal: SignalId(place),
        gain: 0.1,
        reference: if place.is_multiple_of(2) { Reference::Start } else { Reference::Fixed(20.0) },
        lag: Some(Duration::from_secs(600 + 60 * u64::try_from(place).unwrap_or(0))),
    };
    let position = SignalId(SIGNALS - 1);
    let slope = Slope { position, reference: 0.0, travel: None, terms: (20..30).map(term).collect() };
    let linear = Linear { offset: 0.0, terms: (0..20).map(term).collect(), slope: Some(slope) };
    let mut compensation = compensation(&Kind::Linear(linear), SIGNALS, 3);
    let control = [Control { permit: Permit::Armed, ..Control::default() }; 3];
    let mut readings = [Reading::NEVER; SIGNALS];
    let (mut now, mut warmer) = (Moment::from_nanos(0), 0.0);
    criterion.bench_function("step three axes of 30 lagged terms with slopes", |bencher| {
        bencher.iter(|| {
            now = now.after(Duration::from_secs(10));
            warmer = (warmer + 0.01) % 10.0;
            readings.fill(Reading::good(20.0 + warmer, now));
            compensation.step(&Snapshot { now, readings: black_box(&readings) }, &control);
            black_box(compensation.decision(2).map(|decision| decision.cz))
        });
    });
}

criterion_group!(benches, decode, steps, three_axes);
criterion_main!(benches);
