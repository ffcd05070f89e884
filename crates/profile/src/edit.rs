//! Edits the text of a profile: replaces the models of an axis, or adds the signal that shows that the machine is on.
//! Everything else stays as it was written, including comments and order.
//!
//! The edits work on lines. Each result is parsed again and compared with the unedited profile. An edit that changes
//! anything else is refused.

use std::ops::Range;

use toml::{Table, Value};

/// Text of a profile in which the models of an axis have been replaced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelEdit {
    /// Text of the whole profile, with the new models.
    pub text: String,
    /// Line of `text` at which the new models begin, counted from 1.
    pub line: usize,
    /// Number of models that the axis had before, and that were replaced.
    pub replaced: usize,
}

/// Position of a table in the text of a profile.
struct Section {
    /// Keys in the header of the table. For `[axis.z]` these are `axis` and `z`.
    path: Vec<String>,
    /// Lines of the table. They include the comments directly above the header, and no blank lines at the end.
    lines: Range<usize>,
    header: usize,
}

/// Puts the `[[axis.….model]]` tables of `block` into the text of a profile. They replace the models that the axis has.
///
/// # Errors
/// Returns why the text cannot be edited, in one sentence.
pub fn put_model(text: &str, axis: &str, block: &str) -> Result<ModelEdit, String> {
    let models = |text: &str| -> Result<(Table, Option<Value>), String> {
        let mut table: Table = parsed(text)?;
        let axis = table.get_mut("axis").and_then(|axes| axes.get_mut(axis)?.as_table_mut());
        let models = axis.and_then(|axis| axis.remove("model"));
        Ok((table, models))
    };
    let new = models(block)?.1.ok_or_else(|| format!("the new text has no [[axis.{axis}.model]]"))?;
    let (rest, before) = models(text)?;
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let sections = sections(&lines)?;
    let is_model =
        |section: &&Section| section.path.iter().map(String::as_str).take(3).eq(["axis", axis, "model"]);
    let removed: Vec<Range<usize>> =
        sections.iter().filter(is_model).map(|section| without_loose_comments(&lines, section)).collect();
    let own = sections.iter().find(|section| section.path == ["axis", axis]);
    let place = removed.first().map(|range| range.start);
    let place = place.or(own.map(|section| section.lines.end));
    let place = place.ok_or_else(|| format!("the profile has no line [axis.{axis}]"))?;
    let is_kept = |at: &usize| !removed.iter().any(|range| range.contains(at));
    let part = |range: Range<usize>| range.filter(is_kept).map(|at| lines[at]).collect::<String>();
    let ending = if text.contains("\r\n") { "\r\n" } else { "\n" };
    let block = block.trim().lines().collect::<Vec<_>>().join(ending);
    let (above, below) = (part(0..place), part(place..lines.len()));
    let (above, below) = (above.trim_end(), below.trim_start_matches(['\r', '\n']));
    let above = if above.is_empty() { String::new() } else { format!("{above}{ending}{ending}") };
    let line = above.lines().count() + 1;
    let mut edited = format!("{above}{block}{ending}");
    if !below.is_empty() {
        edited.extend([ending, below]);
    }
    // An array `model = [ … ]` and a table cannot be joined: the text before was valid, the edited one is not.
    let is_as_meant =
        models(&edited).is_ok_and(|(rest_now, now)| rest_now == rest && now.as_ref() == Some(&new));
    if !is_as_meant {
        return Err(format!(
            "the tables of axis {axis} are written in a form that cannot be edited automatically"
        ));
    }
    let replaced = before.as_ref().and_then(Value::as_array).map_or(0, Vec::len);
    Ok(ModelEdit { text: edited, line, replaced })
}

/// Adds `on`, the signal whose rising edge is the machine start, to `[machine]` in the text of a profile.
///
/// # Errors
/// Returns why the text cannot be edited, in one sentence.
pub fn put_machine_on(text: &str, signal: &str) -> Result<String, String> {
    let mut expected = parsed(text)?;
    let machine = expected.get_mut("machine").and_then(Value::as_table_mut);
    let machine = machine.ok_or_else(|| "it has no [machine]".to_owned())?;
    if machine.insert("on".to_owned(), Value::from(signal)).is_some() {
        return Err("[machine] already has `on`".to_owned());
    }
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let sections = sections(&lines)?;
    let header = sections.iter().find(|section| section.path == ["machine"]).map(|section| section.header);
    let header = header.ok_or_else(|| "the profile has no line [machine]".to_owned())?;
    let ending = if text.contains("\r\n") { "\r\n" } else { "\n" };
    let key = format!("on     = {}{ending}", Value::from(signal));
    let above = lines[..=header].concat();
    let gap = if above.ends_with('\n') { "" } else { ending };
    let edited = format!("{above}{gap}{key}{}", lines[header + 1..].concat());
    match parsed(&edited)? == expected {
        true => Ok(edited),
        false => Err("[machine] is written in a form that cannot be edited automatically".to_owned()),
    }
}

fn parsed(text: &str) -> Result<Table, String> {
    text.parse::<Table>().map_err(|why| format!("the text is not valid TOML: {}", why.message()))
}

