//! Plausible values for signals that the plant does not have, so that any profile can be served.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::random::stream;
use isotherm_profile::Signal;

/// Returns a plausible value of a signal, in the unit of the signal. `seconds` is the time since the start of the run.
pub(super) fn wander(signal: &Signal, seed: u64, seconds: f64) -> f64 {
    let phase: f64 = stream(seed, &signal.name).random_range(0.0..TAU);
    let wave = |period: f64| (TAU * seconds / period + phase).sin();
    let about = |middle: f64, amplitude: f64| {
        middle + amplitude * wave(6.0 * 3600.0) + 0.03 * noise(signal, seed, seconds)
    };
    let value = match signal.unit.0 {
        "degC" | "K" if signal.is_difference => about(0.0, 1.0),
        "degC" => about(22.0, 2.0),
        "K" => about(295.15, 2.0),
        "mm" => 100.0 + 20.0 * wave(600.0),
        "um" => 2.0 * wave(3600.0),
        "rpm" => 1000.0,
        _ => 1.0,
    };
    match signal.range {
        Some((low, high)) if value < low || value > high => 0.5 * (low + high),
        _ => value,
    }
}

/// Returns noise that changes once a second. The same second always has the same noise.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole seconds since the run began"
)]
fn noise(signal: &Signal, seed: u64, seconds: f64) -> f64 {
    StandardNormal.sample(&mut stream(seed.wrapping_add((seconds as u64).rotate_left(20)), &signal.name))
}
