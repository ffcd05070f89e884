use super::number::Number;
use super::*;
use crate::gateway::store::disk::Files;

const MACHINE: &str = "grinder-1";

/// Directory with a document in it.
struct Bench(tempfile::TempDir);

impl Bench {
    /// Directory after this many saves, each with its number.
    fn new(writings: u64) -> Bench {
        let bench = Bench(tempfile::tempdir().unwrap());
        (0..writings).for_each(|_| bench.write());
        bench
    }

    fn open(&self) -> Opened {
        self.open_beside(false)
    }

    fn open_beside(&self, has_logs: bool) -> Opened {
        let disk: Arc<dyn Disk> = Arc::new(Files);
        open(&disk, (self.0.path(), MACHINE), has_logs, Moment::from_nanos(7))
    }

    /// Saves the document in a separate run.
    fn write(&self) {
        let mut file = self.open().file;
        let number = file.seal.number;
        file.set_state(&number);
        file.save().and_then(|()| file.save_number()).unwrap();
    }

    fn path(&self, ending: &str) -> PathBuf {
        self.0.path().join(format!("{MACHINE}.{ending}"))
    }

    fn bytes(&self, ending: &str) -> Vec<u8> {
        std::fs::read(self.path(ending)).unwrap()
    }

    fn put(&self, ending: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(ending), bytes).unwrap();
    }

    /// Reason why the document is not accepted. If there is one, every axis must wait for an operator.
    #[track_caller]
    fn unfit(&self) -> Option<String> {
        let opened = self.open();
        let unfit = opened.found.err();
        assert_eq!(opened.file.question().is_open(), unfit.is_some(), "{unfit:?}");
        unfit
    }

    #[track_caller]
    fn is_unfit(&self, words: &str) {
        let unfit = self.unfit();
        assert!(unfit.as_ref().is_some_and(|why| why.contains(words)), "not `{words}`: {unfit:?}");
    }

    fn seal(&self) -> Seal {
        document::read(&self.bytes(STATE), MACHINE).unwrap().0
    }
}

const STATE: &str = "state.json";
const NUMBER: &str = "number";

#[test]
fn what_is_saved_is_found_again_with_a_number_that_grows_over_restarts() {
    let bench = Bench::new(3);
    assert_eq!(bench.open().found.unwrap().unwrap().state, Some(2.into()));
    let Seal { number, named, since, in_question, .. } = bench.seal();
    assert_eq!((number, named, since, in_question), (3, 2, Moment::from_nanos(7), false));
    let line = String::from_utf8(bench.bytes(NUMBER)).unwrap();
    assert!(line.starts_with("3 7 ") && line.ends_with('\n') && line.lines().count() == 1, "{line}");
    assert_eq!(std::fs::read_dir(bench.0.path()).unwrap().count(), 2, "nothing else is left behind");
}

#[test]
fn nothing_at_all_is_a_first_start_except_beside_the_logs_of_a_run() {
    let bench = Bench::new(0);
    assert!(bench.unfit().is_none() && bench.open().is_first);
    let beside_logs = bench.open_beside(true);
    assert!(beside_logs.found.is_err_and(|why| why.contains("contains logs of a run")));
    assert!(!beside_logs.is_first && !Bench::new(1).open().is_first);
}

#[test]
fn no_byte_of_document_and_number_can_change_without_being_found() {
    let bench = Bench::new(2);
    for ending in [STATE, NUMBER] {
        let whole = bench.bytes(ending);
        for place in 0..whole.len() {
            for flip in [1_u8, 2, 4, 8, 16, 32, 64, 128, 255] {
                let mut bytes = whole.clone();
                bytes[place] ^= flip;
                bench.put(ending, &bytes);
                assert!(bench.unfit().is_some(), "byte {place} of {ending} with {flip}");
            }
        }
        bench.put(ending, &whole);
    }
    assert_eq!(bench.unfit(), None);
}

#[test]
fn cut_at_every_length_neither_is_accepted() {
    let bench = Bench::new(2);
    for ending in [STATE, NUMBER] {
        let whole = bench.bytes(ending);
        for length in 0..whole.len() {
            bench.put(ending, &whole[..length]);
            assert!(bench.unfit().is_some(), "{length} bytes of {ending}");
        }
        bench.put(ending, &whole);
    }
}

