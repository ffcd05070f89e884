//! Plant: a simulated machine of lumped masses with heat sources, conduction, convection and daily air temperature.
//! Some machines also have a structure, described by the modes of its finite elements. The module has no input or
//! output, and no clock.
//!
//! The equations of the plant deliberately differ from those of the compensation. The true error results from the
//! expansion and bending of the plant's parts. Sensors measure these parts with a lag, rounding and noise, and some
//! parts have no sensor. A compensation can therefore be good, but never perfect.
//!
//! Time advances in whole steps of [`STEP`], counted from the start of the run. The values at a certain time therefore
//! do not depend on how often they were requested before.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg32;

use super::random::stream;
use isotherm_core::quantity::Moment;

mod drive;
mod spec;
mod structure;
#[cfg(test)]
mod tests;
mod time;

pub use spec::{PlantError, PlantSpec, Published, PublishedAxis};
pub use time::STEP;

use drive::{Ambient, Duty};
use spec::SensorSpec;
use structure::{Point, Structure, dot};
use time::seconds;

/// Simulated machine that warms up, with its sensors and the true error of its axes.
#[derive(Clone, Debug)]
pub struct Plant {
    spec: PlantSpec,
    begin: Moment,
    now: Moment,
    steps: u64,
    ambient: Ambient,
    duty: Duty,
    /// Power of each heat source on the simulated day, W.
    powers: Vec<f64>,
    warm: Temperatures,
    /// Temperatures at the start of the run, at which the true error is zero by definition.
    zero: Temperatures,
    sensors: Vec<Sensor>,
    /// Heat flow into each node of the thermal network, W.
    flows: Vec<f64>,
    /// Temperature of each port of the structure (patch of the surface through which heat enters), °C. `enters` is the
    /// heat flow into each port, W.
    ports: Vec<f64>,
    enters: Vec<f64>,
    /// Temperature of the medium at each sink of the structure, °C.
    around: Vec<f64>,
}

/// Temperatures of the air and of all nodes of the thermal network, °C, and the state of the structure.
#[derive(Clone, Debug, Default)]
struct Temperatures {
    nodes: Vec<f64>,
    air: f64,
    /// Amplitude of each thermal mode (temperature pattern) of the structure; empty without a structure.
    modes: Vec<f64>,
}

impl Temperatures {
    /// Returns the temperature at a point, °C.
    fn at(&self, spec: &PlantSpec, point: Point) -> f64 {
        let on_structure = |of: fn(&Structure) -> &Vec<Vec<f64>>, place: usize| {
            spec.structure.as_ref().map_or(0.0, |structure| dot(&of(structure)[place], &self.modes))
        };
        match point {
            Point::Node(index) => self.nodes[index],
            Point::Ambient => self.air,
            Point::Port(place) => on_structure(|structure| &structure.ports, place),
            Point::Spot(place) => on_structure(|structure| &structure.spots, place),
        }
    }
}

#[derive(Clone, Debug)]
struct Sensor {
    felt: f64,
    noise: f64,
    random: Pcg32,
}

impl Plant {
    /// Returns the plant for this seed at `begin`, the start of the run. The machine is switched off, and has adapted
    /// to the temperature of its air. The hour of `begin`, in UTC, is the hour of the simulated day at which the run
    /// begins.
    pub fn new(spec: &PlantSpec, seed: u64, begin: Moment) -> Plant {
        let begin_hour = (begin.as_secs_f64() / 3600.0) % 24.0;
        let ambient = Ambient::new(&spec.ambient, seed, begin_hour);
        let powers = spec.sources.iter().map(|source| {
            let draw: f64 = rand::RngExt::random_range(&mut stream(seed, &source.name), -1.0..=1.0);
            source.watts * (1.0 + source.varies * draw)
        });
        let structure = spec.structure.as_ref();
        let warm = Temperatures {
            nodes: spec.nodes.iter().map(|node| node.initial).collect(),
            air: ambient.at(0.0),
            modes: structure.map_or_else(Vec::new, Structure::begun),
        };
        let ports = vec![0.0; structure.map_or(0, |structure| structure.ports.len())];
        let mut plant = Plant {
            begin,
            now: begin,
            steps: 0,
            duty: Duty::new(&spec.duty, seed),
            powers: powers.collect(),
            warm,
            ambient,
            zero: Temperatures::default(),
            sensors: Vec::new(),
            flows: vec![0.0; spec.nodes.len()],
            enters: ports.clone(),
            ports,
            around: vec![0.0; structure.map_or(0, |structure| structure.sinks.len())],
            spec: spec.clone(),
        };
        plant.soak();
        let begun = plant.spec.sensors.iter().map(|sensor| Sensor {
            felt: sensor.feels(&plant.spec, &plant.warm),
            noise: 0.0,
            random: stream(seed, &sensor.signal),
        });
        plant.sensors = begun.collect();
        plant.zero = plant.warm.clone();
        plant
    }

