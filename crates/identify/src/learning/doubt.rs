//! Finds wrong touches (measurements with a probe), for example if a chip was under the probe, or another
//! part was measured. The gateway accepts or rejects measurements by the same rule.
//!
//! The residual of the model drifts, and a correction follows it. The variance P of the correction is 0 at the datum
//! (zero point) of the run, and grows by q per hour between two touches. A touch has the variance σ²:
//!
//! ```text
//! P += q·Δt      e = residual − correction      K = P / (P + σ²)      correction += K·e      P *= 1 − K
//! ```
//!
//! A touch with e² > 16·(P + σ²) is doubtful. It is accepted only if the next touch confirms it: the difference of the
//! two touches is at most 4·√2·σ.
//!
//! A touch with |e| > `max_error` of the probe is rejected, even if the next touch agrees, because a different part
//! gives the same wrong result twice.

/// Maximum deviation of a touch that is accepted without confirmation by the next touch, in standard deviations.
const BELIEVED: f64 = 4.0;

/// Returns for each touch whether it is accepted. `hours` contains the times and `residuals` the residual errors of the
/// touches of a run. `sigma` is σ of a touch, µm, and `walk` is q, µm²/h. A touch whose deviation is more than `most`,
/// µm, is always rejected.
pub fn accepted(hours: &[f64], residuals: &[f64], (sigma, walk): (f64, f64), most: f64) -> Vec<bool> {
    let own = sigma * sigma;
    let (mut variance, mut correction) = (0.0_f64, 0.0_f64);
    let mut last = hours.first().copied().unwrap_or_default();
    let mut doubted: Option<usize> = None;
    let mut accepted = vec![false; residuals.len()];
    for (place, (hour, residual)) in hours.iter().zip(residuals).enumerate() {
        variance += walk * (hour - last).max(0.0);
        last = *hour;
        let off = residual - correction;
        if off.abs() > most {
            continue;
        }
        let first = doubted.take();
        let confirms =
            |first: usize| (residual - residuals[first]).abs() <= BELIEVED * std::f64::consts::SQRT_2 * sigma;
        if off * off > BELIEVED * BELIEVED * (variance + own) {
            let Some(first) = first.filter(|first| confirms(*first)) else {
                doubted = Some(place);
                continue;
            };
            accepted[first] = true;
            // The correction was so uncertain that this touch would have been accepted at once.
            variance = variance.max((off / BELIEVED).powi(2) - own);
        }
        accepted[place] = true;
        let share = if variance > 0.0 { variance / (variance + own) } else { 0.0 };
        correction += share * off;
        variance *= 1.0 - share;
    }
    accepted
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROBE: (f64, f64) = (0.5, 4.0);

    fn hours(count: u32) -> Vec<f64> {
        (0..count).map(f64::from).collect()
    }

    #[test]
    fn a_single_wrong_touch_is_left_out_and_the_next_good_one_is_used() {
        let residuals = [0.0, 1.0, 40.0, 2.0, 2.5];
        assert_eq!(accepted(&hours(5), &residuals, PROBE, 100.0), [true, true, false, true, true]);
    }

    #[test]
    fn two_touches_that_agree_show_the_truth() {
        let residuals = [0.0, 1.0, 40.0, 41.0, 41.5];
        assert_eq!(accepted(&hours(5), &residuals, PROBE, 100.0), [true; 5]);
    }

    #[test]
    fn another_part_is_left_out_although_it_gives_the_same_result_twice() {
        let residuals = [0.0, 1.0, 140.0, 141.0, 2.5];
        assert_eq!(accepted(&hours(5), &residuals, PROBE, 100.0), [true, true, false, false, true]);
    }

    #[test]
    fn two_wrong_touches_that_differ_are_both_left_out() {
        let residuals = [0.0, 40.0, -40.0, 1.0];
        assert_eq!(accepted(&hours(4), &residuals, PROBE, 100.0), [true, false, false, true]);
    }

    #[test]
    fn a_drift_of_the_usual_size_is_never_doubted() {
        let residuals: Vec<f64> = (0..24).map(|hour| 2.0 * f64::from(hour)).collect();
        assert!(accepted(&hours(24), &residuals, PROBE, 100.0).iter().all(|accepted| *accepted));
    }
}
