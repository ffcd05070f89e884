//! Neural network or linear model in an ONNX file, computed by the library rten. The file has one input
//! tensor: one row with one number for each input of the model. A file with a separate input tensor of one
//! number for each input is also accepted. The output is one number.
//!
//! The graph computes in single precision, even if the file demands another precision. One thread computes
//! the graph, so that the same inputs give the same bits. The runtime allocates a few small tensors at each
//! computation.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use rten::{Dimension, Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value};
use rten_tensor::prelude::*;
use rten_tensor::{Tensor, TensorView};

use super::WIDEST;
use crate::border::beyond;

mod encode;
mod external;
mod frame;
mod operators;
mod standard;
mod trial;

pub use external::ExternalFiles;

/// Graph of an ONNX file that has passed a trial computation.
#[derive(Clone)]
pub struct Onnx {
    graph: Arc<Graph>,
    takes: usize,
    shape: [usize; 2],
    flat: bool,
    columns: Vec<String>,
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
    /// Loads an ONNX file that contains the numbers of all its tensors. See [`Onnx::with_external`].
    ///
    /// # Errors
    /// The errors of [`Onnx::with_external`].
    pub fn new(bytes: impl AsRef<[u8]>, inputs: usize) -> Result<Onnx, String> {
        Onnx::with_external(bytes.as_ref(), &ExternalFiles::new(), inputs)
    }

    /// Returns the names of the files next to an ONNX file that contain numbers of its tensors (external data). The
    /// names are relative to the directory of the ONNX file, and stay in it.
    ///
    /// # Errors
    /// Returns a message if the bytes are not an ONNX file, or if a name leads out of the directory.
    pub fn external_files(bytes: &[u8]) -> Result<Vec<String>, String> {
        check_frame(bytes)?;
        Ok(external::files(bytes)?.into_iter().collect())
    }

    /// Loads an ONNX file, and computes the network once with every input at zero. `external` has the files with
    /// external data ([`Onnx::external_files`]). `inputs` is the number of inputs of the model, for a file that leaves
    /// the size of its input open.
    ///
    /// # Errors
    /// Returns a message if the bytes are not an ONNX file, an operator is not supported, or external data is missing.
    /// Also if the graph does not compute one number from one row of numbers.
    pub fn with_external(bytes: &[u8], external: &ExternalFiles, inputs: usize) -> Result<Onnx, String> {
        check_frame(bytes)?;
        let standard::Rewritten { bytes, columns } =
            standard::rewrite(bytes, &mut external::External::new(external))?;
        trial::check_tensors(&bytes)?;
        let mut hasher = DefaultHasher::new();
        bytes.hash(&mut hasher);
        let mut options = ModelOptions::with_ops(operators::operators());
        // The fused operators of the runtime panic if shapes do not fit. They save nothing in networks of this size.
        options.enable_optimization(false);
        let model = caught(|| options.load(bytes.clone()))?
            .map_err(|why| format!("the file cannot be read as an ONNX network: {why}"))?;
        let (&[input], &[output]) = (model.input_ids(), model.output_ids()) else {
            return Err(format!(
                "the network has {} input tensors and {} output tensors: export it with one input tensor \
                 for all inputs and one output tensor for Cz",
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
        let onnx = Onnx { graph, takes, shape: [1, takes], flat, columns, fingerprint: hasher.finish() };
        trial::run(&bytes, &onnx.graph, onnx.row(&[0.0; WIDEST][..takes]), &onnx.graph.options())?;
        // The output may differ from its declaration in the file, so the graph is computed once.
        let values = onnx.run(&[0.0; WIDEST][..takes])?;
        match values.len() {
            1 => Ok(onnx),
            count => {
                Err(format!("the output of the network has {count} numbers: it must have one number, Cz"))
            }
        }
    }

    /// Returns the names of the input tensors, if the file has a separate input tensor of one number for each
    /// input of the model. Empty if the file has a single input tensor for all inputs.
    pub fn columns(&self) -> &[String] {
        &self.columns
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
            value.try_into().map_err(|why| format!("the output of the network is not a number: {why}"))?;
        Ok(view.to_vec())
    }
}

/// Checks that the bytes are a complete ONNX file.
fn check_frame(bytes: &[u8]) -> Result<(), String> {
    if frame::is_whole(bytes) {
        return Ok(());
    }
    Err("this is not an ONNX file, or the file is incomplete: export the network again".to_owned())
}

/// Runs code of the ONNX runtime, and returns a panic as an error. A file may be invalid in a way that the runtime does
/// not check.
fn caught<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    beyond(run).map_err(|_| "the ONNX runtime failed on this network: export the network again".to_owned())
}

/// Returns the number of inputs of the network, and whether the input tensor has only one dimension (no dimension for
/// rows). `inputs` is the number of inputs of the model, for a file that leaves the size open.
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

/// Compares two networks. They are equal if their files and numbers of inputs are equal.
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
