use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use proptest::prelude::*;

use super::{DiskNews, Store};
use crate::interface::Record;

mod crashed;
mod damaged;

/// Size for six files with two or three records each.
const MOST: u64 = 6 * 4096;
const IN_ONE_FILE: u64 = 100;

fn open(directory: &Path) -> Store {
    Store::in_files_of(directory, MOST, IN_ONE_FILE).unwrap()
}

/// Record that differs from every other one.
fn record(number: u64) -> Record {
    let length = usize::try_from(number * 7 % 23).unwrap();
    Record([number.to_le_bytes().to_vec(), vec![0xa5; length]].concat())
}

fn numbers(records: &[Record]) -> Vec<u64> {
    let number = |record: &Record| u64::from_le_bytes(*record.0.first_chunk().unwrap());
    let numbers: Vec<u64> = records.iter().map(number).collect();
    let expected: Vec<Record> = numbers.iter().map(|number| self::record(*number)).collect();
    assert_eq!(records, expected, "a record has changed");
    numbers
}

fn all(store: &mut Store) -> Vec<u64> {
    // The records of one file are returned together.
    let mut found = Vec::new();
    loop {
        let some = store.first(2).unwrap();
        if some.is_empty() {
            return numbers(&found);
        }
        store.drop_first(some.len()).unwrap();
        found.extend(some);
    }
}

/// Files in a directory, with their content.
fn files(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(directory).unwrap().map(Result::unwrap);
    let read =
        |entry: fs::DirEntry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap());
    entries.map(read).collect()
}

fn lay(directory: &Path, files: &BTreeMap<String, Vec<u8>>) {
    for entry in fs::read_dir(directory).unwrap() {
        fs::remove_file(entry.unwrap().path()).unwrap();
    }
    for (name, bytes) in files {
        fs::write(directory.join(name), bytes).unwrap();
    }
}

#[test]
fn records_come_back_in_order_and_stay_until_they_were_told() {
    let directory = tempfile::tempdir().unwrap();
    let mut store = open(directory.path());
    for number in 0..10 {
        store.push(&record(number)).unwrap();
    }
    assert_eq!(store.len(), 10);
    assert_eq!(numbers(&store.first(2).unwrap()), [0, 1]);
    assert_eq!(numbers(&store.first(2).unwrap()), [0, 1]);
    store.drop_first(1).unwrap();
    assert_eq!(numbers(&store.first(2).unwrap()), [1, 2]);
    drop(store);
    let mut store = open(directory.path());
    assert_eq!((store.len(), store.dropped()), (9, 0));
    store.push(&record(10)).unwrap();
    assert_eq!(all(&mut store), (1..=10).collect::<Vec<u64>>());
    assert_eq!((store.len(), store.is_empty(), store.dropped()), (0, true, 0));
    assert_eq!(files(directory.path()).keys().collect::<Vec<_>>(), ["told"]);
}

#[test]
fn what_was_told_does_not_come_again_after_all_files_are_gone() {
    let directory = tempfile::tempdir().unwrap();
    for number in 0..20 {
        let mut store = open(directory.path());
        store.push(&record(number)).unwrap();
        assert_eq!(numbers(&store.first(9).unwrap()), [number]);
        store.drop_first(1).unwrap();
        assert_eq!(store.dropped(), 0);
    }
}

#[test]
fn a_full_store_loses_its_oldest_and_says_how_many() {
    let directory = tempfile::tempdir().unwrap();
    let mut store = open(directory.path());
    for number in 0..1000 {
        store.push(&record(number)).unwrap();
        assert!(store.bytes() <= MOST, "{}", store.bytes());
        let on_disk: usize = files(directory.path()).values().map(Vec::len).sum();
        assert!(on_disk < 6 * 4096 + 12, "{on_disk}");
    }
    let (waiting, dropped) = (store.len(), store.dropped());
    assert_eq!((waiting + dropped, store.dropped()), (1000, 0));
    assert!(waiting >= 10, "{waiting}");
    drop(store);
    let mut store = open(directory.path());
    assert_eq!(store.dropped(), 0);
    assert_eq!(all(&mut store), (dropped..1000).collect::<Vec<u64>>());
}

#[test]
fn a_file_that_somebody_has_removed_is_counted_and_holds_up_nothing() {
    let home = tempfile::tempdir().unwrap();
    let mut store = open(home.path());
    let mut number = 0;
    while files(home.path()).len() < 4 {
        store.push(&record(number)).unwrap();
        number += 1;
    }
    let oldest = files(home.path()).into_keys().find(|name| name.ends_with(".records")).unwrap();
    std::fs::remove_file(home.path().join(oldest)).unwrap();
    let published = all(&mut store);
    assert_eq!(u64::try_from(published.len()).unwrap() + store.dropped(), number, "{published:?}");
    assert_eq!(published.last(), Some(&(number - 1)));
    assert_eq!(store.news(), None);
}

#[test]
fn what_was_told_and_has_to_go_is_not_lost() {
    let directory = tempfile::tempdir().unwrap();
    let mut store = open(directory.path());
    for number in 0..100 {
        store.push(&record(number)).unwrap();
        if store.len() > 3 {
            store.drop_first(1).unwrap();
        }
    }
    assert_eq!((store.dropped(), all(&mut store)), (0, vec![97, 98, 99]));
}

