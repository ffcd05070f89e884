//! `restart`: another program takes the place of the running gateway.
//!
//! `restart` → `waits …` while the other program checks the profile, and then `still` once a second. The check may
//! take 60 s, or 10 s after `restart within=10`. If the check passes, the answer is `ok …`, and the connection stays
//! open until the running program has ended. If the profile is wrong, the answer is `wrong …`. For another failure,
//! it is `error …`.
//!
//! `restart wrong` restarts nothing: it only records that the requester has found the profile wrong.
//! `restart wrong PATH` records this only if PATH is the profile of this gateway. A client sends PATH if it cannot
//! read the machine name in the profile.
//!
//! `release cnc_z seen=20.0`, or `release cnc_z seen=20.0,4.5 within=10`, restarts in the same way. After the restart,
//! the gateway returns the former registers of the output to their base values. The gateway refuses this if its offsets
//! in these registers differ from the values after `seen=`, in µm.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::unix::OwnedWriteHalf;

use super::{ControlContext, STILL, said_in_a_line, say};
use crate::clock::BootClock;
use crate::gateway::lifecycle::successor::{CHECKED_WITHIN, SuccessorRejection};
use crate::observe::requester::{ANSWER_TIMEOUT, Channel, Connection, Requester};
use crate::observe::status::{Answer, ReleaseRequest};

const RESTART: &str = "restart";
const RELEASE: &str = "release ";
/// Text before the register values that the operator has seen, in a `release` request.
const SEEN: &str = " seen=";
/// Text before the maximum time for the check, in seconds.
const WITHIN: &str = " within=";
/// Maximum time that a client may set for the check of the profile.
const LONGEST_CHECK: Duration = Duration::from_secs(600);
/// Additional time for the end of the check, in which the gateway writes a small test file to the disk.
const CHECK_ENDS_WITHIN: Duration = Duration::from_secs(3);

/// Request to replace the running program by another one, or the report that the profile of the other program is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Request<'a> {
    Restart {
        within: Duration,
    },
    /// Restart, then return the former registers of this output to their base values. `seen` contains numbers in µm,
    /// separated by commas.
    Release {
        output: &'a str,
        seen: &'a str,
        within: Duration,
    },
    /// Record that the profile is wrong. The path of the profile is `None` if the client does not send it.
    Wrong(Option<&'a Path>),
}

impl<'a> Request<'a> {
    /// Parses a request. Returns `None` if the line is another command.
    pub(super) fn parse(line: &'a str) -> Option<Request<'a>> {
        let line = line.rsplit_once(" until=").map_or(line, |(line, _)| line);
        if let Some(more) = line.strip_prefix(RELEASE) {
            let (output, within) = match more.split_once(WITHIN) {
                Some((output, seconds)) => (output, span(seconds)?),
                None => (more, CHECKED_WITHIN),
            };
            let (output, seen) = output.split_once(SEEN)?;
            let is_a_word = !output.is_empty() && !output.contains(' ');
            return is_a_word.then_some(Request::Release { output, seen, within });
        }
        match line.strip_prefix(RESTART)? {
            "" => Some(Request::Restart { within: CHECKED_WITHIN }),
            " wrong" => Some(Request::Wrong(None)),
            more => match more.strip_prefix(WITHIN) {
                Some(seconds) => Some(Request::Restart { within: span(seconds)? }),
                None => more.strip_prefix(" wrong ").map(|path| Request::Wrong(Some(Path::new(path)))),
            },
        }
    }

    /// Returns whether the client of this request stays connected until another program has taken over.
    pub(super) fn stays(self) -> bool {
        match self {
            Request::Restart { .. } | Request::Release { .. } => true,
            Request::Wrong(_) => false,
        }
    }
}

/// Parses the maximum time for the check, in seconds. Returns `None` if `seconds` is not a valid number.
fn span(seconds: &str) -> Option<Duration> {
    let span = Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?;
    Some(span.min(LONGEST_CHECK))
}

pub(super) async fn serve(
    desk: &ControlContext,
    request: Request<'_>,
    (who, connection): (String, &Arc<Connection>),
    writer: &mut OwnedWriteHalf,
) -> std::io::Result<()> {
    // The deadline of the client begins when the check is over.
    let requester = || {
        let until = BootClock::default().passed() + ANSWER_TIMEOUT;
        Requester::new(Channel::Socket, who.clone()).until(until).at(connection)
    };
    let refused = |why: &str| desk.source.turned_away(RESTART, &requester(), why);
    let (within, released) = match request {
        Request::Restart { within } => (within, None),
        Request::Release { output, seen, within } => {
            let seen: Result<Vec<f64>, _> = seen.split(',').map(str::parse).collect();
            let Ok(seen) = seen else {
                return say(writer, "error write numbers after seen=, in µm, separated by commas\n").await;
            };
            (within, Some((output, seen)))
        }
        Request::Wrong(path) => {
            let runs = |path| desk.successor.as_ref().is_some_and(|successor| successor.runs_profile(path));
            if !path.is_none_or(runs) {
                return say(writer, "error this gateway runs another profile\n").await;
            }
            refused("the profile is wrong; the gateway continues as before");
            return say(writer, "ok the gateway continues as before\n").await;
        }
    };
    let Some(successor) = desk.successor.clone() else {
        return say(writer, "error this gateway cannot be replaced by another program\n").await;
    };
    say(writer, "waits the new program checks the profile\n").await?;
    let (answer, mut checked) = tokio::sync::oneshot::channel();
    let checking = successor.clone();
    // The check has its own thread, because the end of this program must not wait for it.
    let check = move || drop(answer.send(checking.check(within)));
    std::thread::Builder::new().name("check".to_owned()).spawn(check)?;
    let until = BootClock::default().passed() + within + CHECK_ENDS_WITHIN;
    let checked = loop {
        match tokio::time::timeout(STILL, &mut checked).await {
            Ok(Ok(checked)) => break checked,
            Ok(Err(_)) => {
                break Err(SuccessorRejection::Other("the check failed with an internal error".to_owned()));
            }
            Err(_) if BootClock::default().passed() >= until => {
                let why = "a small test file could not be written to the state directory in time: does its disk hang?";
                break Err(SuccessorRejection::Other(why.to_owned()));
            }
            Err(_) => say(writer, "still\n").await?,
        }
    };
    let (word, why) = match checked {
        Ok(checked) => {
            if let Some((output, seen)) = &released {
                match desk.source.release(output, ReleaseRequest::Back(seen), &requester()) {
                    Ok(Answer::Done(said)) => say(writer, &said_in_a_line("waits", &said)).await?,
                    Ok(Answer::Waits(why) | Answer::TooSoon(why)) | Err(why) => {
                        return say(writer, &said_in_a_line("error", &why)).await;
                    }
                }
            }
            match successor.take_over(&requester(), checked) {
                Ok(said) => {
                    say(writer, &said_in_a_line("ok", &said)).await?;
                    // The end of the connection shows the client that this program has ended.
                    return std::future::pending().await;
                }
                Err(why) => {
                    if let Some((output, _)) = &released {
                        // Otherwise, a later start would move a register unexpectedly.
                        drop(desk.source.release(output, ReleaseRequest::Stay, &requester()));
                    }
                    return say(writer, &said_in_a_line("error", &why)).await;
                }
            }
        }
        Err(SuccessorRejection::Profile(why)) => ("wrong", format!("the profile is wrong: {why}")),
        Err(SuccessorRejection::Other(why)) => ("error", why),
    };
    let why = format!("{why}; the gateway continues as before");
    refused(&why);
    say(writer, &said_in_a_line(word, &why)).await
}
