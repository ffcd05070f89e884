//! Every command of README and manual runs in a separate directory with virtual devices. Commands that cannot run are
//! listed here.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;

use clap::Parser;
use isotherm::cli::Arguments;

use super::beside::Beside;
use super::book::{Block, Chapter, chapters, read, root};
use super::shop::Shop;

/// Blocks that no test can run, by chapter, with their value of `by-hand=`. Every other block must run.
const BY_HAND: [(&str, &str); 5] = [
    ("docs/fleet.md", "a container engine"),
    ("docs/fleet.md", "a broker"),
    ("docs/fleet.md", "cron"),
    ("docs/installing.md", "a registry of images"),
    ("docs/operating.md", "cron"),
];

/// Number of chapters that run at once.
const AT_ONCE: usize = 4;

fn is_of_a_shell(block: &Block) -> bool {
    ["sh", "console"].contains(&block.language.as_str())
}

/// Commands of a block, each with the output that the block shows.
fn commands(block: &Block) -> Vec<(String, Vec<String>)> {
    let mut found: Vec<(String, Vec<String>)> = Vec::new();
    let mut resumes = false;
    for line in block.text.lines() {
        let command = match block.language.as_str() {
            "sh" => Some(line.trim()),
            _ => line.strip_prefix("$ "),
        };
        match command {
            Some("") => {}
            Some(command) if resumes => found.last_mut().unwrap().0 += command,
            Some(command) => found.push((command.to_owned(), Vec::new())),
            None => found.last_mut().unwrap().1.push(line.to_owned()),
        }
        if let Some((command, _)) = found.last_mut() {
            resumes = command.ends_with('\\');
            if resumes {
                command.pop();
            }
        }
    }
    found
}

/// The command as a user with an installed program would type it.
fn typed(command: &str) -> String {
    command.replace("cargo run --release -- ", "isotherm ")
}

/// Arguments of an `isotherm` command, split as by a shell.
fn words(command: &str) -> Vec<String> {
    let spoken = command.split(" #").next().unwrap().split(" > ").next().unwrap();
    spoken.split_whitespace().map(|word| word.trim_matches('"').to_owned()).collect()
}

#[test]
fn what_no_test_can_run_is_listed_with_the_reason() {
    let mut found = Vec::new();
    for chapter in chapters() {
        for block in chapter.blocks().iter().filter(|block| is_of_a_shell(block)) {
            if let Some(why) = block.says("by-hand") {
                found.push((chapter.path.display().to_string(), why.to_owned()));
            }
        }
    }
    let listed = BY_HAND.map(|(chapter, why)| (chapter.to_owned(), why.to_owned()));
    assert_eq!(found, listed);
}

/// Contents of all files next to the script of a test.
fn sources_of(script: &str) -> Vec<String> {
    let folder = Path::new(script).parent().filter(|folder| folder.parent() != Some(Path::new("")));
    let Some(folder) = folder else { return vec![read(script)] };
    // Scripts that run on a separate kernel or control are in `tests/system`.
    let folders = [folder.to_owned(), Path::new("tests/system").join(folder.file_name().unwrap())];
    let entries = folders.iter().filter_map(|folder| std::fs::read_dir(root().join(folder)).ok()).flatten();
    let files = entries.map(|entry| entry.unwrap().path());
    files.filter_map(|file| std::fs::read_to_string(file).ok()).collect()
}

#[test]
fn what_another_test_runs_it_takes_from_the_chapter() {
    let mut expected: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for chapter in chapters() {
        for block in chapter.blocks().iter().filter(|block| is_of_a_shell(block)) {
            let Some(script) = block.says("by") else { continue };
            let typed = commands(block).into_iter().map(|(command, _)| bare(&command).to_owned());
            let key = (chapter.path.display().to_string(), script.to_owned());
            expected.entry(key).or_default().extend(typed);
        }
    }
    let run = read("tests/run");
    assert!(expected.len() > 6, "{expected:?}");
    for ((chapter, script), typed) in expected {
        let is_started = script == "tests/run" || run.contains(&script);
        assert!(is_started, "{chapter}: tests/run does not start {script}");
        let taken = Command::new(root().join("tests/verbs/manual/commands"))
            .args([&chapter, &script])
            .output()
            .unwrap();
        let taken = String::from_utf8(taken.stdout).unwrap();
        assert_eq!(taken.lines().collect::<Vec<_>>(), typed, "{chapter}, {script}");
        let sources = sources_of(&script);
        let takes = |text: &String| text.contains("manual/commands") && text.contains(&chapter);
        assert!(sources.iter().any(takes), "{script} takes nothing from {chapter}");
        // For root, `tests/run` installs the packages that the script lists as missing.
        let packages = typed.iter().filter_map(|command| command.strip_prefix("apt-get install "));
        for package in packages.flat_map(str::split_whitespace).filter(|word| !word.starts_with('-')) {
            assert!(
                read(&script).contains(&format!("echo {package}\n")),
                "{script} --missing lacks {package}"
            );
        }
    }
}

