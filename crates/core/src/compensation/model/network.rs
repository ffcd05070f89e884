//! Models that are neural networks: back-propagation and radial-basis networks of the project's own format,
//! and networks in ONNX files. The project calls this model M10. Its sources are Ren et al., Chen and Wang,
//! and the notes on radial-basis and Bayesian networks.
//!
//! Inputs are temperatures, positions and speeds, each minus its reference, in the signal's unit. The result is Cz in
//! µm. The network itself contains the scaling of inputs and output, as part of its weights or of the ONNX graph.

use super::{Evaluate, Input, Inputs, Lag, Outputs, Rises, Unusable};
use crate::reading::SignalId;

mod layers;
#[cfg(feature = "onnx")]
mod onnx;
mod radial;
mod scaling;

pub use layers::{Activation, Layer, Layers};
#[cfg(feature = "onnx")]
pub use onnx::{ExternalFiles, Onnx};
pub use radial::{Node, Radial};
pub use scaling::{Scaling, WIDEST};

/// Neural network with its input signals.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    source: String,
    net: Net,
    inputs: Vec<Input>,
}

/// Neural network of one of the supported kinds.
#[derive(Clone, Debug, PartialEq)]
pub enum Net {
    /// Layers of neurons, as back-propagation trains them. Computing the output allocates no memory.
    Layers(Layers),
    /// Radial basis functions. Computing the output allocates no memory.
    Radial(Radial),
    /// Graph of an ONNX file. The ONNX runtime allocates memory when it computes the output.
    #[cfg(feature = "onnx")]
    Onnx(Onnx),
}

impl Net {
    /// Returns the number of inputs that the network requires.
    pub fn takes(&self) -> usize {
        match self {
            Net::Layers(layers) => layers.takes(),
            Net::Radial(radial) => radial.takes(),
            #[cfg(feature = "onnx")]
            Net::Onnx(onnx) => onnx.takes(),
        }
    }

    /// Returns a description of the network for display, for example `back-propagation network 30-16-1`.
    pub fn what(&self) -> String {
        match self {
            Net::Layers(layers) => format!("back-propagation network {}", layers.shape()),
            Net::Radial(radial) => format!("radial-basis network of {} nodes", radial.nodes()),
            #[cfg(feature = "onnx")]
            Net::Onnx(_) => "ONNX network".to_owned(),
        }
    }

    /// Returns the output for these inputs, Cz in µm; NaN if the network cannot be computed.
    pub fn output(&self, inputs: &[f64]) -> f64 {
        match self {
            Net::Layers(layers) => layers.output(inputs),
            Net::Radial(radial) => radial.output(inputs),
            #[cfg(feature = "onnx")]
            Net::Onnx(onnx) => onnx.output(inputs),
        }
    }
}

impl Network {
    /// Creates a model from a network and its inputs, in the network's order. `source` is the name of the file, for
    /// display.
    ///
    /// # Errors
    /// Returns a message if the network has another number of inputs.
    pub fn new(source: impl Into<String>, net: Net, inputs: Vec<Input>) -> Result<Network, String> {
        if net.takes() != inputs.len() || inputs.len() > WIDEST {
            return Err(format!(
                "the network has {} inputs, but the model names {}",
                net.takes(),
                inputs.len()
            ));
        }
        Ok(Network { source: source.into(), net, inputs })
    }

    /// Returns the name of the file with the network.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Returns the neural network without its input signals.
    pub fn net(&self) -> &Net {
        &self.net
    }

    /// Returns the input signals in the order of the network's inputs.
    pub fn reads(&self) -> &[Input] {
        &self.inputs
    }
}

impl Evaluate for Network {
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        let mut rises = [0.0; WIDEST];
        let mut lags = inputs.lags.iter();
        for (rise, input) in rises.iter_mut().zip(&self.inputs) {
            *rise = input.rise(inputs, lags.next().unwrap_or(&Lag::NONE))?.get();
        }
        Outputs::of(self.net.output(&rises[..self.inputs.len()]), 0.0)
    }

    fn signals(&self) -> Vec<SignalId> {
        self.inputs.iter().map(|input| input.signal).collect()
    }

    fn lagging(&self) -> Rises<'_> {
        Rises { inputs: &self.inputs, ..Rises::default() }
    }
}

#[cfg(test)]
mod tests;
