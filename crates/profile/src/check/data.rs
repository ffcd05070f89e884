//! Models whose numbers are in a file, and envelopes: what the file says is fitted to the profile's signals.

use super::model::reference;
use super::{Check, Signals, get};
use crate::data::envelope::EnvelopeFile;
use crate::data::matrix::MatrixFile;
use crate::data::{misfit, network};
use crate::error::allowed;
use crate::place::{child, element};
use crate::raw::{Carries, Component, InputValue, Inputs, OutsideWord, RawModel};
use isotherm_core::compensation::model::envelope::Identified;
use isotherm_core::compensation::model::network::Net;
use isotherm_core::compensation::model::{Envelope, Input, Matrix, Model, Network, Outside, Reference};
use isotherm_core::quantity::Celsius;

/// 1 mm in µm.
const MICRONS: f64 = 1000.0;

impl Check<'_> {
    pub(super) fn matrix(&mut self, path: &str, raw: &RawModel, signals: &Signals) -> Option<Matrix> {
        let needs = [
            (
                "inputs",
                raw.inputs.is_some(),
                "write inputs = [ … ], the signal of each block in the file's order",
            ),
            ("file", raw.file.is_some(), "write file = \"column.json\", a matrix beside the profile"),
            ("position", raw.position.is_some(), "name the signal that tells where the axis is, in mm"),
            (
                "component",
                raw.component.is_some(),
                "write which displacement acts along the axis: \"x\", \"y\", \"z\" or \"-x\", …",
            ),
            ("carries", raw.carries.is_some(), "write what the guideway carries: \"tool\" or \"work\""),
        ];
        for (key, there, help) in needs {
            if !there {
                self.missing(path, key, format!("`{key}` is missing: a matrix needs it"), help);
            }
        }
        let position = raw.position.as_ref().and_then(|name| {
            let at = child(path, "position");
            let position = self.signal(&at, name)?;
            self.in_millimetres(&at, name, get(signals, position.0));
            Some(position)
        });
        let inputs = self.data_inputs(path, raw, None);
        let name = raw.file.as_deref()?;
        let at = child(path, "file");
        let bytes = self.data(&at, name)?;
        let file = self.taken(&at, name, MatrixFile::parse(&bytes))?;
        let (inputs, names) = inputs?;
        self.matches(&at, name, misfit("blocks", &file.blocks, &names))?;
        let (component, along) = match raw.component? {
            Component::X => (0, 1.0),
            Component::Y => (1, 1.0),
            Component::Z => (2, 1.0),
            Component::MinusX => (0, -1.0),
            Component::MinusY => (1, -1.0),
            Component::MinusZ => (2, -1.0),
        };
        // Cz = −e, and a displaced tool is an error of the same sign, displaced work one of the other.
        let acts = match raw.carries? {
            Carries::Tool => -1.0,
            Carries::Work => 1.0,
        };
        let gains = file.component(component, MICRONS * along * acts);
        let position = position?;
        let matrix = quantities(file.guide_mm)
            .and_then(|guide| Ok((guide, quantities(gains)?)))
            .and_then(|(guide, gains)| Matrix::new(name, inputs, position, guide, gains));
        self.taken(&at, name, matrix)
    }

    pub(super) fn network(&mut self, path: &str, raw: &RawModel) -> Option<Network> {
        if raw.inputs.is_none() {
            let help = "write inputs = [ … ], the signals in the network's order";
            self.missing(path, "inputs", "`inputs` is missing: a network needs them", help);
        }
        if raw.file.is_none() {
            let help =
                "write file = \"spindle.onnx\", or a .json of the project's own format, beside the profile";
            self.missing(path, "file", "`file` is missing: a network needs it", help);
        }
        let inputs = self.data_inputs(path, raw, Some(Reference::Fixed(Celsius::ZERO)));
        let name = raw.file.as_deref()?;
        let at = child(path, "file");
        let bytes = self.data(&at, name)?;
        let (inputs, names) = inputs?;
        let (net, own) = self.taken(&at, name, net(name, bytes, inputs.len()))?;
        let misfit = match own {
            Some(own) => misfit("inputs", &own, &names),
            None if net.takes() != inputs.len() => Some(format!(
                "it takes {} inputs, the model names {}: {}",
                net.takes(),
                inputs.len(),
                names.join(", ")
            )),
            None => None,
        };
        self.matches(&at, name, misfit)?;
        self.taken(&at, name, Network::new(name, net, inputs))
    }

    /// The envelope of a model, `Some(None)` where it has none. `model` is the rest of it, if that is right.
    pub(super) fn envelope(
        &mut self,
        path: &str,
        raw: &RawModel,
        model: Option<&Model>,
    ) -> Option<Option<Envelope>> {
        let Some(name) = raw.envelope.as_deref() else {
            if raw.outside.is_some() && !self.places.contains(&child(path, "envelope")) {
                let help = "name the file with `envelope`, or remove `outside`";
                self.wrong_key(&child(path, "outside"), "there is no envelope to be outside of", help);
            }
            return Some(None);
        };
        if raw.outside.is_none() {
            let help = "write outside = \"warn\" (follow the model all the same), \"hold\" (keep Cz) or \"shrink\" (follow it less and less)";
            self.missing(
                path,
                "outside",
                "`outside` is missing: what does the axis do outside its envelope?",
                help,
            );
        }
        let at = child(path, "envelope");
        let bytes = self.data(&at, name)?;
        let file = self.taken(&at, name, EnvelopeFile::parse(&bytes))?;
        let reads = model?.signals();
        let mut known = Vec::new();
        for input in &file.inputs {
            let signal = reads.iter().copied().find(|id| self.signals.names[id.0] == input.signal);
            let Some(signal) = signal else {
                let help = allowed(&input.signal, reads.iter().map(|id| self.signals.names[id.0].as_str()));
                self.wrong(&at, format!("{name}: the model does not read `{}`", input.signal), help);
                return None;
            };
            let reference = input.reference.map_or(Some(Reference::Fixed(Celsius::ZERO)), reference)?;
            let input_of = Input { signal, reference, lag: None };
            known.push(Identified { input: input_of, mean: input.mean, range: (input.min, input.max) });
        }
        let outside = match raw.outside? {
            OutsideWord::Warn => Outside::Warn,
            OutsideWord::Hold => Outside::Hold,
            OutsideWord::Shrink => Outside::Shrink,
        };
        let envelope = Envelope::new(known, &file.covariance, file.reach, outside);
        self.taken(&at, name, envelope.map_err(|wrong| file.why(wrong))).map(Some)
    }

    /// The inputs in their order, with their names. Without a default, each needs a reference.
    fn data_inputs<'r>(
        &mut self,
        path: &str,
        raw: &'r RawModel,
        default: Option<Reference>,
    ) -> Option<(Vec<Input>, Vec<&'r str>)> {
        let list = child(path, "inputs");
        let inputs = match raw.inputs.as_ref()? {
            Inputs::InOrder(inputs) => inputs,
            Inputs::ByName(_) => {
                let help = "write inputs = [ \"bed\", \"column\" ]: their order is that of the file";
                self.wrong(&list, "signals by name have no order", help);
                return None;
            }
        };
        if inputs.is_empty() {
            self.wrong(&list, "a model without inputs follows no temperature", "name at least one signal");
            return None;
        }
        let of_model = raw.reference.and_then(reference).or(default);
        let (mut found, mut names, mut bare) = (Vec::new(), Vec::new(), false);
        for (place, input) in inputs.iter().enumerate() {
            let at = element(&list, place);
            let (name, own, lag) = match input {
                InputValue::Name(name) => (Some(name), None, None),
                InputValue::Table(table) => (table.signal.as_ref(), table.reference, table.lag.as_ref()),
            };
            // Where there is no default, a missing reference is told once for all inputs.
            let referred = default.is_none()
                || own.or(raw.reference).is_some()
                || self.places.contains(&child(path, "reference"));
            let lag = lag.map(|lag| self.lag(&at, lag, referred));
            let Some(name) = name else { continue };
            names.push(name.as_str());
            let signal = self.signal(&at, name);
            let reference = own.and_then(reference).or(of_model);
            bare |= reference.is_none();
            if lag == Some(None) {
                continue;
            }
            let lag = lag.flatten();
            found.extend(signal.zip(reference).map(|(signal, reference)| Input { signal, reference, lag }));
        }
        if bare {
            let help = "write what the rises are measured from: a number in °C, \"start\" or \"zero\"";
            self.missing(path, "reference", "`reference` is missing: a matrix is about rises", help);
        }
        (found.len() == inputs.len()).then_some((found, names))
    }

    fn data(&mut self, path: &str, name: &str) -> Option<Vec<u8>> {
        match self.files.read(name) {
            Ok(bytes) => Some(bytes),
            Err(why) => {
                self.wrong(path, why, "a file is looked for relative to the profile's directory");
                None
            }
        }
    }

    fn taken<T>(&mut self, path: &str, name: &str, result: Result<T, String>) -> Option<T> {
        result
            .map_err(|why| self.errors.push(self.places.at_value(path, format!("{name}: {why}"), None)))
            .ok()
    }

    fn matches(&mut self, path: &str, name: &str, misfit: Option<String>) -> Option<()> {
        self.taken(path, name, misfit.map_or(Ok(()), Err))
    }
}

#[cfg(feature = "onnx")]
fn net(name: &str, bytes: Vec<u8>, inputs: usize) -> Result<(Net, Option<Vec<String>>), String> {
    use isotherm_core::compensation::model::network::Onnx;
    if is_onnx(name) { Ok((Net::Onnx(Onnx::new(bytes, inputs)?), None)) } else { network::parse(&bytes) }
}

#[cfg(not(feature = "onnx"))]
fn net(name: &str, bytes: Vec<u8>, _: usize) -> Result<(Net, Option<Vec<String>>), String> {
    if is_onnx(name) {
        return Err("this program was built without ONNX (the feature `onnx`)".to_owned());
    }
    network::parse(&bytes)
}

fn is_onnx(name: &str) -> bool {
    std::path::Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("onnx"))
}

/// Numbers of a file with their unit.
fn quantities<Q: TryFrom<f64, Error = &'static str>>(numbers: Vec<f64>) -> Result<Vec<Q>, String> {
    numbers.into_iter().map(Q::try_from).collect::<Result<_, _>>().map_err(str::to_owned)
}
