//! Generated chapters: every key of a profile from its schema, every template from its file, every event from the
//! catalogue, every field of the status from its comment.

use std::fmt::Write;

use isotherm_core::display::Display;
use isotherm_core::events::{EventKind, Level};
use isotherm_profile::{ALARM, ALARM_OVER, schema, template};
use serde_json::Value;

use super::book::{read, root};

mod status;

/// Place of the profile itself.
const WHOLE: &str = "";

/// Environment variable that makes the tests write the chapters.
const ANEW: &str = "TEST_WRITES_MANUAL";

/// Asserts that the committed chapter equals the generated one. With `TEST_WRITES_MANUAL=1` it writes the chapter.
#[track_caller]
fn is_committed(path: &str, generated: &str) {
    if std::env::var_os(ANEW).is_some() {
        std::fs::write(root().join(path), generated).unwrap();
    }
    let committed = std::fs::read_to_string(root().join(path)).unwrap_or_default();
    let differs = committed.lines().zip(generated.lines()).position(|(is, should)| is != should);
    let line = differs.unwrap_or_else(|| committed.lines().count().min(generated.lines().count())) + 1;
    assert!(
        committed == generated,
        "{path} is not what it is generated from, from line {line} on; write it again: {ANEW}=1 cargo test --features full --test verbs generated"
    );
}

#[test]
fn the_reference_of_the_profile_is_what_the_schema_says() {
    is_committed("docs/profile.md", &profile());
}

#[test]
fn no_key_of_the_schema_is_missing_from_the_reference() {
    let text = profile();
    let mut count = 0;
    for (name, table) in tables() {
        let section =
            text.split(&format!("\n## {}\n", heading(&name))).nth(1).unwrap_or_else(|| panic!("no {name}"));
        let section = section.split("\n## ").next().unwrap();
        for key in table["properties"].as_object().unwrap().keys() {
            let rows = [format!("\n| `{key}` "), format!("\n| **`{key}`** ")];
            assert!(rows.iter().any(|row| section.contains(row)), "{name} lacks {key}");
            count += 1;
        }
    }
    // The schema itself is counted: every object with properties, at any place.
    assert_eq!(count, properties(schema()));
}

/// Number of keys in the whole schema.
fn properties(value: &Value) -> usize {
    match value {
        Value::Object(object) => object.iter().fold(0, |sum, (key, inner)| match inner {
            Value::Object(keys) if key == "properties" => {
                sum + keys.len() + keys.values().map(properties).sum::<usize>()
            }
            inner => sum + properties(inner),
        }),
        Value::Array(items) => items.iter().map(properties).sum(),
        _ => 0,
    }
}

/// Name and content of a definition that has its own heading in the reference: `#output`.
fn definition(value: &Value) -> Option<(&str, &'static Value)> {
    let name = value["$ref"].as_str()?.strip_prefix("#/$defs/")?;
    let found = schema()["$defs"].get(name).unwrap_or_else(|| panic!("no {name}"));
    Some((name, found))
}

/// Every table with keys of its own, with its place in a profile. The profile itself comes first.
fn tables() -> Vec<(String, &'static Value)> {
    let mut found: Vec<(String, &Value)> = vec![(WHOLE.to_owned(), schema())];
    let mut seen = Vec::new();
    let mut next = 0;
    while next < found.len() {
        let (place, table) = found[next].clone();
        next += 1;
        let inside = if place == WHOLE { String::new() } else { format!("{place}.") };
        for (key, value) in table["properties"].as_object().into_iter().flatten() {
            leads_to(&format!("{inside}{key}"), value, &mut seen, &mut found);
        }
    }
    found
}

