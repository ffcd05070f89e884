//! A structure as modes of its finite elements: what `isotherm place --modes` writes, stepped in time.
//!
//! Each mode decays at its own rate and is driven by the watts that come in through ports and by the temperatures of the
//! sinks behind its films. Where these stand still over a step, the step is exact, whatever the rates.

use super::STEP;

/// Something in a plant that has a temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Point {
    Node(usize),
    Ambient,
    /// A patch of the structure through which heat comes in.
    Port(usize),
    /// A place of the structure that is only looked at.
    Spot(usize),
}

/// A reduced structure in its machine.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Structure {
    /// °C before the soak.
    pub(super) initial: f64,
    /// Place among the positions: where on the guideway that stands whose place counts.
    pub(super) position: usize,
    /// What of each mode is left after a step.
    pub(super) keep: Vec<f64>,
    /// What a drive of 1 makes of each mode in a step.
    pub(super) gain: Vec<f64>,
    /// What each mode has where everything has 1 °C.
    pub(super) uniform: Vec<f64>,
    /// For each port its temperature per unit of each mode; a watt drives the modes with the same numbers.
    pub(super) ports: Vec<Vec<f64>>,
    pub(super) sinks: Vec<Sink>,
    /// For each place of a sensor its temperature per unit of each mode.
    pub(super) spots: Vec<Vec<f64>>,
    /// Points of the guideway, mm, ascending.
    pub(super) guide: Vec<f64>,
    /// Along x, y and z: for each point µm per unit of each mode.
    pub(super) moves: [Vec<Vec<f64>>; 3],
}

/// What flows past a film.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sink {
    /// What has its temperature: a node or the air.
    pub(super) point: Point,
    /// W/K
    pub(super) conductance: f64,
    /// W/K per unit of each mode.
    pub(super) modes: Vec<f64>,
}

impl Structure {
    /// What is left of a mode of this rate (1/s) after a step, and what a drive of 1 makes of it.
    pub(super) fn step(rate: f64) -> (f64, f64) {
        let seconds = STEP.as_secs_f64();
        ((-rate * seconds).exp(), -(-rate * seconds).exp_m1() / rate)
    }

    /// The modes where everything has the initial temperature.
    pub(super) fn begun(&self) -> Vec<f64> {
        self.uniform.iter().map(|one| one * self.initial).collect()
    }

    /// Moves the modes on by a step: `heat` is what comes in through each port, W; `around` the temperature of each sink, °C.
    pub(super) fn advance(&self, modes: &mut [f64], heat: &[f64], around: &[f64]) {
        for (mode, keep) in modes.iter_mut().zip(&self.keep) {
            *mode *= keep;
        }
        let ports = self.ports.iter().zip(heat);
        let sinks = self.sinks.iter().map(|sink| &sink.modes).zip(around);
        for (input, size) in ports.chain(sinks) {
            for ((mode, gain), each) in modes.iter_mut().zip(&self.gain).zip(input) {
                *mode += gain * each * size;
            }
        }
    }

    /// How much warmer a port is a step after 1 W came in, K.
    pub(super) fn yields(&self, port: usize) -> f64 {
        self.ports[port].iter().zip(&self.gain).map(|(port, gain)| port * port * gain).sum()
    }

    /// How far the guideway has moved at a position in one direction, µm; beyond its ends as there.
    pub(super) fn moved(&self, direction: usize, position: f64, modes: &[f64]) -> f64 {
        let after = self.guide.partition_point(|point| *point <= position);
        let (low, high) = (after.saturating_sub(1), after.min(self.guide.len() - 1));
        let span = self.guide[high] - self.guide[low];
        let share = if span > 0.0 { ((position - self.guide[low]) / span).clamp(0.0, 1.0) } else { 0.0 };
        let at = |point: usize| dot(&self.moves[direction][point], modes);
        at(low) * (1.0 - share) + at(high) * share
    }
}

/// A quantity per unit of each mode, of these modes.
pub(super) fn dot(each: &[f64], modes: &[f64]) -> f64 {
    each.iter().zip(modes).map(|(each, mode)| each * mode).sum()
}
