//! Finds and parses a template by its name. A template of the user takes precedence over a shipped one.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{Map, Value, json};

use super::channels::{Channel, of_group};
use super::group::{Group, text, texts};
use super::shipped;
use super::used::Template;
use crate::error::{Findings, allowed};
use crate::file_kind::FileKind;
use crate::files::Files;
use crate::schema_check::SchemaCheck;
use crate::schemas::Schemas;
use crate::source_map::SourceMap;
use crate::tables::signal::unit::Scaling;

/// Directory of the user's own templates, next to the profile.
pub(super) const DIRECTORY: &str = "devices";

/// Template as a device uses it: with the chosen variant, and with `base` added to the register numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Definition {
    /// Template for the preview, with title, source and notes. The signals and outputs that use the template are added
    /// later.
    pub(super) template: Template,
    /// Facts that were not verified, by the name of the group to which they belong.
    pub(super) unverified_of: BTreeMap<String, String>,
    pub(super) functions: Option<Value>,
    pub(super) quirks: Option<Value>,
    pub(super) channels: Vec<Channel>,
    pub(super) targets: Vec<Channel>,
    /// Groups of checks, by name, as the template file contains them.
    pub(super) checks: Vec<(String, Group)>,
    pub(super) set: Option<Value>,
    pub(super) heartbeat: Option<Value>,
    /// Path of the DBC file, relative to the profile.
    pub(super) dbc: Option<String>,
    /// Settings of a CANopen node in the template. `None` if the template has no such settings.
    pub(super) node: Option<Group>,
}

