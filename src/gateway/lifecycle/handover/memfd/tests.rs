use std::fs::Permissions;
use std::os::fd::AsRawFd;
use std::os::unix::fs::PermissionsExt;

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};

use super::memory::{MODE, seals};
use super::*;

use isotherm_core::quantity::Micron;
use isotherm_profile::Sources;

fn handover() -> Handover {
    let off = (0..3).map(|axis| (format!("axis{axis}"), "switched off by a person".to_owned()));
    let armed = [("z".to_owned(), Micron::new(39.0).unwrap())].into();
    Handover { by: "by maria over the command socket".to_owned(), armed, off: off.collect() }
}

fn document(process: &Process) -> Vec<u8> {
    let (process, handover) = (process.clone(), handover());
    serde_json::to_vec(&Document { process, handover, sources: None }).unwrap()
}

/// Sealed memfd with these bytes, opened again.
fn sealed(bytes: &[u8]) -> File {
    let mut file = memory::create(NAME).unwrap();
    file.write_all(bytes).unwrap();
    memory::seal(&file).unwrap();
    again(&file)
}

fn again(file: &File) -> File {
    File::open(format!("/proc/self/fd/{}", file.as_raw_fd())).unwrap()
}

/// Result for a program that finds these bytes in a memfd, and this digest in the state directory.
fn accepted(bytes: &[u8], digest: Option<&str>, process: &Process) -> Result<Handover, String> {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    digest.into_iter().for_each(|digest| std::fs::write(&path, digest).unwrap());
    let arrival = Arrival { found: Some(ReceivedHandover::read(&sealed(bytes), process)) };
    assert_eq!(
        arrival.is_announced(&path),
        digest == Some(&sha256(bytes)) && arrival.found.as_ref().unwrap().is_ok()
    );
    let accepted = arrival.accept(&path);
    assert!(!path.exists(), "the digest is gone");
    Ok(accepted?.unwrap())
}

/// Profile whose sources a check has written.
fn profile(directory: &Path) -> KeptProfile {
    let path = directory.join("mill.toml");
    std::fs::write(&path, "[machine]\nname = \"mill\"\n").unwrap();
    let sources = Sources::create(KeptProfile::offer().unwrap(), &[], &[]);
    let (_, sources) = isotherm_profile::load_and_keep(&path, sources).unwrap();
    KeptProfile::answered(sources.finish().unwrap().0).unwrap().unwrap()
}

#[test]
fn what_is_sealed_is_read_back_and_its_digest_lies_in_the_state_directory() {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    let this = Process::this().unwrap();
    for kept in [None, Some(profile(directory.path()))] {
        let sealed = handover().seal(Prepared::with(kept.as_ref()).unwrap(), &path).unwrap();
        let mut through = again(&sealed);
        let arrival = || Arrival { found: Some(ReceivedHandover::read(&again(&sealed), &this)) };
        for _ in 0..2 {
            assert!(arrival().is_announced(&path), "the digest is still there");
        }
        let found = arrival().profile().map(|found| found.seal.clone());
        assert_eq!(found, kept.as_ref().map(|kept| kept.seal.clone()));
        if let Some(found) = arrival().profile() {
            let loaded = isotherm_profile::load_from(Path::new("mill.toml"), &found.sources().unwrap());
            assert_eq!(loaded.unwrap().profile.name, "mill");
        }
        assert_eq!(arrival().accept(&path), Ok(Some(handover())));
        assert!(!path.exists(), "the digest is gone");
        // The handover was used, so it is not accepted again.
        assert!(arrival().accept(&path).unwrap_err().contains("was used before"));
        // The memory cannot be changed.
        assert!(
            through.write(b"{").is_err() && through.set_len(0).is_err() && (&sealed).write(b"{").is_err()
        );
        let flags = rustix::io::fcntl_getfd(&sealed).unwrap();
        assert!(flags.contains(rustix::io::FdFlags::CLOEXEC), "a child does not get it");
    }
}

