use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use tar::{Builder, EntryType, Header};

/// Manifest of one profile and these files.
fn manifest(files: &[(&str, &[u8])]) -> Vec<u8> {
    let entry = |(path, bytes): &(&str, &[u8])| serde_json::json!({ "path": path, "mode": 0o640, "bytes": bytes.len(), "sha256": sha256(bytes) });
    let files: Vec<_> = files.iter().map(entry).collect();
    let list = serde_json::json!({
        "form": FORM, "program": "0", "machine": "m", "time": "2026-01-31T12:00:00Z", "secrets": false,
        "profile": "m.toml", "state_directory": null, "files": files
    });
    serde_json::to_vec(&list).unwrap()
}

/// A tar header with any name, including invalid ones.
fn header(path: &str, kind: EntryType, size: u64) -> Header {
    let mut header = Header::new_ustar();
    header.as_old_mut().name[..path.len()].copy_from_slice(path.as_bytes());
    header.set_entry_type(kind);
    header.set_size(size);
    header.set_mode(0o640);
    header.set_cksum();
    header
}

fn archive(list: &[u8], files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut archive = Builder::new(Vec::new());
    for (path, bytes) in std::iter::once(&(MANIFEST, list)).chain(files) {
        archive.append(&header(path, EntryType::Regular, bytes.len() as u64), *bytes).unwrap();
    }
    archive.into_inner().unwrap()
}

const GOOD: [(&str, &[u8]); 3] = [
    ("profile/m.toml", b"[machine]\nname = \"m\"\n"),
    ("profile/devices/mine.toml", b"x"),
    ("state/m.state.json", b"{}"),
];

fn why(bytes: &[u8]) -> String {
    format!("{:#}", read(bytes).err().unwrap())
}

#[test]
fn what_a_backup_lists_is_read_in_its_order() {
    let (list, files) = read(&archive(&manifest(&GOOD), &GOOD)).unwrap();
    assert_eq!((list.machine.as_str(), list.files.len()), ("m", 3));
    assert!(files.iter().zip(GOOD).all(|(found, (_, bytes))| found == bytes));
}

#[test]
fn a_name_that_leads_out_of_the_directory_is_refused() {
    for path in [
        "profile/../../etc/passwd",
        "/etc/passwd",
        "profile//etc/passwd",
        "profile/./m.toml/",
        "profile/..",
        "profile/",
        "profile",
        "state/../m.toml",
        "state/deep/m.state.json",
        "elsewhere/m.toml",
        "profile/a\nb",
        "",
    ] {
        let files = [GOOD[0], (path, b"x".as_slice())];
        let said = why(&archive(&manifest(&files), &[GOOD[0]]));
        assert!(
            said.contains("would be outside") || said.contains("not a file of a state"),
            "{path}: {said}"
        );
    }
}

#[test]
fn of_what_was_learned_only_names_that_learning_gives_are_accepted() {
    let learned = ["products/z@2026-01-05T06:00:00Z.products.json", "products/z.learning.json"];
    let files = learned.map(|path| (path, b"x".as_slice()));
    let files = [GOOD[0], GOOD[2], files[0], files[1]];
    assert_eq!(read(&archive(&manifest(&files), &files)).unwrap().1.len(), 4);
    for path in ["products/notes.txt", "products/deep/z.learning.json", "products/z.state.json"] {
        let files = [GOOD[0], (path, b"x".as_slice())];
        let said = why(&archive(&manifest(&files), &files));
        assert!(said.contains("is not a file of learned data"), "{path}: {said}");
    }
}

#[test]
fn links_devices_and_entries_that_speak_of_the_next_one_are_refused() {
    let list = manifest(&GOOD[..1]);
    for kind in [
        EntryType::Symlink,
        EntryType::Link,
        EntryType::Char,
        EntryType::Block,
        EntryType::Fifo,
        EntryType::Directory,
        EntryType::GNUSparse,
        EntryType::GNULongName,
        EntryType::GNULongLink,
        EntryType::XHeader,
        EntryType::XGlobalHeader,
        EntryType::Continuous,
    ] {
        let mut archive = Builder::new(Vec::new());
        archive.append(&header(MANIFEST, EntryType::Regular, list.len() as u64), list.as_slice()).unwrap();
        archive.append(&header(GOOD[0].0, kind, GOOD[0].1.len() as u64), GOOD[0].1).unwrap();
        let said = why(&archive.into_inner().unwrap());
        assert!(said.contains("a link, a device or another file"), "{kind:?}: {said}");
    }
}

