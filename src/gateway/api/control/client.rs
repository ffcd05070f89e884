//! Client of the command socket, for the commands of `isotherm`.

use std::io::{BufRead, BufReader, ErrorKind, Lines, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::sockopt::socket_peercred;
use rustix::process::{PidfdFlags, pidfd_open};
use socket2::{Domain, SockAddr, Socket, Type};

use super::{LONGEST_TRACE, SLACK, STATUS, UNKNOWN, user};
use crate::clock::BootClock;
use crate::observe::requester::ANSWER_TIMEOUT;
use crate::observe::status::{Answer, Command};
use isotherm_core::compensation::MeasuredReport;

/// Time after the deadline of a command in which the gateway's answer may still arrive.
const UNDER_WAY: Duration = Duration::from_millis(250);
/// Interval between attempts to connect to a gateway whose queue of connections is full.
const ASK_AGAIN: Duration = Duration::from_millis(50);
/// Maximum time for the replacement of the running gateway: it saves its state, and the other program starts.
const REPLACED_WITHIN: Duration = Duration::from_secs(120);

/// Reason why a request to the running gateway failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// No gateway is running; contains the error of the connection.
    #[error("no gateway of this machine is running here ({0}); start it with `isotherm run`")]
    NoGateway(String),
    /// The socket belongs to another user; contains an explanation.
    #[error("{0}")]
    Forbidden(String),
    /// The gateway refuses the request; contains the reason.
    #[error("{0}")]
    Refused(String),
    /// The gateway refuses the request because the profile is wrong; contains the reason.
    #[error("{0}")]
    WrongProfile(String),
    /// A gateway is running, but does not answer.
    #[error("no answer within {} s; it is not known whether the command was carried out (see `isotherm \
             events` when the gateway answers again)", ANSWER_TIMEOUT.as_secs())]
    NoAnswer,
    /// Another program replaced the gateway and ended at once.
    #[error(
        "the new program took over and ended at once; no gateway runs now. Start it with `isotherm run` and \
         read its messages (as a service: systemctl status, journalctl)"
    )]
    NewProgramEnded,
    /// Another program replaced the gateway, and has not answered within the contained time.
    #[error("the new program took over and has not answered within {} s. Read its messages (as a service: \
             journalctl), and stop it if it hangs", .0.as_secs())]
    NewProgramSilent(Duration),
    /// The gateway has ended before it answered.
    #[error(
        "the gateway has ended before it answered; it is not known whether the command was carried out (see \
         `isotherm events`)"
    )]
    Ended,
}

/// Sends a command to the running gateway, for one axis, or for all axes if `axis` is `None`. Returns the answer of
/// the gateway to the user.
///
/// # Errors
/// No gateway runs at this socket, it refuses the command, or it does not answer.
pub fn send(path: &Path, command: Command, axis: Option<&str>) -> Result<Answer, Failure> {
    Ok(ask(path, &with_axis(command.name(), axis), ANSWER_TIMEOUT)?.0)
}

/// Requests the running gateway to arm, and waits until it has armed or refused. `show` receives the conditions that
/// are not met yet.
///
/// # Errors
/// No gateway runs at this socket, it refuses to arm, or it stops answering.
pub fn arm(path: &Path, axis: Option<&str>, show: impl FnMut(&str)) -> Result<String, Failure> {
    Ok(stay(ask(path, &(with_axis("arm", axis) + " stay"), ANSWER_TIMEOUT)?, show)?.0)
}

/// Waits for the final answer to a request. Returns the answer and the open connection. `show` receives the
/// conditions that are not met yet.
fn stay(
    (mut answer, mut lines): ReplyLines,
    mut show: impl FnMut(&str),
) -> Result<(String, Lines<BufReader<UnixStream>>), Failure> {
    loop {
        match answer {
            Answer::Done(said) => return Ok((said, lines)),
            Answer::Waits(said) => show(&said),
            Answer::TooSoon(why) => return Err(Failure::Refused(why)),
        }
        let line = loop {
            let line = lines.next().ok_or(Failure::Ended)?.map_err(silent)?;
            if line != "still" {
                break line;
            }
        };
        answer = understand(&line)?;
    }
}

/// Requests the running gateway to move the Cz of an axis a little in the plus direction, and waits until the output
/// has this Cz. `show` receives the progress. The returned text says that the operator may read the gauge. The second
/// value holds the connection: when it is dropped, the gateway moves Cz back.
///
/// # Errors
/// No gateway runs at this socket, it refuses the check, or it stops answering.
pub fn sign(
    path: &Path,
    axis: Option<&str>,
    show: impl FnMut(&str),
) -> Result<(String, impl Sized), Failure> {
    stay(ask(path, &(with_axis("sign", axis) + " stay"), ANSWER_TIMEOUT)?, show)
}

/// Requests the running gateway to let another program replace it, and waits until that program answers. `show`
/// receives the progress. `within` limits the time of the check by the new program, and the time until that program
/// answers. Returns the state of the new gateway as JSON.
///
/// # Errors
/// No gateway runs at this socket, it refuses, or the new program ends or does not answer.
pub fn restart(path: &Path, within: Duration, show: impl FnMut(&str)) -> Result<String, Failure> {
    let begun = match begin(path, &format!("restart within={}", within.as_secs_f64())) {
        // A gateway of an older version accepts only the bare word. It has its own time limit for the check.
        Err(Failure::Refused(why)) if why.starts_with(UNKNOWN) => begin(path, "restart")?,
        begun => begun?,
    };
    replaced(path, begun, within, show)
}

/// Requests the running gateway to return the former registers of an output to their base values. `seen`
/// contains the Cz in each of these registers, µm, as it was shown to the operator. A new program replaces
/// the gateway, as with [`restart`], and moves the registers. Returns the state of the new gateway as JSON.
///
/// # Errors
/// Same as for [`restart`]. Also: the output has no such register, or the register cannot be returned to its
/// base value.
pub fn release(
    path: &Path,
    (output, seen): (&str, &[f64]),
    within: Duration,
    show: impl FnMut(&str),
) -> Result<String, Failure> {
    let seen: Vec<String> = seen.iter().map(f64::to_string).collect();
    let begun =
        begin(path, &format!("release {output} seen={} within={}", seen.join(","), within.as_secs_f64()))?;
    replaced(path, begun, within, show)
}

/// Handle of a gateway process. When `exec` starts another program in the process, the handle remains valid.
struct Process(OwnedFd);

impl Process {
    /// Returns a handle of the process at the other end of the connection. `None` if this program cannot see that
    /// process, for example because one of the two runs inside a container.
    fn behind(stream: &UnixStream) -> Option<Process> {
        let peer = socket_peercred(stream).ok()?;
        pidfd_open(peer.pid, PidfdFlags::empty()).ok().map(Process)
    }

    /// Returns whether the process has ended.
    fn has_ended(&self) -> bool {
        let mut looked = [PollFd::new(&self.0, PollFlags::IN)];
        poll(&mut looked, Some(&Timespec::default())).is_ok_and(|ended| ended > 0)
    }
}

/// Process of the gateway to be replaced, and the first line of the gateway's answer.
type ReplacementReply = (Option<Process>, ReplyLines);

fn begin(path: &Path, line: &str) -> Result<ReplacementReply, Failure> {
    let stream = tell(path, line, ANSWER_TIMEOUT)?;
    // The other program runs in the same process.
    let process = Process::behind(&stream);
    Ok((process, answered(stream)?))
}

/// Waits until the new program answers. Returns its state as JSON.
fn replaced(
    path: &Path,
    (process, asked): ReplacementReply,
    within: Duration,
    mut show: impl FnMut(&str),
) -> Result<String, Failure> {
    let (said, lines) = stay(asked, &mut show)?;
    show(&said);
    let until = BootClock::default().passed() + REPLACED_WITHIN;
    // The connection exists as long as the program that ends.
    let mut waits = lines.map(|line| line.map_err(silent) == Err(Failure::NoAnswer));
    while waits.next() == Some(true) && BootClock::default().passed() < until {}
    let until = BootClock::default().passed() + within;
    loop {
        match status(path) {
            Ok(status) => return Ok(status),
            Err(_) if process.as_ref().is_some_and(Process::has_ended) => {
                return Err(Failure::NewProgramEnded);
            }
            Err(_) if BootClock::default().passed() >= until => {
                return Err(Failure::NewProgramSilent(within));
            }
            Err(_) => std::thread::sleep(ASK_AGAIN),
        }
    }
}

/// Reports to the running gateway that it cannot be restarted, because the new profile is wrong. If `profile` is
/// given, a gateway accepts the report only if it runs that profile.
///
/// # Errors
/// No gateway runs at this socket, it runs another profile, or it does not answer.
pub fn restart_is_wrong(path: &Path, profile: Option<&Path>) -> Result<String, Failure> {
    let which = profile.map(|profile| format!(" {}", profile.display())).unwrap_or_default();
    Ok(ask(path, &format!("restart wrong{which}"), ANSWER_TIMEOUT)?.0.text().to_owned())
}

/// Sends the measured error of an axis. With `None`, the correction from earlier measured errors is removed.
///
/// # Errors
/// No gateway runs at this socket, it refuses the error, or it does not answer.
pub fn send_measured(path: &Path, axis: &str, report: Option<&MeasuredReport>) -> Result<Answer, Failure> {
    let Some(MeasuredReport { error_um, time, id, .. }) = report else {
        return Ok(ask(path, &format!("measured {axis} clear"), ANSWER_TIMEOUT)?.0);
    };
    let mut line = format!("measured {axis} {error_um}");
    line.extend(time.map(|time| format!(" time={time}")));
    line.extend(id.as_ref().map(|id| format!(" id={id}")));
    Ok(ask(path, &line, ANSWER_TIMEOUT)?.0)
}

/// Confirms a device that the operator has checked: the gateway accepts the next values of its signals.
///
/// # Errors
/// No gateway runs at this socket, it does not answer, or it refuses.
pub fn send_confirm(path: &Path, device: &str) -> Result<Answer, Failure> {
    Ok(ask(path, &format!("confirm {device}"), ANSWER_TIMEOUT)?.0)
}

/// Returns the state of the running gateway as JSON.
///
/// # Errors
/// No gateway runs at this socket, or it does not answer.
pub fn status(path: &Path) -> Result<String, Failure> {
    Ok(ask(path, STATUS, ANSWER_TIMEOUT)?.0.text().to_owned())
}

/// First line of an answer, and the reader for the lines after it.
type ReplyLines = (Answer, Lines<BufReader<UnixStream>>);

fn with_axis(command: &str, axis: Option<&str>) -> String {
    axis.map_or_else(|| command.to_owned(), |axis| format!("{command} axis={axis}"))
}

/// Result of the check whether a gateway accepts connections at a command socket.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// A gateway accepts connections at the command socket.
    Answers,
    /// This user may not connect to the socket.
    Forbidden,
    /// No gateway accepts connections at the command socket.
    Absent,
}

/// Checks whether a gateway accepts connections at a command socket.
pub fn presence(path: &Path) -> Presence {
    match connect(path, Duration::ZERO) {
        Err(Failure::NoGateway(_)) => Presence::Absent,
        Err(Failure::Forbidden(_)) => Presence::Forbidden,
        _ => Presence::Answers,
    }
}

/// Connects to a command socket. Tries again while its queue of connections is full. `until` is the time of the last
/// attempt, measured from the start of the computer.
fn connect(path: &Path, until: Duration) -> Result<UnixStream, Failure> {
    let no_gateway = |error: std::io::Error| {
        if error.kind() == ErrorKind::PermissionDenied {
            return Failure::Forbidden(user::forbidden(path));
        }
        let path = path.display();
        match error.kind() {
            ErrorKind::NotFound => Failure::NoGateway(format!("the socket {path} does not exist")),
            ErrorKind::ConnectionRefused => Failure::NoGateway(format!("no program answers at {path}")),
            _ => Failure::NoGateway(format!("{path}: {error}")),
        }
    };
    let address = match super::too_long(path) {
        Some(why) => return Err(Failure::NoGateway(format!("{}: {why}", path.display()))),
        None => SockAddr::unix(path).map_err(no_gateway)?,
    };
    loop {
        let socket = Socket::new(Domain::UNIX, Type::STREAM, None).map_err(no_gateway)?;
        socket.set_nonblocking(true).map_err(no_gateway)?;
        match socket.connect(&address) {
            Ok(()) => {
                socket.set_nonblocking(false).map_err(no_gateway)?;
                return Ok(socket.into());
            }
            Err(error) if error.kind() != ErrorKind::WouldBlock => return Err(no_gateway(error)),
            Err(_) if BootClock::default().passed() >= until => return Err(Failure::NoAnswer),
            Err(_) => std::thread::sleep(ASK_AGAIN),
        }
    }
}

/// Sends a line of text, and waits for the answer for `patience` at most. Returns the first line of the answer, and a
/// reader for the other lines of the answer.
fn ask(path: &Path, line: &str, patience: Duration) -> Result<ReplyLines, Failure> {
    answered(tell(path, line, patience)?)
}

/// Connects and sends a line of text. Returns the connection. `patience` is the maximum wait for each line of the
/// answer.
fn tell(path: &Path, line: &str, patience: Duration) -> Result<UnixStream, Failure> {
    let until = BootClock::default().passed() + ANSWER_TIMEOUT;
    let has_deadline = line != STATUS && !line.starts_with("trace");
    let deadline = if has_deadline { format!(" until={}", until.as_secs_f64()) } else { String::new() };
    // One write: half a line is not a command.
    let whole = format!("{line}{deadline}\n");
    loop {
        let mut stream = connect(path, until)?;
        let sent = stream
            .set_read_timeout(Some(patience + UNDER_WAY))
            .and_then(|()| stream.write_all(whole.as_bytes()));
        match sent {
            Ok(()) => return Ok(stream),
            // The gateway closed the connection before the line came, in favour of other connections.
            Err(error) if error.kind() == ErrorKind::BrokenPipe && BootClock::default().passed() < until => {}
            Err(_) => return Err(Failure::Ended),
        }
    }
}

fn answered(stream: UnixStream) -> Result<ReplyLines, Failure> {
    let mut lines = BufReader::new(stream).lines();
    let answer = lines.next().ok_or(Failure::Ended)?.map_err(silent)?;
    Ok((understand(&answer)?, lines))
}

fn silent(error: std::io::Error) -> Failure {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => Failure::NoAnswer,
        _ => Failure::Ended,
    }
}

fn understand(line: &str) -> Result<Answer, Failure> {
    match line.split_once(' ') {
        Some(("ok", said)) => Ok(Answer::Done(said.to_owned())),
        Some(("waits", said)) => Ok(Answer::Waits(said.to_owned())),
        Some(("wrong", why)) => Err(Failure::WrongProfile(why.to_owned())),
        Some((_, why)) => Err(Failure::Refused(why.to_owned())),
        None => Err(Failure::Ended),
    }
}

/// Traces a device of the running gateway for the time `span`. `show` receives each line when it arrives, and returns
/// whether to continue. Returns a sentence with the number of lines.
///
/// # Errors
/// No gateway runs at this socket, it refuses the trace, or it stops answering.
pub fn trace(
    path: &Path,
    device: &str,
    span: Duration,
    json: bool,
    mut show: impl FnMut(&str) -> bool,
) -> Result<String, Failure> {
    let form = if json { "json" } else { "text" };
    let request = format!("trace {device} {} {form}", span.as_secs_f64());
    for line in ask(path, &request, span.min(LONGEST_TRACE) + SLACK)?.1 {
        let line = line.map_err(silent)?;
        if let Some(said) = line.strip_prefix("end ") {
            return Ok(said.to_owned());
        }
        if !show(&line) {
            return Ok("ended".to_owned());
        }
    }
    Err(Failure::Ended)
}