fn leads_to(
    place: &str,
    value: &'static Value,
    seen: &mut Vec<&'static Value>,
    found: &mut Vec<(String, &'static Value)>,
) {
    if let Some((_, defined)) = definition(value) {
        // A definition is described once, at its first place.
        if !seen.iter().any(|known| std::ptr::eq(*known, defined)) {
            seen.push(defined);
            leads_to(place, defined, seen, found);
        }
    } else if value.get("properties").is_some() {
        found.push((place.to_owned(), value));
    } else if value["additionalProperties"].is_object() {
        leads_to(&format!("{place}.NAME"), &value["additionalProperties"], seen, found);
    } else if value["items"].is_object() {
        leads_to(&format!("{place}[]"), &value["items"], seen, found);
    } else {
        for choice in value["anyOf"].as_array().into_iter().flatten() {
            leads_to(place, choice, seen, found);
        }
    }
}

fn heading(place: &str) -> String {
    if place == WHOLE { "The tables".to_owned() } else { format!("`{place}`") }
}

fn profile() -> String {
    let mut text = "# The profile: every key\n\n\
        This chapter is made from the schema (`isotherm schema`), and a test compares both: change the key's comment in\n\
        `crates/profile/src/tables`, then `TEST_WRITES_MANUAL=1 cargo test --features full --test verbs generated`. Keys in bold must be there. A [layer](settings.md)\n\
        does not change a key with ◆, or only makes it tighter, unless `allow_override` names it. A duration is\n\
        a text as \"250ms\", \"5s\" or \"10min\". What the keys are for, with examples, is in the chapters on [lines](serial.md),\n\
        [CAN](can.md), [models](models.md), [probing](probing.md), [the control](control.md) and [the page](page.md).\n"
        .to_owned();
    let tables = tables();
    let place_of = |wanted: &Value| {
        tables.iter().find(|(_, table)| std::ptr::eq(*table, wanted)).map(|(place, _)| place.clone())
    };
    for (place, table) in &tables {
        let says = table["description"].as_str().unwrap_or_default();
        writeln!(text, "\n## {}\n", heading(place)).unwrap();
        if !says.is_empty() && place != WHOLE {
            writeln!(text, "{}\n", cell(says)).unwrap();
        }
        text.push_str("| key | is | what |\n|---|---|---|\n");
        let required: Vec<&str> =
            table["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        for (key, value) in table["properties"].as_object().unwrap() {
            let shown =
                if required.contains(&key.as_str()) { format!("**`{key}`**") } else { format!("`{key}`") };
            let rule = value.get("x-layers").or(table.get("x-layers")).filter(|rule| *rule != "free");
            let shown = if rule.is_some() { format!("{shown} ◆") } else { shown };
            let about =
                value["description"].as_str().or_else(|| definition(value)?.1["description"].as_str());
            let about = cell(about.unwrap_or_default());
            writeln!(text, "| {shown} | {} | {about} |", kind(value, &place_of)).unwrap();
        }
    }
    text
}

/// A description on one line of a table.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

/// Type of a value: `text`, `number`, `"a"` or `"b"`, a list, or a link to another table.
fn kind(value: &Value, place_of: &dyn Fn(&Value) -> Option<String>) -> String {
    if let Some((name, defined)) = definition(value) {
        return match name {
            "Duration" => "duration".to_owned(),
            "Size" => "size".to_owned(),
            _ => kind(defined, place_of),
        };
    }
    if let Some(place) = place_of(value) {
        return format!("[`{place}`](#{})", anchor(&place));
    }
    if let Some(words) = value["enum"].as_array() {
        let words: Vec<String> = words.iter().map(|word| format!("`{word}`")).collect();
        return words.join(", ");
    }
    if let Some(choices) = value["anyOf"].as_array() {
        let mut kinds: Vec<String> = choices.iter().map(|choice| kind(choice, place_of)).collect();
        kinds.dedup();
        return kinds.join(" or ");
    }
    if value["pattern"].is_string() && value["pattern"] == schema()["$defs"]["Duration"]["pattern"] {
        return "duration".to_owned();
    }
    match value["type"].as_str() {
        Some("string") => "text".to_owned(),
        Some("integer") => "whole number".to_owned(),
        Some("number") => "number".to_owned(),
        Some("boolean") => "`true`, `false`".to_owned(),
        Some("array") if value["items"].is_object() => {
            format!("list of {}", kind(&value["items"], place_of))
        }
        Some("array") => "list".to_owned(),
        Some("object") if value["additionalProperties"].is_object() => {
            format!("by name: {}", kind(&value["additionalProperties"], place_of))
        }
        Some("object") => "table".to_owned(),
        _ => match value["type"].as_array() {
            Some(types) => {
                let types = types.iter().map(|one| kind(&serde_json::json!({ "type": one }), place_of));
                types.collect::<Vec<_>>().join(" or ")
            }
            None => "any value".to_owned(),
        },
    }
}

/// Anchor of a heading in GitHub and mdBook.
pub(crate) fn anchor(heading: &str) -> String {
    let heading = heading.to_lowercase();
    let kept = heading.chars().filter_map(|c| match c {
        ' ' => Some('-'),
        c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
        _ => None,
    });
    kept.collect()
}

#[test]
fn the_table_of_templates_is_what_their_files_say() {
    is_committed("docs/template-list.md", &templates());
}

fn templates() -> String {
    let mut names: Vec<&str> = template::names().collect();
    names.sort_unstable();
    let file = |name: &str| read(format!("profiles/devices/{name}.toml"));
    let read = |name: &str| -> toml::Table { file(name).parse().unwrap() };
    let mut text = "# The shipped device templates\n\n\
        This chapter is made from `profiles/devices`, and a test compares both: `TEST_WRITES_MANUAL=1 cargo test --features full --test verbs generated`.\n\
        How a profile uses them is in [device templates](templates.md). None has been tried on its device by us.\n\n\
        | template | what it is | line | the profile says |\n|---|---|---|---|\n"
        .to_owned();
    for name in &names {
        let template = read(name);
        let line = line(&template);
        let title = template["title"].as_str().unwrap();
        writeln!(text, "| [`{name}`](#{name}) | {} | {line} | {} |", cell(title), asks(&template)).unwrap();
    }
    for name in &names {
        let template = read(name);
        writeln!(text, "\n## `{name}`\n\n{}\n", template["title"].as_str().unwrap()).unwrap();
        text.push_str(&heading_comment(&file(name)));
        for (what, key) in [("channels", "channel"), ("outputs", "target")] {
            let groups = template.get(key).and_then(toml::Value::as_table).into_iter().flatten();
            let groups: Vec<String> = groups.map(|(name, group)| channels(name, group)).collect();
            if !groups.is_empty() {
                writeln!(text, "- **{what}**: {}", groups.join(", ")).unwrap();
            }
        }
        writeln!(text, "- **after**: {}", template["source"].as_str().unwrap()).unwrap();
        for (what, key) in [("note", "notes"), ("not verified", "unverified")] {
            for said in template.get(key).and_then(toml::Value::as_array).into_iter().flatten() {
                writeln!(text, "- **{what}**: {}", said.as_str().unwrap()).unwrap();
            }
        }
    }
    text
}

#[test]
fn the_table_of_events_is_what_the_catalogue_says() {
    is_committed("docs/events.md", &events());
}

fn events() -> String {
    let mut text = "# The events\n\n\
        This chapter is made from `crates/core/src/events.rs`, and a test compares both: `TEST_WRITES_MANUAL=1 cargo test --features full --test verbs generated`.\n\
        [Commands and events](commands.md#events) describes where to read events, and the data of an event.\n\n\
        - **level**: an event with two levels has the second one if it reports no trouble.\n\
        - **until**: the event raises an [alarm](page.md#alarms), and these events end it. An event `axis-state` without trouble ends the one before.\n\
        - **`on`**: words of [`[[notify]]`](notify.md) that post the event, in addition to its name. `axis-off` posts `axis-state` if the axis does not follow a model any more.\n\
        - **what to do**: the hint, unless the cause of the event has its own. Names in capitals are fields of the event's data.\n\n\
        | event | level | until | `on` | meaning | what to do |\n|---|---|---|---|---|---|\n"
        .to_owned();
    let mut kinds = EventKind::ALL;
    kinds.sort_unstable_by_key(|kind| kind.name());
    for kind in kinds {
        let level = match kind.level() {
            Level::Info => "info",
            Level::Warning => "warning",
            Level::Error => "error",
        };
        let level = if kind.may_be_info() { format!("{level}, info") } else { level.to_owned() };
        let until: Vec<String> = kind.ended_by().map(|end| format!("`{}`", end.name())).collect();
        let until = match kind.raises() {
            Some(_) if until.is_empty() => "the next start".to_owned(),
            _ => until.join(", "),
        };
        let alarm = kind.raises().map(|_| ALARM);
        let alarm_over = kind.ends().first().map(|_| ALARM_OVER);
        let words: Vec<String> =
            [alarm, alarm_over, kind.word()].into_iter().flatten().map(|word| format!("`{word}`")).collect();
        let hint = kind.hint().unwrap_or_default().split(['{', '}']).enumerate();
        let hint: String = hint
            .map(|(place, part)| if place % 2 == 0 { part.to_owned() } else { part.to_uppercase() })
            .collect();
        writeln!(
            text,
            "| `{}` | {level} | {until} | {} | {} | {} |",
            kind.name(),
            words.join(", "),
            cell(kind.meaning()),
            cell(&hint)
        )
        .unwrap();
    }
    text
}

/// Comment at the top of a template's file: sentences, or a layout with columns.
fn heading_comment(file: &str) -> String {
    let lines = file.lines().take_while(|line| line.starts_with('#'));
    let lines: Vec<&str> = lines.map(|line| line[1..].strip_prefix(' ').unwrap_or(&line[1..])).collect();
    match lines.join("\n") {
        none if none.trim().is_empty() => String::new(),
        layout if layout.contains("   ") => format!("```text\n{layout}\n```\n\n"),
        sentences => format!("{sentences}\n\n"),
    }
}

fn line(template: &toml::Table) -> &'static str {
    let tables =
        template.get("variant").and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::values);
    let tables = tables.filter_map(toml::Value::as_table).chain([template]);
    let mut channels =
        tables.filter_map(|table| table.get("channel")?.as_table()).flat_map(toml::Table::values);
    if channels.any(|channel| channel.get("text").is_some()) {
        return "text";
    }
    let groups = ["channel", "target"].map(|key| template.get(key).and_then(toml::Value::as_table));
    let groups: Vec<_> = groups.into_iter().flatten().flat_map(toml::Table::values).collect();
    let asks =
        |group: &toml::Value| group.get("ask").is_some_and(|asks| asks.to_string().contains("\"node\""));
    if groups.iter().any(|group| group.get("register").is_some()) {
        "Modbus"
    } else if groups.iter().any(|group| group.get("node").is_some() || asks(group)) {
        "OPC UA"
    } else {
        "CAN"
    }
}

