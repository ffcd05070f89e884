//! The plant: lumped masses with heat sources, conduction, convection and a day's air. Pure: no I/O, no clock.
//!
//! It is deliberately not the compensator's formula. The true error comes from the expansion and the bending of the
//! plant's own parts; sensors feel those parts late, rounded and with noise, and some parts have no sensor at all. So
//! a compensation can be good, but never perfect.
//!
//! Time moves in whole steps of [`STEP`] counted from the beginning, whoever asks and however often: the numbers at a
//! moment do not depend on the moments that were asked for before it.

use std::time::Duration;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg32;

use crate::quantity::Moment;

mod drive;
mod spec;
#[cfg(test)]
mod tests;

pub use spec::{PlantError, PlantSpec, Published, PublishedAxis};

use drive::{Ambient, Duty};
use spec::{Point, SensorSpec};

/// The plant's own step. A machine's time constants are minutes and hours.
pub const STEP: Duration = Duration::from_secs(1);

/// A machine that warms up.
#[derive(Clone, Debug)]
pub struct Plant {
    spec: PlantSpec,
    begin: Moment,
    now: Moment,
    steps: u64,
    ambient: Ambient,
    duty: Duty,
    /// Power of each source on this seed's day, W.
    powers: Vec<f64>,
    temperatures: Vec<f64>,
    air: f64,
    zero: Vec<f64>,
    zero_air: f64,
    sensors: Vec<Sensor>,
    flows: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Sensor {
    felt: f64,
    noise: f64,
    random: Pcg32,
}

/// A source of random numbers of its own for every purpose, so that one more sensor changes no other's noise.
pub(super) fn stream(seed: u64, purpose: &str) -> Pcg32 {
    let hash = purpose.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    Pcg32::seed_from_u64(hash ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

impl Plant {
    /// The plant on this seed's day, switched off and soaked in its air, at the moment the run begins. The hour of the
    /// day is that of `begin` in UTC.
    pub fn new(spec: &PlantSpec, seed: u64, begin: Moment) -> Plant {
        let begin_hour = (begin.as_secs_f64() / 3600.0) % 24.0;
        let ambient = Ambient::new(&spec.ambient, seed, begin_hour);
        let powers = spec.sources.iter().map(|source| {
            let draw: f64 = rand::RngExt::random_range(&mut stream(seed, &source.name), -1.0..=1.0);
            source.watts * (1.0 + source.varies * draw)
        });
        let mut plant = Plant {
            begin,
            now: begin,
            steps: 0,
            duty: Duty::new(&spec.duty, seed),
            powers: powers.collect(),
            temperatures: spec.nodes.iter().map(|node| node.initial).collect(),
            air: ambient.at(0.0),
            ambient,
            zero: Vec::new(),
            zero_air: 0.0,
            sensors: Vec::new(),
            flows: vec![0.0; spec.nodes.len()],
            spec: spec.clone(),
        };
        plant.soak();
        let begun = plant.spec.sensors.iter().map(|sensor| Sensor {
            felt: sensor.feels(&plant.temperatures, plant.air),
            noise: 0.0,
            random: stream(seed, &sensor.signal),
        });
        plant.sensors = begun.collect();
        plant.zero.clone_from(&plant.temperatures);
        plant.zero_air = plant.air;
        plant
    }

    /// Moves time on to `now`; never back.
    pub fn advance_to(&mut self, now: Moment) {
        self.now = self.now.max(now);
        let target = self.now.since(self.begin).as_secs() / STEP.as_secs();
        while self.steps < target {
            self.steps += 1;
            self.step();
        }
    }

    /// What a signal's module would report, in the signal's unit; `None` where the plant has no such signal.
    pub fn sensor(&self, signal: &str) -> Option<f64> {
        let places = self.spec.sensors.iter().zip(&self.sensors);
        if let Some((spec, sensor)) = places.clone().find(|(spec, _)| spec.signal == signal) {
            return Some(spec.shows(sensor.felt + sensor.noise));
        }
        if let Some(position) = self.spec.positions.iter().find(|position| position.signal == signal) {
            return Some(position.at(self.now.since(self.begin).as_secs_f64()));
        }
        let switch = self.spec.switches.iter().find(|switch| switch.signal == signal)?;
        Some(f64::from(u8::from(self.duty.holds(switch.when))))
    }

    /// The displacement error of an axis without compensation, µm: what Cz must cancel. Zero when the run begins. What
    /// depends on a position is that of the present one.
    pub fn true_error_um(&self, axis: &str) -> Option<f64> {
        let displacement = self.spec.axes.iter().find(|displacement| displacement.axis == axis)?;
        let rise = |point: Point| match point {
            Point::Node(index) => self.temperatures[index] - self.zero[index],
            Point::Ambient => self.air - self.zero_air,
        };
        let sum = |gains: &[(Point, f64)]| gains.iter().map(|(point, gain)| gain * rise(*point)).sum::<f64>();
        let seconds = self.now.since(self.begin).as_secs_f64();
        let along = displacement.stretches.iter().map(|stretch| {
            let position = self.spec.positions[stretch.position].at(seconds);
            stretch.effect(position) * sum(&stretch.gains)
        });
        Some(sum(&displacement.gains) + along.sum::<f64>())
    }

    /// The temperature of a node, °C: what no sensor sees exactly.
    pub fn node(&self, name: &str) -> Option<f64> {
        let index = self.spec.nodes.iter().position(|node| node.name == name)?;
        self.temperatures.get(index).copied()
    }

    /// The air's temperature, °C.
    pub fn ambient(&self) -> f64 {
        self.air
    }

    /// The time before the run: the machine stands, off, in its air.
    fn soak(&mut self) {
        let length = self.spec.soak.as_secs() / STEP.as_secs();
        for step in 0..length {
            self.air = self.ambient.at(-seconds(length - step));
            self.exchange_heat(false);
        }
        self.air = self.ambient.at(0.0);
    }

    fn step(&mut self) {
        self.duty.advance_to(self.steps);
        self.exchange_heat(true);
        self.air = self.ambient.at(seconds(self.steps));
        for (spec, sensor) in self.spec.sensors.iter().zip(&mut self.sensors) {
            let share = if spec.lag > 0.0 { -(-STEP.as_secs_f64() / spec.lag).exp_m1() } else { 1.0 };
            sensor.felt += share * (spec.feels(&self.temperatures, self.air) - sensor.felt);
            let draw: f64 = StandardNormal.sample(&mut sensor.random);
            sensor.noise = spec.noise * draw;
        }
    }

    fn exchange_heat(&mut self, running: bool) {
        self.flows.fill(0.0);
        for link in &self.spec.links {
            let other = match link.other {
                Point::Node(index) => self.temperatures[index],
                Point::Ambient => self.air,
            };
            let flow = link.conductance * (other - self.temperatures[link.node]);
            self.flows[link.node] += flow;
            if let Point::Node(index) = link.other {
                self.flows[index] -= flow;
            }
        }
        if running {
            for (source, power) in self.spec.sources.iter().zip(&self.powers) {
                self.flows[source.node] += power * self.duty.share(source.when);
            }
        }
        for ((temperature, flow), node) in self.temperatures.iter_mut().zip(&self.flows).zip(&self.spec.nodes)
        {
            *temperature += flow * STEP.as_secs_f64() / node.capacity;
        }
    }
}

impl SensorSpec {
    /// The temperature where it sits.
    fn feels(&self, temperatures: &[f64], air: f64) -> f64 {
        let at = |point: Point| match point {
            Point::Node(index) => temperatures[index],
            Point::Ambient => air,
        };
        self.feels.iter().map(|(point, share)| share * at(*point)).sum()
    }

    /// A value as its module rounds it.
    fn shows(&self, value: f64) -> f64 {
        if self.resolution > 0.0 { (value / self.resolution).round() * self.resolution } else { value }
    }
}

/// Steps as seconds. A run of 2^53 steps does not exist.
#[allow(clippy::cast_precision_loss)]
fn seconds(steps: u64) -> f64 {
    steps as f64 * STEP.as_secs_f64()
}
