use std::path::PathBuf;
use std::sync::Mutex;

use super::*;
use crate::observe::events::Event;
use crate::observe::events::file::FileItem;
use crate::observe::status::{ReleaseRequest, Status};
use isotherm_core::quantity::Moment;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;

#[derive(Default)]
struct Fake(Mutex<Vec<Command>>, Mutex<Vec<String>>);

impl GatewayApi for Fake {
    fn status(&self) -> Status {
        panic!("nobody asks for it here")
    }

    fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String> {
        self.1.lock().unwrap().push(format!("{requester:?}"));
        if let Some(why) = requester.has_lapsed() {
            return Err(why);
        }
        self.0.lock().unwrap().push(command);
        match command {
            Command::Zero => Err("axis z moves".to_owned()),
            Command::Arm if axis.is_some() => Ok(Answer::Waits("waiting".to_owned())),
            _ => Ok(Answer::Done("z: as you say".to_owned())),
        }
    }

    fn arming(&self, axis: Option<&str>) -> Result<Answer, String> {
        match axis {
            Some("refused") => Err("its register holds too much".to_owned()),
            _ => Ok(Answer::Waits("z: waiting to arm: bed has an open circuit".to_owned())),
        }
    }

    fn signing(&self, axis: Option<&str>) -> Result<Answer, String> {
        self.arming(axis)
    }

    fn acknowledge(&self, _: Option<&str>, _: &Requester) -> Result<Answer, String> {
        Err("there is no such alarm".to_owned())
    }

    fn confirm(&self, device: &str, _: &Requester) -> Result<Answer, String> {
        Err(format!("there is no device {device}"))
    }

    fn release(&self, output: &str, _: ReleaseRequest<'_>, _: &Requester) -> Result<Answer, String> {
        Err(format!("nothing is left of {output}"))
    }

    fn logs(&self, _: Moment, _: Moment) -> Option<Vec<PathBuf>> {
        None
    }

    fn turned_away(&self, _: &str, _: &Requester, _: &str) {}

    fn report(&self, _: &Event) {}

    fn events(&self, _: Moment, _: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()> {
        Ok(())
    }

    fn measured(&self, axis: &str, report: Option<MeasuredReport>, _: &Requester) -> Result<Answer, String> {
        Ok(Answer::Done(format!("{axis}: {report:?}")))
    }
}

fn wire_log() -> WireLog {
    let text = include_str!("../../../../profiles/surface-grinder.toml");
    let loaded = isotherm_profile::parse(Path::new("grinder.toml"), text, &[], &[]);
    WireLog::new(&loaded.unwrap_or_else(|errors| panic!("{errors}")).profile)
}

/// Runs a blocking function while the socket is served. Returns its result and the received commands.
async fn beside<T: Send + 'static>(
    path: &Path,
    act: impl FnOnce() -> T + Send + 'static,
) -> (T, Vec<Command>) {
    let fake = Arc::new(Fake::default());
    let serving = tokio::spawn(serve(open(path).unwrap(), fake.clone(), wire_log(), None, 32));
    let result = tokio::task::spawn_blocking(act).await.unwrap();
    serving.abort();
    let commands = fake.0.lock().unwrap().clone();
    (result, commands)
}

#[tokio::test]
async fn commands_arrive_and_their_answers_return() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let socket = path.clone();
    let send_all = move || Command::ALL.map(|(_, command)| send(&socket, command, None));
    let (answers, commands) = beside(&path, send_all).await;
    assert_eq!(commands, Command::ALL.map(|(_, command)| command));
    assert_eq!(answers[0], Ok(Answer::Done("z: as you say".to_owned())));
    assert_eq!(answers[2], Err(Failure::Refused("axis z moves".to_owned())));
}

#[tokio::test]
async fn who_arms_and_is_refused_is_told_why() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let socket = path.clone();
    let twice = move || ["refused", "z"].map(|axis| send(&socket, Command::Arm, Some(axis)));
    let (answers, _) = beside(&path, twice).await;
    let refused = Err(Failure::Refused("its register holds too much".to_owned()));
    assert_eq!(
        answers,
        [refused, Ok(Answer::Waits("z: waiting to arm: bed has an open circuit".to_owned()))]
    );
}

#[tokio::test]
async fn a_measured_error_arrives_with_every_digit() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let socket = path.clone();
    let named = MeasuredReport::new(3.0, Some("2026-01-31T12:00:00.123456789Z"), Some("id=1:a")).unwrap();
    let said = [Some((-0.1_f64 - 0.2).into()), Some(1e-9.into()), Some(named), None];
    let sent = said.clone();
    let send = move || sent.map(|report| send_measured(&socket, "z", report.as_ref()));
    let (answers, _) = beside(&path, send).await;
    assert_eq!(answers, said.map(|report| Ok(Answer::Done(format!("z: {report:?}")))));
    for line in [
        "measured",
        "measured z",
        "measured z much",
        "measured  ",
        "measuredz 1",
        "arm now",
        "arm until=soon",
        "arm until=-1",
        "disarm stay",
        "measured z 1 axis=z",
        "measured z clear id=a",
        "arm time=2026-01-31T12:00:00Z",
    ] {
        assert_eq!(Line::parse(line), None, "{line}");
    }
}

