"""Writes ONNX files with skl2onnx and onnx into the directory that is named. Prints what onnxruntime computes from them, as JSON: for each
file its rows of inputs with their outputs, or no rows if the file has a model that isotherm rejects."""

import json
import os
import sys

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from skl2onnx import to_onnx
from skl2onnx.common.data_types import DoubleTensorType, FloatTensorType
from sklearn.compose import ColumnTransformer
from sklearn.decomposition import PCA
from sklearn.ensemble import BaggingRegressor, ExtraTreesRegressor, GradientBoostingRegressor, RandomForestRegressor, VotingRegressor
from sklearn.feature_selection import SelectKBest, f_regression
from sklearn.impute import SimpleImputer
from sklearn.linear_model import ElasticNet, HuberRegressor, Lasso, LinearRegression, Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, PolynomialFeatures, RobustScaler, StandardScaler
from sklearn.svm import SVR, LinearSVR
from sklearn.tree import DecisionTreeRegressor

# Temperatures in °C and a speed, with a drift in µm that they cause.
random = np.random.default_rng(52)
X = random.uniform([15, 18, 20], [35, 30, 45], (200, 3)).astype(np.float32)
y = (1.7 * X[:, 0] - 0.8 * X[:, 1] + 6 * np.tanh((X[:, 2] - 30) / 8)).astype(np.float32)
ROWS = np.vstack([X[:20], [[15, 18, 20], [35, 30, 45], [24, 24, 24], [22, 22, 60]]]).astype(np.float32)
OPSET = {"": 17, "ai.onnx.ml": 3}


def mlp(activation, *layers):
    return MLPRegressor(hidden_layer_sizes=layers, activation=activation, solver="lbfgs", max_iter=150, random_state=1, tol=1e-2)


def chosen():
    return ColumnTransformer([("scaled", StandardScaler(), [2, 0]), ("kept", "passthrough", [1])])


COMPUTED = {
    "linear": LinearRegression(),
    "linear_without_intercept": LinearRegression(fit_intercept=False),
    "ridge": Ridge(),
    "lasso": Lasso(alpha=0.01),
    "elastic_net": ElasticNet(alpha=0.01),
    "huber": HuberRegressor(max_iter=1000),
    "linear_svr": LinearSVR(max_iter=20000),
    "standard_ridge": make_pipeline(StandardScaler(), Ridge()),
    "standard_without_mean": make_pipeline(StandardScaler(with_mean=False), Ridge()),
    "robust_ridge": make_pipeline(RobustScaler(), Ridge()),
    "min_max_ridge": make_pipeline(MinMaxScaler(clip=True), Ridge()),
    "max_abs_ridge": make_pipeline(MaxAbsScaler(), Ridge()),
    "imputed_ridge": make_pipeline(SimpleImputer(), Ridge()),
    "selected_ridge": make_pipeline(SelectKBest(f_regression, k=2), Ridge()),
    "columns_ridge": make_pipeline(chosen(), Ridge()),
    "components_ridge": make_pipeline(StandardScaler(), PCA(2), Ridge()),
    "polynomial_ridge": make_pipeline(StandardScaler(), PolynomialFeatures(2, include_bias=False), Ridge()),
    "voting": VotingRegressor([("ridge", Ridge()), ("linear", LinearRegression())]),
    "bagging": BaggingRegressor(Ridge(), 3, random_state=1),
    "mlp_relu": mlp("relu", 8),
    "mlp_tanh": make_pipeline(StandardScaler(), mlp("tanh", 8, 4)),
    "mlp_logistic": make_pipeline(StandardScaler(), mlp("logistic", 6)),
    "mlp_identity": make_pipeline(MinMaxScaler(), mlp("identity", 4)),
}
REJECTED = {
    "forest": RandomForestRegressor(3, random_state=1),
    "extra_trees": ExtraTreesRegressor(3, random_state=1),
    "boosted": GradientBoostingRegressor(n_estimators=3, random_state=1),
    "tree": make_pipeline(StandardScaler(), DecisionTreeRegressor(max_depth=3)),
    "svr": SVR(),
}

os.chdir(sys.argv[1])
answers = {}


def computed(name, columns=None, dtype=np.float32):
    """What onnxruntime computes from a file, row by row, as a gateway does."""
    runtime = onnxruntime.InferenceSession(f"{name}.onnx", providers=["CPUExecutionProvider"])
    outputs = []
    for row in ROWS.astype(dtype):
        if columns:
            feed = {column: row[place : place + 1].reshape(1, 1) for place, column in enumerate(columns)}
        else:
            feed = {runtime.get_inputs()[0].name: row.reshape(1, -1)}
        outputs.append(float(np.ravel(runtime.run(None, feed)[0])[0]))
    answers[name] = {"rows": ROWS.tolist(), "outputs": outputs}


