//! Circular imports between files.

use std::collections::{BTreeMap, BTreeSet};

use super::source::{self, Source};
use super::{budget, root};

/// Whether an import of a module by a file below it (`use super::…`) counts.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum ParentImports {
    Ignored,
    Counted,
}

/// Sets of more than `most` files in which each file imports each other file, directly or through others.
///
/// A name that a module re-exports counts as imported from the file that defines it.
pub(super) fn larger_than(most: usize, sources: &[Source], parents: ParentImports) -> Vec<Vec<String>> {
    let places: BTreeMap<Place, usize> =
        sources.iter().enumerate().map(|(place, source)| (Place::of(source), place)).collect();
    let imports: Vec<Vec<(Place, Vec<String>)>> =
        sources.iter().map(|source| resolved(source, &places)).collect();
    let mut handed_on: BTreeMap<(usize, String), usize> = BTreeMap::new();
    for (place, source) in sources.iter().enumerate() {
        for path in source.hands_on() {
            let target = Place::of(source).find(&path, &places);
            if let Some((module, rest)) = target
                && let Some(name) = rest.last()
                && places[&module] != place
            {
                handed_on.insert((place, name.clone()), places[&module]);
            }
        }
    }
    let arrows: Vec<BTreeSet<usize>> = imports
        .iter()
        .enumerate()
        .map(|(from, found)| {
            let defined_in = |(module, rest): &(Place, Vec<String>)| {
                let mut at = places[module];
                while let Some(next) = rest.first().and_then(|name| handed_on.get(&(at, name.clone()))) {
                    if *next == at {
                        break;
                    }
                    at = *next;
                }
                at
            };
            let own = Place::of(&sources[from]);
            let is_parent = |to: &usize| {
                let other = Place::of(&sources[*to]);
                own.home == other.home && own.modules.starts_with(&other.modules)
            };
            let counts = |to: &usize| *to != from && (parents == ParentImports::Counted || !is_parent(to));
            found.iter().map(defined_in).filter(counts).collect()
        })
        .collect();
    let reached: Vec<BTreeSet<usize>> = (0..sources.len()).map(|from| reach(from, &arrows)).collect();
    let mut circles: BTreeSet<Vec<String>> = BTreeSet::new();
    for from in 0..sources.len() {
        let circle: Vec<String> = (0..sources.len())
            .filter(|to| reached[from].contains(to) && reached[*to].contains(&from))
            .map(|to| sources[to].path.clone())
            .collect();
        if circle.len() > most {
            circles.insert(circle);
        }
    }
    circles.into_iter().collect()
}

/// A module: its crate, and its path in the crate.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    home: String,
    modules: Vec<String>,
}

impl Place {
    fn of(source: &Source) -> Place {
        let rest = source.path.split_once("src/").map_or("", |(_, rest)| rest).trim_end_matches(".rs");
        let modules = if rest == "lib" { Vec::new() } else { rest.split('/').map(str::to_owned).collect() };
        Place { home: source.home().to_owned(), modules }
    }

    /// Deepest module to which a path in this module leads, and the rest of the path.
    fn find(&self, path: &[String], places: &BTreeMap<Place, usize>) -> Option<(Place, Vec<String>)> {
        let mut rest = path;
        let mut at = self.clone();
        match rest.first()?.as_str() {
            "crate" => (at.modules, rest) = (Vec::new(), &rest[1..]),
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|part| part == "super") {
                    at.modules.pop();
                    rest = &rest[1..];
                }
            }
            child => {
                let mut inside = at.clone();
                inside.modules.push(child.to_owned());
                places.get(&inside)?;
            }
        }
        while let Some(part) = rest.first() {
            let mut inside = at.clone();
            inside.modules.push(part.clone());
            if !places.contains_key(&inside) {
                break;
            }
            (at, rest) = (inside, &rest[1..]);
        }
        places.contains_key(&at).then(|| (at, rest.to_vec()))
    }
}

fn resolved(source: &Source, places: &BTreeMap<Place, usize>) -> Vec<(Place, Vec<String>)> {
    let own = Place::of(source);
    source.paths().iter().filter_map(|path| own.find(path, places)).collect()
}

fn reach(from: usize, arrows: &[BTreeSet<usize>]) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(next) = open.pop() {
        open.extend(arrows[next].iter().filter(|to| reached.insert(**to)));
    }
    reached
}

/// Formats the budget of these circles: each file in a circle, and the file that names the circle.
fn print(circles: &[Vec<String>]) -> String {
    let depth = |file: &str| file.matches('/').count();
    let mut rows = Vec::new();
    for circle in circles {
        if let Some(name) = circle.iter().min_by_key(|file| (depth(file), *file)) {
            rows.extend(circle.iter().map(|file| format!("{file},{name}\n")));
        }
    }
    rows.sort();
    format!("file,circle\n{}", rows.concat())
}