#[test]
fn a_store_that_may_take_less_than_before_gives_up_its_oldest_when_it_is_opened() {
    let directory = tempfile::tempdir().unwrap();
    let mut store = Store::in_files_of(directory.path(), 20 * 4096, IN_ONE_FILE).unwrap();
    for number in 0..40 {
        store.push(&record(number)).unwrap();
    }
    drop(store);
    let mut store = open(directory.path());
    assert!(store.bytes() <= MOST);
    let dropped = store.dropped();
    assert!(dropped > 20, "{dropped}");
    assert_eq!(all(&mut store), (dropped..40).collect::<Vec<u64>>());
}

#[test]
fn a_record_that_is_longer_than_all_may_be_is_refused_and_counted_and_the_disk_is_not_blamed() {
    let directory = tempfile::tempdir().unwrap();
    let mut store = open(directory.path());
    store.push(&record(1)).unwrap();
    for length in [25_000, 2_000_000] {
        let error = store.push(&Record(vec![0; length])).unwrap_err();
        assert_eq!(error.to_string(), "the record is longer than allowed");
    }
    assert_eq!((store.dropped(), store.news()), (2, None));
    // A record of exactly the maximum size fits.
    let longest = Record(vec![7; 6 * 4096 - 28]);
    store.push(&longest).unwrap();
    assert_eq!((store.dropped(), store.first(9).unwrap()), (1, vec![longest]));
}

#[test]
fn a_disk_that_fails_is_told_once_and_once_again_when_it_works_with_what_was_lost() {
    let parent = tempfile::tempdir().unwrap();
    let directory = parent.path().join("kept");
    let mut store = open(&directory);
    fs::remove_dir_all(&directory).unwrap();
    for number in 0..5 {
        store.push(&record(number)).unwrap_err();
    }
    assert!(matches!(store.news(), Some(DiskNews::Fails(why)) if why.contains("No such file")));
    assert_eq!((store.news(), store.len()), (None, 0));
    fs::create_dir(&directory).unwrap();
    for number in 5..7 {
        store.push(&record(number)).unwrap();
    }
    assert_eq!(store.news(), Some(DiskNews::Works { lost: 5 }));
    assert_eq!((store.news(), all(&mut store)), (None, vec![5, 6]));
}

#[test]
fn a_mark_that_cannot_be_written_is_told_once_and_nothing_comes_twice_before_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    let mut store = open(directory.path());
    for number in 0..6 {
        store.push(&record(number)).unwrap();
    }
    fs::create_dir(directory.path().join("told.new")).unwrap();
    for number in 0..5 {
        assert_eq!(numbers(&store.first(1).unwrap()), [number]);
        store.drop_first(1).unwrap_err();
    }
    assert!(matches!((store.news(), store.news()), (Some(DiskNews::Fails(_)), None)));
    fs::remove_dir(directory.path().join("told.new")).unwrap();
    store.push(&record(6)).unwrap();
    assert_eq!((store.news(), all(&mut store)), (Some(DiskNews::Works { lost: 0 }), vec![5, 6]));
}

#[test]
fn a_directory_that_cannot_be_made_is_an_error_at_the_start() {
    let parent = tempfile::tempdir().unwrap();
    let file = parent.path().join("file");
    fs::write(&file, "x").unwrap();
    assert!(Store::open(file.join("kept"), 1 << 20).is_err());
}

#[test]
fn files_of_others_in_the_directory_are_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let others = ["notes.txt", "1.records", "00000000000000000000.recordsx", "-0000000000000000001.records"];
    for name in others {
        fs::write(directory.path().join(name), "mine").unwrap();
    }
    let mut store = open(directory.path());
    store.push(&record(0)).unwrap();
    assert_eq!(all(&mut store), [0]);
    assert!(others.iter().all(|name| directory.path().join(name).exists()));
}

#[derive(Clone, Debug)]
enum Step {
    Push,
    Tell(usize),
    Restart,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        5 => Just(Step::Push),
        2 => (0usize..6).prop_map(Step::Tell),
        1 => Just(Step::Restart),
    ];
    proptest::collection::vec(step, 0..120)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// With any sequence of writes, publications and restarts, no record is returned twice or out of order. The number
    /// of missing records equals the count.
    #[test]
    fn each_record_is_told_once_in_order_or_counted(steps in steps()) {
        let directory = tempfile::tempdir().unwrap();
        let mut store = open(directory.path());
        let (mut pushed, mut published, mut dropped) = (0, Vec::new(), 0);
        for step in steps {
            match step {
                Step::Push => {
                    store.push(&record(pushed)).unwrap();
                    pushed += 1;
                }
                Step::Tell(count) => {
                    let some = store.first(count).unwrap();
                    prop_assert!(some.len() <= count);
                    store.drop_first(some.len()).unwrap();
                    published.extend(numbers(&some));
                }
                Step::Restart => {
                    dropped += store.dropped();
                    drop(store);
                    store = open(directory.path());
                }
            }
        }
        published.extend(all(&mut store));
        dropped += store.dropped();
        prop_assert!(published.is_sorted_by(|one, next| one < next));
        prop_assert_eq!(u64::try_from(published.len()).unwrap() + dropped, pushed);
    }
}