def saved(name, model, **how):
    onnx.checker.check_model(model)
    onnx.save_model(model, f"{name}.onnx", **how)


row_of_floats = [("x", FloatTensorType([None, 3]))]
for name, model in COMPUTED.items():
    model.fit(X, y)
    saved(name, to_onnx(model, initial_types=row_of_floats, target_opset=OPSET))
    computed(name)
for name, model in REJECTED.items():
    model.fit(X, y)
    saved(name, to_onnx(model, initial_types=row_of_floats, target_opset=OPSET))
    answers[name] = None

# The same model in other forms: newer operators, the newest as `to_onnx` chooses them, double precision, one input for each column, external data.
saved("polynomial_newer", to_onnx(COMPUTED["polynomial_ridge"], initial_types=row_of_floats, target_opset={"": 20, "ai.onnx.ml": 3}))
computed("polynomial_newer")
for name in ["ridge", "standard_ridge", "polynomial_ridge", "mlp_tanh"]:
    saved(f"{name}_newest", to_onnx(COMPUTED[name], initial_types=row_of_floats))
    computed(f"{name}_newest")
for name in ["linear", "standard_ridge", "mlp_tanh", "columns_ridge"]:
    model = COMPUTED[name]
    saved(f"{name}_double", to_onnx(model, initial_types=[("x", DoubleTensorType([None, 3]))], target_opset=OPSET))
    computed(f"{name}_double", dtype=np.float64)
    columns = ["bed", "column", "head"]
    for suffix, kind, dtype in [("columns", FloatTensorType, np.float32), ("double_columns", DoubleTensorType, np.float64)]:
        if name != "linear":
            each = [(column, kind([None, 1])) for column in columns]
            saved(f"{name}_{suffix}", to_onnx(model, initial_types=each, target_opset=OPSET))
            computed(f"{name}_{suffix}", columns=columns, dtype=dtype)
for name, in_one in [("external_one", True), ("external_each", False)]:
    model = to_onnx(COMPUTED["mlp_tanh"], initial_types=row_of_floats, target_opset=OPSET)
    # Only numbers in raw bytes can leave the file. onnxruntime needs the integers of shapes in it.
    for tensor in model.graph.initializer:
        if tensor.data_type == TensorProto.FLOAT:
            tensor.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(tensor), tensor.name))
    location = f"{name}.data" if in_one else None
    saved(name, model, save_as_external_data=True, all_tensors_to_one_file=in_one, location=location, size_threshold=0)
    computed(name)


def network(name, nodes, tensors):
    """A file as PyTorch exports it: one row of three numbers, operators of version 17."""
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", 3])
    out = helper.make_tensor_value_info("y", TensorProto.FLOAT, ["batch", 1])
    graph = helper.make_graph(nodes, name, [x], [out], [numpy_helper.from_array(value, key) for key, value in tensors.items()])
    saved(name, helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8))
    computed(name)


def some(*shape):
    return random.normal(0, 0.5, shape).astype(np.float32)


layers = {
    "gain": some(3),
    "shift": some(3),
    "mean": X.mean(0),
    "variance": X.var(0),
    "w0": some(5, 3),
    "b0": some(5),
    "w1": some(1, 5),
    "b1": some(1),
    "ratio": np.array(0.5, np.float32),
    "training": np.array(False),
}
normal = helper.make_node("BatchNormalization", ["x", "gain", "shift", "mean", "variance"], ["n"], epsilon=1e-5, momentum=0.9)
hidden = helper.make_node("Gemm", ["n", "w0", "b0"], ["h"], transB=1)
last = helper.make_node("Gemm", ["d", "w1", "b1"], ["y"], transB=1)
for name, inputs in [("dropout", ["a"]), ("dropout_ratio", ["a", "ratio"]), ("dropout_inference", ["a", "ratio", "training"])]:
    network(name, [normal, hidden, helper.make_node("Relu", ["h"], ["a"]), helper.make_node("Dropout", inputs, ["d"]), last], layers)
for operator in ["Erf", "HardSigmoid", "HardSwish", "Softsign"]:
    network(operator.lower(), [normal, hidden, helper.make_node(operator, ["h"], ["d"]), last], layers)
slope = {**layers, "slope": some(5)}
network("prelu", [normal, hidden, helper.make_node("PRelu", ["h", "slope"], ["d"]), last], slope)

json.dump(answers, sys.stdout)