/// Keys that a profile must set for a template.
fn asks(template: &toml::Table) -> String {
    let mut asked: Vec<String> = Vec::new();
    if template.contains_key("variant") {
        let variants = template["variant"].as_table().unwrap().keys();
        asked.push(format!("`variant`: {}", variants.cloned().collect::<Vec<_>>().join(", ")));
    }
    if template.get("movable").and_then(toml::Value::as_bool) == Some(true) {
        asked.push("`base`".to_owned());
    }
    for key in ["channel", "target"] {
        let groups =
            template.get(key).and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::values);
        for ask in groups.filter_map(|group| group.get("ask")?.as_array()).flatten() {
            let ask = format!("`{}`", ask.as_str().unwrap());
            if !asked.contains(&ask) {
                asked.push(ask);
            }
        }
    }
    asked.join(", ")
}

/// Name of a group, or `1 … 8` for a numbered group.
fn channels(name: &str, group: &toml::Value) -> String {
    let number = |key: &str| group.get(key).and_then(toml::Value::as_integer);
    match (group.get("name").and_then(toml::Value::as_str), number("count")) {
        (Some(pattern), Some(count)) => {
            let from = number("from").unwrap_or(0);
            let of = |channel: i64| pattern.replace("{n}", &channel.to_string());
            format!("`{}` … `{}`", of(from), of(from + count - 1))
        }
        _ => format!("`{name}`"),
    }
}

