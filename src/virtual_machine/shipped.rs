//! The shipped profiles against their plants, without sockets: the coefficients are those of one day, and they hold
//! on twenty others.

use std::time::Duration;

use super::plant::{Plant, PlantSpec};
use crate::compensation::model::{Kind, Linear, Model, Reference, Term};
use crate::compensation::settings::{AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault};
use crate::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use crate::quantity::Micron;
use crate::reading::{Reading, SignalId};

mod fit;
mod hold;
mod machines;
mod rig;

/// The day the coefficients were identified on.
const CALIBRATION: u64 = 100;

struct Shipped {
    name: &'static str,
    on: &'static str,
    hours: u64,
    profile: toml::Table,
}

fn grinder() -> Shipped {
    let profile = include_str!("../../profiles/surface-grinder.toml").parse().unwrap();
    Shipped { name: "surface-grinder", on: "hydraulics_on", hours: 8, profile }
}

fn edm() -> Shipped {
    let profile = include_str!("../../profiles/sinker-edm.toml").parse().unwrap();
    Shipped { name: "sinker-edm", on: "machine_on", hours: 12, profile }
}

fn number(table: &toml::Table, key: &str) -> f64 {
    table[key].as_float().unwrap()
}

impl Shipped {
    fn axis(&self) -> &toml::Table {
        self.profile["axis"]["z"].as_table().unwrap()
    }

    /// One of the profile's models, by its place.
    fn model(&self, place: usize) -> &toml::Table {
        self.axis()["model"][place].as_table().unwrap()
    }

    /// The preferred model's signals with their gains.
    fn terms(&self) -> Vec<(String, f64)> {
        let terms = self.model(0)["terms"].as_array().unwrap();
        let term = |term: &toml::Value| {
            let term = term.as_table().unwrap();
            assert_eq!(term["reference"].as_str(), Some("start"));
            (term["signal"].as_str().unwrap().to_owned(), number(term, "gain"))
        };
        terms.iter().map(term).collect()
    }

    fn plant(&self, seed: u64) -> Plant {
        let spec = PlantSpec::shipped(self.name).unwrap().unwrap();
        Plant::new(&spec, seed, spec.start())
    }

    /// The core of the gateway on this seed's day: the extents of the error alone and of what is left, second by
    /// second from the first minute on.
    fn day(&self, seed: u64) -> (f64, f64) {
        let terms = self.terms();
        let mut plant = self.plant(seed);
        let begin = PlantSpec::shipped(self.name).unwrap().unwrap().start();
        let mut core = self.core(&terms);
        let mut readings = vec![Reading::NEVER; terms.len() + 1];
        let mut extents = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for second in 0..=self.hours * 3600 {
            let now = begin.after(Duration::from_secs(second));
            plant.advance_to(now);
            let signals = [self.on].into_iter().chain(terms.iter().map(|(signal, _)| signal.as_str()));
            for (reading, signal) in readings.iter_mut().zip(signals) {
                *reading = Reading::good(plant.sensor(signal).unwrap(), now);
            }
            let control = Control { permit: Permit::Armed, ..Control::default() };
            core.step(&Snapshot { now, readings: &readings }, &[control]);
            if second >= 60 {
                let error = plant.true_error_um("z").unwrap();
                let residual = error + core.decision(0).unwrap().cz.get();
                for (extent, value) in extents.iter_mut().zip([error, residual]) {
                    *extent = [extent[0].min(value), extent[1].max(value)];
                }
            }
        }
        (extents[0][1] - extents[0][0], extents[1][1] - extents[1][0])
    }

    fn core(&self, terms: &[(String, f64)]) -> Compensation {
        let axis = self.axis();
        let terms = terms.iter().enumerate().map(|(place, (_, gain))| Term {
            signal: SignalId(place + 1),
            gain: *gain,
            reference: Reference::Start,
            lag: None,
        });
        let linear = Linear { offset: number(self.model(0), "offset"), terms: terms.collect(), slope: None };
        let micron = |key| Micron::new(number(axis, key)).unwrap();
        let settings = AxisSettings {
            name: "z".to_owned(),
            models: vec![Model { name: "first".to_owned(), kind: Kind::Linear(linear), envelope: None }],
            guard: GuardSettings {
                limit: micron("limit"),
                step: micron("step"),
                rate: number(axis, "rate"),
                deadband: micron("deadband"),
                count: Micron::new(0.1),
            },
            every: Duration::from_secs(10),
            on_fault: OnFault::Hold,
            levels: Levels::default(),
            datum: Datum::Model,
            apart: None,
            probe: None,
        };
        let machine = MachineSettings {
            on: Some(SignalId(0)),
            zero: None,
            settle: Duration::from_secs(180),
            signals: 1 + self.terms().len(),
        };
        Compensation::new(machine, vec![settings], Remembered::default())
    }

