//! `kind = "network"`: a neural network, as ONNX or in the project's own format below. An ONNX file may also contain a
//! linear model. Files in the same directory that contain its external data are read too. `names` in `inputs` is
//! optional. Activations are `tanh`, `relu` and `linear`. `output` is in µm.
//!
//! ```json
//! { "format": "isotherm-network", "version": 1, "type": "bp",
//!   "inputs": { "names": ["bed", "column"], "mean": [22, 21], "scale": [4, 3] }, "output": { "mean": 0, "scale": 1 },
//!   "layers": [{ "weights": [[0.1, 0.2], [0.3, 0.4]], "bias": [0, 0], "activation": "tanh" }, …] }
//! { "format": "isotherm-network", "version": 1, "type": "rbf", "inputs": …, "output": …,
//!   "centres": [[0.1, 0.2], …], "widths": [1.5, …], "weights": [3.0, …], "bias": 0 }
//! ```

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::effect::{effect, figure, late, middle, rises};
use super::file::{bytes, fit, read, taken};
use super::inputs::in_order;
use super::kind::{Computation, KindOfModel};
use super::raw::{NETWORK, RawModel};
use crate::tables::KeyContext;
use crate::tables::signal::Signal;
use isotherm_core::compensation::model::network::{Activation, Layer, Layers, Net, Node, Radial, Scaling};
use isotherm_core::compensation::model::{Input, Kind, Network, Reference};
use isotherm_core::quantity::Celsius;

pub(super) const KIND: KindOfModel = KindOfModel {
    word: NETWORK,
    one: "a network",
    keys: &["inputs", "file", "reference"],
    resolve,
    preview,
    places: |_| None,
};

