use std::path::Path;

use super::pair::{Opened, open_both, refuse_later};
use super::*;
use crate::gateway::disk::Files;

const MACHINE: &str = "grinder-1";

fn of(which: Which, number: u64, other: u64) -> Seal {
    Seal {
        checksum: String::new(),
        kind: which,
        machine: MACHINE.to_owned(),
        since: Moment::from_nanos(5),
        number,
        other,
        in_question: false,
    }
}

/// A document as it is found at the next start.
pub(in crate::gateway) fn found_again(which: Which, content: &impl Serialize) -> Found {
    let bytes = seal(which.version(), of(which, 1, 0), content).unwrap();
    open(&bytes, (which, which.version()), MACHINE).unwrap()
}

/// A directory with two documents in it.
struct Bench(tempfile::TempDir);

impl Bench {
    /// Both as they are after so many writings of the one and of the other, in turns.
    fn new(writings: u64) -> Bench {
        let bench = Bench(tempfile::tempdir().unwrap());
        let [mut state, mut ledger] = bench.open(None);
        for number in 0..writings {
            state.file.save(&number).unwrap();
            ledger.file.save(&number).unwrap();
        }
        bench
    }

    fn open(&self, named: Option<named::Named>) -> [Opened; 2] {
        let disk: Arc<dyn Disk> = Arc::new(Files);
        open_both(&disk, self.0.path(), MACHINE, named, Moment::from_nanos(7))
    }

    fn path(&self, which: Which) -> PathBuf {
        which.path(self.0.path(), MACHINE)
    }

    fn bytes(&self, which: Which) -> Vec<u8> {
        std::fs::read(self.path(which)).unwrap()
    }

    fn put(&self, which: Which, bytes: &[u8]) {
        std::fs::write(self.path(which), bytes).unwrap();
    }

    /// Why the one and the other are not believed.
    #[track_caller]
    fn unfit(&self, named: Option<named::Named>) -> [Option<String>; 2] {
        let opened = self.open(named);
        let unfit = opened.each_ref().map(|opened| opened.found.as_ref().err().cloned());
        assert_eq!(opened[0].file.pair().is_in_question(), unfit.iter().any(Option::is_some));
        unfit
    }

    fn named(&self) -> named::Named {
        self.open(None)[0].file.pair().named()
    }
}

fn has(unfit: &Option<String>, words: &str) -> bool {
    unfit.as_ref().is_some_and(|why| why.contains(words))
}

#[test]
fn what_is_saved_is_found_again_and_a_pair_fits() {
    let bench = Bench::new(3);
    let [state, ledger] = bench.open(Some(bench.named()));
    assert!(matches!(state.found, Ok(Some(Found::Sealed(Seal { number: 3, other: 2, .. }, _)))), "{state:?}");
    assert!(
        matches!(ledger.found, Ok(Some(Found::Sealed(Seal { number: 3, other: 3, .. }, _)))),
        "{ledger:?}"
    );
    assert!(!state.file.pair().is_in_question());
    assert_eq!(std::fs::read_dir(bench.0.path()).unwrap().count(), 2, "nothing else is left behind");
}

#[test]
fn nothing_at_all_is_a_first_start() {
    let bench = Bench::new(0);
    assert_eq!(bench.unfit(None), [None, None]);
}

#[test]
fn no_byte_of_it_can_be_another_without_that_being_seen() {
    let bench = Bench::new(2);
    for which in [Which::State, Which::Ledger] {
        let whole = bench.bytes(which);
        for place in 0..whole.len() {
            for flip in [1_u8, 2, 4, 8, 16, 32, 64, 128, 255] {
                let mut bytes = whole.clone();
                bytes[place] ^= flip;
                let found = open(&bytes, (which, which.version()), MACHINE);
                assert!(found.is_err(), "byte {place} with {flip}: {found:?}");
            }
        }
    }
}

#[test]
fn cut_at_every_length_it_is_not_believed() {
    let bench = Bench::new(2);
    for which in [Which::State, Which::Ledger] {
        let whole = bench.bytes(which);
        for length in 0..whole.len() {
            let found = open(&whole[..length], (which, which.version()), MACHINE);
            assert!(matches!(found, Err(Unfit::Because(_))), "{length}: {found:?}");
        }
    }
}

#[test]
fn an_older_one_does_not_fit_what_the_other_says() {
    for which in [Which::State, Which::Ledger] {
        let bench = Bench::new(2);
        let older = bench.bytes(which);
        let [mut state, mut ledger] = bench.open(None);
        for _ in 0..2 {
            state.file.save(&0).unwrap();
            ledger.file.save(&0).unwrap();
            state.file.save(&0).unwrap();
        }
        bench.put(which, &older);
        let unfit = bench.unfit(None);
        assert!(has(&unfit[which as usize], "a copy from another day"), "{unfit:?}");
        assert_eq!(unfit[1 - which as usize], None);
    }
}

#[test]
fn a_kill_between_the_two_writings_fits() {
    let bench = Bench::new(2);
    for _ in 0..5 {
        bench.open(None)[0].file.save(&0).unwrap();
    }
    assert_eq!(bench.unfit(None), [None, None]);
    for _ in 0..5 {
        bench.open(None)[1].file.save(&0).unwrap();
    }
    assert_eq!(bench.unfit(None), [None, None]);
}

#[test]
fn both_replaced_by_an_older_pair_do_not_fit_the_log() {
    let (bench, later) = (Bench::new(2), Bench::new(2));
    for which in [Which::State, Which::Ledger] {
        later.put(which, &bench.bytes(which));
    }
    let [mut state, mut ledger] = later.open(None);
    state.file.save(&0).unwrap();
    ledger.file.save(&0).unwrap();
    let named = later.named();
    assert_eq!(later.unfit(Some(named)), [None, None]);
    let unfit = bench.unfit(Some(named));
    assert!(unfit.iter().all(|unfit| has(unfit, "older than the newest log says")), "{unfit:?}");
}