/// Checks commands in all blocks, run or not, and within sentences.
#[test]
fn every_command_of_ours_has_arguments_that_the_program_takes() {
    let (mut refused, mut count) = (Vec::new(), 0);
    for chapter in chapters() {
        let mut all: Vec<(String, String)> = Vec::new();
        for block in chapter.blocks().iter().filter(|block| is_of_a_shell(block)) {
            all.extend(
                commands(block).into_iter().map(|(command, _)| (block.place.clone(), typed(&command))),
            );
        }
        let prose = chapter.prose();
        let quoted = prose.split('`').skip(1).step_by(2).map(|quoted| quoted.replace('\n', " "));
        all.extend(quoted.map(|quoted| (chapter.path.display().to_string(), quoted)));
        for (place, command) in all.iter().filter(|(_, command)| command.starts_with("isotherm ")) {
            // "identify --balls" alone is the name of an option.
            if let Err(error) = Arguments::try_parse_from(words(command))
                && !matches!(error.kind(), clap::error::ErrorKind::MissingRequiredArgument)
            {
                refused.push(format!("{place}: {command}\n{error}"));
            }
            count += 1;
        }
    }
    assert!(count > 60 && refused.is_empty(), "{count} commands; refused:\n{}", refused.join("\n"));
}

#[test]
fn every_command_runs_and_prints_what_is_shown() {
    // Most chapters wait more than they compute.
    let (left, wrong) = (Mutex::new(chapters()), Mutex::new(Vec::new()));
    let one = || {
        while let Some(chapter) = { left.lock().unwrap().pop() } {
            let found = mistakes_of(&chapter);
            wrong.lock().unwrap().extend(found);
        }
    };
    std::thread::scope(|scope| (0..AT_ONCE).for_each(|_| drop(scope.spawn(one))));
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

fn mistakes_of(chapter: &Chapter) -> Vec<String> {
    let blocks = chapter.blocks();
    let runs = |block: &&Block| is_of_a_shell(block) && !block.is_run_elsewhere();
    let blocks: Vec<&Block> = blocks.iter().filter(runs).collect();
    let mut wrong = Vec::new();
    let mut besides: BTreeMap<&str, Option<Beside>> = BTreeMap::new();
    if blocks.is_empty() {
        return wrong;
    }
    let mut shop = Shop::of(chapter);
    for block in blocks {
        if block.is("mistaken") {
            shop.make_mistakes();
        }
        let nothing = Some(Beside::default());
        let beside = match block.says("with") {
            Some(word) => &*besides.entry(word).or_insert_with(|| Beside::of(word, chapter, &mut shop)),
            None => &nothing,
        };
        let Some(beside) = beside else { continue };
        shop.typed = beside.typed;
        for (command, shown) in commands(block) {
            if let Some(script) = command.split_whitespace().next().filter(|word| word.starts_with("tests/"))
            {
                assert!(root().join(script).is_file(), "{}: there is no {script}", block.place);
                continue;
            }
            let (said, code) = shop.run(&hurried(&beside.here(&typed(&command))));
            let said = beside.there(&said);
            let expected = if block.is("mistaken") { 64 } else { 0 };
            if code != expected {
                wrong.push(format!("{}: {command}: exit code {code}, not {expected}:\n{said}", block.place));
            } else if let Err(line) = is_in(&shown, &said, block.is("like")) {
                wrong.push(format!("{}: {command} does not print `{line}`:\n{said}", block.place));
            }
        }
        shop.end_of_block();
    }
    wrong
}

/// The command without its comment.
fn bare(command: &str) -> &str {
    command.split(" #").next().unwrap().trim_end()
}

/// The command, with more speed and a free port if it is a demo with a page.
fn hurried(command: &str) -> String {
    let plain = bare(command);
    let is_demo = plain.split_whitespace().nth(1) == Some("demo") && !plain.contains("--learn");
    if is_demo { format!("{plain} --speed 6000 --listen 127.0.0.1:0") } else { plain.to_owned() }
}

/// Checks that the lines are printed in this order. The error is the first line that is missing.
fn is_in<'s>(shown: &'s [String], said: &str, but_for_figures: bool) -> Result<(), &'s str> {
    let form = |line: &str| if but_for_figures { without_figures(line) } else { line.trim_end().to_owned() };
    let mut lines = said.lines().map(form);
    for line in shown.iter().filter(|line| !line.is_empty()) {
        if !lines.any(|found| found == form(line)) {
            return Err(line);
        }
    }
    Ok(())
}

/// Replaces figures: "12 rows over 1m 40s" becomes "# rows over #".
fn without_figures(line: &str) -> String {
    let mut words: Vec<&str> = Vec::new();
    for word in line.split_whitespace() {
        let word = if word.contains(|c: char| c.is_ascii_digit()) { "#" } else { word };
        if (word, words.last()) != ("#", Some(&"#")) {
            words.push(word);
        }
    }
    words.join(" ")
}
