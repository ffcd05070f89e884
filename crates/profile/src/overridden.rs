//! What the layers above a profile set: reported wherever the gateway says how it is set, and never a guard that is looser
//! than the profile's own.

use std::collections::BTreeSet;
use std::fmt;

use serde::Serialize;
use serde_json::{Map, Value};

use crate::error::ProfileError;
use crate::span::{Spans, child};
use crate::unseen::veiled;

/// The keys of an axis that a layer above the profile may only make smaller.
const SMALLER: [&str; 3] = ["limit", "step", "rate"];
/// The one that no layer above the profile changes.
const ON_FAULT: &str = "on_fault";
/// A value that is longer is shown by its beginning: the layer has the rest.
const LONGEST: usize = 80;

/// A key that a layer above the profile has set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Overridden {
    /// Its path: `axis.z.limit`. Of a table that the profile does not have, the table's.
    pub key: String,
    /// Its value in the profile; `None` where that does not have it.
    pub profile: Option<String>,
    /// Its value now.
    pub now: String,
    /// The file with its line, `environment ISOTHERM__…`, or `--set key`.
    pub from: String,
}

impl fmt::Display for Overridden {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Overridden { key, profile, now, from } = self;
        match profile {
            Some(profile) => write!(f, "{key} = {now} instead of the profile's {profile}, from {from}"),
            None => write!(f, "{key} = {now}, which the profile does not have, from {from}"),
        }
    }
}

/// The guard keys of these axes.
pub(crate) fn guard_keys(axes: &[String]) -> Vec<String> {
    let of_axis = |name: &String| {
        let axis = child("axis", name);
        SMALLER.into_iter().chain([ON_FAULT]).map(move |key| child(&axis, key))
    };
    axes.iter().flat_map(of_axis).chain(["machine.arm".to_owned()]).collect()
}

/// The layers above a profile.
pub(crate) struct Above<'a> {
    pub(crate) profile: &'a Value,
    pub(crate) layers: &'a [Value],
    /// So many of them are files, which come first.
    pub(crate) files: usize,
    pub(crate) merged: &'a Value,
    pub(crate) spans: &'a Spans,
}

impl Above<'_> {
    /// Every key that they set, by its path.
    pub(crate) fn list(&self) -> Vec<Overridden> {
        let mut found = BTreeSet::new();
        for (place, layer) in self.layers.iter().enumerate() {
            let is_file = place < self.files;
            gather(&mut Vec::new(), Some(self.profile), layer, is_file, &mut found);
        }
        let overridden = |keys: Vec<String>| {
            let path = keys.iter().fold(String::new(), |path, key| child(&path, key));
            let from = self.spans.line_of(&path);
            let now = at(self.merged, &keys).map(short).unwrap_or_default();
            Overridden { key: path, profile: at(self.profile, &keys).map(short), now, from }
        };
        found.into_iter().map(overridden).collect()
    }
}

/// The keys of a layer. A whole table of a file that the profile does not have counts as one.
fn gather(
    keys: &mut Vec<String>,
    profile: Option<&Value>,
    layer: &Value,
    is_file: bool,
    found: &mut BTreeSet<Vec<String>>,
) {
    let table = layer.as_object().filter(|_| profile.is_some_and(Value::is_object) || !is_file);
    let Some(table) = table else {
        found.insert(keys.clone());
        return;
    };
    for (key, value) in table {
        keys.push(key.clone());
        gather(keys, profile.and_then(|profile| profile.get(key)), value, is_file, found);
        keys.pop();
    }
}

fn at<'v>(value: &'v Value, keys: &[String]) -> Option<&'v Value> {
    keys.iter().try_fold(value, |value, key| value.get(key))
}

fn short(value: &Value) -> String {
    let text = value.to_string();
    let text = veiled(&text).into_owned();
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

/// The guard keys that this layer sets looser than the profile, unless the profile itself allows it.
pub(crate) fn loosened(profile: &Value, layer: &Value, spans: &Spans) -> Vec<ProfileError> {
    let allowed: Vec<&str> = profile
        .pointer("/machine/allow_override")
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let mut guards = Guards { spans, allowed, errors: Vec::new() };
    for (name, axis) in layer.get("axis").and_then(Value::as_object).into_iter().flatten() {
        let (path, own) = (child("axis", name), profile.get("axis").and_then(|axes| axes.get(name)));
        let own = |key: &str| own.and_then(|own| own.get(key));
        for key in SMALLER {
            if let Some(value) = axis.get(key) {
                guards.smaller(&child(&path, key), own(key), value);
            }
        }
        if let Some(value) = axis.get(ON_FAULT).and_then(Value::as_object) {
            guards.same(&child(&path, ON_FAULT), own(ON_FAULT), value);
        }
    }
    guards.machine(profile.get("machine"), layer.get("machine"));
    guards.errors
}

struct Guards<'a> {
    spans: &'a Spans,
    allowed: Vec<&'a str>,
    errors: Vec<ProfileError>,
}

impl Guards<'_> {
    fn smaller(&mut self, path: &str, profile: Option<&Value>, value: &Value) {
        let Some(own) = profile else { return self.absent(path, path) };
        let is_smaller = own.as_f64().zip(value.as_f64()).is_some_and(|(own, new)| new <= own);
        if !is_smaller {
            let why = format!("{value} is more than the {own} of the profile, and may only be less here");
            self.refuse(path, path, why, &format!("write at most {own}"));
        }
    }

    fn same(&mut self, path: &str, profile: Option<&Value>, table: &Map<String, Value>) {
        for (key, value) in table {
            let inner = child(path, key);
            match profile.and_then(|profile| profile.get(key)) {
                Some(own) if own == value => {}
                Some(own) => {
                    let why = format!(
                        "{value} is not the {own} of the profile, which alone says what a fault does"
                    );
                    self.refuse(path, &inner, why, "remove it here");
                }
                None => self.absent(path, &inner),
            }
        }
    }

    fn machine(&mut self, profile: Option<&Value>, layer: Option<&Value>) {
        let Some(layer) = layer else { return };
        let is = |machine: &Value, word: &str| machine.get("arm").is_some_and(|arm| arm == word);
        if is(layer, "auto") && profile.is_some_and(|profile| is(profile, "manual")) {
            let why = "the profile says \"manual\": no layer above it lets axes arm by themselves".to_owned();
            self.refuse("machine.arm", "machine.arm", why, "remove it here");
        }
        if layer.get("allow_override").is_some() {
            let why = "what may be loosened is said by the profile itself, by no layer above it";
            let help = "write it into the profile, or remove it here".to_owned();
            self.errors.push(self.spans.at_key("machine.allow_override", why, Some(help)));
        }
    }

    fn absent(&mut self, guard: &str, path: &str) {
        // What is written there and wrong has been reported.
        if self.spans.rank(path).0 > 0 {
            let why =
                format!("the profile has no `{path}`, and a guard that is not there cannot be tightened");
            self.refuse(guard, path, why, "write it into the profile");
        }
    }

    fn refuse(&mut self, guard: &str, path: &str, why: String, remedy: &str) {
        if !self.allowed.contains(&guard) {
            let help =
                format!("{remedy}; or have the profile allow it: [machine] allow_override = [\"{guard}\"]");
            self.errors.push(self.spans.at_value(path, why, Some(help)));
        }
    }
}
