//! Fallback model of a `difference` model, Cz = Kz·(A − B), after the loss of one of its two sensors A and B. Cz is the
//! compensation value. The formula Cz = F(T, t) uses the temperature T of the remaining sensor and the time t since
//! machine start (JP H07-61598 B2).
//!
//! Without B, the formula is `Kz·A + f1(t)` with `f1(t) = −Kz·(b·t + c)`, because after two or three hours B
//! rises in nearly a straight line. Without A, the formula is `−Kz·B + f2(t)` with `f2(t) = Kz·(K·√t + c)`,
//! because A rises with the square root of the time. Kz is the gain of the difference. b, c and K are fitted
//! by least squares to the temperatures themselves, as in the patent, not to their rises.

use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::Fallback;
use crate::bank::Bank;
use crate::campaign::{Campaign, Target};
use crate::learn::Learned;
use crate::region::Region;
use crate::validate::{HeldOut, Means, RunScore};
use isotherm_core::quantity::Moment;

/// Formula of one sensor and the time since machine start.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Alone {
    /// Text of the formula, as it is written in a profile.
    pub formula: &'static str,
    /// Letter of the remaining sensor in the formula: `A` or `B`.
    pub symbol: &'static str,
    /// Name of the signal of the remaining sensor.
    pub signal: String,
    /// Constants of the formula, each with its name and value.
    pub constants: [(&'static str, f64); 3],
}

/// Formula for one remaining sensor with the temperature T. The temperature of the lost sensor is estimated as
/// slope·f(t) + c. Then Cz = sign·Kz·(T − estimate).
struct Side {
    sign: f64,
    formula: &'static str,
    symbol: &'static str,
    /// Name of the slope in the formula.
    slope: &'static str,
    /// Function f(t) in the estimate, with t in seconds.
    of_time: fn(f64) -> f64,
}

const FIRST: Side =
    Side { sign: 1.0, formula: "Kz * (A - (b*t + c))", symbol: "A", slope: "b", of_time: |seconds| seconds };
const SECOND: Side =
    Side { sign: -1.0, formula: "Kz * (K*sqrt(t) + c - B)", symbol: "B", slope: "K", of_time: f64::sqrt };

/// One tuple for each row: temperature in °C, time since machine start in s, and the Cz that would leave no error in
/// µm.
type Rows = Vec<(f64, f64, f64)>;

/// Returns two fallback models, for the loss of each sensor; empty if the model is not a difference of two sensors.
pub(super) fn alone(
    campaign: &Campaign<'_>,
    bank: &Bank,
    learned: &Learned,
    held_out: &[HeldOut],
) -> Vec<Fallback> {
    let one = |side: &Side| fallback(campaign, bank, pair(learned)?, held_out, side);
    [FIRST, SECOND].iter().filter_map(one).collect()
}

/// Returns the gain Kz and the indices of the inputs A and B; `None` if the model is not a difference of two sensors.
fn pair(learned: &Learned) -> Option<(f64, usize, usize)> {
    match learned.sum()? {
        [(first, gain), (second, _)] if gain.abs() > 0.0 => Some((*gain, first.input, second.input)),
        _ => None,
    }
}

fn fallback(
    campaign: &Campaign<'_>,
    bank: &Bank,
    (gain, a, b): (f64, usize, usize),
    held_out: &[HeldOut],
    side: &Side,
) -> Option<Fallback> {
    let (own, lost) = if side.sign > 0.0 { (a, b) } else { (b, a) };
    let runs: Vec<Rows> = (0..campaign.dataset.runs.len()).map(|run| rows(campaign, run, own)).collect();
    let mut scores = Vec::new();
    for (out, held) in held_out.iter().enumerate() {
        // The gain of the difference without this run. It is used only if it is between the same two sensors.
        let (gain, ..) = pair(&held.learned).filter(|(_, first, second)| (*first, *second) == (a, b))?;
        let others = runs.iter().enumerate().filter(|(run, _)| *run != out).map(|(_, rows)| rows);
        let (slope, constant) = side.line(others, gain)?;
        let left = |(temperature, seconds, target): &(f64, f64, f64)| {
            side.sign * gain * (temperature - (slope * (side.of_time)(*seconds) + constant)) - target
        };
        let left: Vec<f64> = runs[out].iter().map(left).collect();
        let error: Vec<f64> = runs[out].iter().map(|(.., target)| -target).collect();
        scores.push(RunScore::new(&held.score.name, &error, &left));
    }
    let (slope, constant) = side.line(runs.iter(), gain)?;
    Some(Fallback {
        without: campaign.inputs[lost].name.clone(),
        method: "difference",
        terms: Vec::new(),
        alone: Some(Alone {
            formula: side.formula,
            symbol: side.symbol,
            signal: campaign.inputs[own].name.clone(),
            constants: [("Kz", gain), (side.slope, slope), ("c", constant)],
        }),
        region: Region::of(campaign, bank, &[own]),
        expected: None,
        means: Means::of(&scores),
    })
}

fn rows(campaign: &Campaign<'_>, run: usize, input: usize) -> Rows {
    let masked = campaign.masked(run);
    let run = &campaign.dataset.runs[run];
    let Some(start) = campaign.start(run) else { return Vec::new() };
    let signal = campaign.inputs[input].signal;
    let mut readings = Vec::new();
    let row = |((row, now), target): ((usize, &Moment), Target)| {
        campaign.readings(run, row, *now, &mut readings);
        let temperature = readings.get(signal.0)?.usable()?;
        // A target that is measured from a later row does not depend on the temperature itself.
        let counts = !masked[row] && target.cz.is_finite() && target.since.is_none();
        counts.then(|| (temperature, now.since(start).as_secs_f64(), target.cz))
    };
    run.times.iter().enumerate().zip(campaign.targets(run)).filter_map(row).collect()
}

impl Side {
    /// Returns slope and constant c of the estimate of the lost sensor's temperature, fitted to these runs; `None` if
    /// the fit is not possible.
    fn line<'a>(&self, runs: impl Iterator<Item = &'a Rows>, gain: f64) -> Option<(f64, f64)> {
        let (mut square, mut cross) = (Matrix2::zeros(), Vector2::zeros());
        for (temperature, seconds, target) in runs.flatten() {
            let known = Vector2::new((self.of_time)(*seconds), 1.0);
            square += known * known.transpose();
            cross += known * (temperature - self.sign * target / gain);
        }
        let found = square.cholesky()?.solve(&cross);
        Some((found[0], found[1]))
    }
}
