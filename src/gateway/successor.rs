//! Another program in the place of this one: the same path, perhaps another version; the same arguments, perhaps another profile;
//! in the same process, so that a service manager notices nothing. It checks the profile first. What does not pass that leaves
//! this one running.

use std::ffi::OsString;
use std::fs::File;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::time::Duration;

use isotherm_core::explained::Explained;
use isotherm_profile::one_line;

use super::handover::{Handover, digest_path};
use super::panel::CommandHandle;
use super::shared::Shared;
use crate::clock::Passing;
use crate::fieldbus::explain::system;
use crate::observe::asker::Asker;

/// The option by which a program checks what it would run with, and ends; the command socket of the one that runs behind it.
pub const CHECK_ONLY: &str = "check-only";

/// How long a check may take if the client does not say.
pub(super) const CHECKED_WITHIN: Duration = Duration::from_secs(60);
/// This program as it runs, also if another one lies at its path now.
const OWN_IMAGE: &str = "/proc/self/exe";
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// What a check says at most, in bytes, and how many lines of it are passed on.
const MOST_SAID: u64 = 64_000;
const LINES: usize = 5;
/// The exit code for a wrong profile.
const WRONG_PROFILE: i32 = 64;

/// This program, as it was started.
#[derive(Clone, Debug)]
pub struct Program {
    path: PathBuf,
    arguments: Vec<OsString>,
}

/// Why nothing can take the place of this program.
#[derive(Debug)]
pub(super) enum Unfit {
    /// The profile is wrong.
    Profile(String),
    /// Something else.
    Other(String),
}

impl Program {
    /// The one of this process. To be asked for before it is replaced on disk: the path is that of now, by the name under which
    /// it was started, where that is a whole path.
    ///
    /// # Errors
    /// The system does not say which it is.
    pub fn of_this_process() -> std::io::Result<Program> {
        let mut arguments = std::env::args_os();
        let named = arguments.next().map(PathBuf::from).filter(|path| path.is_absolute());
        let path = named.map_or_else(std::env::current_exe, Ok)?;
        Ok(Program { path, arguments: arguments.collect() })
    }

    /// Whether it was started with this file, which need not be there any more.
    fn was_given(&self, file: &Path) -> bool {
        let place = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).ok();
        place(file).is_some_and(|file| {
            self.arguments.iter().any(|given| place(Path::new(given)).as_ref() == Some(&file))
        })
    }

    /// Lets the program at that path check its profile and arguments, within this time.
    fn check(&self, socket: &Path, within: Duration) -> Result<(), Unfit> {
        let shown = self.path.display();
        let mut command = Command::new(&self.path);
        command.args(&self.arguments).arg(format!("--{CHECK_ONLY}")).arg(socket);
        // It speaks to nobody but this program.
        command.env_remove("NOTIFY_SOCKET");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let cannot = |error: std::io::Error| Unfit::Other(format!("{shown} cannot be started: {error}"));
        let mut child = command.spawn().map_err(cannot)?;
        let stderr = child.stderr.take();
        let reading = std::thread::spawn(move || {
            let mut said = Vec::new();
            if let Some(mut stderr) = stderr {
                let _ = stderr.by_ref().take(MOST_SAID).read_to_end(&mut said);
                let _ = std::io::copy(&mut stderr, &mut std::io::sink());
            }
            String::from_utf8_lossy(&said).into_owned()
        });
        let until = Passing::default().passed() + within;
        let status = loop {
            match child.try_wait().map_err(cannot)? {
                Some(status) => break status,
                None if Passing::default().passed() >= until => {
                    let _ = child.kill().and_then(|()| child.wait());
                    let why = format!("{shown} has not checked the profile within {} s", within.as_secs());
                    return Err(Unfit::Other(why));
                }
                None => std::thread::sleep(LOOK_EVERY),
            }
        };
        judge(status, &reading.join().unwrap_or_default())
    }

    /// Becomes the program that lies there now, with a sealed handover as its standard input. Returns a sentence only if that cannot
    /// be started.
    pub fn takes_over(&self, handover: Option<&File>) -> String {
        let error = self.becomes(&self.path, handover);
        format!("{} cannot be started: {}", self.path.display(), system(&error))
    }

    /// Starts the program that runs now once more, with a sealed handover as its standard input. Returns only if that fails.
    pub fn begins_anew(&self, handover: Option<&File>) -> std::io::Error {
        self.becomes(Path::new(OWN_IMAGE), handover)
    }

    fn becomes(&self, image: &Path, handover: Option<&File>) -> std::io::Error {
        let stdin = match handover.map(File::try_clone).transpose() {
            Ok(handover) => handover.map_or_else(Stdio::null, Stdio::from),
            Err(error) => return error,
        };
        Command::new(image).arg0(&self.path).args(&self.arguments).stdin(stdin).exec()
    }
}

fn judge(status: ExitStatus, said: &str) -> Result<(), Unfit> {
    if status.success() {
        return Ok(());
    }
    // Excerpts and help stand behind blanks.
    let lines = said.lines().filter(|line| !line.is_empty() && !line.starts_with(char::is_whitespace));
    let lines: Vec<&str> = lines.filter(|line| !line.starts_with("warning")).take(LINES).collect();
    let said = one_line(&lines.join("; ")).into_owned();
    Err(match status.code() {
        Some(WRONG_PROFILE) => Unfit::Profile(said),
        _ if said.is_empty() => Unfit::Other(format!("the program that is to take over ended with {status}")),
        _ => Unfit::Other(said),
    })
}

/// What can take the place of a running gateway.
#[derive(Clone)]
pub struct Successor {
    shared: Arc<Shared>,
    program: Program,
    socket: PathBuf,
}

impl Successor {
    pub(super) fn new(shared: Arc<Shared>, program: Program, socket: PathBuf) -> Successor {
        Successor { shared, program, socket }
    }

    /// Whether this gateway was started with this profile.
    pub(super) fn runs_profile(&self, path: &Path) -> bool {
        self.program.was_given(path)
    }

    /// Checks that the other program could run in the place of this gateway, and that this gateway can hand over to it. Blocks, at
    /// most `within` this time.
    pub(super) fn check(&self, within: Duration) -> Result<(), Unfit> {
        self.program.check(&self.socket, within)?;
        let directory = self.socket.parent().unwrap_or(Path::new("."));
        Handover::rehearse(&digest_path(directory, &self.shared.profile.name))
            .map_err(|error| Unfit::Other(format!("nothing can be handed over to the new program: {error}")))
    }

    /// Asks the gateway to move nothing more and to make room. A sentence.
    pub(super) fn take_over(&self, asker: &Asker) -> Result<String, String> {
        let commands = CommandHandle(self.shared.clone());
        let answer =
            commands.carry_out(("restart".to_owned(), Vec::new()), asker, String::as_str, |core| {
                if core.stop.is_some() {
                    return Err("the gateway is stopping".into());
                }
                let checked = core.arming.as_slice().iter().position(|arming| arming.sign.is_some());
                if let Some(axis) = checked {
                    let name = &self.shared.profile.axes[axis].settings.name;
                    return Err(Explained::new(
                        format!("the sign of {name} is being checked, which moves it"),
                        "end that first",
                    ));
                }
                core.replaced_by = asker.way.by(&asker.who);
                let path = self.program.path.display();
                Ok(format!("{path} takes over; the registers keep what they hold"))
            })?;
        self.shared.replaced.notify_one();
        Ok(answer)
    }
}
