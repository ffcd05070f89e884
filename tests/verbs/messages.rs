//! Messages of the verbs about mistakes of a user: one sentence for each, with what to do.

use std::path::Path;
use std::process::Stdio;

use crate::cli::{Ended, ended, machine};
use crate::support::process::{Running, file, isotherm, until};

/// Runs `check` on a path, and returns its exit code and its messages.
fn check(home: &Path, path: &Path) -> Ended {
    ended(isotherm(home).arg("check").arg(path).stdin(Stdio::null()))
}

#[test]
fn a_file_that_is_no_profile_is_one_error_that_says_what_it_is() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    let name = text.lines().find(|line| line.starts_with("name")).unwrap();
    for (title, written, words) in [
        ("yaml", "machine:\n  name: press-7\n".to_owned(), "this is a YAML document, not a profile"),
        ("json", "{ \"machine\": { \"name\": \"press-7\" } }\n".to_owned(), "a profile is TOML"),
        ("quotes", text.replace(name, "name = “press-7”"), "these are typographic quotation marks"),
        ("script", text.replace(name, &format!("{name}\n名前 = 1")), "letters a to z"),
        (
            "one-bracket",
            text.replace("[[axis.z.model]]", "[axis.z.model]"),
            "write [[axis.z.model]], with two",
        ),
        ("two-brackets", text.replace("[axis.z]\n", "[[axis.z]]\n"), "write [axis.z], with one"),
        ("empty", String::new(), "the file is empty"),
        ("comment", "# nothing yet\n\n".to_owned(), "the file is empty"),
    ] {
        let path = file(home.path(), &format!("{title}.toml"), &written);
        let Ended { code, said, .. } = check(home.path(), &path);
        assert!(code == Some(64) && said.contains(words) && said.contains("\n  help: "), "{title}: {said}");
        assert!(said.ends_with("1 error in the profile\n"), "{title}: {said}");
    }
    for (path, words) in [
        (home.path(), "this is a directory, not a profile"),
        (Path::new("-"), "not read from standard input"),
        (Path::new("/dev/stdin"), "not read from standard input"),
    ] {
        let Ended { code, said, .. } = check(home.path(), path);
        assert!(code == Some(64) && said.contains(words), "{}: {said}", path.display());
        assert!(said.ends_with("1 error in the profile\n"), "{}: {said}", path.display());
    }
}

#[test]
fn a_profile_that_does_not_exist_is_looked_for_in_its_directory() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    for name in ["press-7.toml", "press-7.local.toml", "press-7.plant.toml"] {
        file(home.path(), name, &text);
    }
    for (written, words) in [
        ("press-7", "did you mean `HOME/press-7.toml`?"),
        ("pres-7.toml", "did you mean `HOME/press-7.toml`?"),
        ("press-7.tml", "did you mean `HOME/press-7.toml`?"),
        ("other.toml", "`isotherm init` writes a first profile"),
        ("etc/press-7.toml", "check that the directory HOME/etc exists"),
    ] {
        let Ended { code, said, .. } = check(home.path(), &home.path().join(written));
        let words = words.replace("HOME", &home.path().display().to_string());
        assert!(code == Some(64) && said.contains(&words), "{written}: {said}");
    }
}

#[test]
fn a_file_that_is_in_the_way_is_named_with_what_to_do() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    // Gateways of other tests run for machines with the usual name.
    let text = text.replacen("name = \"interop\"", "name = \"press-7\"", 1);
    let path = file(home.path(), "press-7.toml", &text);
    let token = file(home.path(), "operator.token", "an old one\n");
    let Ended { code, said, .. } = ended(isotherm(home.path()).args(["token", "--out"]).arg(&token));
    assert!(
        code == Some(1) && said.contains("exists already and is not overwritten: name another file"),
        "{said}"
    );
    assert_eq!(std::fs::read_to_string(&token).unwrap(), "an old one\n");
    let Ended { code, said, .. } = ended(isotherm(home.path()).arg("backup").arg(&path).arg(home.path()));
    assert!(
        code == Some(1) && said.contains("is a directory: give the path of a file in it, or write --rotate"),
        "{said}"
    );
}

#[test]
fn a_relative_state_directory_without_the_state_names_the_one_that_has_it() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    let name = text.lines().find_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"')).unwrap();
    let profile = file(home.path(), "machine.toml", &text);
    let (state, elsewhere) = (home.path().join("state"), home.path().join("elsewhere"));
    for directory in [&state, &elsewhere] {
        std::fs::create_dir(directory).unwrap();
    }
    file(&state, &format!("{name}.state.json"), "{}");
    let status = |from: &Path, state: &str| {
        let mut command = isotherm(home.path());
        ended(command.arg("status").arg(&profile).args(["--state", state]).current_dir(from)).said
    };
    let said = status(&elsewhere, "state");
    let words = [format!("which has no state of {name}. "), format!("{} has one", state.display())];
    assert!(words.iter().all(|words| said.contains(words)), "{said}");
    for (from, state) in [(home.path(), "state"), (&elsewhere, state.to_str().unwrap())] {
        let said = status(from, state);
        assert!(!said.contains("has no state of"), "{state}: {said}");
    }
}

#[test]
fn status_says_that_the_profile_has_changed_since_the_start() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    let profile = file(home.path(), "machine.toml", &text);
    let state = home.path().join("state");
    let mut gateway =
        Running::start(isotherm(home.path()).arg("run").arg(&profile).arg("--state").arg(&state));
    gateway.receives("the gateway runs");
    let status = || ended(isotherm(home.path()).arg("status").arg(&profile).arg("--state").arg(&state)).out;
    let words = "changed on disk since the start: machine.toml; `isotherm restart PROFILE --keep` loads the";
    let before = status();
    assert!(before.contains("clock ") && !before.contains("changed on disk"), "{before}");
    std::fs::write(&profile, format!("{text}\n# another line\n")).unwrap();
    until("the change is seen", || match status() {
        said if said.contains(words) => Ok(()),
        said => Err(said),
    });
    std::fs::write(&profile, &text).unwrap();
    until("the profile is the old one again", || match status() {
        said if said.contains("changed on disk") => Err(said),
        _ => Ok(()),
    });
}