/// An older version reads the whole memfd as one document, and accepts no other key in it.
#[test]
fn a_program_of_an_older_version_is_given_what_it_knows() {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    let sealed = handover().seal(Prepared::with(None).unwrap(), &path).unwrap();
    let mut bytes = Vec::new();
    again(&sealed).read_to_end(&mut bytes).unwrap();
    let document: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
    let keys = |value: &serde_json::Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&document), ["handover", "process"]);
    assert_eq!(keys(&document["handover"]), ["armed", "by", "off"]);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), sha256(&bytes));
    for printed in [&b""[..], b"isotherm is fine\n", b"isotherm-source"] {
        let file = KeptProfile::offer().unwrap();
        (&file).write_all(printed).unwrap();
        assert!(KeptProfile::answered(file).unwrap().is_none());
    }
}

#[test]
fn a_profile_that_was_changed_cut_or_exchanged_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    let this = Process::this().unwrap();
    let kept = profile(directory.path());
    let memory = handover().seal(Prepared::with(Some(&kept)).unwrap(), &path).unwrap();
    let mut whole = Vec::new();
    again(&memory).read_to_end(&mut whole).unwrap();
    assert!(ReceivedHandover::read(&sealed(&whole), &this).is_ok());
    let refused = |bytes: &[u8]| ReceivedHandover::read(&sealed(bytes), &this).err().unwrap_or_default();
    for place in 0..usize::try_from(kept.seal.length).unwrap() {
        let mut bytes = whole.clone();
        bytes[place] ^= 1;
        assert!(refused(&bytes).contains("not accepted"), "{place}");
    }
    for end in 0..whole.len() {
        assert!(refused(&whole[..end]).contains("not accepted"), "{end}");
    }
    let with_length = |length: u64| [&whole[..whole.len() - 8], &length.to_le_bytes()].concat();
    for length in [0, 1, LARGEST + 1, u64::MAX] {
        assert!(refused(&with_length(length)).contains("not accepted"), "{length}");
    }
    // A document without a profile must not have sources before it.
    let document = document(&this);
    let length = (document.len() as u64).to_le_bytes();
    let sources = &whole[..usize::try_from(kept.seal.length).unwrap()];
    assert!(refused(&[sources, &document, &length].concat()).contains("cannot read the format"));
}

#[test]
fn a_rehearsal_leaves_nothing_and_touches_no_handover_under_way() {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    std::fs::write(&path, "under way").unwrap();
    Handover::rehearse(&path).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "under way");
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
    let nowhere = directory.path().join("mill.handover/mill.handover");
    assert!(Handover::rehearse(&nowhere).unwrap_err().to_string().contains("mill.handover"));
}

#[test]
fn what_can_be_changed_or_is_another_users_is_refused() {
    let write = |change: &dyn Fn(&File)| {
        let file = File::from(memfd_create(NAME, MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING).unwrap());
        (&file).write_all(b"{}").unwrap();
        change(&file);
        File::open(format!("/proc/self/fd/{}", file.as_raw_fd())).map_or_else(
            |error| error.to_string(),
            |file| memory::size_of_sealed(&file).err().unwrap_or_default().to_owned(),
        )
    };
    let mode = |file: &File, mode| file.set_permissions(Permissions::from_mode(mode)).unwrap();
    let is_whole = |file: &File| {
        mode(file, MODE);
        fcntl_add_seals(file, seals()).unwrap();
    };
    assert_eq!(write(&is_whole), "");
    assert!(write(&|file| mode(file, MODE)).contains("not sealed"));
    for one in [SealFlags::SEAL, SealFlags::SHRINK, SealFlags::GROW, SealFlags::WRITE] {
        let without = |file: &File| {
            mode(file, MODE);
            fcntl_add_seals(file, seals() - one).unwrap();
        };
        assert!(write(&without).contains("not sealed"), "{one:?}");
    }
    for open in [0o777, 0o600, 0o440, 0o404, 0o4400] {
        let open = |file: &File| {
            fcntl_add_seals(file, seals()).unwrap();
            mode(file, open);
        };
        assert!(write(&open).contains("other users may open the handover"));
    }
    if rustix::process::geteuid().is_root() {
        let of_another = |file: &File| {
            is_whole(file);
            std::os::unix::fs::fchown(file, Some(65534), None).unwrap();
        };
        assert!(write(&of_another).contains("another user"));
    }
    // A file on a disk has no seals.
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("file"), "{}").unwrap();
    let file = File::open(directory.path().join("file")).unwrap();
    assert!(memory::size_of_sealed(&file).unwrap_err().contains("not sealed"));
    let large = vec![b' '; usize::try_from(LARGEST).unwrap() + 1];
    assert!(accepted(&large, None, &Process::this().unwrap()).unwrap_err().contains("too large"));
}

