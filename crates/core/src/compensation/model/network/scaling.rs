//! Scaling from a signal's unit to the unit of a network: `(x − mean) / scale`.

/// Mean and scale of each input.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    pairs: Vec<(f64, f64)>,
}

impl Scaling {
    /// Creates a scaling from means and scales, in the order of the inputs.
    ///
    /// # Errors
    /// Returns a message: different numbers of both, no inputs or too many, a scale of zero, or a number that is not
    /// finite.
    pub fn new(mean: &[f64], scale: &[f64]) -> Result<Scaling, String> {
        if mean.len() != scale.len() || mean.is_empty() || mean.len() > super::WIDEST {
            return Err(format!(
                "the inputs have {} means and {} scales: each input needs one of both, and 1 to {} inputs \
                 are allowed",
                mean.len(),
                scale.len(),
                super::WIDEST
            ));
        }
        let pairs: Vec<(f64, f64)> = mean.iter().copied().zip(scale.iter().copied()).collect();
        let wrong = |(mean, scale): &(f64, f64)| !mean.is_finite() || !scale.is_normal();
        match pairs.iter().position(wrong) {
            Some(place) => Err(format!("input {}: the mean must be finite, the scale not zero", place + 1)),
            None => Ok(Scaling { pairs }),
        }
    }

    /// Returns the number of inputs.
    pub fn count(&self) -> usize {
        self.pairs.len()
    }

    /// Returns the scaled inputs, in order.
    pub fn scaled<'a>(&'a self, inputs: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        inputs.iter().zip(&self.pairs).map(|(input, (mean, scale))| (input - mean) / scale)
    }
}
