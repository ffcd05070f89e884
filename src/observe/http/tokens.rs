//! Tokens of scrapers, viewers and operators. Each token is in a separate file, which is read again when it changes.
//!
//! A token is invalid if its file no longer contains it, if the file cannot be read, or if all users can access the
//! file.

use std::fmt;
use std::fs::Metadata;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use isotherm_profile::safe_file;
use rustix::rand::{GetRandomFlags, getrandom};
use subtle::ConstantTimeEq;

/// Minimum length of a token, in characters. A shorter token could be guessed.
const SHORTEST: usize = 16;
/// Maximum length of a token, in characters, so that it fits into the head of a request.
const LONGEST: usize = 512;
/// Maximum size of a token file, in bytes.
const LARGEST: u64 = 64 * 1024;
/// Permission bits for users who are neither the owner of a file nor in its group.
const OTHERS: u32 = 0o007;

/// Role of an authenticated client, which determines its rights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    /// May read the metrics only.
    Scraper,
    /// May read page, API and metrics.
    Viewer,
    /// May read everything, and send commands.
    Operator,
}

impl Role {
    /// All roles, the role with the fewest rights first. If two roles have the same token, the token gives the rights
    /// of the role with fewer rights.
    const ALL: [Role; 3] = [Role::Scraper, Role::Viewer, Role::Operator];

    pub(super) fn name(self) -> &'static str {
        match self {
            Role::Scraper => "scraper",
            Role::Viewer => "viewer",
            Role::Operator => "operator",
        }
    }
}

/// Token of one role, and the identity of its file when the token was read.
pub struct TokenFile {
    path: PathBuf,
    /// Token; `None` while the file contains no valid token.
    token: Option<String>,
    seen: Option<FileIdentity>,
    /// Number of times that the token has changed.
    version: u64,
    /// Whether it was reported that the file contains no valid token.
    is_reported: bool,
}

/// Formats the token file without the token, which must not appear in a log.
impl fmt::Debug for TokenFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "TokenFile({})", self.path.display())
    }
}

/// Properties that identify the content of a file. If one of them has changed, the file is read again.
#[derive(Clone, Debug, PartialEq)]
struct FileIdentity {
    modified: (i64, i64),
    changed: (i64, i64),
    place: (u64, u64),
    size: u64,
}

impl FileIdentity {
    fn of(metadata: &Metadata) -> FileIdentity {
        FileIdentity {
            modified: (metadata.mtime(), metadata.mtime_nsec()),
            changed: (metadata.ctime(), metadata.ctime_nsec()),
            place: (metadata.dev(), metadata.ino()),
            size: metadata.size(),
        }
    }
}

/// Returns `SIZE` random bytes from the kernel, or the error of the system call.
pub(super) fn random<const SIZE: usize>() -> io::Result<[u8; SIZE]> {
    let mut bytes = [0; SIZE];
    let mut filled = 0;
    while filled < SIZE {
        filled += getrandom(&mut bytes[filled..], GetRandomFlags::empty())?;
    }
    Ok(bytes)
}

/// Makes a token from the kernel's random numbers.
///
/// # Errors
/// The kernel has no random numbers.
pub fn new_token() -> io::Result<String> {
    Ok(random::<20>()?.iter().map(|byte| format!("{byte:02x}")).collect())
}

impl TokenFile {
    /// Reads a token from its file.
    ///
    /// # Errors
    /// The file cannot be read, all users can access it, or it contains no valid token. The error is a sentence with
    /// the file and the remedy.
    pub fn read(path: &Path) -> Result<TokenFile, String> {
        let (token, seen) = read(path)?;
        let path = path.to_owned();
        Ok(TokenFile { path, token: Some(token), seen: Some(seen), version: 0, is_reported: false })
    }

    /// Returns whether both files contain the same token.
    pub fn is_same_as(&self, other: &TokenFile) -> bool {
        self.token == other.token
    }