#[test]
fn an_older_document_and_an_older_number_do_not_fit() {
    for (ending, words) in
        [(STATE, "the file is an older copy"), (NUMBER, "the file with the save number is an older copy")]
    {
        let bench = Bench::new(2);
        let older = bench.bytes(ending);
        (0..3).for_each(|_| bench.write());
        bench.put(ending, older);
        bench.is_unfit(words);
        // The next save has a number that neither of them had.
        let next = bench.open().file.seal.number + 1;
        assert_eq!(next, 6, "{ending}");
    }
}

#[test]
fn a_number_that_is_older_by_one_was_killed_before_it_and_one_that_is_newer_by_one_has_another_document() {
    let bench = Bench::new(3);
    let (document, number) = (bench.bytes(STATE), bench.bytes(NUMBER));
    bench.write();
    let newer = bench.bytes(NUMBER);
    bench.put(NUMBER, &number);
    assert_eq!(bench.unfit(), None);
    bench.put(STATE, &document);
    bench.put(NUMBER, &newer);
    bench.is_unfit("the file is an older copy");
}

#[test]
fn killed_after_any_number_of_promises_without_a_number_the_document_fits() {
    let bench = Bench::new(2);
    let mut file = bench.open().file;
    (0..5).for_each(|_| file.save().unwrap());
    assert_eq!((bench.seal().number, bench.seal().named), (7, 2));
    assert_eq!(bench.unfit(), None);
}

#[test]
fn killed_between_the_very_first_document_and_its_number_it_fits_and_later_a_missing_number_does_not() {
    let bench = Bench::new(0);
    let mut file = bench.open().file;
    (0..2).for_each(|_| file.save().unwrap());
    assert_eq!(bench.unfit(), None);
    (0..2).for_each(|_| bench.write());
    std::fs::remove_file(bench.path(NUMBER)).unwrap();
    bench.is_unfit("the file with its save number is missing");
}

#[test]
fn a_document_that_is_gone_is_missed_by_its_number() {
    let bench = Bench::new(2);
    std::fs::remove_file(bench.path(STATE)).unwrap();
    bench.is_unfit("the file is missing, but the file with its save number exists (2)");
    std::fs::remove_file(bench.path(NUMBER)).unwrap();
    assert!(bench.open().is_first, "to begin again, a person removes both");
}

#[test]
fn a_number_that_somebody_removes_is_written_with_the_next_promise() {
    let bench = Bench::new(1);
    let mut file = bench.open().file;
    file.save().and_then(|()| file.save_number()).unwrap();
    std::fs::remove_file(bench.path(NUMBER)).unwrap();
    file.save().and_then(|()| file.save_number()).unwrap();
    assert_eq!(bench.unfit(), None);
    file.save().and_then(|()| file.save_number()).unwrap();
    assert!(bench.bytes(NUMBER).starts_with(b"3 "), "else it follows the state alone");
}

#[test]
fn a_document_of_another_machine_or_of_one_of_the_same_name_elsewhere_does_not_fit() {
    let bench = Bench::new(2);
    let seal = Seal { number: 90, ..bench.seal() };
    let elsewhere = Seal { since: Moment::from_nanos(6), ..seal.clone() };
    bench.put(STATE, document::render(&elsewhere, b"0", []).unwrap());
    bench.is_unfit("a copy from elsewhere");
    let other = Seal { machine: "lathe-2".to_owned(), ..seal };
    bench.put(STATE, document::render(&other, b"0", []).unwrap());
    bench.is_unfit("the file belongs to another machine, lathe-2");
}

#[test]
fn the_question_outlives_what_raised_it_until_a_person_has_armed() {
    let bench = Bench::new(2);
    bench.put(STATE, "{ half");
    for _ in 0..3 {
        assert!(bench.open().file.question().is_open());
        bench.write();
    }
    let mut opened = bench.open();
    assert!(opened.found.is_ok() && opened.file.question().is_open());
    opened.file.question().close();
    opened.file.save().unwrap();
    assert!(!bench.open().file.question().is_open());
}