    /// The calibration day as a person would record it, one row a minute: machine-on time, the model's signals, and
    /// their references, and the error.
    fn calibration(&self) -> Vec<Row> {
        let signals: Vec<String> = self.terms().into_iter().map(|(signal, _)| signal).collect();
        let mut plant = self.plant(CALIBRATION);
        let begin = PlantSpec::shipped(self.name).unwrap().unwrap().start();
        let (mut on, mut sums, mut rows) = (None, vec![0.0; signals.len()], Vec::new());
        for second in 0..=self.hours * 3600 {
            plant.advance_to(begin.after(Duration::from_secs(second)));
            if plant.sensor(self.on).unwrap() > 0.5 {
                on = on.or(Some(second));
            }
            let Some(t) = on.map(|on| second - on) else { continue };
            let values: Vec<f64> = signals.iter().map(|signal| plant.sensor(signal).unwrap()).collect();
            if t <= 180 {
                sums.iter_mut().zip(&values).for_each(|(sum, value)| *sum += value / 181.0);
            } else if second % 60 == 0 {
                let references = sums.clone();
                let error = plant.true_error_um("z").unwrap();
                rows.push(Row { t: f64::from(u32::try_from(t).unwrap()), values, references, error });
            }
        }
        rows
    }
}

struct Row {
    t: f64,
    values: Vec<f64>,
    references: Vec<f64>,
    error: f64,
}

/// Slope, intercept, and what is left: range and root mean square.
fn least_squares(points: &[(f64, f64)]) -> (f64, f64, f64, f64) {
    let n = f64::from(u32::try_from(points.len()).unwrap());
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let sxy: f64 = points.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
    let sxx: f64 = points.iter().map(|point| (point.0 - x).powi(2)).sum();
    let (slope, intercept) = (sxy / sxx, y - sxy / sxx * x);
    let left = points.iter().map(|point| point.1 - slope * point.0 - intercept);
    let range = left.clone().fold(f64::MIN, f64::max) - left.clone().fold(f64::MAX, f64::min);
    (slope, intercept, range, (left.map(|left| left * left).sum::<f64>() / n).sqrt())
}

fn assert_near(what: &str, shipped: f64, found: f64) {
    assert!((shipped - found).abs() <= 0.02 * found.abs(), "{what}: shipped {shipped}, found {found}");
}

#[test]
fn the_grinders_coefficients_are_those_of_the_calibration_day() {
    let machine = grinder();
    let day = machine.calibration();
    let rise = |row: &Row, place: usize| row.values[place] - row.references[place];
    let points: Vec<_> = day.iter().map(|row| (rise(row, 0) - rise(row, 1), -row.error)).collect();
    let (gain, offset, range, rms) = least_squares(&points);
    println!("Cz = {gain:.4} (A - B) + {offset:.4}: range {range:.2}, rms {rms:.2}");
    let terms = machine.terms();
    assert_near("A", terms[0].1, gain);
    assert_near("B", terms[1].1, -gain);
    assert_near("offset", number(machine.model(0), "offset"), offset);

    let late = || day.iter().filter(|row| row.t >= 9000.0);
    let points: Vec<_> = late().map(|row| (row.t, row.values[0] + row.error / gain)).collect();
    let (b, c, range, _) = least_squares(&points);
    println!("B as {b:.4e} t + {c:.3}: range {:.2} um", range * gain);
    let constants = machine.model(1)["constants"].as_table().unwrap();
    assert_near("Kz", number(constants, "Kz"), gain);
    assert_near("b", number(constants, "b"), b);
    assert_near("c", number(constants, "c"), c);

    let points: Vec<_> = late().map(|row| (row.t.sqrt(), -row.error + gain * row.values[1])).collect();
    let (k, c, range, _) = least_squares(&points);
    println!("Kz A as {k:.4} sqrt(t) + {c:.3}: range {range:.2} um");
    let constants = machine.model(2)["constants"].as_table().unwrap();
    assert_near("Kz", number(constants, "Kz"), gain);
    assert_near("k", number(constants, "k"), k);
    assert_near("c", number(constants, "c"), c);
}

#[test]
fn the_edms_coefficients_are_those_of_the_calibration_day() {
    let machine = edm();
    let day = machine.calibration();
    let points: Vec<_> = day.iter().map(|row| (row.values[0] - row.references[0], -row.error)).collect();
    let (gain, offset, range, rms) = least_squares(&points);
    println!("Cz = {gain:.4} T + {offset:.4}: range {range:.2}, rms {rms:.2}");
    assert_near("T", machine.terms()[0].1, gain);
    assert_near("α", number(machine.model(0), "offset"), offset);
}

fn twenty_days(machine: &Shipped) {
    for seed in 1..=20 {
        let (uncompensated, compensated) = machine.day(seed);
        println!("{} seed {seed}: {uncompensated:.2} -> {compensated:.2} um", machine.name);
        assert!(uncompensated >= 15.0, "seed {seed}: {uncompensated}");
        assert!((1.0..=3.5).contains(&compensated), "seed {seed}: {compensated}");
    }
}

#[test]
fn one_days_coefficients_hold_the_grinder_on_twenty_other_days() {
    twenty_days(&grinder());
}

#[test]
fn one_days_coefficients_hold_the_edm_on_twenty_other_days() {
    twenty_days(&edm());
}
