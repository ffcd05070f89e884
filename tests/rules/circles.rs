//! Circles of files that import each other.

use std::collections::{BTreeMap, BTreeSet};

use super::source::Source;

/// Sets of files of which each imports each other one, on whatever way, and that have more than so many members.
///
/// A name that a module hands on is imported from the file that defines it. A module and the files it is made of are one
/// idea: what these take from it makes no circle.
pub(super) fn larger_than(most: usize, sources: &[Source]) -> Vec<Vec<String>> {
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
            let is_made_of = |to: &usize| {
                let other = Place::of(&sources[*to]);
                own.home == other.home && own.modules.starts_with(&other.modules)
            };
            found.iter().map(defined_in).filter(|to| !is_made_of(to)).collect()
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

/// A module: its crate, and its path in there.
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

    /// The deepest module that a path in this one leads to, and what is left of the path.
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

/// A source file of this path with this code.
fn source(path: &str, code: &str) -> Source {
    Source { path: path.to_owned(), text: code.to_owned(), code: code.to_owned() }
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
    assert!(larger_than(1, &sources).is_empty());
    sources[4].code = "use crate::{a::A, e::E};".to_owned();
    let circle: Vec<String> =
        ["src/a.rs", "src/b/inner.rs", "src/c.rs", "src/d.rs"].map(str::to_owned).to_vec();
    assert_eq!(larger_than(3, &sources), [circle]);
    assert!(larger_than(4, &sources).is_empty());
}
