//! Sample profile for tests of logs: two axes, four signals.

use std::time::Duration;

use isotherm_core::codec::{Address, DataType, Encoding, Register, Scale, Table, WordOrder};
use isotherm_core::compensation::model::{
    Expression, Formula, Input, Kind, Linear, Model, Reference, Symbol, Term,
};
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm_core::reading::SignalId;
use isotherm_profile::{Arm, Axis, DefaultLimits, DeviceId, History, Profile, Purpose, Signal, Unit};

/// Converts a number to a quantity.
pub(crate) fn of<Quantity: TryFrom<f64, Error = &'static str>>(value: f64) -> Quantity {
    Quantity::try_from(value).unwrap()
}

fn signal(name: &str) -> Signal {
    Signal {
        label: String::new(),
        name: name.to_owned(),
        device: DeviceId(0),
        address: Address::Modbus(Register { table: Table::Input, offset: 0 }),
        encoding: Encoding {
            data_type: DataType::F64,
            word_order: WordOrder::MswFirst,
            byte_swap: false,
            scale: Scale::ONE,
            offset: 0.0,
            bias: 0,
            bad: Vec::new(),
        },
        scale_from: None,
        unit: Unit("degC"),
        range: Some((-20.0, 100.0)),
        max_rate: None,
        defaults: DefaultLimits::default(),
        is_difference: false,
        max_age: Duration::from_secs(5),
        fault_when: None,
        merge: true,
        counter: None,
        capture: None,
    }
}

fn linear(name: &str, terms: &[(usize, f64, Reference)]) -> Model {
    let terms = terms.iter().map(|(place, gain, reference)| Term {
        input: Input::of(SignalId(*place), *reference, None),
        gain: of(*gain),
    });
    let kind = Kind::Linear(Linear { offset: of(0.0), terms: terms.collect(), slope: None });
    Model::new(name.to_owned(), kind)
}

fn axis(name: &str, every: u64, count: f64, on_fault: OnFault, models: Vec<Model>) -> Axis {
    let guard = GuardSettings {
        limit: of(40.0),
        step: of(1.0),
        rate: of(0.5),
        deadband: of(0.1),
        count: Some(of(count)),
    };
    let every = Duration::from_secs(every);
    let name = name.to_owned();
    let (levels, datum) = (Levels::default(), Datum::Model);
    let settings = AxisSettings {
        name,
        models,
        guard,
        every,
        on_fault,
        levels,
        datum,
        intercept_slope: None,
        probe: None,
        learned: None,
    };
    Axis {
        settings,
        label: String::new(),
        diameter: false,
        probe_input: None,
        learning: None,
        purpose: Purpose::Compensation,
    }
}

/// Signals: `bed`, `wheelhead`, `hydraulics_on`, `zero_button`. Axes: z every 10 s (M1, then M2), x every 7 s (rises
/// over zero and start).
pub(crate) fn profile() -> Profile {
    let resolve = |name: &str| match name {
        "A" => Some(Symbol::Signal(SignalId(0))),
        "t" => Some(Symbol::Time),
        _ => None,
    };
    let expression = Expression::parse("2.4 * (A - (2e-5*t + 23.4))", &resolve).unwrap();
    let bed_only = Model::new("bed, only".to_owned(), Kind::Formula(Formula { expression }));
    let absolute = Reference::Fixed(of(0.0));
    let difference = linear("difference", &[(0, 2.4, absolute), (1, -2.4, absolute)]);
    let rises = linear("the \"rises\"", &[(0, 1.7, Reference::Zero), (1, -0.3, Reference::Start)]);
    Profile {
        name: "sample".to_owned(),
        description: String::new(),
        label: String::new(),
        path: "sample.toml".into(),
        machine: MachineSettings {
            on: Some(SignalId(2)),
            zero: Some(SignalId(3)),
            settle: Duration::from_secs(45),
            signals: 4,
        },
        arm: Arm::Auto,
        only_recorded: Vec::new(),
        arm_timeout: Duration::from_secs(600),
        on_stop: isotherm_profile::OnStop::FaultAction,
        buses: Vec::new(),
        devices: Vec::new(),
        signals: ["bed", "wheelhead", "hydraulics_on", "zero_button"].map(signal).into(),
        axes: vec![
            axis("z", 10, 0.1, OnFault::Ramp { after: Duration::from_secs(60) }, vec![difference, bed_only]),
            axis("x", 7, 0.3, OnFault::Zero, vec![rises]),
        ],
        outputs: Vec::new(),
        sets: Vec::new(),
        heartbeat: None,
        web: None,
        mqtt: None,
        opcua_server: None,
        notify: Vec::new(),
        history: History { directory: None, keep: Duration::from_secs(86_400), max_size: u64::MAX },
        overridden: Vec::new(),
        members: isotherm_profile::ProfileMembers::default(),
    }
}