/// Languages of the page: code, own name, and chapter of the shop sheet.
const LANGUAGES: [(&str, &str, &str); 4] = [
    ("en", "English", "shop-sheet.md"),
    ("de", "Deutsch", "shop-sheet-de.md"),
    ("ja", "日本語", "shop-sheet-ja.md"),
    ("zh", "中文", "shop-sheet-zh.md"),
];

#[test]
fn the_shop_sheet_says_in_each_language_of_the_page_what_the_page_says() {
    for (language, _, chapter) in LANGUAGES {
        is_committed(&format!("docs/{chapter}"), &shop_sheet(language));
    }
}

/// Makes the shop sheet: the states in the words of the page, and the actions of `docs/shop-sheet.json`.
fn shop_sheet(language: &str) -> String {
    let page: Value =
        serde_json::from_str(&read(format!("src/observe/page/languages/{language}.json"))).unwrap();
    let sheet: Value = serde_json::from_str(&read("docs/shop-sheet.json")).unwrap();
    let text = |value: &Value| value.as_str().unwrap_or_else(|| panic!("{language}: {value}")).to_owned();
    let of_page = |key: &str| text(&page[key]);
    let own = |key: &str| {
        let said = text(sheet[language].pointer(key).unwrap_or(&Value::Null));
        // A button in braces gets its name on the page.
        let buttons = ["arm", "disarm", "zero", "cancel", "acknowledge"];
        buttons.iter().fold(said, |said, key| said.replace(&format!("{{{key}}}"), &of_page(key)))
    };
    let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let others = LANGUAGES.iter().filter(|(other, ..)| *other != language);
    let others: Vec<String> = others.map(|(_, name, chapter)| format!("[{name}]({chapter})")).collect();
    let blank = "______________";
    let mut sheet = format!(
        "# {}\n\n{} *{}: {blank}  {}: http://{blank}  {}: {blank}*\n\n**{}**\n\n{}\n\n{}\n\n",
        own("/title"),
        own("/intro"),
        own("/fields/0"),
        own("/fields/1"),
        own("/fields/2"),
        of_page("not_safety"),
        own("/cz"),
        own("/figure"),
    );
    sheet += &row(&[0, 1, 2].map(|cell| own(&format!("/states/{cell}"))));
    sheet += "|---|---|---|\n";
    for (_, name, _, tone) in Display::ALL {
        let colour = own(&format!("/tones/{}", tone.name()));
        let [word, does] = ["state", "does"].map(|kind| of_page(&format!("{kind}.{name}")));
        sheet += &row(&[format!("{colour}: {word}"), does, own(&format!("/do/{name}"))]);
    }
    sheet += &format!("\n{}|---|---|\n", row(&[0, 1].map(|cell| own(&format!("/cases/{cell}")))));
    for case in 0..7 {
        sheet += &row(&[0, 1].map(|cell| own(&format!("/case/{case}/{cell}"))));
    }
    sheet += &format!(
        "\n[{}](troubleshooting.md) · [{}](operating.md#the-states-of-an-axis) · {}: {}\n",
        own("/more/0"),
        own("/more/1"),
        own("/other"),
        others.join(", "),
    );
    sheet
}
