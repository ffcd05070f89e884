//! Each command of README and manual runs, in a directory of its own with virtual devices; what cannot run is listed here.

use clap::Parser;
use isotherm::cli::Arguments;

use super::book::{Block, Chapter, chapters, root};
use super::shop::Shop;

/// Blocks that no test can run, by chapter, with what stands behind `by-hand=`. Another one is a line here, or it runs.
const BY_HAND: [(&str, &str); 28] = [
    ("README.md", "it builds the program"),
    ("docs/api.md", "it asks a gateway with a token"),
    ("docs/commissioning.md", "a person reads the gauge"),
    ("docs/developing.md", "it builds the program"),
    ("docs/developing.md", "it builds the program"),
    ("docs/developing.md", "a browser"),
    ("docs/fleet.md", "a container engine"),
    ("docs/fleet.md", "a broker"),
    ("docs/fleet.md", "cron"),
    ("docs/installing.md", "it builds the package"),
    ("docs/installing.md", "it builds the program"),
    ("docs/installing.md", "it builds the image"),
    ("docs/installing.md", "a container engine"),
    ("docs/linuxcnc/README.md", "a control"),
    ("docs/linuxcnc/README.md", "a control"),
    ("docs/linuxcnc/README.md", "LinuxCNC"),
    ("docs/machines.md", "LinuxCNC"),
    ("docs/network.md", "it asks this computer's network"),
    ("docs/opcua.md", "a server of OPC UA"),
    ("docs/opcua.md", "a server of OPC UA"),
    ("docs/page.md", "openssl"),
    ("docs/pc-sensors.md", "the sensors of this computer"),
    ("docs/placement.md", "gmsh"),
    ("docs/placement.md", "the mesh is that of gmsh"),
    ("docs/service.md", "systemd"),
    ("docs/service.md", "systemd"),
    ("docs/troubleshooting.md", "a line of the shop"),
    ("docs/troubleshooting.md", "a line of the shop"),
];

fn is_of_a_shell(block: &Block) -> bool {
    ["sh", "console"].contains(&block.language.as_str())
}

/// The commands of a block, each with the lines that it prints, as the block shows them.
fn commands(block: &Block) -> Vec<(String, Vec<String>)> {
    let mut found: Vec<(String, Vec<String>)> = Vec::new();
    let mut goes_on = false;
    for line in block.text.lines() {
        let command = match block.language.as_str() {
            "sh" => Some(line.trim()),
            _ => line.strip_prefix("$ "),
        };
        match command {
            Some("") => {}
            Some(command) if goes_on => found.last_mut().unwrap().0 += command,
            Some(command) => found.push((command.to_owned(), Vec::new())),
            None => found.last_mut().unwrap().1.push(line.to_owned()),
        }
        if let Some((command, _)) = found.last_mut() {
            goes_on = command.ends_with('\\');
            if goes_on {
                command.pop();
            }
        }
    }
    found
}

/// As a person types it who has the program on his path.
fn typed(command: &str) -> String {
    command.replace("cargo run --release -- ", "isotherm ")
}

/// The words of a command of ours, as a shell gives them to it.
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

/// In blocks, run or not, and within sentences.
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
            // "identify --balls" alone speaks of the option.
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
    let mut wrong = Vec::new();
    for chapter in chapters() {
        wrong.extend(mistakes_of(&chapter));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

fn mistakes_of(chapter: &Chapter) -> Vec<String> {
    let blocks = chapter.blocks();
    let runs = |block: &&Block| is_of_a_shell(block) && block.says("by-hand").is_none();
    let blocks: Vec<&Block> = blocks.iter().filter(runs).collect();
    let mut wrong = Vec::new();
    if blocks.is_empty() {
        return wrong;
    }
    let mut shop = Shop::of(chapter);
    for block in blocks {
        if block.is("mistaken") {
            shop.make_mistakes();
        }
        for (command, shown) in commands(block) {
            if let Some(script) = command.split_whitespace().next().filter(|word| word.starts_with("tests/"))
            {
                assert!(root().join(script).is_file(), "{}: there is no {script}", block.place);
                continue;
            }
            let (said, code) = shop.run(&hurried(&typed(&command)));
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

/// A day in some seconds, with its page on a port that is free.
fn hurried(command: &str) -> String {
    let is_demo = command.split_whitespace().nth(1) == Some("demo");
    let plain = command.split(" #").next().unwrap().trim_end();
    if is_demo { format!("{plain} --speed 6000 --listen 127.0.0.1:0") } else { plain.to_owned() }
}

/// Whether the lines are printed, in this order; the first one that is not.
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

/// "12 rows over 1m 40s" is "# rows over #".
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