/// Lists each circle that is larger than all circles that contained its files; `None` if there is none.
fn grown(circles: &[Vec<String>], budget: &str) -> Option<String> {
    let rows: BTreeMap<&str, &str> = budget.lines().skip(1).filter_map(|row| row.split_once(',')).collect();
    let size = |name: &str| rows.values().filter(|other| **other == name).count();
    let mut explained = String::new();
    for circle in circles {
        let names: BTreeSet<&str> =
            circle.iter().filter_map(|file| rows.get(file.as_str()).copied()).collect();
        let most = names.into_iter().map(size).max().unwrap_or(0);
        if circle.len() > most {
            let new = circle.iter().filter(|file| !rows.contains_key(file.as_str()));
            let new: Vec<&str> = new.map(String::as_str).collect();
            explained += &format!(
                "{} files import each other, {most} are allowed; new among them: {}. Move what a file takes from its \
                 parent into a file of its own, or hand it over as an argument. All of them:\n  {}\n",
                circle.len(),
                new.join(", "),
                circle.join("\n  ")
            );
        }
    }
    Some(explained).filter(|explained| !explained.is_empty())
}

#[test]
fn circles_through_parent_modules_only_become_smaller() {
    let circles = larger_than(2, &source::all(root()), ParentImports::Counted);
    let refusal = grown(&circles, &budget::read("circles").unwrap_or_default());
    budget::settle("circles", &print(&circles), refusal);
}

#[test]
fn a_circle_may_lose_files_or_fall_apart_and_may_not_grow() {
    let circle = |files: &[&str]| files.iter().map(|file| (*file).to_owned()).collect::<Vec<String>>();
    let before = print(&[circle(&["src/a.rs", "src/a/b.rs", "src/a/c.rs", "src/a/d.rs"])]);
    assert_eq!(
        before,
        "file,circle\nsrc/a.rs,src/a.rs\nsrc/a/b.rs,src/a.rs\nsrc/a/c.rs,src/a.rs\nsrc/a/d.rs,src/a.rs\n"
    );
    let is_grown = |files: &[&str]| grown(&[circle(files)], &before).is_some();
    assert!(!is_grown(&["src/a.rs", "src/a/b.rs", "src/a/c.rs"]));
    assert!(!is_grown(&["src/a.rs", "src/a/b.rs", "src/a/c.rs", "src/a/renamed.rs"]));
    assert!(is_grown(&["src/e.rs", "src/f.rs", "src/g.rs"]));
    let files = ["src/a.rs", "src/a/b.rs", "src/a/c.rs", "src/a/d.rs", "src/e.rs"];
    let explained = grown(&[circle(&files)], &before).unwrap();
    assert!(explained.starts_with("5 files import each other, 4 are allowed; new among them: src/e.rs."));
}

/// A source file with this path and this code.
fn source(path: &str, code: &str) -> Source {
    Source { path: path.to_owned(), text: code.to_owned(), code: code.to_owned(), tests: Vec::new() }
}

#[test]
fn a_circle_is_found_through_what_is_handed_on_and_not_between_a_module_and_its_parts() {
    let mut sources = vec![
        source("src/a.rs", "use crate::b::B;"),
        source("src/b.rs", "mod inner;\npub use inner::B;"),
        source("src/b/inner.rs", "use super::Outer;\nfn f() { crate::c::g(); }"),
        source("src/c.rs", "use super::d::{E, D};"),
        source("src/d.rs", "use crate::e::E;"),
    ];
    let ignored = |most, sources: &[Source]| larger_than(most, sources, ParentImports::Ignored);
    assert!(ignored(1, &sources).is_empty());
    sources[4].code = "use crate::{a::A, e::E};".to_owned();
    let circle: Vec<String> =
        ["src/a.rs", "src/b/inner.rs", "src/c.rs", "src/d.rs"].map(str::to_owned).to_vec();
    assert_eq!(ignored(3, &sources), [circle]);
    assert!(ignored(4, &sources).is_empty());
}

#[test]
fn an_import_of_a_parent_module_counts_where_it_is_asked_for() {
    let sources = vec![
        source("src/lib.rs", "pub mod a;\npub mod b;\npub struct Root;"),
        source("src/a.rs", "mod inner;\nmod other;\nuse inner::Inner;\npub struct A;"),
        source("src/a/inner.rs", "use crate::a::A;\nuse super::other::Other;\npub struct Inner;"),
        source("src/a/other.rs", "use super::A;\npub struct Other;"),
        source("src/b.rs", "mod leaf;\nuse crate::Root;\nuse leaf::Leaf;"),
        source("src/b/leaf.rs", "pub(in crate::b) struct Leaf;"),
    ];
    assert!(larger_than(1, &sources, ParentImports::Ignored).is_empty());
    let circle: Vec<String> = ["src/a.rs", "src/a/inner.rs", "src/a/other.rs"].map(str::to_owned).to_vec();
    assert_eq!(larger_than(1, &sources, ParentImports::Counted), [circle]);
}
