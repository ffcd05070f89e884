use super::*;

use isotherm_core::quantity::Micron;

fn handover() -> Handover {
    let off = (0..3).map(|axis| (format!("axis{axis}"), "switched off by a person".to_owned()));
    let armed = [("z".to_owned(), Micron::new(39.0).unwrap())].into();
    Handover { by: "by maria over the command socket".to_owned(), armed, off: off.collect() }
}

fn document(process: &Process) -> Vec<u8> {
    serde_json::to_vec(&Document { process: process.clone(), handover: handover() }).unwrap()
}

#[test]
fn what_is_sealed_is_read_back_and_its_digest_lies_in_the_state_directory() {
    let directory = tempfile::tempdir().unwrap();
    let path = digest_path(directory.path(), "mill");
    let sealed = handover().seal(&path).unwrap();
    let mut through =
        File::open(format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&sealed))).unwrap();
    let bytes = content(&through).unwrap();
    let digest = take_digest(&path).unwrap();
    let this = Process::this().unwrap();
    assert_eq!(accepted(&bytes, digest.as_deref(), &this).unwrap(), handover());
    assert!(std::fs::read_dir(directory.path()).unwrap().next().is_none(), "the digest is gone");
    // Once more: it was used.
    let digest = take_digest(&path).unwrap();
    assert!(accepted(&bytes, digest.as_deref(), &this).unwrap_err().contains("was used before"));
    // Nobody changes it.
    assert!(through.write(b"{").is_err() && through.set_len(0).is_err() && (&sealed).write(b"{").is_err());
    let flags = rustix::io::fcntl_getfd(&sealed).unwrap();
    assert!(flags.contains(rustix::io::FdFlags::CLOEXEC), "a child does not get it");
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
        let path = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&file));
        File::open(path)
            .map_or_else(|error| error.to_string(), |file| content(&file).err().unwrap_or_default())
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
        assert!(write(&open).contains("others than its owner"));
    }
    let large = |file: &File| {
        file.set_len(LARGEST + 1).unwrap();
        is_whole(file);
    };
    assert!(write(&large).contains("too large"));
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
    assert!(content(&File::open(directory.path().join("file")).unwrap()).unwrap_err().contains("not sealed"));
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
        // With a digest of its own it is what its writer says, or nothing; never a panic.
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
    let sealed = handover.seal(&path).unwrap();
    let path_of_it = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&sealed));
    let bytes = content(&File::open(path_of_it).unwrap()).unwrap();
    assert!(bytes.len() > 2_000_000);
    let digest = take_digest(&path).unwrap();
    assert_eq!(accepted(&bytes, digest.as_deref(), &Process::this().unwrap()).unwrap(), handover);
}
