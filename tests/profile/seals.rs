//! `sha256` of a model: a changed file is rejected at the key that names it.

use super::data::{ENVELOPE, File, HALVED, HALVES, NETWORK, NETWORK_KEYS, STAND_INS, machine, refused_at};
use super::*;
use isotherm_profile::sha256;

const FILES: [File<'_>; 3] =
    [("e.json", ENVELOPE.as_bytes()), ("h.json", HALVES.as_bytes()), ("s.json", STAND_INS.as_bytes())];

/// Returns a model with three files and their SHA-256.
fn sealed() -> String {
    let seal = |(key, (_, content)): (&str, &File<'_>)| format!("\nsha256.{key} = \"{}\"", sha256(content));
    let seals: String = ["envelope", "halves", "stand_ins"].into_iter().zip(&FILES).map(seal).collect();
    format!("{HALVED}\nstand_ins = \"s.json\"{seals}")
}

/// Returns the warnings about SHA-256.
fn doubts(loaded: &Loaded) -> Vec<ProfileError> {
    loaded.warnings.iter().filter(|warning| warning.message.contains("sha256")).cloned().collect()
}

#[test]
fn a_seal_is_what_sha256sum_prints_in_capitals_as_well() {
    assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    for keys in
        [sealed(), sealed().replace(&sha256(HALVES.as_bytes()), &sha256(HALVES.as_bytes()).to_uppercase())]
    {
        let loaded = machine(&keys, &FILES).unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(doubts(&loaded), []);
    }
}

#[test]
fn a_file_that_was_changed_is_refused_at_the_key_that_names_it_with_what_to_do() {
    for (changed, key) in [(0, "envelope"), (1, "halves"), (2, "stand_ins")] {
        let (name, content) = FILES[changed];
        // The content is equal for a reader of JSON.
        let content = [content, b"\n"].concat();
        let mut files = FILES;
        files[changed].1 = &content;
        let found = sha256(&content);
        let remedy = format!("If the change is intended, write sha256.{key} = \"{found}\"");
        refused_at(
            &sealed(),
            &files,
            &format!(".{key}"),
            &[name, "was changed", "put back the file", &remedy],
        );
    }
}

#[test]
fn a_network_is_sealed_as_the_others_are() {
    let keys = |seal: &str| format!("{NETWORK_KEYS}\nreference = 0.0\nsha256 = {{ file = \"{seal}\" }}");
    let files: &[File<'_>] = &[("n.json", NETWORK.as_bytes())];
    machine(&keys(&sha256(NETWORK.as_bytes())), files).unwrap_or_else(|errors| panic!("{errors}"));
    refused_at(
        &keys(&sha256(b"another")),
        files,
        ".file",
        &["n.json: the file was changed, or belongs to another model"],
    );
}

#[test]
fn what_seals_nothing_or_is_no_seal_is_refused() {
    let none = format!(
        "kind = \"linear\"\nterms = [ {{ signal = \"bed\", gain = 2, reference = 0.0 }} ]\nsha256.halves = \"{}\"",
        sha256(b"")
    );
    refused_at(
        &none,
        &[],
        ".sha256.halves",
        &["the model has a SHA-256 for the file `halves`, but no key `halves`"],
    );
    let short = sealed().replace(&sha256(HALVES.as_bytes()), "cafe");
    refused_at(&short, &FILES, ".sha256.halves", &["64 hex digits", "`sha256sum h.json` prints"]);
    let other = format!("{}\nsha256.nets = \"\"", sealed());
    refused_at(&other, &FILES, ".sha256.nets", &["nets"]);
}

#[test]
fn one_file_without_a_seal_beside_others_that_have_one_is_doubted_and_none_at_all_is_not() {
    let lacking = sealed().replace(&format!("\nsha256.stand_ins = \"{}\"", sha256(STAND_INS.as_bytes())), "");
    let loaded = machine(&lacking, &FILES).unwrap_or_else(|errors| panic!("{errors}"));
    let warnings = doubts(&loaded);
    let [warning] = warnings.as_slice() else { panic!("{warnings:?}") };
    assert_eq!(warning.key, "axis.z.model[0].stand_ins", "{warning}");
    assert!(warning.to_string().contains("s.json has no `sha256.stand_ins`"), "{warning}");
    let unsealed = machine(&format!("{HALVED}\nstand_ins = \"s.json\""), &FILES).unwrap();
    assert_eq!(doubts(&unsealed), []);
}
