//! Inputs of a plant that differ from day to day: air temperature, and operation of the machine.

use rand::RngExt;
use rand_pcg::Pcg32;

use super::spec::{AmbientSpec, DutySpec, Span, When};
use super::time::STEP;
use crate::virtual_machine::random::stream;
use std::f64::consts::TAU;

/// Air temperature of a run: mean, daily curve, drift, and slow waves of the weather.
#[derive(Clone, Debug)]
pub(super) struct Ambient {
    mean: f64,
    amplitude: f64,
    peak_hour: f64,
    drift_per_day: f64,
    weather: [Wave; 2],
    /// Hour of the day (UTC) at which the run begins.
    begin_hour: f64,
}

#[derive(Clone, Copy, Debug)]
struct Wave {
    amplitude: f64,
    period_hours: f64,
    phase: f64,
}

impl Ambient {
    pub(super) fn new(spec: &AmbientSpec, seed: u64, begin_hour: f64) -> Ambient {
        let mut random = stream(seed, "ambient");
        let varies = spec.varies;
        let mut draw = |nominal: f64, varies: f64| nominal + varies * random.random_range(-1.0..=1.0);
        let (mean, amplitude) = (draw(spec.mean, varies.mean), draw(spec.amplitude, varies.amplitude));
        let peak_hour = draw(spec.peak_hour, varies.peak_hour);
        let drift_per_day = draw(spec.drift_per_day, varies.drift_per_day);
        let mut wave = |share: f64, shortest: f64, longest: f64| Wave {
            amplitude: spec.weather * share,
            period_hours: random.random_range(shortest..=longest),
            phase: random.random_range(0.0..=TAU),
        };
        let weather = [wave(0.7, 7.0, 13.0), wave(0.3, 2.0, 4.0)];
        Ambient { mean, amplitude, peak_hour, drift_per_day, weather, begin_hour }
    }

    /// Returns the air temperature in °C at a time in seconds since the start of the run. Negative times belong to the
    /// soak: the time before the run, in which the machine is off.
    pub(super) fn at(&self, seconds: f64) -> f64 {
        let hours = seconds / 3600.0;
        let day = self.amplitude * (TAU * (self.begin_hour + hours - self.peak_hour) / 24.0).cos();
        let weather: f64 = self
            .weather
            .iter()
            .map(|wave| wave.amplitude * (TAU * hours / wave.period_hours + wave.phase).sin())
            .sum();
        self.mean + day + self.drift_per_day * hours.max(0.0) / 24.0 + weather
    }
}

/// Operation of the machine as a sequence of phases: switched off, then working and pausing in turn.
#[derive(Clone, Debug)]
pub(super) struct Duty {
    spec: DutySpec,
    random: Pcg32,
    phase: Phase,
    /// Load of the current work phase: factor for the power of sources that depend on work. The load has its own random
    /// numbers, so that a change of the load does not change the phases.
    load: f64,
    loads: Pcg32,
    /// Step at which the current phase ends.
    until: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Off,
    Work,
    Pause,
}

impl Duty {
    pub(super) fn new(spec: &DutySpec, seed: u64) -> Duty {
        let mut random = stream(seed, "duty");
        let until = steps(&mut random, spec.on_after);
        Duty { spec: *spec, random, phase: Phase::Off, load: 1.0, loads: stream(seed, "load"), until }
    }

    /// Advances to this step. The steps of successive calls must ascend.
    pub(super) fn advance_to(&mut self, step: u64) {
        while step >= self.until {
            let (phase, span) = match self.phase {
                Phase::Work => (Phase::Pause, self.spec.pause),
                Phase::Off | Phase::Pause => (Phase::Work, self.spec.work),
            };
            self.phase = phase;
            if phase == Phase::Work {
                let [lightest, hardest] = self.spec.load;
                self.load = self.loads.random_range(lightest..=hardest);
            }
            self.until += steps(&mut self.random, span);
        }
    }

    /// Returns the factor by which the power of a heat source is multiplied now. The source has power in the machine
    /// state `when`; otherwise the factor is 0.
    pub(super) fn share(&self, when: When) -> f64 {
        match (self.holds(when), when) {
            (false, _) => 0.0,
            (true, When::Work) => self.load,
            (true, When::Always | When::On) => 1.0,
        }
    }

    pub(super) fn holds(&self, when: When) -> bool {
        match when {
            When::Always => true,
            When::On => self.phase != Phase::Off,
            When::Work => self.phase == Phase::Work,
        }
    }
}

/// Draws a duration from a range, and returns it as a number of steps.
fn steps(random: &mut Pcg32, span: Span) -> u64 {
    let count = |duration: std::time::Duration| duration.as_secs() / STEP.as_secs().max(1);
    random.random_range(count(span.shortest)..=count(span.longest))
}