    /// Advances the plant to `now`. An earlier time is ignored.
    pub fn advance_to(&mut self, now: Moment) {
        self.now = self.now.max(now);
        let target = self.now.since(self.begin).as_secs() / STEP.as_secs();
        while self.steps < target {
            self.steps += 1;
            self.step();
        }
    }

    /// Returns the value that the sensor of a signal shows, in the unit of the signal; `None` if the plant does not
    /// have this signal.
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

    /// Returns the error of an axis without compensation, µm, which Cz must cancel. The error is zero at the start of
    /// the run. Parts of it may depend on the current position. Returns `None` if the plant does not have this axis.
    pub fn true_error_um(&self, axis: &str) -> Option<f64> {
        let displacement = self.spec.axes.iter().find(|displacement| displacement.axis == axis)?;
        let rise = |point: Point| self.warm.at(&self.spec, point) - self.zero.at(&self.spec, point);
        let sum = |gains: &[(Point, f64)]| gains.iter().map(|(point, gain)| gain * rise(*point)).sum::<f64>();
        let seconds = self.now.since(self.begin).as_secs_f64();
        let along = displacement.stretches.iter().map(|stretch| {
            let position = self.spec.positions[stretch.position].at(seconds);
            stretch.effect(position) * sum(&stretch.gains)
        });
        let guided = displacement.guided.zip(self.spec.structure.as_ref()).map(|(direction, structure)| {
            let position = self.spec.positions[structure.position].at(seconds);
            let moved = |at: &Temperatures| structure.moved(direction, position, &at.modes);
            moved(&self.warm) - moved(&self.zero)
        });
        Some(sum(&displacement.gains) + along.sum::<f64>() + guided.unwrap_or_default())
    }

    /// Simulates the time before the run, in which the machine is off and adapts to the air.
    fn soak(&mut self) {
        let length = self.spec.soak.as_secs() / STEP.as_secs();
        for step in 0..length {
            self.warm.air = self.ambient.at(-seconds(length - step));
            self.exchange_heat(false);
        }
        self.warm.air = self.ambient.at(0.0);
    }

    fn step(&mut self) {
        self.duty.advance_to(self.steps);
        self.exchange_heat(true);
        self.warm.air = self.ambient.at(seconds(self.steps));
        for (spec, sensor) in self.spec.sensors.iter().zip(&mut self.sensors) {
            let share = if spec.lag > 0.0 { -(-STEP.as_secs_f64() / spec.lag).exp_m1() } else { 1.0 };
            sensor.felt += share * (spec.feels(&self.spec, &self.warm) - sensor.felt);
            let draw: f64 = StandardNormal.sample(&mut sensor.random);
            sensor.noise = spec.noise * draw;
        }
    }

    fn exchange_heat(&mut self, running: bool) {
        self.flows.fill(0.0);
        self.enters.fill(0.0);
        for (place, port) in self.ports.iter_mut().enumerate() {
            *port = self.warm.at(&self.spec, Point::Port(place));
        }
        for link in &self.spec.links {
            let other = match link.other {
                Point::Port(place) => self.ports[place],
                point => self.warm.at(&self.spec, point),
            };
            let flow = link.conductance * (other - self.warm.nodes[link.node]);
            self.flows[link.node] += flow;
            match link.other {
                Point::Node(index) => self.flows[index] -= flow,
                Point::Port(place) => self.enters[place] -= flow,
                Point::Ambient | Point::Spot(_) => {}
            }
        }
        if running {
            for (source, power) in self.spec.sources.iter().zip(&self.powers) {
                self.flows[source.node] += power * self.duty.share(source.when);
            }
        }
        if let Some(structure) = &self.spec.structure {
            for (sink, around) in structure.sinks.iter().zip(&mut self.around) {
                *around = self.warm.at(&self.spec, sink.point);
                if let Point::Node(index) = sink.point {
                    self.flows[index] += dot(&sink.modes, &self.warm.modes) - sink.conductance * *around;
                }
            }
            structure.advance(&mut self.warm.modes, &self.enters, &self.around);
        }
        for ((temperature, flow), node) in self.warm.nodes.iter_mut().zip(&self.flows).zip(&self.spec.nodes) {
            *temperature += flow * STEP.as_secs_f64() / node.capacity;
        }
    }
}

impl SensorSpec {
    /// Returns the temperature that the sensor measures, °C, before its lag.
    fn feels(&self, spec: &PlantSpec, warm: &Temperatures) -> f64 {
        self.feels.iter().map(|(point, share)| share * warm.at(spec, *point)).sum()
    }

    /// Returns a value rounded to the resolution of the sensor.
    fn shows(&self, value: f64) -> f64 {
        if self.resolution > 0.0 { (value / self.resolution).round() * self.resolution } else { value }
    }
}
