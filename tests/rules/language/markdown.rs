//! Texts in Markdown: headings, paragraphs, list items, table cells. Code blocks are skipped.

use super::sentences::Text;

/// Texts of a document. Each is a list of lines with their numbers.
pub(super) fn texts(document: &str) -> Vec<Text> {
    let mut texts: Vec<Text> = Vec::new();
    let mut paragraph: Text = Vec::new();
    let mut fence = "";
    for (number, line) in (1..).zip(document.lines()) {
        let line = line.trim_start_matches(|c: char| c == '>' || c.is_whitespace()).trim_end();
        if !fence.is_empty() {
            if line.starts_with(fence) {
                fence = "";
            }
            continue;
        }
        fence = ["```", "~~~"].into_iter().find(|mark| line.starts_with(*mark)).unwrap_or_default();
        let item = item(line);
        let ends = line.is_empty() || line.starts_with(['<', '#', '|']) || item.is_some();
        if ends || !fence.is_empty() {
            texts.push(std::mem::take(&mut paragraph));
        }
        if line.starts_with('|') {
            texts.extend(cells(line).into_iter().map(|cell| vec![(number, cell)]));
        } else if line.starts_with('#') {
            texts.push(vec![(number, line.trim_start_matches('#').to_owned())]);
        } else if fence.is_empty() && !line.is_empty() && !line.starts_with('<') {
            paragraph.push((number, item.unwrap_or(line).to_owned()));
        }
    }
    texts.push(paragraph);
    texts.retain(|text| text.iter().any(|(_, said)| !said.trim().is_empty()));
    texts
}

/// Text of a list item on its first line; `None` for any other line.
fn item(line: &str) -> Option<&str> {
    let number = line.trim_start_matches(|c: char| c.is_ascii_digit());
    let rest = match line.strip_prefix(['-', '*', '+']) {
        Some(rest) => rest,
        None if number.len() < line.len() => number.strip_prefix(['.', ')'])?,
        None => return None,
    };
    rest.starts_with([' ', '\t']).then(|| rest.trim_start())
}

/// Cells of a table row. A `|` in code or after a backslash is not a separator.
fn cells(row: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let (mut is_code, mut before) = (false, ' ');
    for c in row.chars() {
        is_code ^= c == '`';
        if c == '|' && !is_code && before != '\\' {
            cells.push(String::new());
        } else if let Some(cell) = cells.last_mut() {
            cell.push(c);
        }
        before = c;
    }
    cells
}

#[test]
fn each_block_is_a_text_and_code_is_none() {
    let document = "# Head\n\nOne line,\nand another.\n- An item\n  of two lines.\n- **Bold** item.\n\
                    ```sh\ncargo build # not this. Nor that.\n```\n| a | `b|c` \\| d |\n|---|---|\n\
                    > quoted\n\n<br>\n10. tenth\n1.5 mm";
    let found: Vec<(usize, String)> = texts(document)
        .iter()
        .map(|text| {
            let lines: Vec<&str> = text.iter().map(|(_, line)| line.trim()).collect();
            (text[0].0, lines.join(" / "))
        })
        .collect();
    let expected = [
        (1, "Head"),
        (3, "One line, / and another."),
        (5, "An item / of two lines."),
        (7, "**Bold** item."),
        (11, "a"),
        (11, "`b|c` \\| d"),
        (12, "---"),
        (12, "---"),
        (13, "quoted"),
        (16, "tenth / 1.5 mm"),
    ];
    assert_eq!(found, expected.map(|(line, text)| (line, text.to_owned())));
}
