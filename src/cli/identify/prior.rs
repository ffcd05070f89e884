//! `--prior MODEL.toml`: reads the terms of an existing model, from a file that `--write` wrote or from a profile. A
//! term is a signal with its gain, and optionally with a lag.

use std::path::Path;

use anyhow::{Context, anyhow};
use serde::Deserialize;

use crate::cli::loading::of_other_kind;
use isotherm_identify::method::PriorTerm;
use isotherm_profile::FileKind;

#[derive(Deserialize)]
struct File {
    axis: std::collections::BTreeMap<String, Axis>,
}

#[derive(Deserialize)]
struct Axis {
    #[serde(default)]
    model: Vec<Model>,
}

#[derive(Deserialize)]
struct Model {
    #[serde(default)]
    terms: Vec<Term>,
}

#[derive(Deserialize)]
struct Term {
    signal: String,
    gain: f64,
    lag: Option<String>,
    power: Option<u8>,
}

/// Reads the terms of the first model of this axis that has terms. A file without such a model is an error.
pub(super) fn terms(path: &Path, axis: &str) -> anyhow::Result<Vec<PriorTerm>> {
    let shown = path.display();
    let text = std::fs::read_to_string(path).with_context(|| format!("{shown} cannot be read"))?;
    let file: File = toml::from_str(&text).map_err(|why| {
        let why = anyhow!(
            "{shown} cannot be read as TOML with [[axis.{axis}.model]] and terms of `signal` and `gain`: \
                 {why}"
        );
        of_other_kind(path, FileKind::ModelBlock, why)
    })?;
    let found = file.axis.get(axis).and_then(|axis| axis.model.iter().find(|model| !model.terms.is_empty()));
    let model = found.ok_or_else(|| {
        let why = anyhow!(
            "{shown} has no linear model of axis {axis}; --prior needs a model that `isotherm identify \
             --write` wrote"
        );
        of_other_kind(path, FileKind::ModelBlock, why)
    })?;
    let term = |term: &Term| {
        let lag = term.lag.as_deref().map(humantime::parse_duration).transpose();
        let lag = lag.with_context(|| format!("{shown}: the lag of {} is not a duration", term.signal))?;
        let lag = lag.filter(|lag| !lag.is_zero());
        let squared = term.power == Some(2);
        Ok(PriorTerm { signal: term.signal.clone(), lag, squared, gain: term.gain })
    };
    model.terms.iter().map(term).collect()
}