#[derive(Debug, Deserialize)]
struct Typed {
    r#type: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LayersFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    #[serde(rename = "type")]
    _type: IgnoredAny,
    inputs: RawScaling,
    output: Output,
    layers: Vec<RawLayer>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RadialFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    #[serde(rename = "type")]
    _type: IgnoredAny,
    inputs: RawScaling,
    output: Output,
    centres: Vec<Vec<f64>>,
    widths: Vec<f64>,
    weights: Vec<f64>,
    bias: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScaling {
    names: Option<Vec<String>>,
    mean: Vec<f64>,
    scale: Vec<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Output {
    mean: f64,
    scale: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawLayer {
    weights: Vec<Vec<f64>>,
    bias: Vec<f64>,
    activation: Activation,
}

/// Parses a network in the project's own format. Returns the network, and the names of its inputs if the file contains
/// them.
pub fn parse(bytes: &[u8]) -> Result<(Net, Option<Vec<String>>), String> {
    const FORMAT: &str = "isotherm-network";
    let typed: Typed = read(bytes, FORMAT)?;
    match typed.r#type.as_deref() {
        Some("bp") => layers(read(bytes, FORMAT)?),
        Some("rbf") => radial(read(bytes, FORMAT)?),
        Some(other) => Err(format!("the type of the network is \"{other}\"; allowed: \"bp\" and \"rbf\"")),
        None => Err("the file has no \"type\"; allowed: \"bp\" and \"rbf\"".to_owned()),
    }
}

impl RawScaling {
    fn resolved(self) -> Result<(Scaling, Option<Vec<String>>), String> {
        let scaling = Scaling::new(&self.mean, &self.scale)?;
        if let Some(names) = self.names.as_ref().filter(|names| names.len() != scaling.count()) {
            return Err(format!(
                "the file names {} inputs, but has scales for {}",
                names.len(),
                scaling.count()
            ));
        }
        Ok((scaling, self.names))
    }
}

fn layers(file: LayersFile) -> Result<(Net, Option<Vec<String>>), String> {
    let (scaling, names) = file.inputs.resolved()?;
    let layer = |RawLayer { weights, bias, activation }: RawLayer| Layer { weights, bias, activation };
    let layers = file.layers.into_iter().map(layer).collect();
    Ok((Net::Layers(Layers::new(scaling, layers, (file.output.mean, file.output.scale))?), names))
}

fn radial(file: RadialFile) -> Result<(Net, Option<Vec<String>>), String> {
    let (scaling, names) = file.inputs.resolved()?;
    let (centres, widths, weights) = (file.centres.len(), file.widths.len(), file.weights.len());
    if centres != widths || centres != weights {
        return Err(format!(
            "the network has {centres} centres, {widths} widths and {weights} weights: each node needs one \
             centre, one width and one weight"
        ));
    }
    let parts = file.centres.into_iter().zip(file.widths).zip(file.weights);
    let nodes = parts.map(|((centre, width), weight)| Node { centre, width, weight }).collect();
    let output = (file.output.mean, file.output.scale);
    Ok((Net::Radial(Radial::new(scaling, nodes, file.bias, output)?), names))
}

fn resolve(raw: &RawModel, at: &KeyContext<'_>) -> Option<Kind> {
    let help = "write inputs = [ … ], the signals in the network's order";
    at.key("inputs").missing("`inputs` is missing: a network needs its input signals", help);
    let help = "write file = \"spindle.onnx\", or a .json of the project's own format, next to the profile";
    at.key("file").missing("`file` is missing: a network needs the file with its coefficients", help);
    let inputs = in_order((raw.inputs.as_ref(), raw.reference), at, Some(Reference::Fixed(Celsius::ZERO)));
    let (name, at) = (raw.file.as_deref()?, at.key("file"));
    let bytes = bytes(raw.sha256.as_ref(), "file", &at, name)?;
    let (inputs, names) = inputs?;
    let (net, own) = net(raw, &at, name, &bytes, inputs.len())?;
    let fits = match own {
        Some(own) => fit("inputs", &own, &names),
        None if net.takes() == inputs.len() => Ok(()),
        None => {
            let (takes, count, names) = (net.takes(), inputs.len(), names.join(", "));
            Err(format!("the network has {takes} inputs, but the model names {count}: {names}"))
        }
    };
    taken(&at, name, fits)?;
    taken(&at, name, Network::new(name, net, inputs)).map(Kind::Network)
}

/// Network from a file, with the names of its inputs. The names are `None` if the file does not contain them.
type Named = (Net, Option<Vec<String>>);

/// Reads the network in the file `name`. If it is invalid, reports the reason and returns `None`. `inputs` is the
/// number of inputs that the model has.
#[cfg(feature = "onnx")]
fn net(raw: &RawModel, at: &KeyContext<'_>, name: &str, bytes: &[u8], inputs: usize) -> Option<Named> {
    use isotherm_core::compensation::model::network::Onnx;
    if !is_onnx(name) {
        return taken(at, name, own_format(name, bytes));
    }
    let external = external(raw, at, name, bytes)?;
    let onnx = taken(at, name, Onnx::with_external(bytes, &external, inputs))?;
    let names = Some(onnx.columns().to_vec()).filter(|names| !names.is_empty());
    Some((Net::Onnx(onnx), names))
}

#[cfg(not(feature = "onnx"))]
fn net(_: &RawModel, at: &KeyContext<'_>, name: &str, bytes: &[u8], _: usize) -> Option<Named> {
    if is_onnx(name) {
        let why = "this program was built without ONNX: use a packaged program, or build one with ONNX: \
                   `cargo build --release --features onnx`";
        return taken(at, name, Err(why.to_owned()));
    }
    taken(at, name, own_format(name, bytes))
}

/// Parses a network in the project's own format. If the file is in the format of a training program, such as a pickle,
/// the error says which formats are supported.
fn own_format(name: &str, bytes: &[u8]) -> Result<Named, String> {
    parse(bytes).map_err(|why| match has_extension(name, "json") {
        true => why,
        false => format!(
            "{why}. A network is an .onnx file, or a .json file of the project's own format: export the model as ONNX"
        ),
    })
}

/// Reads the external files of an ONNX file, which contain some of its weights. If an external file cannot be read,
/// reports the reason and returns `None`.
#[cfg(feature = "onnx")]
fn external(
    raw: &RawModel,
    at: &KeyContext<'_>,
    name: &str,
    bytes: &[u8],
) -> Option<isotherm_core::compensation::model::network::ExternalFiles> {
    use isotherm_core::compensation::model::network::Onnx;
    let files = taken(at, name, Onnx::external_files(bytes))?;
    if let Some(file) = files.first()
        && raw.sha256.as_ref().is_some_and(|seals| seals.states("file"))
    {
        return at.reject(
            format!("{name}: `sha256.file` does not include {file}, which contains numbers of this network"),
            "save the network in one file, in Python by `onnx.save_model(onnx.load(\"net.onnx\"), \"one.onnx\")`, \
             and write the SHA-256 of that file",
        );
    }
    let directory = std::path::Path::new(name).parent().unwrap_or(std::path::Path::new(""));
    let read = |file: String| {
        let beside = directory.join(&file);
        let help = "the ONNX file contains only a part of the network: copy this file from the same export \
                    into the directory of the ONNX file";
        Some((file, at.file(beside.to_str()?, help)?))
    };
    files.into_iter().map(read).collect()
}

fn is_onnx(name: &str) -> bool {
    has_extension(name, "onnx")
}

fn has_extension(name: &str, wanted: &str) -> bool {
    std::path::Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

/// Returns the calculation as text for the preview, with the effect of each signal. Every signal is assumed
/// to be in the middle of its range. A rise from a captured reference is assumed to be zero. `None` for
/// another kind of model.
fn preview(signals: &[Signal], kind: &Kind) -> Option<Computation> {
    let Kind::Network(network) = kind else { return None };
    let reads = network.reads();
    let formula =
        format!("Cz = {} of {} µm, over {}", network.net().what(), network.source(), rises(signals, reads));
    let rise = |input: &Input| match input.reference {
        Reference::Fixed(number) => middle(signals, input.signal) - number.get(),
        Reference::Start | Reference::Zero => 0.0,
    };
    let at: Vec<f64> = reads.iter().map(rise).collect();
    let before = network.net().output(&at);
    let one = |(place, input): (usize, &Input)| {
        let mut raised = at.clone();
        raised[place] += 1.0;
        let change = network.net().output(&raised) - before;
        let name = &signals[input.signal.0].name;
        let from = figure(middle(signals, input.signal));
        if change.is_finite() {
            let place = format!(" (from {from})");
            effect(signals, input.signal, change, &late(signals, input, &place))
        } else {
            format!("near {name} = {from} the output of the neural network is not a finite number")
        }
    };
    Some(Computation { formula, effects: reads.iter().enumerate().map(one).collect() })
}
