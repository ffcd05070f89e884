//! State and ledger held against each other: each names the number of the other that it last saw, and the newest log
//! names both. A document fits when it is not older than the others say.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use super::named::Named;
use super::{Found, Seal, SealedFile, Unfit, open};
use crate::fieldbus::explain::system;
use crate::gateway::disk::Disk;
use isotherm_core::quantity::Moment;

/// What the name ends with of a ledger that could not be written when a run began.
pub(in crate::gateway) const BEGUN: &str = "begun.json";
/// No gateway lives long enough to write as often.
const MOST: u64 = 1 << 60;

/// One of the two documents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::gateway) enum Which {
    State,
    Ledger,
}

impl Which {
    pub(in crate::gateway) fn name(self) -> &'static str {
        match self {
            Which::State => "saved state",
            Which::Ledger => "ledger",
        }
    }

    /// The layout that this program writes.
    pub(in crate::gateway) fn version(self) -> u32 {
        match self {
            Which::State => 4,
            Which::Ledger => 3,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Which::State => "state",
            Which::Ledger => "ledger",
        }
    }

    fn other(self) -> Which {
        match self {
            Which::State => Which::Ledger,
            Which::Ledger => Which::State,
        }
    }

    pub(in crate::gateway) fn path(self, directory: &Path, machine: &str) -> PathBuf {
        directory.join(format!("{machine}.{}.json", self.word()))
    }
}

/// What the documents of a machine know of each other.
#[derive(Debug)]
pub(in crate::gateway) struct Pair {
    machine: String,
    since: Moment,
    /// Those on disk, or the greatest that anybody has seen.
    numbers: [AtomicU64; 2],
    is_in_question: AtomicBool,
}

impl Pair {
    /// The seal of the next writing.
    pub(super) fn next(&self, which: Which) -> Seal {
        Seal {
            checksum: String::new(),
            kind: which,
            machine: self.machine.clone(),
            since: self.since,
            number: self.number(which) + 1,
            other: self.number(which.other()),
            in_question: self.is_in_question(),
        }
    }

    pub(super) fn is_on_disk(&self, which: Which, number: u64) {
        self.numbers[which as usize].store(number, Ordering::Relaxed);
    }

    fn number(&self, which: Which) -> u64 {
        self.numbers[which as usize].load(Ordering::Relaxed)
    }

    /// As the log names them.
    pub(in crate::gateway) fn named(&self) -> Named {
        Named { since: self.since, numbers: [self.number(Which::State), self.number(Which::Ledger)] }
    }

    /// Something did not fit, and no person has armed since.
    pub(in crate::gateway) fn is_in_question(&self) -> bool {
        self.is_in_question.load(Ordering::Relaxed)
    }

    pub(super) fn doubt(&self) {
        self.is_in_question.store(true, Ordering::Relaxed);
    }

    /// A person has armed.
    pub(in crate::gateway) fn answered(&self) {
        self.is_in_question.store(false, Ordering::Relaxed);
    }
}

/// What was found of a document at the start, and where it is written from now on.
#[derive(Debug)]
pub(in crate::gateway) struct Opened {
    /// `None` where there is none; a sentence where it is not believed.
    pub(in crate::gateway) found: Result<Option<Found>, String>,
    pub(in crate::gateway) file: SealedFile,
    /// It has an earlier layout: which, and under what name it is kept before it is replaced.
    pub(in crate::gateway) earlier: Option<(u32, PathBuf)>,
    /// It stands under the name of a ledger that could not be written when a run began.
    pub(in crate::gateway) is_begun: bool,
}

/// What stands at a name.
struct Looked {
    path: PathBuf,
    is_begun: bool,
    found: Result<Option<Found>, Unfit>,
}