#[tokio::test]
async fn a_word_it_does_not_know_is_refused_and_one_that_never_ends_is_cut() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let socket = path.clone();
    let (answers, commands) = beside(&path, move || {
        ["launch\n".to_owned(), "a".repeat(10_000)].map(|word| {
            let mut stream = UnixStream::connect(&socket).unwrap();
            let _ = stream.write_all(word.as_bytes());
            let mut answer = String::new();
            let _ = BufReader::new(stream).read_line(&mut answer);
            answer
        })
    })
    .await;
    assert!(answers[0].starts_with("error this socket understands"), "{answers:?}");
    assert!(commands.is_empty());
}

/// The limit is 32 connections. A client that waits to arm keeps its connection.
#[tokio::test]
async fn a_command_takes_the_place_of_the_connection_that_has_been_silent_longest() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let socket = path.clone();
    let ((answer, waits, closed), commands) = beside(&path, move || {
        let mut waiting = UnixStream::connect(&socket).unwrap();
        waiting.write_all(b"arm axis=z stay\n").unwrap();
        let mut waiting = BufReader::new(waiting).lines();
        let first = waiting.next().unwrap().unwrap();
        let silent: Vec<UnixStream> = (0..600).map(|_| UnixStream::connect(&socket).unwrap()).collect();
        let answer = send(&socket, Command::Disarm, None);
        let waits = [first, waiting.next().unwrap().unwrap()];
        let is_closed = |stream: &&UnixStream| {
            stream.set_nonblocking(true).unwrap();
            let mut stream: &UnixStream = stream;
            matches!(stream.read(&mut [0]), Ok(0))
        };
        (answer, waits, silent.iter().take(500).filter(is_closed).count())
    })
    .await;
    assert_eq!(answer, Ok(Answer::Done("z: as you say".to_owned())));
    assert_eq!(commands, [Command::Arm, Command::Disarm]);
    assert!(waits[0].starts_with("waits") && waits[1] == "still", "{waits:?}");
    assert_eq!(closed, 500, "the oldest are closed");
}

/// A gateway of an older version accepts `restart` without a time only. An upgrade must still be possible.
#[test]
fn a_gateway_that_knows_the_bare_restart_only_is_asked_by_that() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let listener = std::os::unix::net::UnixListener::bind(&path).unwrap();
    let old = std::thread::spawn(move || {
        let mut heard = Vec::new();
        for answer in ["error this socket understands arm, restart\n", "error it is stopping\n"] {
            let (mut stream, _) = listener.accept().unwrap();
            let mut line = String::new();
            BufReader::new(&stream).read_line(&mut line).unwrap();
            stream.write_all(answer.as_bytes()).unwrap();
            heard.push(line);
        }
        heard
    });
    let said = restart(&path, Duration::from_secs(10), |_| ());
    assert_eq!(said, Err(Failure::Refused("it is stopping".to_owned())));
    let heard = old.join().unwrap();
    assert!(
        heard[0].starts_with("restart within=10 ") && heard[1].starts_with("restart until="),
        "{heard:?}"
    );
}

#[tokio::test]
async fn a_second_gateway_is_refused_and_the_socket_of_a_dead_one_is_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let first = open(&path).unwrap();
    let error = open(&path).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::AddrInUse);
    assert!(error.to_string().contains("another gateway"), "{error}");
    drop(first);
    assert!(path.exists(), "a dead gateway leaves its socket behind");
    open(&path).unwrap();
    assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o660);
}

#[tokio::test]
async fn a_wire_log_ends_by_itself_and_one_of_an_unknown_device_is_refused_with_the_known_ones() {
    let directory = tempfile::tempdir().unwrap();
    let path = path(directory.path(), "m");
    let socket = path.clone();
    let (said, _) = beside(&path, move || {
        let listen = |device| trace(&socket, device, Duration::from_millis(50), false, |_| true);
        (listen("cnc"), listen("lathe"))
    })
    .await;
    assert!(said.0.unwrap().starts_with("nothing was sent to the device"));
    let refused = said.1.unwrap_err().to_string();
    assert!(
        refused.starts_with("there is no device `lathe`; there are: ") && refused.contains("cnc"),
        "{refused}"
    );
}

#[test]
fn only_a_whole_wish_for_a_wire_log_is_one() {
    for line in
        ["trace", "trace cnc", "trace cnc 5", "trace cnc x text", "trace cnc -1 text", "trace cnc 5 xml"]
    {
        assert!(TraceRequest::parse(line).is_none(), "{line}");
    }
    assert!(TraceRequest::parse("trace cnc 0.5 json").is_some());
    assert!(TraceRequest::parse("trace cnc 1e9 text").is_some_and(|request| request.span == LONGEST_TRACE));
}

#[test]
fn a_release_names_one_output_and_its_client_stays() {
    let parse = restart::Request::parse;
    let seconds = |seconds: u64| Duration::from_secs(seconds);
    let release = |seen, within| Some(restart::Request::Release { output: "cnc_z", seen, within });
    assert_eq!(parse("release cnc_z seen=20"), release("20", seconds(60)));
    assert_eq!(parse("release cnc_z seen=20,-4.5 within=10 until=8123.25"), release("20,-4.5", seconds(10)));
    assert_eq!(parse("release cnc_z seen=20 within=1e9"), release("20", seconds(600)));
    for line in [
        "release",
        "release ",
        "release cnc_z",
        "release a b seen=20",
        "release cnc_z seen=20 within=soon",
        "released cnc_z seen=20",
    ] {
        assert_eq!(parse(line), None, "{line}");
    }
    let stays =
        ["release cnc_z seen=20", "restart", "restart within=10", "restart wrong", "restart wrong a.toml"];
    assert_eq!(stays.map(|line| parse(line).unwrap().stays()), [true, true, true, false, false]);
}