/// Error in the choice of a template, variant or base: the key of the device at which it is reported, message, and
/// hint.
pub(super) type Wrong = (&'static str, String, String);

/// Text of a template that was found, with its parsed content.
#[derive(Clone)]
pub(super) struct Written {
    pub(super) own_file: Option<String>,
    pub(super) text: Arc<str>,
    /// Parsed content. `None` if the file has mistakes, which have already been reported.
    pub(super) body: Option<Group>,
}

/// Finds the template with this name. Returns an error if the template does not exist or cannot be read.
pub(super) fn find(
    name: &str,
    (files, schemas): (&Files<'_>, &Schemas),
    errors: &mut Findings,
) -> Result<Written, Wrong> {
    let plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    let file = format!("{DIRECTORY}/{name}.toml");
    let own = if name.bytes().all(plain) { files.text(&file) } else { Ok(None) };
    let own = own.map_err(|why| {
        (
            "template",
            why,
            "check that the template is a TOML file in UTF-8 which this user may read".to_owned(),
        )
    })?;
    let own_file = own.is_some().then(|| files.path(&file));
    let Some(text) = own.map(Arc::<str>::from).or_else(|| shipped::text(name).map(Arc::from)) else {
        let mut known: Vec<String> = shipped::names().map(str::to_owned).collect();
        known.extend(files.names(DIRECTORY, ".toml"));
        known.sort();
        known.dedup();
        let help = format!(
            "{}; a template of your own must be in {} next to the profile",
            nearest_names(name, &known),
            format_args!("{DIRECTORY}/NAME.toml")
        );
        return Err(("template", format!("there is no device template `{name}`"), help));
    };
    let shown = own_file.clone().unwrap_or_else(|| format!("profiles/{file}"));
    let body = read(schemas.template(), (&shown, &text), errors);
    Ok(Written { own_file, text, body })
}

/// Builds a hint for an unknown template name. Users often abbreviate a model number. The suggestion is a name with the
/// same beginning, else the nearest word, else a name with the same number.
fn nearest_names(name: &str, known: &[String]) -> String {
    let bare = |text: &str| text.chars().filter(char::is_ascii_alphanumeric).collect::<String>();
    let digits = |text: &str| text.chars().filter(char::is_ascii_digit).collect::<String>();
    let wanted = bare(&name.to_lowercase());
    let alike = |known: &&String| !wanted.is_empty() && bare(known).starts_with(&wanted);
    let list = allowed(name, known.iter().map(String::as_str));
    let number = digits(name);
    let has_number = |known: &&String| number.len() > 2 && digits(known).contains(&number);
    let near = known.iter().find(alike);
    match near.or_else(|| known.iter().find(has_number).filter(|_| !list.starts_with("did"))) {
        Some(near) => format!("did you mean `{near}`? allowed: {}", known.join(", ")),
        None => list,
    }
}

fn read(schema: &Value, (shown, written): (&str, &str), errors: &mut Findings) -> Option<Group> {
    let mut spans = SourceMap::default();
    let layer = spans.add_layer(shown, Some(written));
    let mut found = Findings::default();
    let mut walk =
        SchemaCheck { schema, layer, spans: &mut spans, errors: &mut found, beside: Scaling::default() };
    let (table, _) = walk.parsed(written);
    let value = walk.table(schema, "", table);
    // Keys that a group omits may be set by the profile.
    walk.missing(&json!({ "required": schema.get("required") }), "", &value);
    if let (true, Value::Object(group)) = (found.is_empty(), value) {
        return Some(group);
    }
    // Of another kind of file, all keys would be reported as unknown.
    match FileKind::of(written.as_bytes()).and_then(|kind| kind.instead_of(FileKind::Template)) {
        Some(other) => errors.push(other.error(shown)),
        None => errors.append(found),
    }
    None
}

impl Definition {
    /// Creates the definition for a device with this variant. `base` is added to all register numbers.
    ///
    /// # Errors
    /// The variant or `base` does not fit the template.
    pub(super) fn of(
        name: &str,
        mut body: Group,
        variant: Option<&str>,
        base: Option<u16>,
    ) -> Result<Definition, Wrong> {
        let variants = match body.remove("variant") {
            Some(Value::Object(variants)) => variants,
            _ => Map::new(),
        };
        match (variant, variants.is_empty()) {
            (None, true) => {}
            (None, false) => {
                let message = format!("template `{name}` has variants: write the `variant` of this device");
                return Err(("template", message, format!("write variant = \"…\": {}", titles(&variants))));
            }
            (Some(_), true) => {
                let message = format!("template `{name}` has no variants");
                return Err(("variant", message, "remove `variant`".to_owned()));
            }
            (Some(word), false) => match variants.get(word) {
                Some(over) => lay(&mut body, over),
                None => {
                    let known = variants.keys().map(String::as_str);
                    let message = format!("template `{name}` has no variant `{word}`");
                    return Err(("variant", message, allowed(word, known)));
                }
            },
        }
        let movable = body.get("movable").and_then(Value::as_bool).unwrap_or(false);
        if base.is_some() && !movable {
            let message = format!("the registers of template `{name}` have fixed addresses");
            return Err(("base", message, "remove `base`".to_owned()));
        }
        let members = |table: &str| expanded(&body, table, base.unwrap_or(0));
        let one = |key: &str| {
            let only = Group::from_iter([("register".to_owned(), body.get(key)?.clone())]);
            of_group(key, &only, base.unwrap_or(0)).ok()?.pop()?.keys.remove("register")
        };
        let broken = |why: String| {
            ("template", format!("template `{name}`: {why}"), "correct the file of the template".to_owned())
        };
        let set = match body.get("set").and_then(Value::as_object) {
            Some(set) => {
                let set = of_group("set", set, base.unwrap_or(0)).map_err(broken)?.pop();
                set.map(|set| Value::Object(set.keys))
            }
            None => None,
        };
        let groups = |table: &str| -> Vec<(String, Group)> {
            groups(&body, table).map(|(name, group)| (name.clone(), group.clone())).collect()
        };
        let template = Template {
            name: name.to_owned(),
            variant: variant.map(str::to_owned),
            title: text(&body, "title").unwrap_or_default().to_owned(),
            source: text(&body, "source").unwrap_or_default().to_owned(),
            notes: texts(&body, "notes"),
            unverified: texts(&body, "unverified"),
            ..Template::default()
        };
        Ok(Definition {
            template,
            unverified_of: ["channel", "target"]
                .into_iter()
                .flat_map(groups)
                .filter_map(|(name, group)| Some((name, text(&group, "unverified")?.to_owned())))
                .collect(),
            functions: body.get("functions").cloned(),
            quirks: body.get("quirks").cloned(),
            channels: members("channel").map_err(broken)?,
            targets: members("target").map_err(broken)?,
            checks: groups("check"),
            heartbeat: one("heartbeat"),
            dbc: text(&body, "dbc").map(|file| format!("{DIRECTORY}/{file}")),
            node: body.get("node").and_then(Value::as_object).cloned(),
            set,
        })
    }
}

/// Merges a variant into its template. Tables are merged key by key.
fn lay(below: &mut Group, over: &Value) {
    for (key, value) in over.as_object().into_iter().flatten() {
        match (below.get_mut(key), value) {
            (Some(Value::Object(below)), Value::Object(_)) => lay(below, value),
            // The title of the variant does not replace that of the device.
            (Some(_), Value::String(_)) if key == "title" => {}
            _ => {
                below.insert(key.clone(), value.clone());
            }
        }
    }
}

fn titles(variants: &Map<String, Value>) -> String {
    let one = |(name, variant): (&String, &Value)| match variant.get("title").and_then(Value::as_str) {
        Some(title) => format!("{name} ({title})"),
        None => name.clone(),
    };
    variants.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn groups<'g>(body: &'g Group, table: &str) -> impl Iterator<Item = (&'g String, &'g Group)> {
    let groups = body.get(table).and_then(Value::as_object).into_iter().flatten();
    groups.filter_map(|(name, group)| Some((name, group.as_object()?)))
}

fn expanded(body: &Group, table: &str, base: u16) -> Result<Vec<Channel>, String> {
    let mut channels = Vec::new();
    for (name, group) in groups(body, table) {
        channels.extend(of_group(name, group, base).map_err(|why| format!("{table}.{name}: {why}"))?);
    }
    Ok(channels)
}
