//! State and ledger of a machine, taken out of its directory while a gateway writes there, and put back into one.
//!
//! What is put back is of another day: nobody knows what was written since. So both documents come back in question. Every axis
//! is off until a person arms, and of a register that an operator writes to no share is taken to be ours before that.

use std::io::{Error, ErrorKind};
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use super::disk::{Disk, Files};
use super::ledger::file::Entries;
use super::sealed::{Found, Seal, Unfit, Which, named, open, seal};
use isotherm_core::output::{Doubt, Kept};

/// A state is written every eight seconds and a ledger before a register is: a pair is soon read between two writings.
const TRIES: u32 = 50;
const PAUSE: Duration = Duration::from_millis(20);

const BOTH: [Which; 2] = [Which::State, Which::Ledger];

/// The names and bytes of state and ledger that belong together; none where nothing was kept yet.
///
/// # Errors
/// A sentence: one of them cannot be read, or they changed at every look.
pub fn take(directory: &Path, machine: &str) -> Result<Vec<(String, Vec<u8>)>, String> {
    let read = |which: Which| {
        let path = which.path(directory, machine);
        match Files.read(&path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(format!("{} cannot be read: {error}", path.display())),
        }
    };
    for _ in 0..TRIES {
        let state = read(Which::State)?;
        let ledger = read(Which::Ledger)?;
        if read(Which::State)? == state {
            let both = BOTH.into_iter().zip([state, ledger]);
            return Ok(both.filter_map(|(which, bytes)| Some((file_name(which, machine), bytes?))).collect());
        }
        std::thread::sleep(PAUSE);
    }
    Err(format!("state and ledger in {} change at every look; try again", directory.display()))
}

/// What is put into a directory for these files of a backup, in question.
///
/// # Errors
/// A sentence: one of them is no document of this machine, or what lies in the directory already, or its logs, are newer.
pub fn put_back(
    directory: &Path,
    machine: &str,
    files: &[(String, Vec<u8>)],
) -> Result<Vec<(String, Vec<u8>)>, String> {
    let logged = named::newest(directory, machine);
    let mut back = Vec::new();
    for (name, bytes) in files {
        let which = BOTH.into_iter().find(|which| file_name(*which, machine) == *name);
        let which = which.ok_or_else(|| format!("{name} is neither state nor ledger of {machine}"))?;
        let wrong = |why: String| format!("{name} of the backup is not believed: {why}");
        let (backed_up, content) = sealed(bytes, which, machine).map_err(wrong)?;
        let path = which.path(directory, machine);
        let there = match Files.read(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(format!("{} cannot be read: {error}", path.display())),
            Ok(bytes) => Some(sealed(&bytes, which, machine)),
        };
        let remedy =
            "restore into another directory (--state DIR), or move state, ledger and logs away together";
        match there {
            Some(Ok((there, _))) if (there.since, there.number) == (backed_up.since, backed_up.number) => {}
            Some(Ok((there, _))) if there.since == backed_up.since && there.number < backed_up.number => {}
            Some(Ok((there, _))) if there.since == backed_up.since => {
                return Err(format!(
                    "{} is newer than the backup (its number is {}, not {}): {remedy}",
                    path.display(),
                    there.number,
                    backed_up.number
                ));
            }
            Some(_) => {
                return Err(format!(
                    "{} is not of the same machine's history, or not whole: {remedy}",
                    path.display()
                ));
            }
            None => {}
        }
        if let Some(why) = logged.and_then(|logged| logged.is_later(which, backed_up.since, backed_up.number))
        {
            return Err(format!("the logs in {} {why}: {remedy}", directory.display()));
        }
        let content = match which {
            Which::State => content,
            Which::Ledger => doubted(content).map_err(|error| wrong(error.to_string()))?,
        };
        let in_question = Seal { in_question: true, ..backed_up };
        back.push((name.clone(), seal(which.version(), in_question, &content).map_err(|e| e.to_string())?));
    }
    Ok(back)
}

fn sealed(bytes: &[u8], which: Which, machine: &str) -> Result<(Seal, Value), String> {
    match open(bytes, (which, which.version()), machine) {
        Ok(Found::Sealed(seal, content)) => Ok((seal, content)),
        Ok(Found::Earlier(version, _)) => {
            Err(format!("it has the earlier layout {version}: restore it with the version that made it"))
        }
        Err(Unfit::Later(version)) => {
            Err(format!("a later version of the program wrote it (layout {version})"))
        }
        Err(Unfit::Because(why)) => Err(why),
    }
}

/// What was written since is not known: a share is nobody's before a person says so, and a whole register waits as after a kill.
fn doubted(content: Value) -> std::io::Result<Value> {
    let mut entries: Entries = serde_json::from_value(content).map_err(Error::from)?;
    for entry in entries.values_mut() {
        entry.kept = match entry.kept.account {
            Some(_) => Kept::in_question(Doubt::Restored),
            None => Kept { in_order: false, ..entry.kept },
        };
    }
    Ok(serde_json::to_value(entries)?)
}

fn file_name(which: Which, machine: &str) -> String {
    which.path(Path::new(""), machine).display().to_string()
}
