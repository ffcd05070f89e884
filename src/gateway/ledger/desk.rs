//! The accounts of all outputs that own a share of a register, kept on disk.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::Account;
use super::book::{self, Accounts};
use crate::clock::Clock;
use crate::gateway::saver::{Kept, Saver};
use crate::observe::events::{Event, Journal};
use crate::profile::{Output, Profile, Share};

/// The name of it in events.
const WHAT: &str = "the ledger";
/// Where it cannot be kept.
const OTHERWISE: &str = "what depends on it is not written";

/// The accounts of all outputs that own a share of a register.
#[derive(Debug)]
pub(in crate::gateway) struct Ledger {
    accounts: Saver<Accounts>,
}

impl Ledger {
    /// Opens the ledger of a machine; without a directory, or where no output needs one, nothing is ever kept.
    pub(in crate::gateway) fn open(
        profile: &Profile,
        directory: Option<&Path>,
        remembers: impl Fn(&str) -> bool,
        journal: Arc<Journal>,
        clock: &Clock,
    ) -> Ledger {
        if !profile.outputs.iter().any(|output| output.share == Share::Ledger) {
            return Ledger { accounts: Saver::idle() };
        }
        let not_kept = |why| Event::NotKept { what: WHAT.to_owned(), why };
        let Some(directory) = directory else {
            let why = "there is no state directory; name one with --state".to_owned();
            journal.tell(clock.now(), &not_kept(why));
            return Ledger { accounts: Saver::idle() };
        };
        let found = book::open(directory, profile, remembers);
        if let Some(why) = found.trouble {
            journal.tell(clock.now(), &not_kept(why));
        }
        let mut book = found.book;
        let save = move |accounts: &Accounts| book.save(accounts);
        Ledger { accounts: Saver::start((WHAT, OTHERWISE), found.accounts, save, journal, clock) }
    }

    /// The account of an output as it was last kept or is to be kept; `None` before its register was first read.
    pub(in crate::gateway) fn account(&self, output: &Output) -> Option<Account> {
        self.accounts.look(|accounts| accounts.get(&output.name).cloned())
    }

    /// The account of a register that nothing of ours has ever been in.
    pub(in crate::gateway) fn new_account(&self, profile: &Profile, output: &Output, found: i64) -> Account {
        Account::open(book::register(profile, output), found)
    }

    /// Has this account put on disk; the number asks for what became of it.
    pub(in crate::gateway) fn keep(&self, output: &Output, account: Account) -> u64 {
        self.accounts.keep(|accounts| drop(accounts.insert(output.name.clone(), account)))
    }

    /// What became of that, waiting for it no longer than `span`: see [`Saver::kept`].
    pub(in crate::gateway) async fn kept(&self, version: u64, span: Duration) -> Kept {
        self.accounts.kept(version, span).await
    }

    /// Waits for what is still to be put on disk.
    pub(in crate::gateway) async fn finish(&self, span: Duration) {
        self.accounts.finish(span).await;
    }
}