#[test]
fn sizes_that_promise_more_than_there_is_cost_no_memory() {
    for size in [u64::from(u32::MAX), 1 << 40, u64::MAX] {
        let mut bytes = header(MANIFEST, EntryType::Regular, 0);
        bytes.set_size(size);
        bytes.set_cksum();
        assert!(read(bytes.as_bytes()).is_err());
        let list = manifest(&GOOD[..1]);
        let mut whole = archive(&list, &[]);
        whole.truncate(512 + list.len().next_multiple_of(512));
        let mut next = header(GOOD[0].0, EntryType::Regular, 0);
        next.set_size(size);
        next.set_cksum();
        whole.extend_from_slice(next.as_bytes());
        assert!(read(&whole).is_err(), "{size}");
    }
}

#[test]
fn more_less_and_other_than_the_list_says_is_refused() {
    let list = manifest(&GOOD);
    assert!(why(&archive(&list, &GOOD[..2])).contains("ends before state/m.state.json"));
    let more = [GOOD[0], GOOD[1], GOOD[2], ("profile/more", b"x".as_slice())];
    assert!(why(&archive(&list, &more)).contains("more files than its manifest"));
    let other = [GOOD[0], (GOOD[1].0, b"y".as_slice()), GOOD[2]];
    assert!(why(&archive(&list, &other)).contains("SHA-256 is wrong"));
    let twice = [GOOD[0], GOOD[0]];
    assert!(why(&archive(&manifest(&twice), &twice)).contains("twice"));
    assert!(why(&archive(&manifest(&GOOD[1..]), &GOOD[1..])).contains("not contain the profile m.toml"));
    assert!(why(b"").contains("the file is empty"));
    assert!(why(b"no archive at all").contains("the file is damaged"));
}

/// After any change of a backup's bytes, it is rejected or its files are the same.
#[test]
fn whatever_is_changed_in_a_backup_it_is_refused_or_the_files_are_the_same() {
    let good = archive(&manifest(&GOOD), &GOOD);
    let mut random = Pcg64::seed_from_u64(25);
    let (mut refused, mut same) = (0, 0);
    for _ in 0..20_000 {
        let mut bytes = good.clone();
        for _ in 0..random.random_range(1..4) {
            let place = random.random_range(0..bytes.len());
            match random.random_range(0..4) {
                0 => bytes[place] = random.random(),
                1 => bytes[place] ^= 1 << random.random_range(0..8),
                2 => bytes.truncate(place.max(1)),
                _ => drop(bytes.splice(place..place, std::iter::repeat_n(0, 512))),
            }
        }
        match read(&bytes) {
            Err(_) => refused += 1,
            Ok((list, files)) => {
                same += 1;
                let found = list.files.iter().zip(&files);
                assert!(found.zip(GOOD).all(|((_, found), (_, bytes))| found == bytes));
                assert!(
                    list.files
                        .iter()
                        .all(|entry| entry.path.starts_with("profile/") || entry.path.starts_with("state/"))
                );
            }
        }
    }
    assert!(refused > 1000 && same > 0, "{refused} refused, {same} the same");
}

#[test]
fn only_secrets_of_root_are_given_to_the_service() {
    let home = tempfile::tempdir().unwrap();
    let file = |name: &str, mode: u32| {
        let path = home.path().join(name);
        std::fs::write(&path, name).unwrap();
        Planned { path, mode, bytes: Vec::new() }
    };
    let written = [file("m.toml", PROFILE_MODE), file("operator.token", SECRET_MODE), file("state", MODE)];
    let given: Vec<&Path> = secrets_of_root(&written).collect();
    let is_root = rustix::process::geteuid().is_root();
    let expected: Vec<&Path> =
        written[1..2].iter().map(|file| file.path.as_path()).filter(|_| is_root).collect();
    assert_eq!(given, expected);
    if is_root {
        std::os::unix::fs::chown(&written[1].path, Some(65534), None).unwrap();
        assert_eq!(secrets_of_root(&written).count(), 0, "it belongs to the user of its directory");
    }
}