/// Returns the position of every table of a profile, in the order of the lines.
fn sections(lines: &[&str]) -> Result<Vec<Section>, String> {
    let headers = headers(lines);
    // Comments directly above a header belong to it.
    let begin = |header: usize| {
        let comments = lines[..header].iter().rev().take_while(|line| line.trim_start().starts_with('#'));
        header - comments.count()
    };
    let mut sections = Vec::new();
    for (place, header) in headers.iter().enumerate() {
        let next = headers.get(place + 1).map_or(lines.len(), |next| begin(*next));
        let blank = lines[*header + 1..next.max(*header + 1)].iter().rev();
        let end = next.max(*header + 1) - blank.take_while(|line| line.trim().is_empty()).count();
        sections.push(Section { path: path(lines[*header])?, lines: begin(*header)..end, header: *header });
    }
    Ok(sections)
}

/// Returns the lines of a table. Comments at the end of the table are left out if they follow a blank line, because
/// such comments belong to the rest of the file.
fn without_loose_comments(lines: &[&str], section: &Section) -> Range<usize> {
    let Section { lines: Range { start, end }, header, .. } = section;
    let is_blank = |line: &&str| line.trim().is_empty();
    let is_loose = |line: &&&str| line.trim().is_empty() || line.trim_start().starts_with('#');
    let loose = lines[header + 1..*end].iter().rev().take_while(is_loose).count();
    let begin = end - loose;
    let blank = lines[begin..*end].iter().position(is_blank);
    *start..blank.map_or(*end, |blank| begin + blank)
}

/// Returns the keys in the header of a table: for `[axis.z]` these are `axis` and `z`.
fn path(header: &str) -> Result<Vec<String>, String> {
    let mut keys = Vec::new();
    let mut inner = Value::Table(parsed(header)?);
    loop {
        let table = match inner {
            Value::Table(table) => table,
            Value::Array(mut list) => match list.pop() {
                Some(Value::Table(table)) => table,
                _ => return Ok(keys),
            },
            _ => return Ok(keys),
        };
        let Some((key, value)) = table.into_iter().next() else { return Ok(keys) };
        keys.push(key);
        inner = value;
    }
}

/// State of the line scanner at the beginning of a line of TOML text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Within {
    /// The line begins between keys, or inside a value. The field is the number of brackets that are still open.
    Keys(usize),
    /// The line begins inside a quoted text of several lines. The fields are the closing quote, and the number of
    /// brackets that are open around the text.
    Text(&'static str, usize),
}

/// Returns the indices of the lines that are headers of tables.
fn headers(lines: &[&str]) -> Vec<usize> {
    let (mut within, mut found) = (Within::Keys(0), Vec::new());
    for (place, line) in lines.iter().enumerate() {
        if within == Within::Keys(0) && line.trim_start().starts_with('[') {
            found.push(place);
        } else {
            within = after(line, within);
        }
    }
    found
}

/// Returns the state at the beginning of the next line, given the state at the beginning of `line`.
fn after(line: &str, mut within: Within) -> Within {
    let mut rest = line;
    loop {
        match within {
            Within::Text(quote, open) => {
                let Some(end) = end_of_text(rest, quote) else { return within };
                rest = &rest[end..];
                within = Within::Keys(open);
            }
            Within::Keys(open) => {
                let Some(at) = rest.find(['#', '"', '\'', '[', ']', '{', '}']) else { return within };
                let (special, behind) = (rest.as_bytes()[at], &rest[at + 1..]);
                let quote = if special == b'"' { "\"\"\"" } else { "'''" };
                match special {
                    b'#' => return within,
                    b'[' | b'{' => (rest, within) = (behind, Within::Keys(open + 1)),
                    b']' | b'}' => (rest, within) = (behind, Within::Keys(open.saturating_sub(1))),
                    _ if rest[at..].starts_with(quote) => {
                        (rest, within) = (&rest[at + 3..], Within::Text(quote, open));
                    }
                    _ => match end_of_text(behind, &quote[..1]) {
                        Some(end) => rest = &behind[end..],
                        None => return within,
                    },
                }
            }
        }
    }
}

/// Returns the index after the end of a quoted text. `None` if the text does not end in this line. In texts with `"`, a
/// backslash escapes the next character.
fn end_of_text(text: &str, quote: &str) -> Option<usize> {
    let mut from = 0;
    while from < text.len() {
        let rest = &text[from..];
        if rest.starts_with('\\') && quote.starts_with('"') {
            from += 1 + rest[1..].chars().next().map_or(0, char::len_utf8);
        } else if let Some(behind) = rest.strip_prefix(quote) {
            let more = behind.bytes().take_while(|byte| quote.as_bytes()[0] == *byte).count();
            // A text of several lines may end with two quotes of its own.
            return Some(from + quote.len() + if quote.len() == 3 { more.min(2) } else { 0 });
        } else {
            from += rest.chars().next().map_or(1, char::len_utf8);
        }
    }
    None
}

#[cfg(test)]
mod tests;
