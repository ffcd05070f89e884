//! Replacement of the running gateway program by another program. The other program has the same path and arguments,
//! but perhaps another version or another profile. The other program runs in the same process, so that the service
//! manager does not notice the replacement. It is first started for a check of the profile. If the check fails, the
//! running program continues. If the check passes, the other program runs exactly the profile that was checked.

use std::ffi::OsString;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use isotherm_core::explained::Explained;
use isotherm_core::quantity::Micron;
use isotherm_profile::safe_file::cut;
use isotherm_profile::{duration_text, one_line};
use rustix::process::{Pid, Signal, kill_process_group};

use super::handover::{Handover, KeptProfile, Prepared, digest_path};
use crate::clock::BootClock;
use crate::fieldbus::explain::system;
use crate::gateway::shared::carry_out::carry_out;
use crate::gateway::shared::shared_state::Shared;
use crate::gateway::state::sign::time_to_zero;
use crate::observe::requester::Requester;

/// Option with which a program only checks its profile and arguments, and then ends. The next argument is the path of
/// the running gateway's command socket.
pub const CHECK_ONLY: &str = "check-only";

/// Maximum time of a check, if the client does not set one.
pub(in crate::gateway) const CHECKED_WITHIN: Duration = Duration::from_secs(60);
/// File of the running program. The path is valid even if the program's own file was replaced by another one.
const OWN_IMAGE: &str = "/proc/self/exe";
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Maximum size of the stored output of a checking program, in bytes. `LINES` is the maximum number of lines of this
/// output in the answer to the client.
const MOST_SAID: usize = 64_000;
const LINES: usize = 5;
/// Maximum length of a checking program's output in the answer to the client, in characters.
const LONGEST_SAID: usize = 800;
/// Maximum wait for further output after the end of a checking program. A process that this program has started may
/// still hold the pipe open.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// Exit code by which a check reports a wrong profile.
const WRONG_PROFILE: i32 = 64;

/// Path and arguments with which this program was started.
#[derive(Clone, Debug)]
pub struct Program {
    path: PathBuf,
    arguments: Vec<OsString>,
}

/// Reason why the other program cannot replace the running program.
#[derive(Debug)]
pub(in crate::gateway) enum SuccessorRejection {
    /// The profile is wrong; contains the messages of the check.
    Profile(String),
    /// Another reason, as a sentence.
    Other(String),
}

/// Identity of a program file. A file with another identity was replaced or changed.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Image {
    place: (u64, u64),
    size: u64,
    modified: (i64, i64),
}

impl Image {
    fn at(path: &Path) -> Option<Image> {
        let found = std::fs::metadata(path).ok()?;
        Some(Image {
            place: (found.dev(), found.ino()),
            size: found.size(),
            modified: (found.mtime(), found.mtime_nsec()),
        })
    }
}

/// Result of a check that has passed. The handover to the program that has made the check uses this result.
#[derive(Debug)]
pub struct Checked {
    image: Option<Image>,
    /// Memory for the handover. The memory contains the checked profile, if the new program can load a profile from
    /// memory.
    pub prepared: Prepared,
}

impl Program {
    /// Creates a description of the program at this path, with these arguments.
    pub fn new(path: PathBuf, arguments: Vec<OsString>) -> Program {
        Program { path, arguments }
    }

    /// Returns the program of this process. Call this function before the program's file is replaced. The path is the
    /// first argument if this argument is absolute, otherwise the present path of the program's file.
    ///
    /// # Errors
    /// The system does not report the path.
    pub fn of_this_process() -> std::io::Result<Program> {
        let mut arguments = std::env::args_os();
        let named = arguments.next().map(PathBuf::from).filter(|path| path.is_absolute());
        let path = named.map_or_else(std::env::current_exe, Ok)?;
        Ok(Program::new(path, arguments.collect()))
    }

