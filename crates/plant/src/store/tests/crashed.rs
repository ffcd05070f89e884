//! Tests in which the program ends at any byte that it writes.

use super::*;

/// Environment variable with the directory of the child process.
const KEPT_IN: &str = "TEST_KEPT_IN";

type Files = BTreeMap<String, Vec<u8>>;

/// All states of the directory between `before` and `after`.
///
/// A write first removes files, then marks their records, then writes. A publication first marks, then removes.
fn between(before: &Files, after: &Files, is_push: bool) -> Vec<Files> {
    let mut states = vec![before.clone()];
    if is_push {
        remove(&mut states, after);
        mark(&mut states, after);
        grow(&mut states, after);
    } else {
        mark(&mut states, after);
        remove(&mut states, after);
    }
    assert_eq!(states.last(), Some(after), "the test does not know what happens");
    states
}

fn remove(states: &mut Vec<Files>, after: &Files) {
    let mut now = states.last().unwrap().clone();
    let gone: Vec<String> = now.keys().filter(|name| !after.contains_key(*name)).cloned().collect();
    for name in gone {
        now.remove(&name);
        states.push(now.clone());
    }
}

fn mark(states: &mut Vec<Files>, after: &Files) {
    let mut now = states.last().unwrap().clone();
    let Some(mark) = after.get("told").filter(|mark| now.get("told") != Some(mark)) else { return };
    for length in 0..=mark.len() {
        now.insert("told.new".to_owned(), mark[..length].to_vec());
        states.push(now.clone());
    }
    now.remove("told.new");
    now.insert("told".to_owned(), mark.clone());
    states.push(now);
}

fn grow(states: &mut Vec<Files>, after: &Files) {
    let mut now = states.last().unwrap().clone();
    for (name, bytes) in after {
        let written = now.get(name).map_or(0, Vec::len);
        if now.get(name) == Some(bytes) {
            continue;
        }
        for length in written..=bytes.len() {
            now.insert(name.clone(), bytes[..length].to_vec());
            states.push(now.clone());
        }
    }
}

/// Opens the store after a crash, and appends one more record. Returns the numbers of the records before that one.
fn found_after(crash: &Files, directory: &Path) -> Vec<u64> {
    lay(directory, crash);
    // Room for one more file than can exist.
    let open = || Store::in_files_of(directory, MOST + 8192, IN_ONE_FILE).unwrap();
    let mut store = open();
    let waiting = store.len();
    store.push(&record(999)).unwrap();
    drop(store);
    let mut store = open();
    let mut found = all(&mut store);
    assert_eq!(found.pop(), Some(999));
    assert!(u64::try_from(found.len()).unwrap() <= waiting);
    found
}

#[test]
fn killed_at_any_byte_every_record_is_there_once_unchanged_and_in_order() {
    let (live, crashed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut store = open(live.path());
    let (mut pushed, mut first, mut crashes) = (0, 0, 0);
    // Files are created, filled, published in part and as a whole, and removed.
    for step in "pppptpppttpppppppppppppppppppptttttttttttpp".chars() {
        let before = files(live.path());
        let (was_pushed, was_first) = (pushed, first);
        if step == 'p' {
            store.push(&record(pushed)).unwrap();
            pushed += 1;
            first += store.dropped();
        } else {
            let count = u64::try_from(store.first(2).unwrap().len()).unwrap();
            store.drop_first(2).unwrap();
            first = pushed.min(first + count.max(2));
        }
        let after = files(live.path());
        let allowed: Vec<Vec<u64>> = [(was_first, was_pushed), (first, was_pushed), (first, pushed)]
            .map(|(from, to)| (from..to).collect())
            .to_vec();
        for crash in between(&before, &after, step == 'p') {
            let found = found_after(&crash, crashed.path());
            assert!(allowed.contains(&found), "{step}: {found:?} is none of {allowed:?}: {crash:?}");
            crashes += 1;
        }
    }
    assert!(crashes > 1000, "{crashes}");
    assert_eq!(first, pushed - store.len());
}

/// Checks that each record is on disk when `push` returns. With [`KEPT_IN`], this test is the child process of the test
/// below, and writes records until it is killed.
#[test]
fn a_record_is_on_disk_when_push_comes_back() {
    use std::io::Write;
    let Ok(directory) = std::env::var(KEPT_IN) else {
        let directory = tempfile::tempdir().unwrap();
        let mut store = open(directory.path());
        for number in 0..5 {
            store.push(&record(number)).unwrap();
            let mut found = Vec::new();
            for first in super::super::segment::numbers(directory.path()).unwrap() {
                let segment = super::super::segment::Segment::open(directory.path(), first).unwrap().unwrap();
                found.extend(segment.records(directory.path(), 0, 9).unwrap());
            }
            assert_eq!(numbers(&found), (0..=number).collect::<Vec<u64>>());
        }
        return;
    };
    let mut store = Store::in_files_of(Path::new(&directory), 1 << 22, 4096).unwrap();
    for number in store.next.. {
        store.push(&record(number)).unwrap();
        writeln!(std::io::stderr(), "kept {number}").unwrap();
    }
}

#[test]
fn a_process_that_is_killed_has_kept_every_record_that_it_has_said_to_have() {
    use std::io::{BufRead, BufReader};
    let directory = tempfile::tempdir().unwrap();
    let mut said = 0;
    let name = "store::tests::crashed::a_record_is_on_disk_when_push_comes_back";
    for round in 1..=8 {
        let mut child = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", name, "--nocapture"])
            .env(KEPT_IN, directory.path())
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let kept = |line: &str| line.strip_prefix("kept ").and_then(|number| number.parse::<u64>().ok());
        // The process is killed after a different number of records each time.
        for line in lines.by_ref().take(round * 97) {
            said = kept(&line.unwrap()).unwrap_or(said);
        }
        child.kill().unwrap();
        child.wait().unwrap();
        said = lines.map_while(Result::ok).filter_map(|line| kept(&line)).last().unwrap_or(said);
    }
    let mut store = Store::in_files_of(directory.path(), 1 << 22, 4096).unwrap();
    assert!(said > 1000 && store.dropped() == 0, "{said}");
    let found = all(&mut store);
    // The last record may have been written but not yet reported.
    let last = *found.last().unwrap();
    assert!(last == said || last == said + 1, "{last} {said}");
    assert_eq!(found, (0..=last).collect::<Vec<u64>>());
}