#[test]
fn one_that_is_gone_is_missed_by_what_knows_of_it() {
    for which in [Which::State, Which::Ledger] {
        let bench = Bench::new(2);
        let named = bench.named();
        std::fs::remove_file(bench.path(which)).unwrap();
        let unfit = bench.unfit(None);
        assert!(has(&unfit[which as usize], "it is missing, and the"), "{unfit:?}");
        std::fs::remove_file(bench.path([Which::Ledger, Which::State][which as usize])).unwrap();
        assert!(bench.unfit(Some(named)).iter().all(|unfit| has(unfit, "the newest log knows of one")));
        assert_eq!(bench.unfit(None), [None, None]);
    }
}

#[test]
fn the_one_in_place_of_the_other_and_one_of_another_machine_do_not_fit() {
    let bench = Bench::new(2);
    let [state, ledger] = [Which::State, Which::Ledger].map(|which| bench.bytes(which));
    bench.put(Which::State, &ledger);
    bench.put(Which::Ledger, &state);
    assert!(bench.unfit(None).iter().all(|unfit| has(unfit, "under another name")));
    let other = open(&state, (Which::State, Which::State.version()), "lathe-2");
    assert_eq!(other, Err(Unfit::Because("it is of another machine, grinder-1".to_owned())));
}

#[test]
fn a_copy_from_a_machine_of_the_same_name_does_not_fit() {
    for which in [Which::State, Which::Ledger] {
        let bench = Bench::new(2);
        let named = bench.named();
        let mut foreign = of(which, 90, 0);
        foreign.since = Moment::from_nanos(6);
        bench.put(which, &seal(which.version(), foreign, &0).unwrap());
        // Where no log says which of them belongs here, neither is believed.
        assert!(bench.unfit(None).iter().all(|unfit| has(unfit, "a copy from elsewhere")));
        let unfit = bench.unfit(Some(named));
        assert!(has(&unfit[which as usize], "a copy from elsewhere"), "{unfit:?}");
        assert_eq!(unfit[1 - which as usize], None);
    }
}

#[test]
fn the_question_outlives_what_raised_it_until_a_person_has_armed() {
    let bench = Bench::new(2);
    bench.put(Which::State, b"{ half");
    let mut opened = bench.open(None);
    for which in [Which::Ledger, Which::State, Which::State] {
        opened[which as usize].file.save(&1).unwrap();
        opened = bench.open(None);
        assert!(opened[0].file.pair().is_in_question(), "after {which:?}");
    }
    assert_eq!(bench.open(None).map(|opened| opened.found.is_ok()), [true, true]);
    opened[0].file.pair().answered();
    opened[0].file.save(&2).unwrap();
    assert!(!bench.open(None)[0].file.pair().is_in_question());
}

#[test]
fn what_is_not_believed_is_kept_beside_and_never_overwrites_what_was_kept_before() {
    let bench = Bench::new(2);
    for (bad, aside) in
        [("{ one", "state.json.bad"), ("{ two", "state.json.bad.2"), ("{ three", "state.json.bad.3")]
    {
        bench.put(Which::State, bad.as_bytes());
        let [mut state, _] = bench.open(None);
        assert!(has(&state.found.as_ref().err().cloned(), aside), "{state:?}");
        state.file.save(&1).unwrap();
        let kept = bench.0.path().join(format!("{MACHINE}.{aside}"));
        assert_eq!(std::fs::read_to_string(kept).unwrap(), bad);
    }
}

#[test]
fn one_of_a_later_version_is_refused_with_words_and_never_replaced() {
    let bench = Bench::new(2);
    let later = br#"{ "version": 99, "whatever": [] }"#;
    bench.put(Which::State, later);
    let refused = refuse_later(&Files, bench.0.path(), MACHINE).unwrap_err();
    for words in ["a later version of this program", "layout 99", "grinder-1.state.json", "run that version"]
    {
        assert!(refused.contains(words), "{refused}");
    }
    let [mut state, _] = bench.open(None);
    assert!(state.file.save(&1).is_err());
    assert_eq!(bench.bytes(Which::State), later);
}

#[test]
fn what_a_power_cut_left_of_a_writing_is_no_part_of_the_next() {
    let bench = Bench::new(2);
    let whole = bench.bytes(Which::State);
    let new = bench.path(Which::State).with_added_extension("new");
    for cut in 0..=whole.len() {
        std::fs::write(&new, &whole[..cut]).unwrap();
        let [mut state, _] = bench.open(None);
        assert!(state.found.is_ok() && !state.file.pair().is_in_question());
        state.file.save(&7).unwrap();
        assert!(!new.exists());
    }
}

#[test]
fn a_named_row_is_believed_only_as_it_was_written() {
    let named = Bench::new(3).named();
    let row = String::from_utf8(named.row(Moment::from_nanos(9))).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join(format!("{MACHINE}-2026-01-05.outputs.csv"));
    let newest = |text: &str| {
        std::fs::write(&log, text).unwrap();
        named::newest(directory.path(), MACHINE)
    };
    let before = "some,row\n".repeat(10) + &row;
    assert_eq!(newest(&(before.clone() + "another\nhal")), Some(named));
    assert_eq!(newest("nothing of it\n"), None);
    for place in 0..row.len() - 1 {
        let mut bytes = row.clone().into_bytes();
        bytes[place] ^= 1;
        let found = newest(&String::from_utf8_lossy(&bytes));
        assert!(found.is_none() || found == Some(named), "{place}");
    }
    assert!(Path::new(&log).exists());
}
