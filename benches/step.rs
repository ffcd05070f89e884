//! Benchmark of one update: decoding a reply, and stepping an axis.
//!
//! If a step has a limit, the benchmark prints it with the figure. The compared figure is that of the fastest of many
//! batches, in which no other process needed the processor.

use std::cell::RefCell;
use std::hint::black_box;
use std::time::Duration;

use criterion::Criterion;
use isotherm::clock::Clock;
use isotherm_core::codec::{DataType, Encoding, WordOrder};
use isotherm_core::compensation::model::network::{Activation, Layer, Layers, Net, Network, Scaling};
use isotherm_core::compensation::model::{
    Expression, Formula, Input, Kind, Linear, Matrix, Model, Reference, Slope, Symbol, Term,
};
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::{Reading, SignalId};

#[cfg(feature = "onnx")]
#[path = "../tests/support/encode.rs"]
mod onnx;

fn decode(criterion: &mut Criterion) {
    let encoding = Encoding {
        data_type: DataType::I16,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: isotherm_core::codec::Scale::of(0.1),
        offset: 0.0,
        bias: 0,
        bad: vec![(-32768).into(), 32767.into()],
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
        models: vec![Model::new("model".to_owned(), kind.clone())],
        guard: GuardSettings {
            limit: micron(40.0),
            step: micron(1.0),
            rate: of(0.5),
            deadband: micron(0.1),
            count: Some(micron(0.1)),
        },
        every: Duration::from_secs(10),
        on_fault: OnFault::Ramp { after: Duration::from_secs(60) },
        levels: Levels::default(),
        datum: Datum::Model,
        intercept_slope: None,
        probe: None,
        learned: None,
    };
    let machine = MachineSettings { signals, ..MachineSettings::default() };
    Compensation::new(machine, vec![axis; axes], Remembered::default())
}

/// A measured limit: name, and figure and limit in µs.
struct Looked {
    name: String,
    found: f64,
    limit: f64,
}

thread_local! {
    static LOOKED: RefCell<Vec<Looked>> = const { RefCell::new(Vec::new()) };
}

const BATCH: u32 = 500;
const BATCHES: usize = 200;

/// Mean time of a step in the fastest batch, µs.
fn fastest(mut step: impl FnMut()) -> f64 {
    let clock = Clock::wall();
    let mut batch = || {
        let begun = clock.now();
        (0..BATCH).for_each(|_| step());
        clock.now().since(begun).as_secs_f64() * 1e6 / f64::from(BATCH)
    };
    (0..BATCHES).map(|_| batch()).fold(f64::INFINITY, f64::min)
}

fn step(criterion: &mut Criterion, name: &str, kind: &Kind, limit: Option<f64>) {
    const SIGNALS: usize = 65;
    stepped::<SIGNALS, 1>(criterion, name, kind, limit);
}

/// Measures steps of axes of this kind. All their signals become warmer together.
fn stepped<const SIGNALS: usize, const AXES: usize>(
    criterion: &mut Criterion,
    name: &str,
    kind: &Kind,
    limit: Option<f64>,
) {
    let mut compensation = compensation(kind, SIGNALS, AXES);
    let control = [Control { permit: Permit::Armed, ..Control::default() }; AXES];
    let mut readings = [Reading::NEVER; SIGNALS];
    let mut now = Moment::from_nanos(0);
    let mut warmer = 0.0;
    let mut once = || {
        now = now.after(Duration::from_secs(10));
        warmer = (warmer + 0.01) % 10.0;
        readings.fill(Reading::good(20.0 + warmer, now));
        compensation.step(&Snapshot::new(now, black_box(&readings)), &control);
        black_box(compensation.decision(AXES - 1).map(|decision| decision.cz));
    };
    criterion.bench_function(name, |bencher| bencher.iter(&mut once));
    if let Some(limit) = limit {
        let looked = Looked { name: name.to_owned(), found: fastest(once), limit };
        LOOKED.with_borrow_mut(|all| all.push(looked));
    }
}

fn steps(criterion: &mut Criterion) {
    let terms = (0..16)
        .map(|place| Term { input: Input::of(SignalId(place), reference(place), None), gain: of(2.4) });
    let linear = Kind::Linear(Linear { offset: of(0.0), terms: terms.collect(), slope: None });
    step(criterion, "step an axis of 16 linear terms", &linear, None);

    let resolve = |name: &str| match name {
        "A" => Some(Symbol::Signal(SignalId(0))),
        "Kz" => Some(Symbol::Constant(2.4)),
        "b" => Some(Symbol::Constant(2e-5)),
        "c" => Some(Symbol::Constant(23.4)),
        "t" => Some(Symbol::Time),
        _ => None,
    };
    if let Ok(expression) = Expression::parse("Kz * (A - (b*t + c))", &resolve) {
        step(criterion, "step an axis with a formula", &Kind::Formula(Formula { expression }), None);
    }
}