#[test]
fn what_is_not_accepted_is_kept_beside_and_never_overwrites_what_was_kept_before() {
    let bench = Bench::new(2);
    for (bad, ending) in [("{ one", "bad"), ("{ two", "bad.2"), ("{ three", "bad.3")] {
        bench.put(STATE, bad);
        let number = bench.bytes(NUMBER);
        bench.is_unfit(&format!("{STATE}.{ending} and "));
        bench.write();
        assert_eq!(bench.bytes(&format!("{STATE}.{ending}")), bad.as_bytes());
        assert_eq!(bench.bytes(&format!("{NUMBER}.{ending}")), number);
    }
}

#[test]
fn a_document_of_a_later_version_is_refused_with_words_and_never_replaced() {
    let bench = Bench::new(2);
    let later = br#"{ "version": 99, "whatever": [] }"#;
    bench.put(STATE, later);
    let refused = may_start(&Files, bench.0.path(), MACHINE).unwrap_err();
    for words in ["a later version of this program", "layout 99", "grinder-1.state.json", "Run that version"]
    {
        assert!(refused.contains(words), "{refused}");
    }
    assert!(bench.open().file.save().is_err());
    assert_eq!(bench.bytes(STATE), later);
}

#[test]
fn what_a_power_cut_left_of_a_writing_is_no_part_of_the_next() {
    let bench = Bench::new(2);
    for ending in [STATE, NUMBER] {
        let (whole, new) = (bench.bytes(ending), bench.path(ending).with_added_extension("new"));
        for cut in 0..=whole.len() {
            std::fs::write(&new, &whole[..cut]).unwrap();
            assert_eq!(bench.unfit(), None);
            bench.write();
            assert!(!new.exists());
        }
    }
}

#[test]
fn a_number_is_read_only_as_it_was_written() {
    let bench = Bench::new(0);
    let number = Number { number: 17, since: Moment::from_nanos(1_795_823_557_453_364_912) };
    let line = number.line();
    let found = |text: &str| {
        bench.put(NUMBER, text);
        number::read_number(&Files, bench.0.path(), MACHINE).1
    };
    assert_eq!(found(&line), Ok(Some(number)));
    for wrong in
        [line.trim_end(), &line.replace("17 ", "017 "), &format!("{line}\n"), &line.to_uppercase(), ""]
    {
        let is_same = wrong == line;
        assert!(found(wrong).is_err() || is_same, "{wrong:?}");
    }
}

/// Files that version f2a36f8a has written for a machine named `mixed`.
fn of_an_earlier_version(ledger: &str) -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(directory.path().join(name), bytes).unwrap();
    put("mixed.state.json", include_bytes!("../../../../tests/gateway/earlier/stopped/mixed.state.json"));
    put(ledger, include_bytes!("../../../../tests/gateway/earlier/stopped/mixed.ledger.json"));
    directory
}

#[test]
fn state_and_ledger_of_an_earlier_version_become_one_document_by_name() {
    let disk: Arc<dyn Disk> = Arc::new(Files);
    for (ledger, in_order) in [("mixed.ledger.json", true), ("mixed.ledger.begun.json", false)] {
        let directory = of_an_earlier_version(ledger);
        let opened = open(&disk, (directory.path(), "mixed"), true, Moment::from_nanos(7));
        assert_eq!(opened.earlier.map(|(layout, _)| layout), Some(4));
        let Content { state, outputs } = opened.found.unwrap().unwrap();
        let machine = &state.unwrap()["machine"];
        for signal in ["bed", "head"] {
            assert!(machine["start"][signal]["value"].is_number(), "{machine}");
        }
        let lags = machine["axes"]["z"]["lags"].as_array().unwrap();
        assert_eq!(lags.iter().map(|lag| &lag["signal"]).collect::<Vec<_>>(), ["bed", "head"]);
        assert_eq!(outputs.keys().collect::<Vec<_>>(), ["set_x", "set_y", "shared", "whole"]);
        assert!(outputs.values().all(|entry| entry.kept.in_order == in_order));
        assert_eq!(outputs["shared"].kept.account.unwrap().share.0, 32);
    }
}
