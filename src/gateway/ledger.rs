//! How much of a register is ours, where an operator writes to it too.
//!
//! # Theory of operation
//! A register holds base (the operator's) + share (ours), in whole counts without bias. The register shows only the sum,
//! so the share stands in a ledger on disk, one account for each such output, and the base is what is left: whatever
//! anybody writes there is the operator's, kept, and told.
//!
//! Before a share is sent, the account on disk names it beside the one that stands: a promise. After it was read back,
//! the account names it alone. So whenever the gateway dies, the register holds base + one of the shares in the account,
//! and the register itself says which:
//!
//! | the register holds | it means |
//! |---|---|
//! | base + share | what was sent last has not arrived (yet: it stays promised for a while) |
//! | base + a promised share | that one has arrived |
//! | zero | the CNC was restarted, or somebody cleared it: both are gone; base 0, share 0 |
//! | something else, nothing promised | the operator changed it: the base moves by the difference, the share stays |
//! | something else, a share promised | undecidable: the sum has two unknowns |
//! | something else, after a restart of the CNC | undecidable: our share may be gone with its memory |
//!
//! The last two are never guessed: the axis is off until a person arms it, the share is taken to be the one that was
//! verified last, and the person is told to which value that makes the register right. The same holds for an account
//! that is lost, cannot be read, or speaks of another register; then no share is taken to be in it.
//!
//! What cannot be seen at all: an operator who changes the register by exactly the difference of a promise that did not
//! arrive; a restart of the CNC that neither a boot counter nor the machine's `on` signal shows, after which an operator
//! enters his part before the gateway has read the zero, which looks like a change of his part; and an operator who writes in the milliseconds between our reading and our writing of the register, whose value is
//! overwritten, because Modbus cannot compare and write at once. The register is read again after the promise is on
//! disk, so that this gap is a single exchange.

use std::fmt;

use serde::{Deserialize, Serialize};

mod book;
mod desk;

pub(super) use book::register;
pub(super) use desk::Ledger;

/// One register: what is the operator's and what is ours, in counts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Account {
    /// Which register it speaks of, and what a count is worth there.
    register: String,
    base: i64,
    /// As last verified.
    share: i64,
    /// Shares that may have been sent and may or may not have arrived.
    promised: Vec<i64>,
    /// Why it is not believed; only a person ends that.
    doubt: Option<Doubt>,
}

/// Why an account is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Doubt {
    /// The register was changed while a write was under way.
    Undecidable,
    /// The register was changed while the CNC restarted.
    Rebooted,
    /// What was written does not stay.
    Unsteady,
    /// The ledger cannot be read.
    Unreadable,
    /// The state remembers an offset, and there is no account of it.
    Lost,
    /// The account speaks of another register, or of counts of another worth.
    Elsewhere,
}

/// What the register was found to mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Finding {
    /// What was known.
    Same,
    /// What was promised has arrived.
    Arrived,
    /// The operator's part moved.
    Moved {
        /// Counts before.
        from: i64,
        /// Counts now.
        to: i64,
    },
    /// Both parts are gone.
    Restarted,
    /// Only a person can tell.
    InQuestion,
}

/// What a write that was acknowledged came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReadBack {
    /// It stands there.
    Verified,
    /// What stood there before still does.
    Ignored,
    /// It had arrived, and then something else happened.
    Then(Finding),
}

impl Account {
    /// The account of a register that nothing of ours has ever been in.
    pub(super) fn open(register: String, found: i64) -> Account {
        Account { register, base: found, share: 0, promised: Vec::new(), doubt: None }
    }

    /// One that is not believed: no share of ours is taken to be in the register.
    fn in_question(register: String, doubt: Doubt) -> Account {
        Account { doubt: Some(doubt), ..Account::open(register, 0) }
    }

    pub(super) fn base(&self) -> i64 {
        self.base
    }

    pub(super) fn share(&self) -> i64 {
        self.share
    }

    pub(super) fn doubt(&self) -> Option<Doubt> {
        self.doubt
    }

    pub(super) fn promised(&self) -> &[i64] {
        &self.promised
    }

    /// What the register holds with this share.
    pub(super) fn with(&self, share: i64) -> i64 {
        self.base.saturating_add(share)
    }

    /// The account that must be on disk before this share is sent.
    pub(super) fn promising(&self, share: i64) -> Account {
        let mut account = self.clone();
        if share != self.share && !self.promised.contains(&share) {
            account.promised.push(share);
        }
        account
    }

    /// Says what a register that was just read means, and takes note of it. `cleared`: it reads as it does after a
    /// restart of the CNC.
    pub(super) fn find(&mut self, found: i64, cleared: bool) -> Finding {
        if self.doubt.is_some() {
            return Finding::InQuestion;
        }
        let part = found.saturating_sub(self.base);
        if part == self.share {
            return Finding::Same;
        }
        if let Some(place) = self.promised.iter().position(|share| *share == part) {
            self.promised.swap_remove(place);
            self.share = part;
            return Finding::Arrived;
        }
        if cleared {
            (self.base, self.share) = (found, 0);
            self.promised.clear();
            return Finding::Restarted;
        }
        if !self.promised.is_empty() {
            self.doubt = Some(Doubt::Undecidable);
            return Finding::InQuestion;
        }
        let from = self.base;
        self.base = found.saturating_sub(self.share);
        Finding::Moved { from, to: self.base }
    }

    /// The same for the first look after a restart of the CNC, which may or may not have forgotten its registers: what an
    /// operator entered since then is his part alone, or our share is still in it.
    pub(super) fn find_rebooted(&mut self, found: i64, cleared: bool) -> Finding {
        let part = found.saturating_sub(self.base);
        let is_known = cleared || part == self.share || self.promised.contains(&part);
        if !is_known && (self.share != 0 || !self.promised.is_empty()) {
            self.doubt.get_or_insert(Doubt::Rebooted);
        }
        self.find(found, cleared)
    }

    /// The same for a register that is read back after a write of this share was acknowledged.
    pub(super) fn read_back(&mut self, share: i64, found: i64, cleared: bool) -> ReadBack {
        let part = found.saturating_sub(self.base);
        if part == share {
            self.share = share;
            self.promised.clear();
            return ReadBack::Verified;
        }
        if part == self.share || self.promised.iter().any(|other| *other != share && *other == part) {
            // It may still arrive, so it stays promised.
            let _ = self.find(found, cleared);
            return ReadBack::Ignored;
        }
        // The device said that it took it: what came then came on top of it.
        self.share = share;
        self.promised.clear();
        ReadBack::Then(self.find(found, cleared))
    }

    /// What was promised and not seen for long will not come any more.
    pub(super) fn forget_promises(&mut self) {
        self.promised.clear();
    }

    /// What is written does not stay.
    pub(super) fn doubt_for(&mut self, doubt: Doubt) {
        self.doubt = Some(doubt);
    }

    /// A person says that the register is right: the share stays what it is taken to be, the rest is the operator's.
    pub(super) fn confirm(&mut self, found: i64) {
        self.base = found.saturating_sub(self.share);
        self.promised.clear();
        self.doubt = None;
    }
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Doubt::Undecidable => "somebody changed the register while a write was under way",
            Doubt::Rebooted => "the CNC was restarted, and something else stands in its register since",
            Doubt::Unsteady => "what is written does not stay, twice in a row something else stood there",
            Doubt::Unreadable => "the ledger cannot be read",
            Doubt::Lost => "an offset was written before, and there is no ledger of it",
            Doubt::Elsewhere => "the ledger speaks of another register, or of counts of another worth",
        })
    }
}

#[cfg(test)]
mod tests;
