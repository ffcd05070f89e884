//! Text from outside that contains control characters or forged lines. The program rejects it, or shows it escaped.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::on_time::OnTime;
use crate::process::{Running, file, isotherm, until};
use crate::rig::{EVERY, Machine, walker};

const MACHINE: &str = include_str!("../interop/machine.toml");
const TOKEN: &str = "0123456789abcdef0123456789abcdef";
const FORGED: &str = "FORGED axis z: armed by the owner";

/// Asserts that the output contains no line that begins with the forged text, and no control characters.
#[track_caller]
fn is_honest(said: &str) {
    assert!(!said.chars().any(|one| one.is_control() && one != '\n' && one != '\t'), "{said:?}");
    assert!(!said.lines().any(|line| line.starts_with("FORGED")), "{said}");
}

fn said(command: &mut Command) -> String {
    let output = command.output().unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// A directory with a name that would clear the screen and begin a new line.
fn hostile(home: &Path) -> PathBuf {
    let directory = home.join(format!("a\u{1b}[2J\n{FORGED}"));
    std::fs::create_dir(&directory).unwrap();
    directory
}

#[test]
fn whoever_asks_over_http_or_the_socket_forges_no_line_of_the_log_nor_of_the_events() {
    let home = tempfile::tempdir().unwrap();
    let token = file(home.path(), "token", TOKEN);
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
    let (device, text) = walker();
    let address = device.address().to_string();
    let text = text.replace(&address, "127.0.0.1:9");
    let web = format!("{text}\n[web]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"{}\"\n", token.display());
    let directory = hostile(home.path());
    let profile = file(&directory, "machine.toml", &web);
    file(&directory, "machine.local.toml", &format!("[bus.cell]\naddress = \"{address}\"\n"));
    let state = home.path().join("state");
    let mut gateway =
        Running::start(isotherm(home.path()).arg("run").arg(&profile).arg("--state").arg(&state));
    let page = gateway.receives("page http://").split_once("http://").unwrap().1.to_owned();
    gateway.receives("the gateway runs");
    let _on_time = OnTime::from_now(&device, EVERY, gateway.id());

    let forged = FORGED.replace(' ', "%20");
    let mut answers = String::new();
    for path in [
        format!("acknowledge?alarm=x%0A{forged}%1B%5B2J"),
        format!("disarm?axis=x%0A{forged}%C2%9B2J"),
        format!("axes/x%0A{forged}%1B/measured"),
    ] {
        let mut stream = TcpStream::connect(&page).unwrap();
        let body = "{ \"error_um\": 1.0 }";
        let head = format!(
            "POST /api/{path} HTTP/1.1\r\nHost: {page}\r\nAuthorization: Bearer {TOKEN}\r\nConnection: close\r\n\
             Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        );
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answers += answer.split_once("\r\n\r\n").unwrap().1;
    }
    is_honest(&answers);
    let mut socket = UnixStream::connect(state.join("walker.sock")).unwrap();
    socket.write_all("zero axis=\u{1b}]0;owned\u{7}\r\n".as_bytes()).unwrap();
    let mut answer = String::new();
    socket.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("error there is no axis \\u001b]0;owned\\u0007"), "{answer:?}");

    let events = || said(isotherm(home.path()).arg("events").arg(&profile).arg("--state").arg(&state));
    until("all of it is an event", || {
        let events = events();
        let is_there = events.contains("x\\nFORGED") && events.contains("\\u001b]0;owned");
        if is_there { Ok(()) } else { Err(events) }
    });
    is_honest(&events());
    gateway.receives("\\u001b]0;owned");
    is_honest(&gateway.so_far().join("\n"));
    assert!(gateway.said.iter().any(|line| line.contains("bus.cell.address")), "{:?}", gateway.said);
}

#[test]
fn an_argument_that_is_none_steers_no_terminal() {
    let _beside = Machine::beside();
    let home = tempfile::tempdir().unwrap();
    let hostile = format!("a\u{1b}[2J\n{FORGED}");
    for arguments in [
        vec![hostile.clone()],
        vec![format!("--{hostile}")],
        vec!["replay".to_owned(), "p.toml".to_owned(), "l.csv".to_owned(), format!("--out{hostile}")],
        vec!["identify".to_owned(), format!("--method={hostile}"), "p.toml".to_owned(), "l.csv".to_owned()],
    ] {
        let output = isotherm(home.path()).args(&arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("a\\u001b[2J\\nFORGED"), "{said}");
        is_honest(&said);
    }
}

#[test]
fn a_profile_s_own_name_and_texts_steer_no_terminal() {
    let _beside = Machine::beside();
    let home = tempfile::tempdir().unwrap();
    let directory = hostile(home.path());
    let name = "name = \"interop\"";
    for (text, words) in [
        (
            MACHINE.replace(name, &format!("{name}\ndescription = \"a\\u001b[2J\"")),
            "has invisible characters, or a line break",
        ),
        (
            MACHINE.replace(name, &format!("{name}\ndescription = \"a\\n{FORGED}\"")),
            "has invisible characters, or a line break",
        ),
        (MACHINE.replace("[axis.z]", &format!("[axis.z]\n\"a\\u001b\\n{FORGED}\" = 1")), "unknown key"),
        (MACHINE.replace("[axis.z]", "[axis.z]\n# \u{1b}[2J"), "machine.toml:"),
        (MACHINE.replace("name  = \"difference\"", "name  = \"\u{202e}ecnereffid\""), "machine.toml:"),
    ] {
        let profile = file(&directory, "machine.toml", &text);
        let said = said(isotherm(home.path()).arg("check").arg(&profile));
        assert!(said.contains(words) && said.contains("1 error in the profile"), "{words}: {said}");
        is_honest(&said);
        assert!(!said.contains('\u{202e}'), "{said}");
    }
    let not_there = said(isotherm(home.path()).arg("replay").arg(directory.join("no.toml")).arg("no.csv"));
    is_honest(&not_there);
}
