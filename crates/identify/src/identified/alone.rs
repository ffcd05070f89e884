//! One sensor of a `difference` with the time t since machine start stands in where the other is lost, JP H07-61598 B2: Cz = F(T, t).
//!
//! `Kz·A + f1(t)` with `f1(t) = −Kz·(b·t + c)`: after two or three hours B rises in nearly a straight line.
//! `−Kz·B + f2(t)` with `f2(t) = Kz·(K·√t + c)`: A rises with the root of the time. Kz is that of the difference; b, c and
//! K are least squares on the temperatures themselves, as the patent has them: nothing here is a rise.

use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::Fallback;
use crate::bank::Bank;
use crate::campaign::{Campaign, Target};
use crate::learn::Learned;
use crate::region::Region;
use crate::validate::{HeldOut, Means, RunScore};
use isotherm_core::quantity::Moment;

/// A formula of one sensor and the time since machine start.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Alone {
    /// As a profile writes it.
    pub formula: &'static str,
    /// The sensor's name in it.
    pub symbol: &'static str,
    /// The sensor.
    pub signal: String,
    /// Its constants.
    pub constants: [(&'static str, f64); 3],
}

/// The sensor that is left. With T its temperature, the other one's is taken to be slope·f(t) + c, and
/// Cz = sign·Kz·(T − other).
struct Side {
    sign: f64,
    formula: &'static str,
    symbol: &'static str,
    /// The slope's name in the formula.
    slope: &'static str,
    /// f(t), t in seconds.
    of_time: fn(f64) -> f64,
}

const FIRST: Side =
    Side { sign: 1.0, formula: "Kz * (A - (b*t + c))", symbol: "A", slope: "b", of_time: |seconds| seconds };
const SECOND: Side =
    Side { sign: -1.0, formula: "Kz * (K*sqrt(t) + c - B)", symbol: "B", slope: "K", of_time: f64::sqrt };

/// The temperature, the time since machine start in seconds and the Cz that would leave no error, row by row.
type Rows = Vec<(f64, f64, f64)>;

/// Stand-ins for the loss of either sensor; none where the model is no difference.
pub(super) fn alone(
    campaign: &Campaign<'_>,
    bank: &Bank,
    learned: &Learned,
    held_out: &[HeldOut],
) -> Vec<Fallback> {
    let one = |side: &Side| fallback(campaign, bank, pair(learned)?, held_out, side);
    [FIRST, SECOND].iter().filter_map(one).collect()
}

/// Kz, A and B.
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
        // The gain of the difference that was found without this run: between the same two, or it says nothing here.
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
        // What is measured from a later row says nothing of the temperature itself.
        let counts = !masked[row] && target.cz.is_finite() && target.since.is_none();
        counts.then(|| (temperature, now.since(start).as_secs_f64(), target.cz))
    };
    run.times.iter().enumerate().zip(campaign.targets(run)).filter_map(row).collect()
}

impl Side {
    /// Slope and constant of what the other sensor must have been.
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
