//! One sensor of a `difference` with machine-on time t stands in where the other is lost, JP H07-61598 B2: Cz = F(T, t).
//!
//! `Kz·A + f1(t)` with `f1(t) = −Kz·(b·t + c)`: after two or three hours B rises in nearly a straight line.
//! `−Kz·B + f2(t)` with `f2(t) = Kz·(K·√t + c)`: A rises with the root of the time. Kz is that of the difference; b, c and
//! K are least squares on the temperatures themselves, as the patent has them: nothing here is a rise.

use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::{Fallback, means};
use crate::bank::{Bank, Candidate};
use crate::campaign::{Campaign, Wanted};
use crate::learn::Learned;
use crate::region::Region;
use crate::validate::{HeldOut, scored};
use isotherm_core::quantity::Moment;

/// A formula of one sensor and machine-on time.
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

/// Which of the two is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum There {
    First,
    Second,
}

/// The temperature, machine-on time in seconds and the compensation that is wanted, row by row.
type Rows = Vec<(f64, f64, f64)>;

/// Stand-ins for the loss of either sensor; none where the model is no difference.
pub(super) fn alone(
    campaign: &Campaign<'_>,
    bank: &Bank,
    learned: &Learned,
    held_out: &[HeldOut],
) -> Vec<Fallback> {
    let one = |there| fallback(campaign, bank, pair(learned)?, held_out, there);
    [There::First, There::Second].into_iter().filter_map(one).collect()
}

/// Kz, A and B.
fn pair(learned: &Learned) -> Option<(f64, usize, usize)> {
    match learned {
        Learned::Sum(gains) => match gains.as_slice() {
            [(Candidate { input: a, .. }, gain), (Candidate { input: b, .. }, _)] if gain.abs() > 0.0 => {
                Some((*gain, *a, *b))
            }
            _ => None,
        },
        Learned::Net { .. } => None,
    }
}

fn fallback(
    campaign: &Campaign<'_>,
    bank: &Bank,
    (gain, a, b): (f64, usize, usize),
    held_out: &[HeldOut],
    there: There,
) -> Option<Fallback> {
    let (own, lost) = match there {
        There::First => (a, b),
        There::Second => (b, a),
    };
    let runs: Vec<Rows> = (0..campaign.dataset.runs.len()).map(|run| rows(campaign, run, own)).collect();
    let mut scores = Vec::new();
    for (out, held) in held_out.iter().enumerate() {
        // The gain of the difference that was found without this run: between the same two, or it says nothing here.
        let (gain, ..) = pair(&held.learned).filter(|(_, first, second)| (*first, *second) == (a, b))?;
        let others = runs.iter().enumerate().filter(|(run, _)| *run != out).map(|(_, rows)| rows);
        let line = line(others, gain, there)?;
        let left: Vec<f64> = runs[out].iter().map(|row| cz(row, gain, line, there) - row.2).collect();
        let error: Vec<f64> = runs[out].iter().map(|(.., wanted)| -wanted).collect();
        let score = scored(&held.score.name, &error, &left);
        scores.push((score.range_um, score.rmse_um));
    }
    let (slope, constant) = line(runs.iter(), gain, there)?;
    let (formula, symbol, of_time) = match there {
        There::First => ("Kz * (A - (b*t + c))", "A", "b"),
        There::Second => ("Kz * (K*sqrt(t) + c - B)", "B", "K"),
    };
    Some(Fallback {
        without: campaign.inputs[lost].name.clone(),
        method: "difference",
        terms: Vec::new(),
        alone: Some(Alone {
            formula,
            symbol,
            signal: campaign.inputs[own].name.clone(),
            constants: [("Kz", gain), (of_time, slope), ("c", constant)],
        }),
        region: Region::of(campaign, bank, &[own]),
        means: means(scores.into_iter()),
    })
}

fn rows(campaign: &Campaign<'_>, run: usize, input: usize) -> Rows {
    let run = &campaign.dataset.runs[run];
    let Some(start) = campaign.start(run) else { return Vec::new() };
    let signal = campaign.inputs[input].signal;
    let mut readings = Vec::new();
    let wanted = campaign.wanted(run);
    let row = |(row, (now, wanted)): (usize, (&Moment, Wanted))| {
        campaign.readings(run, row, *now, &mut readings);
        let temperature = readings.get(signal.0)?.usable()?;
        // What is measured from a later row says nothing of the temperature itself.
        let told = wanted.cz.is_finite() && wanted.since.is_none();
        told.then(|| (temperature, now.since(start).as_secs_f64(), wanted.cz))
    };
    run.times.iter().zip(wanted).enumerate().filter_map(row).collect()
}

fn of_time(seconds: f64, there: There) -> f64 {
    match there {
        There::First => seconds,
        There::Second => seconds.sqrt(),
    }
}

fn cz(row: &(f64, f64, f64), gain: f64, (slope, constant): (f64, f64), there: There) -> f64 {
    let other = slope * of_time(row.1, there) + constant;
    match there {
        There::First => gain * (row.0 - other),
        There::Second => gain * (other - row.0),
    }
}

/// Slope over t or √t, and constant, of what the other sensor must have been.
fn line<'a>(runs: impl Iterator<Item = &'a Rows>, gain: f64, there: There) -> Option<(f64, f64)> {
    let (mut square, mut cross) = (Matrix2::zeros(), Vector2::zeros());
    for (temperature, seconds, wanted) in runs.flatten() {
        let other = match there {
            There::First => temperature - wanted / gain,
            There::Second => temperature + wanted / gain,
        };
        let known = Vector2::new(of_time(*seconds, there), 1.0);
        square += known * known.transpose();
        cross += known * other;
    }
    let found = square.cholesky()?.solve(&cross);
    Some((found[0], found[1]))
}
