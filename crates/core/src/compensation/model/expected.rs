//! Expected error of a model: its residual error on runs that were not used for identification, depending on the
//! elapsed time.

use std::time::Duration;

use crate::quantity::Micron;

/// Expected residual error of a model, one standard deviation. The residuals of the last probings scale this
/// error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Growth of the error's variance with the time since the datum (zero point) of the model.
    pub since_datum: Growth,
    /// Growth of the error's variance with the time since the last accepted probing; `None` if the identification had
    /// no probings.
    pub since_touch: Option<Growth>,
}

/// Variance of an error that grows linearly with the time h in hours: `σ² = per_hour · h + at_once`, µm².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    per_hour: f64,
    at_once: f64,
}

impl Expected {
    /// Returns the standard deviation of the error after these times. After a probing, this is the smaller of the two
    /// deviations. `None` if it is not finite.
    pub fn after(&self, since_datum: Duration, since_touch: Option<Duration>) -> Option<Micron> {
        let from_datum = self.since_datum.after(since_datum);
        let from_touch = self.since_touch.zip(since_touch).map(|(growth, span)| growth.after(span));
        Micron::new(from_touch.map_or(from_datum, |from_touch| from_touch.min(from_datum)))
    }
}

impl Growth {
    /// Creates a growth from the increase in each hour, µm²/h, and the variance at the start, µm². `None` if a number
    /// is negative or not finite.
    pub fn new(per_hour: f64, at_once: f64) -> Option<Growth> {
        let is_variance = |number: f64| number.is_finite() && number >= 0.0;
        (is_variance(per_hour) && is_variance(at_once)).then_some(Growth { per_hour, at_once })
    }

    /// Returns the increase of the variance in each hour, µm²/h.
    pub fn per_hour(&self) -> f64 {
        self.per_hour
    }

    /// Returns the variance at the start of the growth, µm².
    pub fn at_once(&self) -> f64 {
        self.at_once
    }

    /// Returns the standard deviation σ after this time, µm. The result may be infinite.
    fn after(&self, span: Duration) -> f64 {
        (self.per_hour * span.as_secs_f64() / 3600.0 + self.at_once).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_hours(1);

    fn growth(per_hour: f64, at_once: f64) -> Growth {
        Growth::new(per_hour, at_once).unwrap()
    }

    #[test]
    fn a_variance_grows_by_the_hour_and_after_a_probing_the_smaller_of_the_two_holds() {
        let expected = Expected { since_datum: growth(0.9, 1.1), since_touch: Some(growth(0.8, 0.2)) };
        for (datum, touch, wanted) in [
            (Duration::ZERO, None, 1.1_f64.sqrt()),
            (4 * HOUR, None, 4.7_f64.sqrt()),
            (4 * HOUR, Some(Duration::ZERO), 0.2_f64.sqrt()),
            (4 * HOUR, Some(HOUR / 2), 0.6_f64.sqrt()),
            // The datum was taken after the probing, and its variance is smaller.
            (Duration::ZERO, Some(4 * HOUR), 1.1_f64.sqrt()),
        ] {
            let found = expected.after(datum, touch).unwrap().get();
            assert!((found - wanted).abs() < 1e-12, "{datum:?} {touch:?}: {found}");
        }
        let untried = Expected { since_touch: None, ..expected };
        assert_eq!(untried.after(4 * HOUR, Some(HOUR)), untried.after(4 * HOUR, None));
    }

    #[test]
    fn what_is_no_variance_is_refused_and_what_is_no_number_is_not_shown() {
        for (per_hour, at_once) in [(-0.1, 1.0), (1.0, -0.1), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert_eq!(Growth::new(per_hour, at_once), None);
        }
        let endless = Expected { since_datum: growth(f64::MAX, f64::MAX), since_touch: None };
        assert_eq!(endless.after(1000 * HOUR, None), None);
        assert_eq!(Growth::new(0.0, 0.0).map(|none| none.after(HOUR)), Some(0.0));
    }
}
