//! Token for a server of `[[notify]]`. The file is read again for each message, because it may have changed.

use std::io::{ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use isotherm_profile::safe_file;

/// Maximum size of a token file, in bytes. No server accepts a longer header.
const LONGEST: u64 = 4096;
/// Permission bits for users who are neither the owner of a file nor in its group.
const OTHERS: u32 = 0o007;

/// Reads the token from its file.
///
/// # Errors
/// The token cannot be used. The error is a sentence with the file and the remedy; it does not quote the content.
pub fn read(path: &Path) -> Result<String, String> {
    let at = path.display();
    let cannot = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => {
            format!("the token file {at} does not exist: write the token of the server into this file")
        }
        _ => {
            format!("the token file {at} cannot be read: {}", safe_file::without_numbers(&error.to_string()))
        }
    };
    let file = safe_file::open(path).map_err(cannot)?;
    if file.metadata().map_err(cannot)?.mode() & OTHERS != 0 {
        return Err(format!("the token file {at} is open to all users of this computer: run chmod 600 {at}"));
    }
    let mut text = String::new();
    let length = file.take(LONGEST + 1).read_to_string(&mut text).map_err(cannot)?;
    let token = text.trim();
    match () {
        () if token.is_empty() => {
            Err(format!("the token file {at} is empty: write the token of the server into this file"))
        }
        () if length as u64 > LONGEST => {
            Err(format!("the token file {at} is larger than 4 kB: write only the token into this file"))
        }
        () if !token.bytes().all(|byte| byte.is_ascii_graphic()) => Err(format!(
            "the token in {at} has spaces, more than one line, or characters that a request cannot contain: \
             write the token on one line"
        )),
        () => Ok(token.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn what_is_no_token_is_refused_in_words_and_nothing_of_it_is_quoted() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("notify.token");
        assert!(read(&path).unwrap_err().contains("notify.token does not exist: write the token"));
        let long = "secret".repeat(1000);
        for (text, mode, why) in [
            ("secret-token\n", 0o600, None),
            ("secret", 0o640, None),
            ("secret", 0o604, Some("chmod 600")),
            ("", 0o600, Some("is empty")),
            ("secret\nsecret", 0o600, Some("more than one line")),
            ("sécret", 0o600, Some("characters that a request cannot contain")),
            (&long, 0o600, Some("larger than 4 kB")),
        ] {
            let _ = std::fs::remove_file(&path);
            std::fs::write(&path, text).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            match (read(&path), why) {
                (Ok(token), None) => assert_eq!(token, text.trim()),
                (Err(said), Some(why)) => assert!(said.contains(why) && !said.contains("secret"), "{said}"),
                (found, _) => panic!("{text:?} {mode:o}: {found:?}"),
            }
        }
    }
}
