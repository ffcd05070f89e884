//! Parquet: files that caused panics in its reader, and small files with huge content.

use std::path::{Path, PathBuf};

use super::rig::{Home, isotherm, size};

fn there() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests")
}

fn kept(directory: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(there().join(directory)).unwrap();
    entries.map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn every_parquet_file_that_was_kept_is_refused_or_read() {
    let _home = Home::new();
    for path in kept("corpus/parquet").into_iter().chain(kept("security/bombs")) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let seen = isotherm(&["report"], &path);
        seen.is_within(size(&path));
        assert_eq!(seen.code, 1, "{name}: {}", seen.said);
        // The good files lack a displacement, which is their only error.
        assert!(name.starts_with("good") || seen.said.contains(name), "{name}: {}", seen.said);
    }
}

#[test]
fn what_is_wrong_with_a_parquet_file_is_said_in_a_sentence() {
    let _home = Home::new();
    for (name, words) in [
        ("corpus/parquet/negative_length.parquet", ["column", "negative"]),
        ("corpus/parquet/no_dictionary.parquet", ["column", "a page has no header, or a damaged header"]),
        // Its pages look valid, but the reader panics on their content.
        ("corpus/parquet/reader_panics.parquet", ["the file cannot be read as Parquet", "the reader failed"]),
        ("security/bombs/many_rows.parquet", ["20000000 rows", "are allowed"]),
        ("security/bombs/huge_page.parquet", ["has 80000", "at most 48000000"]),
        ("security/bombs/more_than_it_says.parquet", ["contains more than", "that its header gives"]),
    ] {
        let path = there().join(name);
        isotherm(&["report"], &path).is_refused(size(&path), &[&[name], &words[..]].concat());
    }
}

#[test]
fn a_parquet_file_cut_short_or_of_something_else_is_refused() {
    let home = Home::new();
    let whole = std::fs::read(there().join("corpus/parquet/good.parquet")).unwrap();
    for (name, bytes) in [
        ("empty.parquet", &b""[..]),
        ("magic.parquet", b"PAR1PAR1"),
        ("footer.parquet", b"PAR1\xff\xff\xff\x7fPAR1"),
        ("half.parquet", &whole[..whole.len() / 2]),
    ] {
        let path = home.write(name, bytes);
        isotherm(&["report"], &path).is_refused(size(&path), &[name, "the file is not a Parquet file"]);
    }
    let path = home.write("text.parquet", b"time,bed\n0,20\n");
    isotherm(&["report"], &path)
        .is_refused(size(&path), &["text.parquet", "rename it to a name that ends with .csv"]);
}
