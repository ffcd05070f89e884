//! `restart`: another program takes the place of the gateway that runs.
//!
//! `restart` → `waits …` while that program checks the profile, with `still` once a second, for 60 s at most or, with `restart
//! within=10`, for so many; then `ok …`, and the connection stays
//! open until this program is gone; or `wrong …` where the profile is, or `error …`. `restart wrong` only notes that whoever wanted
//! it has found the profile wrong; `restart wrong PATH` does where that is the profile of this gateway, for one in which no name
//! can be read.
//!
//! `release cnc_z seen=20.0`, or `release cnc_z seen=20.0,4.5 within=10`, is the same, and the registers that the output had are taken
//! back to their base after it, if so many µm of ours are in them.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::unix::OwnedWriteHalf;

use super::{Desk, STILL, said_in_a_line, say};
use crate::clock::Passing;
use crate::gateway::successor::{CHECKED_WITHIN, Unfit};
use crate::observe::asker::{Asker, Connection, PATIENCE, Way};
use crate::observe::status::{Answer, Wish};

const RESTART: &str = "restart";
const RELEASE: &str = "release ";
/// Beginning of the word that says what the person has seen.
const SEEN: &str = " seen=";
/// Beginning of the word that says how long the check may take.
const WITHIN: &str = " within=";
/// No check takes longer, whatever a client says.
const LONGEST_CHECK: Duration = Duration::from_secs(600);
/// How much longer than the check itself its end may take: the disk must take one small file.
const CHECK_ENDS_WITHIN: Duration = Duration::from_secs(3);

/// Whoever wants it has found the profile wrong, or has not looked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Request<'a> {
    Restart {
        within: Duration,
    },
    /// The former registers of this output are taken back to their base after the restart. `seen`: numbers with commas between them.
    Release {
        output: &'a str,
        seen: &'a str,
        within: Duration,
    },
    /// The profile may be named by its path.
    Wrong(Option<&'a Path>),
}

impl<'a> Request<'a> {
    /// `None` where the line is another command.
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

    /// Returns whether its client stays connected until another program has taken over.
    pub(super) fn stays(self) -> bool {
        match self {
            Request::Restart { .. } | Request::Release { .. } => true,
            Request::Wrong(_) => false,
        }
    }
}

/// Time for a check, of this many seconds.
fn span(seconds: &str) -> Option<Duration> {
    let span = Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?;
    Some(span.min(LONGEST_CHECK))
}

pub(super) async fn serve(
    desk: &Desk,
    request: Request<'_>,
    (who, connection): (String, &Arc<Connection>),
    writer: &mut OwnedWriteHalf,
) -> std::io::Result<()> {
    // Until when he waits is known when the check is over.
    let asker = || {
        let until = Passing::default().passed() + PATIENCE;
        Asker::new(Way::Socket, who.clone()).until(until).at(connection)
    };
    let refused = |why: &str| desk.source.turned_away(RESTART, &asker(), why);
    let (within, released) = match request {
        Request::Restart { within } => (within, None),
        Request::Release { output, seen, within } => {
            let seen: Result<Vec<f64>, _> = seen.split(',').map(str::parse).collect();
            let Ok(seen) = seen else { return say(writer, "error seen=… needs numbers\n").await };
            (within, Some((output, seen)))
        }
        Request::Wrong(path) => {
            let runs = |path| desk.successor.as_ref().is_some_and(|successor| successor.runs_profile(path));
            if !path.is_none_or(runs) {
                return say(writer, "error this gateway runs another profile\n").await;
            }
            refused("the profile is wrong; the gateway goes on as it was");
            return say(writer, "ok the gateway goes on as it was\n").await;
        }
    };
    let Some(successor) = desk.successor.clone() else {
        return say(writer, "error nothing can take the place of this gateway\n").await;
    };
    say(writer, "waits the program that is to take over checks the profile\n").await?;
    let (answer, mut checked) = tokio::sync::oneshot::channel();
    let checking = successor.clone();
    // A thread of its own: nothing waits for it when this program ends.
    let check = move || drop(answer.send(checking.check(within)));
    std::thread::Builder::new().name("check".to_owned()).spawn(check)?;
    let until = Passing::default().passed() + within + CHECK_ENDS_WITHIN;
    let checked = loop {
        match tokio::time::timeout(STILL, &mut checked).await {
            Ok(Ok(checked)) => break checked,
            Ok(Err(_)) => break Err(Unfit::Other("the check has failed inside".to_owned())),
            Err(_) if Passing::default().passed() >= until => {
                let why = "the state directory has not taken a small file in time: does its disk hang?";
                break Err(Unfit::Other(why.to_owned()));
            }
            Err(_) => say(writer, "still\n").await?,
        }
    };
    let (word, why) = match checked {
        Ok(checked) => {
            if let Some((output, seen)) = &released {
                match desk.source.release(output, Wish::Back(seen), &asker()) {
                    Ok(Answer::Done(said)) => say(writer, &said_in_a_line("waits", &said)).await?,
                    Ok(Answer::Waits(why) | Answer::TooSoon(why)) | Err(why) => {
                        return say(writer, &said_in_a_line("error", &why)).await;
                    }
                }
            }
            match successor.take_over(&asker(), checked) {
                Ok(said) => {
                    say(writer, &said_in_a_line("ok", &said)).await?;
                    // Its end tells that this program is gone.
                    return std::future::pending().await;
                }
                Err(why) => {
                    if let Some((output, _)) = &released {
                        // A later start would move a register that nobody expects to move any more.
                        drop(desk.source.release(output, Wish::Stay, &asker()));
                    }
                    return say(writer, &said_in_a_line("error", &why)).await;
                }
            }
        }
        Err(Unfit::Profile(why)) => ("wrong", format!("the profile is wrong: {why}")),
        Err(Unfit::Other(why)) => ("error", why),
    };
    let why = format!("{why}; the gateway goes on as it was");
    refused(&why);
    say(writer, &said_in_a_line(word, &why)).await
}