#[test]
fn of_another_process_another_start_or_another_boot_nothing_is_accepted() {
    let this = Process::this().unwrap();
    let refused = |process: &Process| {
        let bytes = document(process);
        accepted(&bytes, Some(&sha256(&bytes)), &this).err().unwrap_or_default()
    };
    assert_eq!(refused(&this), "");
    assert!(refused(&Process { id: this.id + 1, ..this.clone() }).contains("another process"));
    assert!(refused(&Process { started: this.started + 1, ..this.clone() }).contains("another process"));
    let boot = "00000000-0000-0000-0000-000000000000".to_owned();
    assert!(refused(&Process { boot, ..this.clone() }).contains("another process"));
}

#[test]
fn bytes_that_were_cut_or_changed_are_refused_with_their_own_digest_too_unless_they_say_the_same() {
    let this = Process::this().unwrap();
    let whole = document(&this);
    let digest = sha256(&whole);
    let mut changed: Vec<Vec<u8>> = (0..whole.len()).map(|end| whole[..end].to_vec()).collect();
    for place in 0..whole.len() {
        for byte in [0, b'"', b'}', b'9', 0xff] {
            let mut bytes = whole.clone();
            bytes[place] = byte;
            changed.push(bytes);
        }
    }
    let garbage = ["", "null", "[]", "{}", "{\"process\":{}}", "\u{0}", "1e999"];
    changed.extend(garbage.map(|text| text.as_bytes().to_vec()));
    changed.push(b"[".repeat(100_000));
    changed.push([&whole[..], &whole[..]].concat());
    for bytes in changed.iter().filter(|bytes| **bytes != whole) {
        assert!(accepted(bytes, Some(&digest), &this).is_err(), "{}", String::from_utf8_lossy(bytes));
        // With a matching digest, the content is accepted as it was written, or rejected. It never causes a panic.
        if let Ok(found) = accepted(bytes, Some(&sha256(bytes)), &this) {
            assert!(found.armed.values().all(|cz| cz.get().is_finite()), "{found:?}");
        }
    }
    for digest in
        [None, Some(""), Some(&digest[1..]), Some(&digest.to_uppercase()), Some(&format!("{digest}\n"))]
    {
        assert!(accepted(&whole, digest, &this).is_err(), "{digest:?}");
    }
}

#[test]
fn thousands_of_axes_fit() {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    let why = "waits for a person: ".repeat(20);
    let off = (0..5000).map(|axis| (format!("axis_{axis:060}"), why.clone())).collect();
    let handover = Handover { off, ..Handover::default() };
    let sealed = handover.seal(Prepared::with(None).unwrap(), &path).unwrap();
    assert!(sealed.metadata().unwrap().len() > 2_000_000);
    let found = ReceivedHandover::read(&again(&sealed), &Process::this().unwrap());
    assert_eq!(Arrival { found: Some(found) }.accept(&path), Ok(Some(handover)));
}
