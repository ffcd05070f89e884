//! SHA-256 checksums as a profile states them: 64 hex digits.

use std::fmt::Write as _;
use std::io::Read;

use sha2::{Digest, Sha256};

/// Returns the SHA-256 of these bytes as a profile states it: 64 hex digits.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    in_hex(&Sha256::digest(bytes))
}

/// Returns the SHA-256 of all bytes that a reader returns, as 64 hex digits.
///
/// # Errors
/// Errors of the reader.
pub fn sha256_of(mut reader: impl Read) -> std::io::Result<String> {
    let (mut digest, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match reader.read(&mut part)? {
            0 => return Ok(in_hex(&digest.finalize())),
            length => digest.update(&part[..length]),
        }
    }
}

fn in_hex(digest: &[u8]) -> String {
    digest.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
