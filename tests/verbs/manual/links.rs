//! Every link leads to an existing file, heading or picture, and the summary lists every chapter.

use std::path::{Component, Path, PathBuf};

use super::book::{Chapter, chapters, read, root};
use super::generated::anchor;

/// Targets of the links `[text](target)`, without web addresses.
fn targets(prose: &str) -> Vec<String> {
    let opened = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    let targets = opened.map(|(target, _)| target.to_owned());
    targets.filter(|target| !target.starts_with("http")).collect()
}

fn headings(text: &str) -> Vec<String> {
    let chapter = Chapter { path: PathBuf::new(), text: text.to_owned() };
    let prose = chapter.prose();
    let lines = prose.lines().filter(|line| line.starts_with('#'));
    lines.map(|line| anchor(line.trim_start_matches('#').trim())).collect()
}

/// Simplifies a path: `docs/../README.md` becomes `README.md`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        if part == Component::ParentDir {
            plain.pop();
        } else {
            plain.push(part);
        }
    }
    plain
}

#[test]
fn every_link_leads_somewhere() {
    let others = ["SECURITY.md", "CONTRIBUTING.md"];
    let others = others.map(|path| Chapter { path: path.into(), text: read(path) });
    let (mut broken, mut count) = (Vec::new(), 0);
    for chapter in chapters().iter().chain(&others) {
        for target in targets(&chapter.prose()) {
            count += 1;
            let (file, heading) = target.split_once('#').unwrap_or((&target, ""));
            let path = match file {
                "" => chapter.path.clone(),
                file => plain(&chapter.path.parent().unwrap().join(file)),
            };
            let found = root().join(&path);
            let is_there = found.exists()
                && (heading.is_empty() || headings(&read(&path)).contains(&heading.to_owned()));
            if !is_there {
                broken.push(format!("{}: {target}", chapter.path.display()));
            }
        }
    }
    assert!(count > 100 && broken.is_empty(), "{count} links; these lead nowhere:\n{}", broken.join("\n"));
}

#[test]
fn the_summary_names_every_chapter_once() {
    let summary = read("docs/SUMMARY.md");
    let mut named: Vec<PathBuf> =
        targets(&summary).iter().map(|target| Path::new("docs").join(target)).collect();
    named.sort();
    let mut there: Vec<PathBuf> = chapters().into_iter().map(|chapter| chapter.path).collect();
    there.retain(|path| path != Path::new("README.md") && path != Path::new("docs/SUMMARY.md"));
    assert_eq!(named, there);
}

#[test]
fn readme_is_short_and_begins_with_what_to_do() {
    let readme = read("README.md");
    assert!(readme.lines().count() <= 250, "README has {} lines, 250 are allowed", readme.lines().count());
    let begin: Vec<&str> = readme.lines().take(14).collect();
    let says =
        |words: &str| assert!(begin.iter().any(|line| line.starts_with(words)), "{words} is not at the top");
    says("cargo run --release -- demo ");
    says("tests/run ");
}

#[test]
fn every_picture_is_shown_and_small() {
    let texts: String = chapters().into_iter().map(|chapter| chapter.text).collect();
    let mut count = 0;
    for entry in std::fs::read_dir(root().join("docs/pictures")).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        assert!(texts.contains(&format!("pictures/{name})")), "nobody shows {name}");
        let size = entry.metadata().unwrap().len();
        assert!(size <= 150_000, "{name} has {size} bytes");
        count += 1;
    }
    assert!(count >= 2);
}