    /// Returns whether the program was started with this file as an argument. The file may have been removed since
    /// then.
    fn was_given(&self, file: &Path) -> bool {
        let place = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).ok();
        place(file).is_some_and(|file| {
            self.arguments.iter().any(|given| place(Path::new(given)).as_ref() == Some(&file))
        })
    }

    /// Starts the program at the path with the option [`CHECK_ONLY`], so that the program checks its profile and
    /// arguments. `within` is the maximum duration of the check.
    fn check(&self, socket: &Path, within: Duration) -> Result<Checked, SuccessorRejection> {
        let shown = self.path.display();
        let image = Image::at(&self.path);
        let no_memory = |error: std::io::Error| {
            SuccessorRejection::Other(format!("the state cannot be handed over to the new program: {error}"))
        };
        let answer = KeptProfile::offer().ok();
        let stdout = answer.as_ref().map(File::try_clone).transpose().map_err(no_memory)?;
        let mut command = Command::new(&self.path);
        command.args(&self.arguments).arg(format!("--{CHECK_ONLY}")).arg(socket);
        // The check must not send notifications to the service manager.
        command.env_remove("NOTIFY_SOCKET");
        command
            .stdin(Stdio::null())
            .stdout(stdout.map_or_else(Stdio::null, Stdio::from))
            .stderr(Stdio::piped());
        // A script may start other processes. All of them end when the time is over.
        command.process_group(0);
        let cannot =
            |error: std::io::Error| SuccessorRejection::Other(format!("{shown} cannot be started: {error}"));
        let mut child = command.spawn().map_err(cannot)?;
        // The command holds a copy of the answer.
        drop(command);
        let said = child.stderr.take().map(read_aside);
        let until = BootClock::default().passed() + within;
        let status = loop {
            match child.try_wait().map_err(cannot)? {
                Some(status) => break status,
                None if BootClock::default().passed() >= until => {
                    end(&mut child);
                    let why = format!("{shown} has not checked the profile within {} s", within.as_secs());
                    return Err(SuccessorRejection::Other(why));
                }
                None => std::thread::sleep(LOOK_EVERY),
            }
        };
        assess(status, || said.map(collected).unwrap_or_default())?;
        let profile =
            answer.map(KeptProfile::answered).transpose().map_err(SuccessorRejection::Other)?.flatten();
        Ok(Checked { image, prepared: Prepared::with(profile.as_ref()).map_err(no_memory)? })
    }

    /// Replaces the running program by the program at the path of `self`. The new program receives the
    /// handover (profile and state in memory that cannot be changed) as standard input. Returns only if the
    /// new program cannot be started. The returned text is a sentence with the reason.
    pub fn start(&self, handover: Option<&File>) -> String {
        let error = self.exec(&self.path, handover);
        format!("{} cannot be started: {}", self.path.display(), system(&error))
    }

    /// Starts the file of the running program again, even if another file is at its path. The program
    /// receives the handover (profile and state in memory that cannot be changed) as standard input. Returns
    /// only if the start fails.
    pub fn start_own_image(&self, handover: Option<&File>) -> std::io::Error {
        self.exec(Path::new(OWN_IMAGE), handover)
    }

    fn exec(&self, image: &Path, handover: Option<&File>) -> std::io::Error {
        let stdin = match handover.map(File::try_clone).transpose() {
            Ok(handover) => handover.map_or_else(Stdio::null, Stdio::from),
            Err(error) => return error,
        };
        Command::new(image).arg0(&self.path).args(&self.arguments).stdin(stdin).exec()
    }
}

/// Kills a checking program and every process that this program has started.
fn end(child: &mut Child) {
    if let Some(group) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
        let _ = kill_process_group(group, Signal::KILL);
    }
    let _ = child.kill().and_then(|()| child.wait());
}

/// Reads the output of a checking program in a separate thread. Discards the output beyond `MOST_SAID` bytes.
fn read_aside(mut stderr: ChildStderr) -> Receiver<Vec<u8>> {
    let (sender, parts) = channel();
    std::thread::spawn(move || {
        let mut part = [0; 4096];
        let mut left = MOST_SAID;
        while let Ok(length @ 1..) = stderr.read(&mut part) {
            let kept = length.min(left);
            left -= kept;
            if kept > 0 && sender.send(part[..kept].to_vec()).is_err() {
                return;
            }
        }
    });
    parts
}

/// Returns the stored output of a checking program that has ended.
fn collected(parts: Receiver<Vec<u8>>) -> String {
    let until = BootClock::default().passed() + LAST_WORDS;
    let mut said = Vec::new();
    while let Ok(part) = parts.recv_timeout(until.saturating_sub(BootClock::default().passed())) {
        said.extend(part);
    }
    String::from_utf8_lossy(&said).into_owned()
}

