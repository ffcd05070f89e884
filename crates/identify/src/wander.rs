//! Random drift of the residual error of a model: growth q of its variance in µm²/h. With q, the gateway calculates the
//! weight of a touch of the probe.
//!
//! The residual of each held-out run is sampled every 15 minutes, and is zero at the start of the run. The residual is
//! modelled as a random walk with variance q per hour, measured with noise of variance r. q and r maximize the
//! likelihood of the innovations d with variance F:
//!
//! ```text
//! P += q·Δt      F = P + r      d = e − m      K = P / F      m += K·d      P *= 1 − K      Σ −½ (ln F + d²/F) → max
//! ```
//!
//! Only q is returned. The noise variance r is not used, because a touch of the probe has different noise.

use crate::statistics::count;
use crate::validate::HeldOut;

/// Interval at which the residual is sampled, s.
const EVERY: f64 = 900.0;

/// Returns q in µm²/h; `None` if all residuals are zero, or if there are fewer than ten samples.
pub(crate) fn wander(held_out: &[HeldOut]) -> Option<f64> {
    let runs: Vec<Vec<(f64, f64)>> = held_out.iter().map(sampled).collect();
    let squares = runs.iter().flatten().map(|(_, left)| left * left);
    let (sum, rows) = squares.fold((0.0, 0), |(sum, rows), square| (sum + square, rows + 1));
    let mean = sum / count(rows);
    if rows < 10 || mean.is_nan() || mean <= 0.0 {
        return None;
    }
    let unlikely = |point: [f64; 2]| {
        let (walk, noise) = (point[0].exp(), point[1].exp());
        runs.iter().map(|run| surprise(run, walk, noise)).sum::<f64>()
    };
    let [walk, _] = least([(0.3 * mean).ln(), (0.05 * mean).ln()], unlikely);
    Some(walk.exp()).filter(|walk| walk.is_finite())
}

/// Returns samples of the residual of a run: time in h, and residual in µm.
fn sampled(held: &HeldOut) -> Vec<(f64, f64)> {
    let left = held.residual(None);
    let mut next = f64::NEG_INFINITY;
    let mut taken = Vec::new();
    for (second, left) in held.seconds.iter().zip(left) {
        if *second >= next {
            taken.push((second / 3600.0, left));
            next = second + EVERY;
        }
    }
    taken
}

/// Returns −2·ln of the likelihood of a run, without a constant summand. `walk` is q, and `noise` is r.
fn surprise(run: &[(f64, f64)], walk: f64, noise: f64) -> f64 {
    let (mut level, mut variance, mut sum) = (0.0, 0.0, 0.0);
    let mut last = run.first().map_or(0.0, |row| row.0);
    for (hours, left) in run {
        variance += walk * (hours - last);
        last = *hours;
        let innovation = variance + noise;
        let off = left - level;
        let gain = variance / innovation;
        sum += innovation.ln() + off * off / innovation;
        level += gain * off;
        variance *= 1.0 - gain;
    }
    sum
}

/// Returns the arguments at which a function of two numbers is smallest, by the simplex method of Nelder and Mead
/// (1965).
fn least(start: [f64; 2], cost: impl Fn([f64; 2]) -> f64) -> [f64; 2] {
    const ROUNDS: usize = 200;
    const NEAR: f64 = 1e-7;
    let point = |at: [f64; 2]| (cost(at), at);
    let mut simplex = [point(start), point([start[0] + 1.0, start[1]]), point([start[0], start[1] + 1.0])];
    for _ in 0..ROUNDS {
        simplex.sort_by(|one, other| one.0.total_cmp(&other.0));
        let [best, middle, worst] = simplex;
        if (worst.0 - best.0).abs() <= NEAR * (1.0 + best.0.abs()) {
            break;
        }
        let along = |step: f64| {
            point([0, 1].map(|place| {
                let centre = 0.5 * (best.1[place] + middle.1[place]);
                centre + step * (worst.1[place] - centre)
            }))
        };
        let reflected = along(-1.0);
        let better = if reflected.0 < best.0 {
            let expanded = along(-2.0);
            Some(if expanded.0 < reflected.0 { expanded } else { reflected })
        } else if reflected.0 < middle.0 {
            Some(reflected)
        } else {
            let contracted = if reflected.0 < worst.0 { along(-0.5) } else { along(0.5) };
            Some(contracted).filter(|contracted| contracted.0 < worst.0.min(reflected.0))
        };
        match better {
            Some(better) => simplex[2] = better,
            None => {
                for corner in &mut simplex[1..] {
                    let at = corner.1;
                    *corner = point([0, 1].map(|place| 0.5 * (best.1[place] + at[place])));
                }
            }
        }
    }
    simplex.sort_by(|one, other| one.0.total_cmp(&other.0));
    simplex[0].1
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn a_valley_is_found() {
        let [x, y] = least([0.0, 0.0], |[x, y]: [f64; 2]| (x - 3.0).powi(2) + 10.0 * (y + x).powi(2));
        assert!((x - 3.0).abs() < 1e-3 && (y + 3.0).abs() < 1e-3, "{x} {y}");
    }

    /// Forty runs of eight hours with a random walk of 2 µm per hour.
    #[test]
    fn a_walk_is_told_by_how_fast_it_wanders() {
        let mut chance = rand_pcg::Pcg64::seed_from_u64(7);
        // The sum of twelve uniform random numbers is nearly normal, with variance 1.
        let mut normal = || (0..12).map(|_| chance.random_range(-0.5..0.5)).sum::<f64>();
        let runs: Vec<Vec<(f64, f64)>> = (0..40)
            .map(|_| {
                let mut level = 0.0;
                let step = |quarter: u32| {
                    level += if quarter > 0 { normal() } else { 0.0 };
                    (f64::from(quarter) / 4.0, level)
                };
                (0..32).map(step).collect()
            })
            .collect();
        let [walk, _] = least([0.0, -3.0], |point: [f64; 2]| {
            runs.iter().map(|run| surprise(run, point[0].exp(), point[1].exp())).sum()
        });
        assert!((3.4..4.6).contains(&walk.exp()), "{}", walk.exp());
    }
}
