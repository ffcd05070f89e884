//! `--into-profile`: puts the identified model into the profile after the user has answered yes. Everything else in the
//! file is unchanged. The previous profile is kept in the same directory.

use std::fs::Metadata;
use std::io::Write;
use std::os::unix::fs::{MetadataExt, chown};
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::cli::backup::write_new;
use crate::cli::loading::shipped;
use crate::cli::print::{Out, say, say_beside};
use crate::cli::values::{typed, wrong_arguments};
use isotherm_core::compensation::model::Outside;
use isotherm_core::compensation::reference::Reference;
use isotherm_identify::Identified;
use isotherm_identify::written::{Written, written};
use isotherm_profile::edit::{ModelEdit, put_machine_on, put_model};
use isotherm_profile::{NO_MACHINE_START, Profile, counted, environment, load_edited, safe_file};

/// Upper limit, exclusive, of the number at the end of a model's file names. The numbers from 1 are tried
/// until no file with such a name exists.
const MOST_FILES: u32 = 10_000;

/// Options for a model that goes into the profile.
#[derive(clap::Args, Debug)]
pub(super) struct IntoProfileArguments {
    /// Puts the model into the profile after you have answered yes. It replaces the models of the axis; everything else
    /// in the file is unchanged, comments included. The files of the model are written to the same directory. The
    /// previous profile is kept as PROFILE.old
    #[arg(long, conflicts_with_all = ["json", "balls", "set"])]
    pub(super) into_profile: bool,
    /// With --into-profile: changes the profile without a question
    #[arg(long, short, requires = "into_profile")]
    pub(super) yes: bool,
}

/// Edit of a profile that waits for the confirmation of the user.
pub(super) struct IntoProfile {
    /// Path of the profile as the user wrote it. The files of the model are in the directory of this path, even if the
    /// path is a symbolic link.
    path: PathBuf,
    text: String,
    before: String,
    written: Written,
    line: usize,
    replaced: usize,
}

/// Returns the text of the profile. A shipped profile inside the program is an error, because only a file can be
/// edited. The check is made before the long identification.
pub(super) fn text_of(path: &Path) -> anyhow::Result<String> {
    if shipped(path).is_some() {
        return Err(wrong_arguments(format!(
            "--into-profile needs the file of a profile, and {} is part of the program; --write writes the block to a \
             file",
            path.display()
        )));
    }
    safe_file::read_text_of(path, safe_file::LARGEST_PROFILE)
        .with_context(|| format!("{} cannot be read", path.display()))
}

impl IntoProfile {
    /// Prepares the edit: the text of the profile with the model. Changes no file.
    pub(super) fn prepare(
        profile: &Path,
        before: String,
        found: &Identified,
        outside: Outside,
    ) -> anyhow::Result<IntoProfile> {
        let (shown, path) = (profile.display(), profile.to_owned());
        let written = with_new_files(found, &path, outside)?;
        let by_hand = "; --write writes the block to a file: copy it into the profile by hand";
        let edit = put_model(&before, &found.axis, &written.block);
        let ModelEdit { text, line, replaced } =
            edit.map_err(|why| anyhow::anyhow!("the model cannot be put into {shown}: {why}{by_hand}"))?;
        Ok(IntoProfile { path, text, before, written, line, replaced })
    }

    /// Asks the user, then writes the files of the model and the profile. `profile` is the previous profile.
    pub(super) fn ask_and_write(mut self, profile: &Profile, axis: &str, yes: bool) -> anyhow::Result<()> {
        let shown = self.path.display().to_string();
        let instead = match self.replaced {
            0 => String::new(),
            count => format!(", instead of {}", counted(count, "model")),
        };
        say_beside!(
            "The model of axis {axis} will be written to {shown}, line {}{instead}. Nothing else in this \
             file changes.",
            self.line
        );
        if !yes && !agrees("Write the model to the profile?")? {
            anyhow::bail!("{shown} is not changed");
        }
        let written = self.write(profile, axis, yes);
        let old = written.inspect_err(|_| self.remove_files())?;
        say!("the model is in {shown}, line {}; the old profile is saved as {}", self.line, old.display())?;
        for (name, _) in &self.written.files {
            say!("the model also needs the file {name} in the directory of the profile")?;
        }
        say!("Next: isotherm check {shown}")?;
        Ok(())
    }

