//! Budgets: counts in `tests/rules/budget` that may only decrease.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Environment variable with which a test writes its budget.
const WRITES: &str = "TEST_WRITES_BUDGET";

/// A key whose count is above its budget.
pub(super) struct Above {
    pub(super) key: String,
    pub(super) count: usize,
    pub(super) allowed: usize,
}

type Counts = BTreeMap<String, usize>;

/// Compares counts with the budget `tests/rules/budget/NAME.csv`. `explain` lists the necessary changes for the keys
/// above their budget.
///
/// With `TEST_WRITES_BUDGET=1`, the budget is updated after a file was renamed or divided, if the total does not grow.
pub(super) fn hold(name: &str, key: &str, counts: &Counts, explain: impl Fn(&[Above]) -> String) {
    let allowed = parse(&read(name).unwrap_or_default());
    let above = above(counts, &allowed);
    let has_grown = counts.values().sum::<usize>() > allowed.values().sum::<usize>();
    let is_refused = if writes() { has_grown } else { !above.is_empty() };
    let hint = if has_grown { "" } else { "\nIf a file was only renamed or divided, write the budget." };
    settle(name, &print(key, counts), is_refused.then(|| explain(&above) + hint));
}

/// Reads the budget of this name; `None` if it does not exist.
pub(super) fn read(name: &str) -> Option<String> {
    std::fs::read_to_string(file(name)).ok()
}

/// Fails if the budget differs from the counts. With `TEST_WRITES_BUDGET=1`, it writes the budget instead, unless there
/// is a `refusal`, which says what to change.
pub(super) fn settle(name: &str, counted: &str, refusal: Option<String>) {
    let file = file(name);
    let before = read(name);
    let command = format!("{WRITES}=1 cargo test --test rules");
    if let (Some(_), Some(refusal)) = (&before, refusal) {
        panic!(
            "the budget {name} may only fall:\n{refusal}\nTo write it: {command}\nIf there is no other way, raise its \
             rows in {} by hand.",
            file.display()
        );
    }
    if writes() {
        std::fs::write(&file, counted).unwrap();
        return;
    }
    let changes = changes(&before.unwrap_or_default(), counted);
    assert!(changes.is_empty(), "the budget {name} must follow: {command}\n{}", changes.join("\n"));
}

fn writes() -> bool {
    std::env::var_os(WRITES).is_some()
}

fn file(name: &str) -> PathBuf {
    super::root().join("tests/rules/budget").join(format!("{name}.csv"))
}

/// Rows that are in only one of two texts.
fn changes(before: &str, after: &str) -> Vec<String> {
    let (old, new): (BTreeSet<&str>, BTreeSet<&str>) = (before.lines().collect(), after.lines().collect());
    let gone = old.difference(&new).map(|row| format!("- {row}"));
    gone.chain(new.difference(&old).map(|row| format!("+ {row}"))).collect()
}

/// Parses a budget. The last column of each row is the count, the columns before it are the key.
fn parse(text: &str) -> Counts {
    let rows = text.lines().skip(1).filter_map(|row| row.rsplit_once(','));
    rows.map(|(key, count)| (key.to_owned(), count.parse().unwrap())).collect()
}

fn print(key: &str, counts: &Counts) -> String {
    let rows = counts.iter().filter(|(_, count)| **count > 0);
    let rows: String = rows.map(|(key, count)| format!("{key},{count}\n")).collect();
    format!("{key},count\n{rows}")
}

fn above(counts: &Counts, allowed: &Counts) -> Vec<Above> {
    let all = counts.iter().map(|(key, count)| Above {
        key: key.clone(),
        count: *count,
        allowed: allowed.get(key).copied().unwrap_or(0),
    });
    all.filter(|entry| entry.count > entry.allowed).collect()
}

#[test]
fn a_budget_is_printed_and_parsed_and_each_difference_is_seen() {
    let counts = |rows: &[(&str, usize)]| -> Counts {
        rows.iter().map(|(key, count)| ((*key).to_owned(), *count)).collect()
    };
    let allowed = counts(&[("a.rs,some words", 2), ("b.rs", 1), ("gone.rs", 3)]);
    assert_eq!(print("file", &allowed), "file,count\na.rs,some words,2\nb.rs,1\ngone.rs,3\n");
    assert_eq!(parse(&print("file", &allowed)), allowed);
    let found = counts(&[("a.rs,some words", 1), ("b.rs", 1), ("new.rs", 1)]);
    let more: Vec<(String, usize, usize)> =
        above(&found, &allowed).into_iter().map(|entry| (entry.key, entry.count, entry.allowed)).collect();
    assert_eq!(more, [("new.rs".to_owned(), 1, 0)]);
    let changes = changes(&print("file", &allowed), &print("file", &found));
    assert_eq!(changes, ["- a.rs,some words,2", "- gone.rs,3", "+ a.rs,some words,1", "+ new.rs,1"]);
}
