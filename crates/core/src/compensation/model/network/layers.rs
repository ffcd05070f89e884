//! Neural network of layers. Each layer computes `y = f(W·x + b)` from the outputs x of the layer before it.

use serde::Deserialize;

use super::{Scaling, WIDEST};

/// Neural network of layers, with the scaling of its inputs and its output.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    scaling: Scaling,
    layers: Vec<Layer>,
    output: (f64, f64),
}

/// One layer of neurons.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Weights: one row for each neuron, one column for each neuron of the layer before.
    pub weights: Vec<Vec<f64>>,
    /// Bias of each neuron, which is added to the weighted sum of its inputs.
    pub bias: Vec<f64>,
    /// Function that each neuron applies to the weighted sum of its inputs.
    pub activation: Activation,
}

/// Function that a neuron applies to the weighted sum of its inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Activation {
    /// The function is the hyperbolic tangent of the sum.
    Tanh,
    /// The function is the sum if it is above zero, else zero.
    Relu,
    /// The function is the sum itself.
    Linear,
}

impl Activation {
    fn of(self, sum: f64) -> f64 {
        match self {
            Activation::Tanh => sum.tanh(),
            // `max` would turn NaN into zero.
            Activation::Relu if sum < 0.0 => 0.0,
            Activation::Relu | Activation::Linear => sum,
        }
    }
}

impl Layers {
    /// Creates a network of these layers. `scaling`: scaling of the inputs. `output`: mean and scale, µm, that convert
    /// the last neuron's y into Cz = mean + scale · y.
    ///
    /// # Errors
    /// Returns a message if the sizes of two layers do not fit, or if a number is not finite. Also if the last layer
    /// does not have exactly one neuron.
    pub fn new(scaling: Scaling, layers: Vec<Layer>, output: (f64, f64)) -> Result<Layers, String> {
        let mut width = scaling.count();
        for (place, layer) in layers.iter().enumerate() {
            let number = place + 1;
            let neurons = layer.weights.len();
            if neurons == 0 || neurons > WIDEST || neurons != layer.bias.len() {
                return Err(format!(
                    "layer {number} has {neurons} rows of weights and {} biases: each neuron needs one \
                     row and one bias, and 1 to {WIDEST} neurons are allowed",
                    layer.bias.len()
                ));
            }
            if let Some(row) = layer.weights.iter().position(|row| row.len() != width) {
                return Err(format!(
                    "layer {number}, neuron {}: {} weights, but the layer has {width} inputs: each input \
                     needs one weight",
                    row + 1,
                    layer.weights[row].len()
                ));
            }
            if !layer.weights.iter().flatten().chain(&layer.bias).all(|number| number.is_finite()) {
                return Err(format!("layer {number}: every number must be finite"));
            }
            width = neurons;
        }
        if width != 1 || layers.is_empty() {
            return Err(format!("the last layer has {width} neurons: it must have one neuron, for Cz"));
        }
        if !output.0.is_finite() || !output.1.is_finite() {
            return Err("the output's mean and scale must be finite".to_owned());
        }
        Ok(Layers { scaling, layers, output })
    }

    pub(super) fn takes(&self) -> usize {
        self.scaling.count()
    }

    /// Returns the number of inputs and of the neurons of each layer, for example `30-16-1`.
    pub(super) fn shape(&self) -> String {
        let widths = self.layers.iter().map(|layer| format!("-{}", layer.bias.len()));
        format!("{}{}", self.takes(), widths.collect::<String>())
    }

    pub(super) fn output(&self, inputs: &[f64]) -> f64 {
        let (mut from, mut to) = ([0.0; WIDEST], [0.0; WIDEST]);
        for (value, scaled) in from.iter_mut().zip(self.scaling.scaled(inputs)) {
            *value = scaled;
        }
        for layer in &self.layers {
            for ((value, row), bias) in to.iter_mut().zip(&layer.weights).zip(&layer.bias) {
                let sum: f64 = row.iter().zip(&from).map(|(weight, input)| weight * input).sum();
                *value = layer.activation.of(sum + bias);
            }
            std::mem::swap(&mut from, &mut to);
        }
        self.output.0 + self.output.1 * from[0]
    }
}