/// Measures three axes of thirty terms over thirty signals. Each term has a lag, and ten are in a slope.
fn three_axes(criterion: &mut Criterion) {
    const SIGNALS: usize = 31;
    let input = |place: usize| {
        let lag = Some(Duration::from_secs(600 + 60 * u64::try_from(place).unwrap_or(0)));
        Input::of(SignalId(place), reference(place), lag)
    };
    let position = SignalId(SIGNALS - 1);
    let terms = (20..30).map(|place| Term { input: input(place), gain: of(0.1) }).collect();
    let slope = Slope { position, reference: of(0.0), travel: None, terms };
    let terms = (0..20).map(|place| Term { input: input(place), gain: of(0.1) }).collect();
    let linear = Linear { offset: of(0.0), terms, slope: Some(slope) };
    let name = "step three axes of 30 lagged terms with slopes";
    stepped::<SIGNALS, 3>(criterion, name, &Kind::Linear(linear), Some(1.0));
}

/// Converts a number to the required quantity; zero if it is not finite.
fn of<Quantity: TryFrom<f64> + Default>(value: f64) -> Quantity {
    Quantity::try_from(value).unwrap_or_default()
}

/// Reference of a term: every other term is relative to its value at machine start.
fn reference(place: usize) -> Reference {
    if place.is_multiple_of(2) { Reference::Start } else { Reference::Fixed(of(20.0)) }
}

/// Weight that differs from place to place, and is the same in every run.
fn weight(place: usize) -> f64 {
    f64::from(u8::try_from(place * 37 % 101).unwrap_or_default()) / 101.0 - 0.5
}

fn inputs(count: usize) -> Vec<Input> {
    (0..count).map(|place| Input::of(SignalId(place), Reference::Fixed(of(20.0)), None)).collect()
}

/// Measures models that are in files: a matrix of 64 blocks and 8 guideway points, which has 24 rows, and networks of
/// 30-16-1.
fn files(criterion: &mut Criterion) {
    let guide = (0..8u8).map(|point| of(f64::from(point) * 5.0)).collect();
    let gains = (0..8 * 64).map(|place| of(weight(place))).collect();
    if let Ok(matrix) = Matrix::new("column.json", inputs(64), SignalId(64), guide, gains) {
        step(criterion, "step an axis with a matrix of 24 x 64", &Kind::Matrix(matrix), Some(5.0));
    }
    let hidden: Vec<Vec<f64>> =
        (0..16).map(|row| (0..30).map(|column| weight(row * 30 + column)).collect()).collect();
    let last: Vec<Vec<f64>> = vec![(0..16).map(weight).collect()];
    let (bias, mean, scale) = ([0.1; 16], [2.0; 30], [5.0; 30]);
    let layer = |weights: &[Vec<f64>], bias: &[f64], activation| Layer {
        weights: weights.to_vec(),
        bias: bias.to_vec(),
        activation,
    };
    let layers = vec![layer(&hidden, &bias, Activation::Tanh), layer(&last, &[0.0], Activation::Linear)];
    let net = Scaling::new(&mean, &scale).and_then(|scaling| Layers::new(scaling, layers, (0.0, 10.0)));
    if let Ok(network) = net.and_then(|net| Network::new("net.json", Net::Layers(net), inputs(30))) {
        step(criterion, "step an axis with a network of 30-16-1", &Kind::Network(network), Some(20.0));
    }
    #[cfg(feature = "onnx")]
    {
        use isotherm_core::compensation::model::network::Onnx;
        let layers: [onnx::Dense<'_>; 2] = [(&hidden, &bias, "Tanh"), (&last, &[0.0], "")];
        let file = onnx::network(&mean, &scale, &layers, Some(30));
        let net = Onnx::new(file, 30).map(Net::Onnx);
        if let Ok(network) = net.and_then(|net| Network::new("net.onnx", net, inputs(30))) {
            step(
                criterion,
                "step an axis with an ONNX network of 30-16-1",
                &Kind::Network(network),
                Some(20.0),
            );
        }
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    for bench in [decode, steps, three_axes, files] {
        bench(&mut criterion);
    }
    criterion.final_summary();
    LOOKED.with_borrow(|all| {
        for Looked { name, found, limit } in all {
            let verdict = if found <= limit { "reached" } else { "MISSED" };
            println!("{name}: {found:.2} µs, at most {limit} µs: {verdict}");
        }
    });
}
