//! Network in an ONNX file, run by rten. Its input is one tensor: one row with one number for each input. Its output is
//! one number.
//!
//! The graph computes in single precision, whatever the file says. It uses one thread, so that the same inputs give the
//! same bits. The runtime allocates a few small tensors inside a step.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use rten::{Dimension, Model, ModelOptions, NodeId, OpRegistry, RunOptions, ThreadPool, Value, op_types};
use rten_tensor::prelude::*;
use rten_tensor::{Tensor, TensorView};

use super::WIDEST;
use crate::border::beyond;

mod frame;
mod trial;

/// Graph that has been run once as a trial.
#[derive(Clone)]
pub struct Onnx {
    graph: Arc<Graph>,
    takes: usize,
    shape: [usize; 2],
    flat: bool,
    fingerprint: u64,
}

struct Graph {
    model: Model,
    input: NodeId,
    output: NodeId,
    pool: Arc<ThreadPool>,
}

impl Graph {
    fn options(&self) -> RunOptions {
        RunOptions::default().with_thread_pool(Some(self.pool.clone()))
    }
}

impl Onnx {
    /// Loads an ONNX file, and runs it with every input at zero. `inputs` is the number of inputs of the model. It sets
    /// a dimension that the file leaves open.
    ///
    /// # Errors
    /// Returns a message: the bytes are no ONNX file, an operator is not supported, or the graph does not take one row
    /// of numbers or does not give one number.
    pub fn new(bytes: Vec<u8>, inputs: usize) -> Result<Onnx, String> {
        if !frame::is_whole(&bytes) {
            return Err(
                "this is no ONNX file, or the file is incomplete: export the network again".to_owned()
            );
        }
        trial::check_tensors(&bytes)?;
        let mut hasher = DefaultHasher::new();
        bytes.hash(&mut hasher);
        let mut options = ModelOptions::with_ops(operators());
        // The fused operators of the runtime panic if shapes do not fit. They save nothing in networks of this size.
        options.enable_optimization(false);
        let model = caught(|| options.load(bytes.clone()))?
            .map_err(|why| format!("the file cannot be read as an ONNX network: {why}"))?;
        let (&[input], &[output]) = (model.input_ids(), model.output_ids()) else {
            return Err(format!(
                "the network has {} input tensors and {} output tensors: export it with one tensor of all \
                 inputs and one of Cz",
                model.input_ids().len(),
                model.output_ids().len()
            ));
        };
        let name = model.node_info(input).and_then(|node| node.name()).unwrap_or("input").to_owned();
        let (takes, flat) = row(model.input_shape(0), inputs, &name)?;
        if takes == 0 || takes > WIDEST {
            return Err(format!(
                "input `{name}` of the network has {takes} numbers: 1 to {WIDEST} are allowed"
            ));
        }
        let pool = Arc::new(ThreadPool::with_num_threads(1));
        let graph = Arc::new(Graph { model, input, output, pool });
        let onnx = Onnx { graph, takes, shape: [1, takes], flat, fingerprint: hasher.finish() };
        trial::run(&bytes, &onnx.graph, onnx.row(&[0.0; WIDEST][..takes]), &onnx.graph.options())?;
        // The output may differ from what the file says, so the graph is run.
        let values = onnx.run(&[0.0; WIDEST][..takes])?;
        match values.len() {
            1 => Ok(onnx),
            count => Err(format!("the output of the network has {count} numbers: it must have one, Cz")),
        }
    }

    pub(super) fn takes(&self) -> usize {
        self.takes
    }

    pub(super) fn output(&self, inputs: &[f64]) -> f64 {
        match self.run(inputs).as_deref() {
            Ok([value]) => f64::from(*value),
            _ => f64::NAN,
        }
    }

    fn row(&self, inputs: &[f64]) -> Value {
        #[allow(clippy::cast_possible_truncation, reason = "the graph computes in single precision")]
        let row: Vec<f32> = inputs.iter().map(|input| *input as f32).collect();
        let shape = if self.flat { &self.shape[1..] } else { &self.shape[..] };
        Tensor::from_data(shape, row).into()
    }

    fn run(&self, inputs: &[f64]) -> Result<Vec<f32>, String> {
        let row = self.row(inputs);
        let Graph { model, input, output, .. } = &*self.graph;
        let options = self.graph.options();
        let values = caught(|| model.run_n([(*input, row.into())].into(), [*output], Some(options)))?
            .map_err(|why| format!("the network cannot be computed: {why}"))?;
        let [value] = &values;
        let view: TensorView<'_, f32> =
            value.try_into().map_err(|why| format!("the output of the network is no number: {why}"))?;
        Ok(view.to_vec())
    }
}

/// Catches a panic of the runtime. A file may be invalid in a way that the runtime does not check.
fn caught<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    beyond(run).map_err(|_| "the ONNX runtime failed on this network: export it again".to_owned())
}

/// Returns the number of inputs, and whether the tensor has no dimension for the row.
fn row(shape: Option<Vec<Dimension>>, inputs: usize, name: &str) -> Result<(usize, bool), String> {
    let size = |dimension: &Dimension| match dimension {
        Dimension::Fixed(size) => *size,
        Dimension::Symbolic(_) => inputs,
    };
    match shape.as_deref() {
        None => Ok((inputs, false)),
        Some([only]) => Ok((size(only), true)),
        Some([Dimension::Fixed(1) | Dimension::Symbolic(_), numbers]) => Ok((size(numbers), false)),
        Some(other) => {
            let sizes: Vec<String> = other.iter().map(named).collect();
            Err(format!(
                "input `{name}` of the network has the shape [{}]: export the network for one row of inputs",
                sizes.join(", ")
            ))
        }
    }
}

fn named(dimension: &Dimension) -> String {
    match dimension {
        Dimension::Fixed(size) => size.to_string(),
        Dimension::Symbolic(name) => name.clone(),
    }
}

/// Operators with which networks of neurons and radial basis functions are exported. More would only make the program
/// larger.
fn operators() -> OpRegistry {
    OpRegistry::with_ops(&[
        &op_types::Abs,
        &op_types::Add,
        &op_types::Cast,
        &op_types::Clip,
        &op_types::Concat,
        &op_types::Div,
        &op_types::Elu,
        &op_types::Exp,
        &op_types::Flatten,
        &op_types::Gather,
        &op_types::Gemm,
        &op_types::Identity,
        &op_types::LeakyRelu,
        &op_types::MatMul,
        &op_types::Max,
        &op_types::Min,
        &op_types::Mul,
        &op_types::Neg,
        &op_types::Pow,
        &op_types::ReduceSum,
        &op_types::Relu,
        &op_types::Reshape,
        &op_types::Sigmoid,
        &op_types::Softplus,
        &op_types::Sqrt,
        &op_types::Squeeze,
        &op_types::Sub,
        &op_types::Tanh,
        &op_types::Transpose,
        &op_types::Unsqueeze,
    ])
}

/// Two networks are equal if their files and numbers of inputs are equal.
impl PartialEq for Onnx {
    fn eq(&self, other: &Onnx) -> bool {
        (self.fingerprint, self.takes) == (other.fingerprint, other.takes)
    }
}

impl std::fmt::Debug for Onnx {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Onnx").field("takes", &self.takes).field("fingerprint", &self.fingerprint).finish()
    }
}