fn assess(status: ExitStatus, said: impl FnOnce() -> String) -> Result<(), SuccessorRejection> {
    if status.success() {
        return Ok(());
    }
    let said = said();
    // Excerpts and help are indented.
    let lines = said.lines().filter(|line| !line.is_empty() && !line.starts_with(char::is_whitespace));
    let lines = lines.filter(|line| !line.starts_with("warning")).take(LINES);
    let lines: Vec<&str> = lines.map(|line| line.strip_prefix("isotherm: ").unwrap_or(line)).collect();
    let said = cut(&one_line(&lines.join("; ")), LONGEST_SAID).into_owned();
    Err(match status.code() {
        Some(WRONG_PROFILE) => SuccessorRejection::Profile(said),
        _ if said.is_empty() => SuccessorRejection::Other(format!("the new program ended with {status}")),
        _ => SuccessorRejection::Other(said),
    })
}

/// Handle by which another program can replace a running gateway.
#[derive(Clone)]
pub struct Successor {
    shared: Arc<Shared>,
    program: Program,
    socket: PathBuf,
    /// Result of the check by the program that takes over; `None` until this gateway has agreed to its replacement.
    checked: Arc<Mutex<Option<Checked>>>,
}

impl Successor {
    pub(in crate::gateway) fn new(shared: Arc<Shared>, program: Program, socket: PathBuf) -> Successor {
        Successor { shared, program, socket, checked: Arc::default() }
    }

    /// Returns whether this gateway was started with the profile at `path`.
    pub(in crate::gateway) fn runs_profile(&self, path: &Path) -> bool {
        self.program.was_given(path)
    }

    /// Takes the result of the check that the new program has made. Returns `None` at a second call. Also returns
    /// `None` before this gateway has agreed to its replacement.
    pub fn take_checked(&self) -> Option<Checked> {
        self.checked.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Checks that another program can replace this gateway, and that this gateway can pass its state to that
    /// program. The call blocks until the program has checked the profile, at most for `within`, and until one small
    /// file is on disk.
    pub(in crate::gateway) fn check(&self, within: Duration) -> Result<Checked, SuccessorRejection> {
        let checked = self.program.check(&self.socket, within)?;
        let directory = self.socket.parent().unwrap_or(Path::new("."));
        Handover::rehearse(&digest_path(directory, &self.shared.profile.name)).map_err(|error| {
            SuccessorRejection::Other(format!("the state cannot be handed over to the new program: {error}"))
        })?;
        if Image::at(&self.program.path) != checked.image {
            let shown = self.program.path.display();
            let why = format!("{shown} was replaced after it had checked the profile: restart once more");
            return Err(SuccessorRejection::Other(why));
        }
        Ok(checked)
    }

    /// Requests the gateway to stop its outputs and to end, because the checked program replaces it. Returns a
    /// sentence for the requester.
    pub(in crate::gateway) fn take_over(
        &self,
        requester: &Requester,
        checked: Checked,
    ) -> Result<String, String> {
        let command = ("restart".to_owned(), Vec::new());
        let answer = carry_out(&self.shared, command, requester, String::as_str, |core| {
            if core.phase.is_stopping() {
                return Err("the gateway is stopping".into());
            }
            let axes = || core.arming.as_slice().iter().zip(&self.shared.profile.axes);
            if let Some((_, axis)) = axes().find(|(arming, _)| arming.sign.is_some()) {
                return Err(Explained::new(
                    format!("the sign of {} is being checked, which moves the axis", axis.settings.name),
                    "end the sign check first",
                ));
            }
            // An axis without a model is armed only for a check of its sign, and returns to zero after it.
            let returns = axes().position(|(arming, axis)| arming.is_armed() && !axis.has_model());
            if let Some(axis) = returns {
                let settings = &self.shared.profile.axes[axis].settings;
                let cz = core.compensation.decision(axis).map_or(Micron::ZERO, |decision| decision.cz);
                let seconds = time_to_zero(&settings.guard, settings.every, cz).as_secs() + 1;
                return Err(Explained::new(
                    format!("axis {} returns to zero after its sign check", settings.name),
                    format!("repeat the command in {} or later", duration_text(Duration::from_secs(seconds))),
                ));
            }
            core.replaced_by = requester.way.by(&requester.who);
            let path = self.program.path.display();
            Ok(format!("{path} takes over; the registers keep their values"))
        })?;
        *self.checked.lock().unwrap_or_else(PoisonError::into_inner) = Some(checked);
        self.shared.replaced.notify_one();
        Ok(answer)
    }
}