    fn directory(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Writes the files of the model, a copy of the previous profile, and the new profile. Returns the path of the
    /// copy.
    fn write(&mut self, profile: &Profile, axis: &str, yes: bool) -> anyhow::Result<PathBuf> {
        let shown = self.path.display().to_string();
        // The profile may be a link, which stays.
        let file = self.path.canonicalize().with_context(|| format!("{shown} cannot be found"))?;
        let like = file.metadata().with_context(|| format!("{shown} cannot be read"))?;
        for (name, text) in &self.written.files {
            let path = self.directory().join(name);
            put(&path, text, &like).with_context(|| format!("{} cannot be written", path.display()))?;
        }
        let new = self.parsed()?;
        let counts_from_start =
            new.axes.iter().any(|own| own.settings.name == axis && own.counts_from(Reference::Start));
        if counts_from_start && new.machine.on.is_none() {
            self.ask_for_the_start(profile, yes)?;
            self.parsed()?;
        }
        anyhow::ensure!(
            text_of(&self.path)? == self.before,
            "{shown} is not changed, because another program has changed it meanwhile: repeat the command"
        );
        let old = self.path.with_added_extension("old");
        let kept = put(&old, &self.before, &like);
        kept.with_context(|| format!("{} cannot be written, so {shown} is not changed", old.display()))?;
        put(&file, &self.text, &like).with_context(|| format!("{shown} cannot be written"))?;
        Ok(old)
    }

    /// Removes the files of the model after a failed edit, because the profile does not name them.
    fn remove_files(&self) {
        for (name, _) in &self.written.files {
            let _ = std::fs::remove_file(self.directory().join(name));
        }
    }

    /// Loads the profile with the model from the new text, and returns it. The files that the profile names must exist.
    fn parsed(&self) -> anyhow::Result<Profile> {
        let parsed = load_edited(&self.path, &self.text, &environment());
        Ok(parsed
            .map_err(|errors| anyhow::anyhow!("with this model the profile has errors:\n{errors}"))?
            .profile)
    }

    /// Asks which signal shows the machine start, because the model uses temperature rises since the machine start.
    /// Without an answer, the profile gets no such signal.
    fn ask_for_the_start(&mut self, profile: &Profile, yes: bool) -> anyhow::Result<()> {
        say_beside!("{NO_MACHINE_START}");
        if yes {
            return Ok(());
        }
        let bits = profile.signals.iter().filter(|signal| signal.unit.0 == "bool");
        let names: Vec<&str> = bits.map(|signal| signal.name.as_str()).collect();
        if names.is_empty() {
            say_beside!(
                "  no signal of the profile is a bit; add such a signal, and write its name as `on` into [machine]"
            );
            return Ok(());
        }
        loop {
            prompt(&format!(
                "Signal that is 1 while the machine is on ({}), or none [none]: ",
                names.join(", ")
            ))?;
            let answer = typed()?.unwrap_or_default();
            match answer.trim() {
                "" | "none" => return Ok(()),
                name if names.contains(&name) => {
                    let edited = put_machine_on(&self.text, name);
                    self.text = edited
                        .map_err(|why| anyhow::anyhow!("`on` cannot be added to the profile: {why}"))?;
                    // `on` is a line above the model, as [machine] stands above the axes in every shipped profile.
                    self.line += 1;
                    return Ok(());
                }
                other => say_beside!(
                    "  {}",
                    isotherm_profile::allowed(other, names.iter().copied().chain(["none"]))
                ),
            }
        }
    }
}

/// Returns the block and the files of a model. Each file gets a name that does not exist yet, so that the previous
/// profile stays valid.
fn with_new_files(found: &Identified, path: &Path, outside: Outside) -> anyhow::Result<Written> {
    let directory = path.parent().unwrap_or(Path::new(""));
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("model");
    let mut numbered =
        (1..MOST_FILES).map(|number| written(found, &format!("{stem}-{}-{number}", found.axis), outside));
    let is_new = |written: &Written| {
        !written.files.iter().any(|(name, _)| directory.join(name).symlink_metadata().is_ok())
    };
    numbered
        .find(is_new)
        .with_context(|| format!("there are too many files of models next to {}", path.display()))
}

/// Writes a complete file, and replaces an existing one at once. The file has the permissions and the owner of the
/// profile, if this user may set them. The file may contain passwords, and the gateway must be able to read it.
fn put(path: &Path, text: &str, profile: &Metadata) -> std::io::Result<()> {
    const PERMISSIONS: u32 = 0o777;
    let new = path.with_added_extension("new");
    let _ = std::fs::remove_file(&new);
    let written = write_new(&new, text.as_bytes(), profile.mode() & PERMISSIONS, None).and_then(|()| {
        let _ = chown(&new, Some(profile.uid()), Some(profile.gid()));
        std::fs::rename(&new, path)
    });
    written.inspect_err(|_| {
        let _ = std::fs::remove_file(&new);
    })
}

fn prompt(text: &str) -> std::io::Result<()> {
    Out.write_all(text.as_bytes())?;
    Out.flush()
}

/// Asks until the answer is yes or no. The end of the input counts as no.
fn agrees(question: &str) -> anyhow::Result<bool> {
    loop {
        prompt(&format!("{question} [yes]: "))?;
        let Some(answer) = typed()? else { return Ok(false) };
        match answer.trim().to_ascii_lowercase().as_str() {
            "" | "y" | "yes" => return Ok(true),
            "n" | "no" => return Ok(false),
            _ => say_beside!("  write yes or no"),
        }
    }
}
