use super::model::{Expression, Formula, Input, Kind, Linear, Model, Reference, Slope, Symbol, Term};
use super::settings::{Datum, GuardSettings, InterceptSlope, Levels, OnFault};
use super::*;
use crate::quantity::of;
use crate::reading::{Reading, Reason};
use std::time::Duration;

mod behind;
mod datum;
mod expected;
mod intercept_slope;
mod lags;
mod levels;
mod models;
mod outside;
mod preferred;
mod probes;
mod properties;
mod rejected;
mod restarted;
mod returns;
mod signs;
mod stand_ins;
mod states;
mod weighed;
mod worse;

const BED: SignalId = SignalId(0);
const WHEELHEAD: SignalId = SignalId(1);
const ON: SignalId = SignalId(2);
const BUTTON: SignalId = SignalId(3);

fn um(value: f64) -> Micron {
    Micron::new(value).unwrap()
}

fn seconds(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds)
}

fn term<Gain: TryFrom<f64, Error = &'static str>>(
    signal: SignalId,
    gain: f64,
    reference: Reference,
) -> Term<Gain> {
    lagged(signal, gain, reference, None)
}

fn lagged<Gain: TryFrom<f64, Error = &'static str>>(
    signal: SignalId,
    gain: f64,
    reference: Reference,
    lag: Option<Duration>,
) -> Term<Gain> {
    Term { input: Input::of(signal, reference, lag), gain: of(gain) }
}

fn linear(name: &str, offset: f64, terms: &[Term]) -> Model {
    let kind = Kind::Linear(Linear { offset: um(offset), terms: terms.to_vec(), slope: None });
    Model::new(name.to_owned(), kind)
}

fn formula(name: &str, text: &str) -> Model {
    let resolve = |name: &str| match name {
        "A" => Some(Symbol::Signal(BED)),
        "t" => Some(Symbol::Time),
        "Kz" => Some(Symbol::Constant(2.4)),
        "b" => Some(Symbol::Constant(2e-5)),
        "c" => Some(Symbol::Constant(23.4)),
        _ => None,
    };
    let expression = Expression::parse(text, &resolve).unwrap();
    Model::new(name.to_owned(), Kind::Formula(Formula { expression }))
}

/// Model M1: `Cz = Kz (A − B)`.
fn difference() -> Model {
    let absolute = Reference::Fixed(of(0.0));
    linear("difference", 0.0, &[term(BED, 2.4, absolute), term(WHEELHEAD, -2.4, absolute)])
}

/// Model M2: `Cz = Kz·A + f1(t)`.
fn bed_only() -> Model {
    formula("bed only", "Kz * (A - (b*t + c))")
}

fn axis(models: Vec<Model>) -> AxisSettings {
    AxisSettings {
        name: "z".to_owned(),
        models,
        guard: GuardSettings {
            limit: um(40.0),
            step: um(1.0),
            rate: of(0.5),
            deadband: um(0.1),
            count: Some(um(0.1)),
        },
        every: seconds(10.0),
        on_fault: OnFault::Ramp { after: seconds(60.0) },
        levels: Levels::default(),
        datum: Datum::Model,
        intercept_slope: None,
        probe: None,
        learned: None,
    }
}

/// Machine with one axis, whose readings the test sets. NaN stands for a bad reading.
struct Rig {
    compensation: Compensation,
    now: Moment,
    values: [f64; 4],
    control: Control,
}

impl Rig {
    fn new(axis: AxisSettings) -> Rig {
        Rig::with(MachineSettings { signals: 4, ..MachineSettings::default() }, axis)
    }

    fn with(settings: MachineSettings, axis: AxisSettings) -> Rig {
        Rig {
            compensation: Compensation::new(settings, vec![axis], Remembered::default()),
            now: Moment::from_nanos(0),
            values: [27.5, 24.0, 0.0, 0.0],
            control: Control { permit: Permit::Armed, ..Control::default() },
        }
    }

    /// Steps the axis at the present time. Requests in the control, such as a probing, apply to this step only.
    fn step(&mut self) -> Decision {
        let (now, values) = (self.now, self.values);
        let readings = values.map(|value| match value.is_nan() {
            true => Reading::bad(now, Reason::Timeout),
            false => Reading::good(value, now),
        });
        self.compensation.step(&Snapshot::new(now, &readings), &[self.control]);
        self.control = Control { permit: self.control.permit, ..Control::default() };
        *self.compensation.decision(0).unwrap()
    }

    fn after(&mut self, span: f64) -> Decision {
        self.now = self.now.after(seconds(span));
        self.step()
    }

    /// Steps the axis whenever it is due, for `span` seconds. Returns the decisions.
    fn run(&mut self, span: f64) -> Vec<Decision> {
        let end = self.now.after(seconds(span));
        let mut decisions = Vec::new();
        while let Some(due) = self.compensation.next_due().filter(|due| *due <= end) {
            self.now = due.max(self.now);
            decisions.push(self.step());
        }
        self.now = end;
        decisions
    }

    fn permit(&mut self, permit: Permit) -> &mut Rig {
        self.control.permit = permit;
        self
    }

    fn found(&mut self, found: f64) -> &mut Rig {
        self.control.take_over = Some(um(found));
        self
    }

    fn show(&mut self, bed: f64, wheelhead: f64) -> &mut Rig {
        self.values[0] = bed;
        self.values[1] = wheelhead;
        self
    }
}
