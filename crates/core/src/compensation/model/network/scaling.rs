//! Scaling of the inputs of a neural network from the signals' units: `(x − mean) / scale`.

/// Maximum number of inputs of a network, and of neurons of a layer. It is limited because a step stores the values in
/// arrays of fixed size.
pub const WIDEST: usize = 256;

/// Mean and scale of each input of a neural network.
#[derive(Clone, Debug, PartialEq)]
pub struct Scaling {
    pairs: Vec<(f64, f64)>,
}

impl Scaling {
    /// Creates a scaling from the means and the scales of the inputs, in their order.
    ///
    /// # Errors
    /// Returns a message if there are no means, more than [`WIDEST`] means, or another number of scales than
    /// means. Also if a scale is zero, or a number is not finite.
    pub fn new(mean: &[f64], scale: &[f64]) -> Result<Scaling, String> {
        if mean.len() != scale.len() || mean.is_empty() || mean.len() > WIDEST {
            return Err(format!(
                "the inputs have {} means and {} scales: each input needs one mean and one scale, and 1 to \
                 {} inputs are allowed",
                mean.len(),
                scale.len(),
                WIDEST
            ));
        }
        let pairs: Vec<(f64, f64)> = mean.iter().copied().zip(scale.iter().copied()).collect();
        let wrong = |(mean, scale): &(f64, f64)| !mean.is_finite() || !scale.is_normal();
        match pairs.iter().position(wrong) {
            Some(place) => Err(format!("input {}: the mean must be finite, the scale not zero", place + 1)),
            None => Ok(Scaling { pairs }),
        }
    }

    /// Returns the number of inputs that the network requires.
    pub fn count(&self) -> usize {
        self.pairs.len()
    }

    /// Returns the scaled inputs, in order.
    pub fn scaled<'a>(&'a self, inputs: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        inputs.iter().zip(&self.pairs).map(|(input, (mean, scale))| (input - mean) / scale)
    }
}
