//! Neural network of radial basis functions: `y = bias + Σ w·exp(−|x − c|² / (2·width²))`.

use super::Scaling;

/// Neural network of radial basis functions, with the scaling of its inputs and its output.
#[derive(Clone, Debug, PartialEq)]
pub struct Radial {
    scaling: Scaling,
    nodes: Vec<Node>,
    bias: f64,
    output: (f64, f64),
}

/// Node of the network: a radial basis function, which depends on the distance of the inputs from its centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Centre of the function: one scaled number for each input.
    pub centre: Vec<f64>,
    /// Distance from the centre, in scaled inputs, at which the function has 0.61 of its value at the centre.
    pub width: f64,
    /// Value of the function at its centre.
    pub weight: f64,
}

impl Radial {
    /// Creates a network of these nodes. `scaling`: scaling of the inputs. `output`: mean and scale, µm, that convert
    /// the sum y into Cz = mean + scale · y.
    ///
    /// # Errors
    /// Returns a message if there are no nodes, a centre has another number of inputs, a width is not above
    /// zero, or a number is not finite.
    pub fn new(scaling: Scaling, nodes: Vec<Node>, bias: f64, output: (f64, f64)) -> Result<Radial, String> {
        if nodes.is_empty() {
            return Err("the network has no nodes".to_owned());
        }
        for (place, node) in nodes.iter().enumerate() {
            let number = place + 1;
            if node.centre.len() != scaling.count() {
                let (has, wants) = (node.centre.len(), scaling.count());
                return Err(format!(
                    "centre {number} has {has} numbers, but there are {wants} inputs: the two numbers must be equal"
                ));
            }
            if !(node.width > 0.0 && node.width.is_normal()) {
                return Err(format!("width {number} is {}: it must be above zero", node.width));
            }
            if !node.centre.iter().chain([&node.weight]).all(|number| number.is_finite()) {
                return Err(format!("node {number}: every number must be finite"));
            }
        }
        if ![bias, output.0, output.1].iter().all(|number| number.is_finite()) {
            return Err("bias and the output's mean and scale must be finite".to_owned());
        }
        Ok(Radial { scaling, nodes, bias, output })
    }

    pub(super) fn takes(&self) -> usize {
        self.scaling.count()
    }

    pub(super) fn nodes(&self) -> usize {
        self.nodes.len()
    }

    pub(super) fn output(&self, inputs: &[f64]) -> f64 {
        let mut sum = self.bias;
        for node in &self.nodes {
            let apart = |(input, centre): (f64, &f64)| ((input - centre) / node.width).powi(2);
            let squared: f64 = self.scaling.scaled(inputs).zip(&node.centre).map(apart).sum();
            sum += node.weight * (-0.5 * squared).exp();
        }
        self.output.0 + self.output.1 * sum
    }
}
