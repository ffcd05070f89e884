//! Directory of the certificates, in the form that the OPC UA library requires. The directory contains the certificates
//! of the server, of trusted clients, and of refused clients.
//!
//! The directory is made again at each start from the files of the profile, so that only the clients of the profile are
//! trusted. The library stores the certificate of each refused client. An attacker could fill the disk with such
//! certificates, so only the newest are kept. The library reads the private key from a file in memory, so that the
//! directory does not contain the key.

use std::collections::BTreeSet;
use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use ::opcua::crypto::{CertificateStore, X509};
use rustix::fs::{MemfdFlags, memfd_create};

use super::files::{OwnCertificate, ServerFiles};
use isotherm_profile::safe_file::cut;

/// Name of the file with the certificate of the server. The library accepts no other file extension.
pub(super) const OWN: &str = "own/cert.der";
const TRUSTED: &str = "trusted";
const REJECTED: &str = "rejected";
const DIRECTORY_MODE: u32 = 0o750;
const FILE_MODE: u32 = 0o640;
/// Maximum number of certificates of refused clients that are kept.
const MOST_REJECTED: usize = 10;
/// Maximum size of a certificate that is read for a report, bytes.
const LARGEST: u64 = 16 * 1024;
/// Maximum length of a subject in a report, characters. A client may write any text into its certificate.
const LONGEST: usize = 100;

/// Directory of the certificates of the server and of its clients.
pub(super) struct Pki {
    directory: PathBuf,
    /// File names of the refused certificates that have been reported.
    reported: BTreeSet<String>,
    /// Private key; `None` without security. The library reads it for each connection.
    key: Option<KeyInMemory>,
}

/// Refused client: the subject and the digest of its certificate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RejectedClient {
    pub(super) subject: String,
    pub(super) thumbprint: String,
}

/// File in memory (memfd) with the private key. The library reads it like a file on disk.
pub(super) struct KeyInMemory(File);

impl KeyInMemory {
    fn of(own: &OwnCertificate) -> io::Result<KeyInMemory> {
        let memory = memfd_create("isotherm-opcua-key", MemfdFlags::CLOEXEC).map_err(io::Error::from)?;
        let mut memory = File::from(memory);
        memory.write_all(&own.key)?;
        Ok(KeyInMemory(memory))
    }

    /// Returns the path by which this process can read the key.
    pub(super) fn path(&self) -> PathBuf {
        PathBuf::from(format!("/proc/self/fd/{}", self.0.as_raw_fd()))
    }
}

impl Pki {
    /// Makes the directory from the files of the profile.
    ///
    /// # Errors
    /// The directory cannot be written.
    pub(super) fn make(directory: &Path, files: &ServerFiles) -> io::Result<Pki> {
        make_directory(directory)?;
        for name in [TRUSTED, REJECTED, "own"] {
            let inside = directory.join(name);
            make_directory(&inside)?;
            for entry in std::fs::read_dir(&inside)? {
                std::fs::remove_file(entry?.path())?;
            }
        }
        for der in &files.trusted {
            let cert = X509::from_der(der).map_err(|_| io::Error::from(ErrorKind::InvalidData))?;
            let path = directory.join(TRUSTED).join(CertificateStore::cert_file_name(&cert));
            match write(&path, der) {
                // The profile may name one certificate twice, for example in DER and in PEM form.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                written => written?,
            }
        }
        let key = match &files.own {
            Some(own) => {
                write(&directory.join(OWN), &own.cert)?;
                Some(KeyInMemory::of(own)?)
            }
            None => None,
        };
        Ok(Pki { directory: directory.to_owned(), reported: BTreeSet::new(), key })
    }

    /// Returns the path of the directory of the certificates.
    pub(super) fn directory(&self) -> &Path {
        &self.directory
    }

    /// Returns the private key; `None` if the server has no security.
    pub(super) fn key(&self) -> Option<&KeyInMemory> {
        self.key.as_ref()
    }

    /// Stores the certificate of a refused client, as the library does. Bytes that are not a certificate are ignored.
    pub(super) fn reject(&self, certificate: &[u8]) {
        let Ok(cert) = X509::from_der(certificate) else { return };
        let path = self.directory.join(REJECTED).join(CertificateStore::cert_file_name(&cert));
        // The file exists already, or it cannot be written.
        let _ = write(&path, certificate);
    }