/// Looks for state and ledger of a machine. `named`: the numbers that the newest log names.
pub(in crate::gateway) fn open_both(
    disk: &Arc<dyn Disk>,
    directory: &Path,
    machine: &str,
    named: Option<Named>,
    now: Moment,
) -> [Opened; 2] {
    let looked = [Which::State, Which::Ledger].map(|which| look(&**disk, directory, which, machine));
    let seals = looked.each_ref().map(|looked| seal_of(&looked.found));
    let unfit = judge(seals, looked.each_ref().map(|looked| matches!(looked.found, Ok(Some(_)))), named);
    let since = named.map(|named| named.since);
    let since = since.or_else(|| seals.into_iter().flatten().map(|seal| seal.since).next()).unwrap_or(now);
    let of_here = || seals.into_iter().flatten().filter(|seal| seal.since == since && seal.number < MOST);
    let greatest = |which: Which| {
        let own = of_here().filter(|seal| seal.kind == which).map(|seal| seal.number);
        let reported = of_here().filter(|seal| seal.kind != which).map(|seal| seal.other);
        let named = named.map(|named| named.numbers[which as usize]);
        AtomicU64::new(own.chain(reported).chain(named).max().unwrap_or(0))
    };
    let is_unfit = |looked: &Looked| looked.found.is_err();
    let was_in_question = was_in_question(seals);
    let pair = Arc::new(Pair {
        machine: machine.to_owned(),
        since,
        numbers: [Which::State, Which::Ledger].map(greatest),
        is_in_question: AtomicBool::new(
            was_in_question || looked.iter().any(is_unfit) || unfit.iter().any(Option::is_some),
        ),
    });
    let mut unfit = unfit.into_iter();
    let mut which = [Which::State, Which::Ledger].into_iter();
    looked.map(|looked| {
        // There are as many of the one as of the other.
        let which = which.next().unwrap_or(Which::Ledger);
        opened(disk, (directory, machine), which, looked, unfit.next().flatten(), &pair)
    })
}

fn look(disk: &dyn Disk, directory: &Path, which: Which, machine: &str) -> Looked {
    let at = |path: PathBuf, is_begun| Looked {
        found: match disk.read(&path) {
            Ok(bytes) => open(&bytes, (which, which.version()), machine).map(Some),
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
            Err(error) => Err(Unfit::Because(system(&error))),
        },
        path,
        is_begun,
    };
    let path = which.path(directory, machine);
    let looked = at(path, false);
    match (which, &looked.found) {
        (Which::Ledger, Ok(None)) => match at(looked.path.with_extension(BEGUN), true) {
            Looked { found: Ok(None), .. } => looked,
            begun => begun,
        },
        _ => looked,
    }
}

fn seal_of(found: &Result<Option<Found>, Unfit>) -> Option<&Seal> {
    match found {
        Ok(Some(Found::Sealed(seal, _))) => Some(seal),
        _ => None,
    }
}

/// Why the one and the other does not fit what the rest says of it. `is_there`: something whole stands there, under a
/// seal or of an earlier layout.
fn judge(seals: [Option<&Seal>; 2], is_there: [bool; 2], named: Option<Named>) -> [Option<String>; 2] {
    let [state, ledger] = seals.map(|seal| seal.map(|seal| seal.since));
    let is_elsewhere = |own: Option<Moment>, other: Option<Moment>| match (own, named) {
        (Some(own), Some(named)) => own != named.since,
        (Some(own), None) => other.is_some_and(|other| other != own),
        (None, _) => false,
    };
    let elsewhere = [is_elsewhere(state, ledger), is_elsewhere(ledger, state)];
    let own = |which: Which| seals[which as usize].filter(|_| !elsewhere[which as usize]);
    [Which::State, Which::Ledger].map(|which| {
        if elsewhere[which as usize] {
            return Some("it does not belong to the other files here: it is a copy from elsewhere".to_owned());
        }
        let by_other = own(which.other()).map(|seal| (seal.other, which.other().name()));
        let by_log = named.map(|named| (named.numbers[which as usize], "newest log"));
        let reported = by_other.into_iter().chain(by_log).filter(|(number, _)| *number < MOST);
        let (reported, by) = reported.max_by_key(|(number, _)| *number)?;
        let number = own(which).map_or(0, |seal| seal.number);
        match is_there[which as usize] {
            _ if number >= reported => None,
            true => Some(format!(
                "it is older than the {by} says: it is a copy from another day (its number is {number}, not {reported})"
            )),
            false => Some(format!("it is missing, and the {by} knows of one")),
        }
    })
}

