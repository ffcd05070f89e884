//! The ledger's file: one JSON document beside the state, replaced atomically and synced.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Account, Doubt};
use crate::profile::{Output, Profile, Share};

/// The layout of the file.
const VERSION: u32 = 1;

/// More counts than any register holds: an account with more is not one of ours.
const MOST: i64 = 1 << 40;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: u32,
    outputs: Accounts,
}

/// The accounts of a machine, by output.
pub(super) type Accounts = BTreeMap<String, Account>;

/// What was found at start.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) accounts: Accounts,
    pub(super) book: Book,
    /// A sentence where the file cannot be used.
    pub(super) trouble: Option<String>,
}

/// Where the accounts are kept.
#[derive(Debug)]
pub(super) struct Book {
    path: PathBuf,
    /// The file that stands there cannot be used: it is kept aside before it is replaced.
    spoilt: bool,
}

/// What an account must speak of to be this output's.
pub(in crate::gateway) fn register(profile: &Profile, output: &Output) -> String {
    let encoding = &output.encoding;
    let device = &profile.device(output.device).name;
    format!(
        "{} of {device}, {} {}{}, {} per count, bias {}",
        output.address,
        encoding.data_type.name(),
        encoding.word_order,
        if encoding.byte_swap { " byte-swapped" } else { "" },
        encoding.scale.get(),
        encoding.bias
    )
}

/// Reads the accounts of a machine. `remembers`: whether an offset of this output was verified before.
pub(super) fn open(directory: &Path, profile: &Profile, remembers: impl Fn(&str) -> bool) -> Found {
    let path = directory.join(format!("{}.ledger.json", profile.name));
    let (mut accounts, trouble) = match read(&path) {
        Ok(accounts) => (accounts, None),
        Err(why) => (Accounts::new(), Some(format!("{} cannot be used: {why}", path.display()))),
    };
    for output in profile.outputs.iter().filter(|output| output.share == Share::Ledger) {
        let register = register(profile, output);
        let account = match take(&mut accounts, profile, &output.name, &register) {
            _ if trouble.is_some() => Account::in_question(register, Doubt::Unreadable),
            Some(account) if account.register == register => account,
            Some(_) => Account::in_question(register, Doubt::Elsewhere),
            None if remembers(&output.name) => Account::in_question(register, Doubt::Lost),
            None => continue,
        };
        accounts.insert(output.name.clone(), account);
    }
    Found { accounts, book: Book { path, spoilt: trouble.is_some() }, trouble }
}

/// By its name; an output that was given a new name goes on with the account of its register.
fn take(accounts: &mut Accounts, profile: &Profile, name: &str, register: &str) -> Option<Account> {
    let is_nobodys = |known: &str| profile.outputs.iter().all(|output| output.name != known);
    let former = |(known, account): &(&String, &Account)| is_nobodys(known) && account.register == register;
    let former = || accounts.iter().find(former).map(|(known, _)| known.clone());
    let key = if accounts.contains_key(name) { name.to_owned() } else { former()? };
    accounts.remove(&key)
}

impl Book {
    /// Puts the accounts on disk: they are there when this returns.
    pub(super) fn save(&mut self, accounts: &Accounts) -> std::io::Result<()> {
        if let Some(directory) = self.path.parent() {
            std::fs::create_dir_all(directory)?;
        }
        if self.spoilt {
            // A copy: between two renames there would be no file at all, which means that nothing is ours.
            match std::fs::copy(&self.path, self.path.with_extension("json.bad")) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => self.spoilt = false,
            }
        }
        let document = Document { version: VERSION, outputs: accounts.clone() };
        let mut file = atomic_write_file::AtomicWriteFile::open(&self.path)?;
        serde_json::to_writer_pretty(&mut file, &document).map_err(std::io::Error::other)?;
        file.write_all(b"\n")?;
        file.commit()
    }
}

/// The accounts of a file; none where there is no file.
fn read(path: &Path) -> Result<Accounts, String> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Accounts::new()),
        Err(error) => return Err(error.to_string()),
    };
    let document: Document = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    if document.version != VERSION {
        return Err(format!("it has version {}, this program writes {VERSION}", document.version));
    }
    let fits = |counts: &i64| counts.unsigned_abs() <= MOST.unsigned_abs();
    let all_fit =
        |account: &Account| fits(&account.base) && fits(&account.share) && account.promised.iter().all(fits);
    match document.outputs.iter().find(|(_, account)| !all_fit(account)) {
        Some((name, _)) => Err(format!("no register holds as many counts as it says of {name}")),
        None => Ok(document.outputs),
    }
}

#[cfg(test)]
mod tests;
