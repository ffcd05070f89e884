//! One axis of a surface grinder warms up for half an hour, then its bed sensor breaks. The example prints the
//! compensation Cz, in µm, for each minute.
//!
//! ```sh
//! cargo run -p isotherm-core --example compensate
//! ```
//!
//! The example never waits. Time is an argument of the step, so half an hour of machine time takes only the
//! computing time.

use std::error::Error;
use std::time::Duration;

use isotherm_core::compensation::model::{Input, Kind, Linear, Model, Reference, Term};
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::quantity::{Celsius, Micron, MicronPerCelsius, MicronPerSecond, Moment};
use isotherm_core::reading::{Reading, Reason, SignalId};

const BED: SignalId = SignalId(0);
const WHEELHEAD: SignalId = SignalId(1);

const SECOND: Duration = Duration::from_secs(1);
/// Final temperature rise of the bed, °C.
const WARMTH: f64 = 4.0;
/// Time constant of the bed, s: the time in which the bed reaches 63 % of the final rise.
const LAG: f64 = 900.0;
/// Time at which the sensor breaks, s.
const BREAKS: u32 = 30 * 60;
/// Time at which the example ends, s.
const ENDS: u32 = 38 * 60;

fn main() -> Result<(), Box<dyn Error>> {
    let machine = MachineSettings { signals: 2, ..MachineSettings::default() };
    let mut compensation = Compensation::new(machine, vec![axis()?], Remembered::default());
    // The first control takes over the register value when the axis is armed.
    let mut control = Control { permit: Permit::Armed, take_over: Some(Micron::ZERO), ..Control::default() };

    println!("  min  bed °C  model µm   Cz µm  state");
    for second in 0..=ENDS {
        let now = Moment::default().after(SECOND * second);
        let readings = readings(second, now);
        // A step between two updates of the axis changes nothing.
        let stepped = compensation.step(&Snapshot::new(now, &readings), &[control]);
        control.take_over = None;
        let Some(decision) = compensation.decision(0).filter(|_| stepped.anything && second % 120 == 0)
        else {
            continue;
        };
        let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
        println!(
            "{:>5}  {:>6}  {:>8}  {:>6.1}  {}",
            second / 60,
            number(readings[BED.0].usable()),
            number(decision.raw.map(Micron::get)),
            decision.cz.get(),
            decision.state,
        );
    }
    Ok(())
}

/// Returns the settings of an axis with `Cz = 2.4 · (bed − wheelhead)`. Cz changes by at most 1 µm in ten seconds.
fn axis() -> Result<AxisSettings, Box<dyn Error>> {
    let gain = MicronPerCelsius::try_from(2.4)?;
    let term = |signal, gain| Term { input: Input::of(signal, Reference::Fixed(Celsius::ZERO), None), gain };
    let terms = vec![term(BED, gain), term(WHEELHEAD, -gain)];
    let difference = Model::new(
        "difference".to_owned(),
        Kind::Linear(Linear { offset: Micron::ZERO, terms, slope: None }),
    );
    Ok(AxisSettings {
        name: "z".to_owned(),
        models: vec![difference],
        guard: GuardSettings {
            limit: Micron::try_from(40.0)?,
            step: Micron::try_from(1.0)?,
            rate: MicronPerSecond::try_from(0.05)?,
            deadband: Micron::try_from(0.1)?,
            count: Some(Micron::try_from(0.1)?),
        },
        every: 10 * SECOND,
        on_fault: OnFault::Ramp { after: 60 * SECOND },
        levels: Levels::default(),
        datum: Datum::Model,
        intercept_slope: None,
        probe: None,
        learned: None,
    })
}

/// Returns the readings of both sensors at this second: the bed warms up, the wheelhead does not.
fn readings(second: u32, now: Moment) -> [Reading; 2] {
    let bed = 20.0 + WARMTH * (1.0 - (-f64::from(second) / LAG).exp());
    let bed = if second < BREAKS { Reading::good(bed, now) } else { Reading::bad(now, Reason::OpenCircuit) };
    [bed, Reading::good(20.0, now)]
}