/// What was written last knows whether a person has armed since something did not fit.
fn was_in_question(seals: [Option<&Seal>; 2]) -> bool {
    match seals {
        [Some(state), Some(ledger)] if state.other >= ledger.number => state.in_question,
        [Some(state), Some(ledger)] if ledger.other >= state.number => ledger.in_question,
        seals => seals.into_iter().flatten().any(|seal| seal.in_question),
    }
}

fn opened(
    disk: &Arc<dyn Disk>,
    (directory, machine): (&Path, &str),
    which: Which,
    looked: Looked,
    unfit: Option<String>,
    pair: &Arc<Pair>,
) -> Opened {
    let is_of_a_later_version = matches!(looked.found, Err(Unfit::Later(_)));
    let version = which.version();
    let is_missing = matches!(looked.found, Ok(None));
    let found = match (looked.found, unfit) {
        (Err(Unfit::Later(found)), _) => {
            Err(format!("it has version {found}, this program writes {version}"))
        }
        (Err(Unfit::Because(why)), _) | (Ok(_), Some(why)) => Err(why),
        (Ok(found), None) => Ok(found),
    };
    let suffix = match &found {
        Ok(Some(Found::Earlier(version, _))) => Some(format!("v{version}.json")),
        Err(_) if !is_missing && !is_of_a_later_version => Some("json.bad".to_owned()),
        _ => None,
    };
    let aside = suffix.map(|suffix| free(&**disk, &looked.path, &suffix));
    let kept = aside.as_ref().map_or(String::new(), |aside| format!("; it is kept as {}", aside.display()));
    let path = looked.path.display();
    let found = found.map_err(|why| format!("the {} {path} is not believed: {why}{kept}", which.name()));
    let earlier = match &found {
        Ok(Some(Found::Earlier(version, _))) => aside.clone().map(|aside| (*version, aside)),
        _ => None,
    };
    let file = SealedFile {
        disk: Arc::clone(disk),
        which,
        version,
        path: which.path(directory, machine),
        pair: Arc::clone(pair),
        aside: aside.map(|aside| (looked.path, aside)),
        is_of_a_later_version,
    };
    Opened { found, file, earlier, is_begun: looked.is_begun }
}

/// A name beside it that nothing else has.
fn free(disk: &dyn Disk, path: &Path, suffix: &str) -> PathBuf {
    let first = path.with_extension(suffix);
    let numbered = |number: u32| match number {
        1 => first.clone(),
        number => first.with_added_extension(number.to_string()),
    };
    // An endless series has a free one.
    (1..).map(numbered).find(|aside| !disk.has(aside)).unwrap_or(first)
}

/// Whether a gateway may start on what lies there.
///
/// # Errors
/// A sentence with the remedy: a later version of the program has written it.
pub(in crate::gateway) fn refuse_later(
    disk: &dyn Disk,
    directory: &Path,
    machine: &str,
) -> Result<(), String> {
    for which in [Which::State, Which::Ledger] {
        let looked = look(disk, directory, which, machine);
        if let Err(Unfit::Later(found)) = looked.found {
            return Err(format!(
                "the {} {} was written by a later version of this program (layout {found}, this one knows up to {}): \
                 run that version, or move the file away and let a person arm",
                which.name(),
                looked.path.display(),
                which.version()
            ));
        }
    }
    Ok(())
}
