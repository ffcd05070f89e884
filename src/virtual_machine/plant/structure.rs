//! Structure as the thermal modes of its finite elements, which `isotherm place --modes` calculates. The state advances
//! step by step.
//!
//! Each mode decays at its own rate. Two kinds of input excite the modes: the heat flow into each port (patch of the
//! surface), and the temperature of each sink (medium around the structure). If the excitation is constant during a
//! step, the calculated step is exact for any rate.

use super::STEP;

/// Point of a plant that has a temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Point {
    Node(usize),
    Ambient,
    /// Patch of the structure's surface through which heat enters.
    Port(usize),
    /// Point of the structure whose temperature is only measured.
    Spot(usize),
}

/// Structure of a machine, reduced to thermal modes. Its state is the amplitude of each mode.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Structure {
    /// Temperature of the structure before the soak (the time before the run in which the machine is off), °C.
    pub(super) initial: f64,
    /// Index of the position that selects the point of the guideway.
    pub(super) position: usize,
    /// Factor by which the amplitude of each mode decays in one step.
    pub(super) keep: Vec<f64>,
    /// Amplitude that each mode gains in one step by an excitation of 1.
    pub(super) gain: Vec<f64>,
    /// Amplitude that each mode has if the whole structure is 1 °C warm.
    pub(super) uniform: Vec<f64>,
    /// Temperature of each port per amplitude 1 of each mode. The same numbers are the excitation of the modes by one
    /// watt at the port.
    pub(super) ports: Vec<Vec<f64>>,
    pub(super) sinks: Vec<Sink>,
    /// Temperature of each spot per amplitude 1 of each mode.
    pub(super) spots: Vec<Vec<f64>>,
    /// Positions of the guideway's points, mm, ascending.
    pub(super) guide: Vec<f64>,
    /// Displacement of each point of the guideway along x, y and z, µm per amplitude 1 of each mode.
    pub(super) moves: [Vec<Vec<f64>>; 3],
}

/// Medium (air or a node of the plant) that exchanges heat with the structure through one film (`*FILM` of the FE
/// input).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sink {
    /// Node or air with which the structure exchanges heat. Its temperature is the temperature of the sink.
    pub(super) point: Point,
    /// Film coefficient times area: heat flow per kelvin between medium and structure, W/K.
    pub(super) conductance: f64,
    /// For each mode: heat flow from the structure into the medium per amplitude 1 of the mode. The same numbers are
    /// the excitation of the modes by 1 °C of the medium.
    pub(super) modes: Vec<f64>,
}

impl Structure {
    /// Returns two factors of a mode with this decay rate (1/s). The first is the remaining part of its amplitude after
    /// one step. The second is the change of the amplitude by an excitation of 1.
    pub(super) fn step(rate: f64) -> (f64, f64) {
        let seconds = STEP.as_secs_f64();
        ((-rate * seconds).exp(), -(-rate * seconds).exp_m1() / rate)
    }

    /// Returns the amplitudes of the modes at the initial temperature.
    pub(super) fn begun(&self) -> Vec<f64> {
        self.uniform.iter().map(|one| one * self.initial).collect()
    }

    /// Advances the amplitudes of the modes by one step. `heat` is the heat flow into each port, W. `around` is the
    /// temperature of each sink, °C.
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

    /// Returns how much 1 W warms a port in one step, K.
    pub(super) fn yields(&self, port: usize) -> f64 {
        self.ports[port].iter().zip(&self.gain).map(|(port, gain)| port * port * gain).sum()
    }

    /// Returns the displacement of the guideway at a position in one direction, µm. Beyond the ends of the guideway,
    /// the displacement of the end is returned.
    pub(super) fn moved(&self, direction: usize, position: f64, modes: &[f64]) -> f64 {
        let after = self.guide.partition_point(|point| *point <= position);
        let (low, high) = (after.saturating_sub(1), after.min(self.guide.len() - 1));
        let span = self.guide[high] - self.guide[low];
        let share = if span > 0.0 { ((position - self.guide[low]) / span).clamp(0.0, 1.0) } else { 0.0 };
        let at = |point: usize| dot(&self.moves[direction][point], modes);
        at(low) * (1.0 - share) + at(high) * share
    }
}

/// Returns the sum of a quantity over all modes with these amplitudes. `each` contains the value of the quantity per
/// amplitude 1 of each mode.
pub(super) fn dot(each: &[f64], modes: &[f64]) -> f64 {
    each.iter().zip(modes).map(|(each, mode)| each * mode).sum()
}
