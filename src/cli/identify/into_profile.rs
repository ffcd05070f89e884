//! `--into-profile`: puts the identified model into the profile after a yes. Everything else in the file stays as it was
//! written. The profile before is kept next to it.

use std::io::Write;
use std::os::unix::fs::{MetadataExt, chown};
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::cli::print::{Out, say, say_beside};
use crate::cli::values::{typed, wrong_arguments};
use isotherm_core::compensation::model::Outside;
use isotherm_core::compensation::reference::Reference;
use isotherm_identify::Identified;
use isotherm_identify::written::{Written, written};
use isotherm_profile::edit::{ModelEdit, put_machine_on, put_model};
use isotherm_profile::{NO_MACHINE_START, Profile, counted, parse_beside, safe_file};

/// Largest number at the end of the names of a model's files.
const MOST_FILES: u32 = 10_000;

/// Options for a model that goes into the profile.
#[derive(clap::Args, Debug)]
pub(super) struct IntoProfileArguments {
    /// Puts the model into the profile after a yes. It replaces the models of the axis; everything else in the file stays
    /// as it was written, comments included. The files of the model are next to the profile, and the profile before is
    /// kept as PROFILE.old
    #[arg(long, conflicts_with_all = ["json", "balls", "set"])]
    pub(super) into_profile: bool,
    /// With --into-profile: puts the model in without a question
    #[arg(long, short, requires = "into_profile")]
    pub(super) yes: bool,
}

/// Edit of a profile that waits for the yes of the operator.
pub(super) struct IntoProfile {
    /// The file, behind all links.
    path: PathBuf,
    text: String,
    before: String,
    written: Written,
    line: usize,
    replaced: usize,
}

/// Returns the text of the profile, if it is a file. The check is made before the long identification.
pub(super) fn text_of(path: &Path) -> anyhow::Result<String> {
    if !path.exists() {
        return Err(wrong_arguments(format!(
            "--into-profile needs the file of a profile, and {} is none; --write writes the block to a file",
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
        let shown = profile.display();
        let path = profile.canonicalize().with_context(|| format!("{shown} cannot be found"))?;
        let directory = path.parent().unwrap_or(Path::new("")).to_owned();
        let written = with_new_files(found, &path, &directory, outside)?;
        let by_hand = "; --write writes the block to a file, to be pasted by hand";
        let edit = put_model(&before, &found.axis, &written.block);
        let ModelEdit { text, line, replaced } =
            edit.map_err(|why| anyhow::anyhow!("the model cannot be put into {shown}: {why}{by_hand}"))?;
        Ok(IntoProfile { path, text, before, written, line, replaced })
    }

    /// Asks, then writes the files of the model and the profile. `profile` is the profile before.
    pub(super) fn ask_and_write(mut self, profile: &Profile, axis: &str, yes: bool) -> anyhow::Result<()> {
        let shown = self.path.display().to_string();
        let instead = match self.replaced {
            0 => String::new(),
            count => format!(", instead of {}", counted(count, "model")),
        };
        say_beside!(
            "The model of axis {axis} goes into {shown}, line {}{instead}. Nothing else in it changes.",
            self.line
        );
        if !yes && !agrees("Put it in?")? {
            anyhow::bail!("{shown} is not changed");
        }
        self.write_files()?;
        let new = self.parsed().inspect_err(|_| self.remove_files())?;
        let counts_from_start =
            new.axes.iter().any(|own| own.settings.name == axis && own.counts_from(Reference::Start));
        if counts_from_start && new.machine.on.is_none() {
            self.ask_for_the_start(profile, yes)?;
        }
        let old = self.path.with_added_extension("old");
        let kept = std::fs::write(&old, &self.before);
        kept.with_context(|| format!("{} cannot be written, so {shown} is not changed", old.display()))?;
        replace(&self.path, &self.text).with_context(|| format!("{shown} cannot be written"))?;
        say!("the model is in {shown}, line {}; the profile before is {}", self.line, old.display())?;
        for (name, _) in &self.written.files {
            say!("a file of it is {name}, next to the profile")?;
        }
        say!("Next: isotherm check {shown}")?;
        Ok(())
    }

    fn directory(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    fn write_files(&self) -> anyhow::Result<()> {
        for (name, text) in &self.written.files {
            let path = self.directory().join(name);
            std::fs::write(&path, text).with_context(|| format!("{} cannot be written", path.display()))?;
        }
        Ok(())
    }

    /// Removes the files of the model, because the profile does not name them.
    fn remove_files(&self) {
        for (name, _) in &self.written.files {
            let _ = std::fs::remove_file(self.directory().join(name));
        }
    }

    /// Returns the profile with the model. The files that it names must exist.
    fn parsed(&self) -> anyhow::Result<Profile> {
        let parsed = parse_beside(&self.path, &self.text);
        Ok(parsed
            .map_err(|errors| anyhow::anyhow!("with this model the profile has errors:\n{errors}"))?
            .profile)
    }

    /// Asks which signal shows the machine start, from which the model counts. Without an answer, the profile stays
    /// without such a signal.
    fn ask_for_the_start(&mut self, profile: &Profile, yes: bool) -> anyhow::Result<()> {
        say_beside!("{NO_MACHINE_START}");
        if yes {
            return Ok(());
        }
        let names: Vec<&str> = profile.signals.iter().map(|signal| signal.name.as_str()).collect();
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
                    self.text = edited.map_err(|why| anyhow::anyhow!("`on` cannot be put in: {why}"))?;
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

/// Returns the block and the files of a model. Their names do not exist yet, so that the profile before stays valid.
fn with_new_files(
    found: &Identified,
    path: &Path,
    directory: &Path,
    outside: Outside,
) -> anyhow::Result<Written> {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("model");
    let mut numbered =
        (1..MOST_FILES).map(|number| written(found, &format!("{stem}-{}-{number}", found.axis), outside));
    let is_new = |written: &Written| {
        !written.files.iter().any(|(name, _)| directory.join(name).symlink_metadata().is_ok())
    };
    numbered.find(is_new).with_context(|| format!("{} has too many files of models", directory.display()))
}

/// Replaces a file at once. The new file has the permissions and the owner of the old one, if this user may set them.
fn replace(path: &Path, text: &str) -> std::io::Result<()> {
    let new = path.with_added_extension("new");
    let old = std::fs::metadata(path)?;
    let mut file = std::fs::File::create(&new)?;
    file.write_all(text.as_bytes())?;
    file.set_permissions(old.permissions())?;
    file.sync_all()?;
    let _ = chown(&new, Some(old.uid()), Some(old.gid()));
    std::fs::rename(&new, path)
}

fn prompt(text: &str) -> std::io::Result<()> {
    Out.write_all(text.as_bytes())?;
    Out.flush()
}

/// Asks until the answer is yes or no. The end of the input is no.
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