    /// Returns the clients that were refused since the last call, and removes the oldest certificates. The result is
    /// empty if the directory cannot be read.
    pub(super) fn rejected(&mut self) -> Vec<RejectedClient> {
        let Ok(entries) = std::fs::read_dir(self.directory.join(REJECTED)) else { return Vec::new() };
        let mut files: Vec<((i64, i64), PathBuf)> = entries
            .flatten()
            .filter_map(|entry| {
                let metadata = entry.metadata().ok()?;
                Some(((metadata.mtime(), metadata.mtime_nsec()), entry.path()))
            })
            .collect();
        files.sort();
        for (_, old) in files.drain(..files.len().saturating_sub(MOST_REJECTED)) {
            let _ = std::fs::remove_file(old);
        }
        let names = files.iter().map(|(_, path)| name(path)).collect();
        let known = std::mem::replace(&mut self.reported, names);
        let new = files.iter().filter(|(_, path)| !known.contains(&name(path)));
        new.filter_map(|(_, path)| client(path)).collect()
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Reads the certificate of a refused client; `None` if the certificate cannot be read.
fn client(path: &Path) -> Option<RejectedClient> {
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(LARGEST).read_to_end(&mut bytes).ok()?;
    let cert = X509::from_der(&bytes).ok()?;
    // The thumbprint follows in the event, which is cut at its end.
    let subject = cut(&cert.subject_name(), LONGEST).into_owned();
    Some(RejectedClient { subject, thumbprint: cert.thumbprint().as_hex_string() })
}

fn make_directory(path: &Path) -> io::Result<()> {
    match DirBuilder::new().mode(DIRECTORY_MODE).create(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        made => made,
    }
}

fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).create_new(true).mode(FILE_MODE).open(path)?;
    file.write_all(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_refused_certificates_the_newest_are_kept_and_each_is_reported_once() {
        let home = tempfile::tempdir().unwrap();
        let directory = home.path().join("press-opcua");
        let mut pki = Pki::make(&directory, &ServerFiles::default()).unwrap();
        assert!(pki.key().is_none() && pki.rejected().is_empty());
        let rejected = directory.join(REJECTED);
        for number in 0..50 {
            std::fs::write(rejected.join(format!("{number}.der")), "no certificate").unwrap();
        }
        assert!(pki.rejected().is_empty(), "they are no certificates");
        assert_eq!(std::fs::read_dir(&rejected).unwrap().count(), MOST_REJECTED);
        let mut pki = Pki::make(&directory, &ServerFiles::default()).unwrap();
        assert_eq!(std::fs::read_dir(&rejected).unwrap().count(), 0, "a start begins with none");
        assert!(pki.rejected().is_empty());
    }

    #[test]
    fn a_certificate_that_two_files_contain_is_trusted_once() {
        let cert = rcgen::generate_simple_self_signed(["mes".to_owned()]).unwrap().cert.der().to_vec();
        let home = tempfile::tempdir().unwrap();
        let files = ServerFiles { trusted: vec![cert.clone(), cert.clone()], ..ServerFiles::default() };
        let pki = Pki::make(&home.path().join("press-opcua"), &files).unwrap();
        let mut trusted = std::fs::read_dir(pki.directory().join(TRUSTED)).unwrap();
        assert_eq!(std::fs::read(trusted.next().unwrap().unwrap().path()).unwrap(), cert);
        assert!(trusted.next().is_none());
    }

    #[test]
    fn a_subject_of_any_length_is_reported_with_its_beginning() {
        let home = tempfile::tempdir().unwrap();
        let mut pki = Pki::make(home.path(), &ServerFiles::default()).unwrap();
        let mut params = rcgen::CertificateParams::new(Vec::new()).unwrap();
        params.distinguished_name.push(rcgen::DnType::OrganizationName, "x".repeat(5000));
        let cert = params.self_signed(&rcgen::KeyPair::generate().unwrap()).unwrap();
        pki.reject(b"no certificate");
        pki.reject(cert.der());
        pki.reject(cert.der());
        let found = pki.rejected();
        let [one] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!(one.subject.chars().count(), LONGEST + 1);
        assert_eq!(one.thumbprint.len(), 40);
    }

    #[test]
    fn the_key_is_read_from_memory_and_no_file_contains_it() {
        let home = tempfile::tempdir().unwrap();
        let own = OwnCertificate { cert: b"certificate".to_vec(), key: b"secret key".to_vec() };
        let files = ServerFiles { own: Some(own), ..ServerFiles::default() };
        let pki = Pki::make(&home.path().join("press-opcua"), &files).unwrap();
        assert_eq!(std::fs::read(pki.key().unwrap().path()).unwrap(), b"secret key");
        assert_eq!(std::fs::read(pki.directory().join(OWN)).unwrap(), b"certificate");
        let own: Vec<String> = std::fs::read_dir(pki.directory().join("own"))
            .unwrap()
            .map(|entry| name(&entry.unwrap().path()))
            .collect();
        assert_eq!(own, ["cert.der"]);
    }
}
