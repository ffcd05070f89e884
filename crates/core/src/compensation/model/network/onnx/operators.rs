//! Operators of the ONNX runtime that a network may use.

use rten::{OpRegistry, op_types};

/// Defines the operators of the ONNX runtime that a network may use, and the list of their names.
macro_rules! operators {
    ($($name:ident)*) => {
        /// Names of the supported operators.
        pub(super) const SUPPORTED: &[&str] = &[$(stringify!($name)),*];

        /// Returns the registry of the supported operators, with which the ONNX runtime loads a file.
        pub(super) fn operators() -> OpRegistry {
            OpRegistry::with_ops(&[$(&op_types::$name),*])
        }
    };
}

// Operators with which networks of neurons, radial basis functions and linear models are exported, and the mean of several
// of them. More would only make the program larger. `standard` replaces some other operators by these.
operators! {
    Abs Add BatchNormalization Cast CastLike Clip Concat Div Elu Erf Exp Flatten Gather Gelu Gemm
    HardSigmoid HardSwish Identity LeakyRelu MatMul Max Mean Min Mul Neg PRelu Pow ReduceMean ReduceProd
    ReduceSum Relu Reshape Sigmoid Softplus Softsign Sqrt Squeeze Sub Sum Tanh Transpose Unsqueeze
}