    /// Stores the result of reading the file. Returns a change that must be reported; `None` if there is nothing to
    /// report.
    fn take(&mut self, found: Result<(String, FileIdentity), String>) -> Option<Change> {
        let (token, seen) = match found {
            Ok((token, seen)) => (token, seen),
            Err(why) => {
                self.seen = None;
                self.version += u64::from(self.token.take().is_some());
                let is_reported = std::mem::replace(&mut self.is_reported, true);
                return (!is_reported).then_some(Change::Gone(why));
            }
        };
        (self.seen, self.is_reported) = (Some(seen), false);
        if self.token.as_ref() == Some(&token) {
            return None;
        }
        self.token = Some(token);
        self.version += 1;
        Some(Change::Another)
    }
}

fn read(path: &Path) -> Result<(String, FileIdentity), String> {
    let at = path.display();
    let cannot = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => {
            format!("the token file {at} does not exist: create it with isotherm token --out {at}")
        }
        _ => format!("the token file {at} cannot be read: {error}"),
    };
    let mut file = safe_file::open(path).map_err(cannot)?;
    let metadata = file.metadata().map_err(cannot)?;
    if metadata.len() > LARGEST {
        let kilobytes = LARGEST >> 10;
        return Err(format!(
            "the token file {at} is larger than {kilobytes} kB: create a token with isotherm token > {at}"
        ));
    }
    if metadata.mode() & OTHERS != 0 {
        return Err(format!("the token file {at} is open to all users of this computer: run chmod 600 {at}"));
    }
    let mut text = String::new();
    file.by_ref().take(LARGEST).read_to_string(&mut text).map_err(cannot)?;
    let token = text.trim();
    let length = token.chars().count();
    match () {
        () if length == 0 => {
            Err(format!("the token file {at} is empty: create a token with isotherm token > {at}"))
        }
        () if length < SHORTEST => Err(format!(
            "the token in {at} has {length} characters, fewer than {SHORTEST}: create a token with isotherm \
             token > {at}"
        )),
        () if token.len() > LONGEST => Err(format!(
            "the token in {at} is longer than {LONGEST} bytes: create a token with isotherm token > {at}"
        )),
        () if !token.chars().all(|letter| matches!(letter, ' '..='~')) => Err(format!(
            "the token in {at} has more than one line, or characters that a request cannot contain: create \
             a token with isotherm token > {at}"
        )),
        () => Ok((token.to_owned(), FileIdentity::of(&metadata))),
    }
}

/// Change of a token file since the file was last read.
#[derive(Debug, PartialEq)]
pub(super) enum Change {
    /// The token file contains another token than before.
    Another,
    /// The file no longer contains a valid token. The text is the reason.
    Gone(String),
}

/// Token files of all roles, in the order of [`Role::ALL`]; `None` for a role without a file.
pub(super) struct Tokens(Mutex<[Option<TokenFile>; 3]>);

impl Tokens {
    /// Creates the collection of token files. `files` are in the order of [`Role::ALL`].
    pub(super) fn new(files: [Option<TokenFile>; 3]) -> Tokens {
        Tokens(Mutex::new(files))
    }

    /// Returns whether the profile names a token file for this role, even if the file is invalid.
    pub(super) fn has(&self, role: Role) -> bool {
        self.files()[place(role)].is_some()
    }

    pub(super) fn any(&self) -> bool {
        self.files().iter().any(Option::is_some)
    }

    /// Returns the role and the version of a token. `None` if the token is wrong.
    pub(super) fn role_of(&self, given: &str) -> Option<(Role, u64)> {
        let files = self.files();
        // A comparison in constant time: response times do not help to guess a token.
        let is_given = |token: &String| bool::from(token.as_bytes().ct_eq(given.as_bytes()));
        let matches = |file: &&TokenFile| file.token.as_ref().is_some_and(is_given);
        Role::ALL.into_iter().find_map(|role| {
            let file = files[place(role)].as_ref().filter(matches)?;
            Some((role, file.version))
        })
    }

    /// Returns the version of a role's token. Clients that have used an older version lose their access.
    pub(super) fn version(&self, role: Role) -> u64 {
        self.files()[place(role)].as_ref().map_or(0, |file| file.version)
    }

    /// Reads the token files that have changed, and returns the changes. The lock is not held while the disk is read.
    pub(super) fn check(&self) -> Vec<(Role, Change)> {
        let look = |role: Role| {
            let (path, seen) = {
                let files = self.files();
                let file = files[place(role)].as_ref()?;
                (file.path.clone(), file.seen.clone())
            };
            let now = std::fs::metadata(&path).ok().map(|metadata| FileIdentity::of(&metadata));
            if now.is_some() && now == seen {
                return None;
            }
            let found = read(&path);
            let change = self.files()[place(role)].as_mut()?.take(found)?;
            Some((role, change))
        };
        Role::ALL.into_iter().filter_map(look).collect()
    }

