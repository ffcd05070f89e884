//! From a signal's unit to what a network was trained on: `(x − mean) / scale`.

/// One mean and one scale per input.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    pairs: Vec<(f64, f64)>,
}

impl Scaling {
    /// From the means and the scales, in the order of the inputs.
    ///
    /// # Errors
    /// A sentence: not as many of one as of the other, none at all, a scale of zero, a number that is none.
    pub fn new(mean: &[f64], scale: &[f64]) -> Result<Scaling, String> {
        if mean.len() != scale.len() || mean.is_empty() || mean.len() > super::WIDEST {
            return Err(format!(
                "its inputs have {} means and {} scales: one of each per input is wanted, 1 to {} inputs",
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

    /// How many inputs.
    pub fn count(&self) -> usize {
        self.pairs.len()
    }

    /// The scaled inputs, in their order.
    pub fn scaled<'a>(&'a self, inputs: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        inputs.iter().zip(&self.pairs).map(|(input, (mean, scale))| (input - mean) / scale)
    }
}
