//! The chapter of the fields of `/api/status`, from the doc comments of their structs.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::super::book::read;
use super::{anchor, cell, is_committed};

/// Files with the structs of the status.
const FILES: [&str; 7] = [
    "src/observe/status.rs",
    "src/observe/status/broker.rs",
    "src/observe/status/former_registers.rs",
    "src/observe/status/probe.rs",
    "src/observe/events/alarms.rs",
    "src/observe/events/journal.rs",
    "crates/profile/src/overridden_keys.rs",
];

/// Endings of the names of fields, and their units.
const UNITS: [(&str, &str); 4] = [("_um_per_s", "µm/s"), ("_um", "µm"), ("_ms", "ms"), ("_s", "s")];

/// Field of a struct.
struct Field {
    name: String,
    /// Type in Rust.
    kind: String,
    about: String,
    /// The fields of its type are fields of the struct.
    is_flat: bool,
    may_be_missing: bool,
}

type Structs = BTreeMap<String, Vec<Field>>;

#[test]
fn the_fields_of_the_status_are_what_their_comments_say() {
    is_committed("docs/status.md", &chapter());
}

fn chapter() -> String {
    let structs = structs();
    let mut text = "# The fields of the status\n\n\
        This chapter is made from the comments in `src/observe/status.rs`, and a test compares both: `TEST_WRITES_MANUAL=1 cargo test --features full --test verbs generated`.\n\
        It describes the answer of `GET /api/status` for [clients that may look](page.md#who-may-look-and-who-may-command).\n"
        .to_owned();
    let mut open = vec![(String::new(), "Status".to_owned())];
    let mut next = 0;
    while let Some((place, name)) = open.get(next).cloned() {
        let heading = if place.is_empty() { "The whole".to_owned() } else { format!("`{place}`") };
        write!(text, "\n## {heading}\n\n| field | is | unit | what |\n|---|---|---|---|\n").unwrap();
        rows(&structs[&name], &place, &structs, &mut open, &mut text);
        next += 1;
    }
    text
}

/// Writes the rows of a struct, and adds the structs to which they lead.
fn rows(
    fields: &[Field],
    place: &str,
    structs: &Structs,
    open: &mut Vec<(String, String)>,
    text: &mut String,
) {
    for Field { name, kind, about, is_flat, may_be_missing } in fields {
        if *is_flat && let Some(inner) = structs.get(kind) {
            rows(inner, place, structs, open, text);
            continue;
        }
        let path = if place.is_empty() { name.clone() } else { format!("{place}.{name}") };
        let is = json(kind, &path, structs, open);
        let is = if *may_be_missing { format!("{is}; may be missing") } else { is };
        let unit = UNITS.iter().find(|(ending, _)| name.ends_with(ending)).map_or("", |(_, unit)| *unit);
        writeln!(text, "| `{name}` | {is} | {unit} | {} |", cell(about)).unwrap();
    }
}

/// Type of a field in JSON. A struct is a link to its section.
fn json(kind: &str, path: &str, structs: &Structs, open: &mut Vec<(String, String)>) -> String {
    let inside = |outer: &str| kind.strip_prefix(outer).and_then(|rest| rest.strip_suffix('>'));
    if let Some(inner) = inside("Option<") {
        return format!("{} or null", json(inner, path, structs, open));
    }
    if let Some(inner) = inside("Vec<") {
        return format!("list of {}", json(inner, &format!("{path}[]"), structs, open));
    }
    if let Some((_, inner)) = inside("BTreeMap<").and_then(|types| types.split_once(", ")) {
        return format!("by name: {}", json(inner, &format!("{path}.NAME"), structs, open));
    }
    if let Some(items) = kind.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) {
        let items: Vec<String> = items.split(", ").map(|item| json(item, path, structs, open)).collect();
        return format!("[{}]", items.join(", "));
    }
    if structs.contains_key(kind) {
        let known = open.iter().find(|(_, name)| name == kind).map(|(place, _)| place.clone());
        let place = known.unwrap_or_else(|| {
            open.push((path.to_owned(), kind.to_owned()));
            path.to_owned()
        });
        return format!("[`{place}`](#{})", anchor(&place));
    }
    let is = match kind {
        "bool" => "`true`, `false`",
        "f64" => "number",
        "u8" | "u32" | "u64" | "usize" => "whole number",
        "serde_json::Value" => "any value",
        _ => "text",
    };
    is.to_owned()
}

/// Structs of the files, by name.
fn structs() -> Structs {
    let texts = FILES.map(read);
    let all = texts.iter().flat_map(|text| text.split("\npub struct ").skip(1));
    let all = all.filter_map(|rest| rest.split_once(" {\n"));
    let all = all.filter(|(name, _)| name.chars().all(char::is_alphanumeric));
    all.map(|(name, body)| (name.to_owned(), fields(body.split("\n}").next().unwrap_or_default()))).collect()
}

fn fields(body: &str) -> Vec<Field> {
    let mut found = Vec::new();
    let (mut about, mut attributes) = (Vec::new(), String::new());
    for line in body.lines().map(str::trim) {
        if let Some(said) = line.strip_prefix("/// ") {
            about.push(said);
        } else if line.starts_with("#[") {
            attributes.push_str(line);
        } else {
            let field = line.strip_prefix("pub ").and_then(|field| field.split_once(": "));
            if let Some((name, kind)) = field.filter(|_| !attributes.contains("serde(skip)")) {
                found.push(Field {
                    name: name.to_owned(),
                    kind: kind.trim_end_matches(',').to_owned(),
                    about: about.join(" ").replace("`None`", "null"),
                    is_flat: attributes.contains("flatten"),
                    may_be_missing: attributes.contains("skip_serializing_if"),
                });
            }
            (about, attributes) = (Vec::new(), String::new());
        }
    }
    found
}