    fn files(&self) -> MutexGuard<'_, [Option<TokenFile>; 3]> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn place(role: Role) -> usize {
    match role {
        Role::Scraper => 0,
        Role::Viewer => 1,
        Role::Operator => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn write(path: &Path, text: &str, mode: u32) {
        std::fs::write(path, text).unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn what_is_no_token_is_refused_with_what_to_do() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("operator.token");
        assert!(TokenFile::read(&path).unwrap_err().contains("does not exist: create it with isotherm"));
        for (text, mode, why) in [
            ("0123456789abcdef\n", 0o644, Some("chmod 600")),
            ("0123456789abcdef\n", 0o602, Some("chmod 600")),
            ("0123456789abcde\n", 0o600, Some("15 characters, fewer than 16")),
            ("äöüäöüäöüäöüäöüä", 0o600, Some("characters that a request cannot contain")),
            (" \n", 0o600, Some("is empty")),
            ("0123456789abcdef\n0123456789abcdef\n", 0o600, Some("more than one line")),
            (&"x".repeat(513), 0o600, Some("longer than 512")),
            ("0123456789abcdef\n", 0o640, None),
            ("0123456789abcdef", 0o400, None),
        ] {
            let _ = std::fs::remove_file(&path);
            write(&path, text, mode);
            match (TokenFile::read(&path), why) {
                (Ok(_), None) => {}
                (Err(said), Some(why)) => assert!(said.contains(why), "{text:?}: {said}"),
                (found, _) => panic!("{text:?} {mode:o}: {found:?}"),
            }
        }
    }

    #[test]
    fn a_new_token_is_one_and_no_two_are_alike() {
        let (one, other) = (new_token().unwrap(), new_token().unwrap());
        assert_eq!((one.len(), one != other), (40, true));
        assert!(one.bytes().all(|letter| letter.is_ascii_hexdigit()));
    }

    #[test]
    fn a_token_that_is_changed_or_taken_away_is_none_any_more_and_that_is_said_once() {
        let home = tempfile::tempdir().unwrap();
        let [looks, commands] = ["viewer", "operator"].map(|name| home.path().join(name));
        write(&looks, "looks-and-no-more", 0o600);
        write(&commands, "commands-and-more", 0o600);
        let file = |path| Some(TokenFile::read(path).unwrap());
        let tokens = Tokens::new([None, file(&looks), file(&commands)]);
        assert_eq!(tokens.check(), []);
        assert_eq!(tokens.role_of("looks-and-no-more"), Some((Role::Viewer, 0)));
        assert_eq!(tokens.role_of("commands-and-more"), Some((Role::Operator, 0)));
        assert_eq!(tokens.role_of("commands-and-mor"), None);
        assert_eq!(tokens.role_of(""), None);

        write(&commands, "another-one-is-this", 0o600);
        assert_eq!(tokens.check(), [(Role::Operator, Change::Another)]);
        assert_eq!(tokens.role_of("commands-and-more"), None);
        assert_eq!(tokens.role_of("another-one-is-this"), Some((Role::Operator, 1)));
        std::fs::set_permissions(&commands, std::fs::Permissions::from_mode(0o604)).unwrap();
        let changes = tokens.check();
        assert!(matches!(&changes[..], [(Role::Operator, Change::Gone(why))] if why.contains("chmod 600")));
        assert_eq!((tokens.check(), tokens.role_of("another-one-is-this")), (vec![], None));
        std::fs::remove_file(&commands).unwrap();
        assert_eq!(tokens.check(), []);
        assert!(tokens.has(Role::Operator), "it is asked for all the same");
        write(&commands, "another-one-is-this", 0o600);
        assert_eq!(tokens.check(), [(Role::Operator, Change::Another)]);
        // The operator's file contains the viewer's token, which may not command.
        write(&looks, "another-one-is-this", 0o600);
        tokens.check();
        assert_eq!(tokens.role_of("another-one-is-this").unwrap().0, Role::Viewer);
    }
}
