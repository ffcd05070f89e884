use std::time::Duration;

use super::*;
use crate::observe::events::Event;

const DAY: &str = "2026-01-31";

fn entry(second: u64) -> Entry {
    let noon = time::parse("2026-01-31T12:00:00Z").unwrap();
    Event::KeptAgain { what: format!("number {second}") }.entry(noon.after(Duration::from_secs(second)))
}

/// Texts and damage that are read from a file of `count` events after `spoil` has changed its lines.
fn spoilt(count: u64, spoil: impl FnOnce(&mut Vec<String>)) -> (Vec<String>, Vec<String>) {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m", DAY);
    let mut end = End::of_nothing(&path);
    let mut lines = Vec::new();
    for second in 1..=count {
        let (line, behind) = end.line(&entry(second));
        (end, _) = (behind, lines.push(line));
    }
    spoil(&mut lines);
    std::fs::write(&path, lines.concat()).unwrap();
    read_all(&path)
}

fn read_all(path: &Path) -> (Vec<String>, Vec<String>) {
    let (mut texts, mut damage) = (Vec::new(), Vec::new());
    read(path, |found| match found {
        FileItem::Event(entry) => texts.push(entry.text),
        FileItem::Damage(what) => damage.push(what.rsplit_once(DAY).unwrap().1.to_owned()),
    })
    .unwrap();
    (texts, damage)
}

#[test]
fn a_file_that_nobody_touched_is_read_without_a_word() {
    let (texts, damage) = spoilt(5, |_| {});
    assert_eq!((texts.len(), damage), (5, vec![]));
    assert_eq!(texts[4], "number 5 is saved again");
}

#[test]
fn a_line_that_was_changed_cut_or_taken_out_is_found_and_the_rest_is_read() {
    let (texts, damage) = spoilt(5, |lines| lines[2] = lines[2].replace("number 3", "number 9"));
    assert_eq!(texts.len(), 5);
    assert_eq!(damage, [".events.jsonl, line 3: the line was changed: its checksum is wrong"]);

    let (texts, damage) = spoilt(5, |lines| drop(lines.remove(2)));
    assert_eq!(texts.len(), 4);
    assert_eq!(damage, [".events.jsonl, line 3: after event 2 comes event 4: lines are missing"]);

    let (texts, damage) = spoilt(5, |lines| drop(lines.remove(0)));
    assert_eq!((texts.len(), damage.len()), (4, 1));

    let (texts, damage) = spoilt(5, |lines| lines.swap(1, 2));
    assert_eq!((texts.len(), damage.len()), (5, 3));

    for cut in 1..40 {
        let (texts, damage) = spoilt(5, |lines| {
            let left = lines[4].len() - cut;
            // A line without its line end is still complete.
            lines[4].truncate(left);
        });
        assert_eq!((texts.len(), damage.len()), if cut == 1 { (5, 0) } else { (4, 1) }, "{cut}: {damage:?}");
    }
}

#[test]
fn every_bit_of_a_line_that_falls_over_is_found() {
    let (_, end) = {
        let end = End::of_nothing(Path::new("m"));
        end.line(&entry(1))
    };
    let (line, _) = end.line(&entry(2));
    let bits = line.len() * 8;
    for bit in (0..bits).step_by(3) {
        let (_, damage) = spoilt(3, |lines| {
            let mut bytes = std::mem::take(&mut lines[1]).into_bytes();
            let end = bytes.len() * 8 - 8;
            let bit = bit % end;
            bytes[bit / 8] ^= 1 << (bit % 8);
            // A line that is no valid text any more is replaced by one invalid character.
            lines[1] = String::from_utf8(bytes).unwrap_or_else(|_| "\u{fffd}\n".to_owned());
        });
        assert!(!damage.is_empty(), "bit {bit} fell over and nobody noticed");
    }
}

#[test]
fn a_file_in_the_place_of_another_days_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let (line, _) = End::of_nothing(&path(directory.path(), "m", "2026-01-30")).line(&entry(1));
    let other = path(directory.path(), "m", DAY);
    std::fs::write(&other, line).unwrap();
    let (texts, damage) = read_all(&other);
    assert_eq!(texts.len(), 1);
    let words = "this line does not match the previous line: lines were changed or moved";
    assert_eq!(damage, [format!(".events.jsonl, line 1: {words}")]);
}

#[test]
fn what_follows_half_a_line_is_whole() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m", DAY);
    let (first, end) = End::of_nothing(&path).line(&entry(1));
    let (second, _) = end.line(&entry(2));
    std::fs::write(&path, format!("{first}{}", &second[..20])).unwrap();
    let end = read(&path, |_| {}).unwrap();
    let (third, _) = end.line(&entry(3));
    std::fs::write(&path, format!("{first}{}{third}", &second[..20])).unwrap();
    let (texts, damage) = read_all(&path);
    assert_eq!(texts, ["number 1 is saved again", "number 3 is saved again"]);
    assert_eq!(damage, [".events.jsonl, line 2: not an event: the line is cut or overwritten"]);
}

#[test]
fn what_is_no_file_is_not_waited_for() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::create_dir(path(directory.path(), "m", DAY)).unwrap();
    assert!(read(&path(directory.path(), "m", DAY), |_| {}).is_err());
    let mut found = Vec::new();
    since(directory.path(), "m", Moment::default(), |one| {
        found.push(one);
        true
    })
    .unwrap();
    assert!(matches!(&found[..], [FileItem::Damage(what)] if what.contains("cannot be read")), "{found:?}");
}

#[test]
fn those_of_a_machine_are_told_apart_from_those_of_one_whose_name_begins_alike() {
    let directory = tempfile::tempdir().unwrap();
    for (machine, second) in [("m", 1), ("m-2", 2)] {
        let path = path(directory.path(), machine, DAY);
        std::fs::write(&path, End::of_nothing(&path).line(&entry(second)).0).unwrap();
    }
    assert_eq!(machines(directory.path()).unwrap(), ["m", "m-2"]);
    let texts: Vec<String> = last(directory.path(), "m", 10).into_iter().map(|entry| entry.text).collect();
    assert_eq!(texts, ["number 1 is saved again"]);
}

#[test]
fn behind_the_day_in_which_no_more_is_wanted_nothing_is_read() {
    let directory = tempfile::tempdir().unwrap();
    for day in ["2026-01-30", DAY] {
        let path = path(directory.path(), "m", day);
        std::fs::write(&path, End::of_nothing(&path).line(&entry(1)).0).unwrap();
    }
    for (wanted, read) in [(true, 2), (false, 1)] {
        let mut count = 0;
        since(directory.path(), "m", Moment::default(), |_| {
            count += 1;
            wanted
        })
        .unwrap();
        assert_eq!(count, read);
    }
}
