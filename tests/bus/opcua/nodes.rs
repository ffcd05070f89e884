//! Tests of the nodes that `read --browse` and `check --online` show.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;

use serde_json::Value;

use super::process::isotherm;
use super::rig::{Server, machine, with_many};
use super::secured::{certificates, serve};
use super::words::{Ended, typing};

fn read(server: &Server, more: &[&str]) -> Ended {
    let home = tempfile::tempdir().unwrap();
    let bus = format!("opc.tcp://127.0.0.1:{}", server.port);
    typing(isotherm(home.path()).args(["read", "--bus", &bus, "--timeout", "20s"]).args(more), "")
}

fn nodes(ended: &Ended) -> Vec<Value> {
    ended.json()["nodes"].as_array().unwrap_or_else(|| panic!("{}{}", ended.out, ended.said)).clone()
}

fn names(ended: &Ended) -> Vec<String> {
    nodes(ended).iter().map(|node| node["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn each_node_is_shown_with_its_type_what_this_user_may_and_what_it_holds() {
    let server = Server::start(&[]);
    let found = read(&server, &["--browse", "--json"]);
    let found = nodes(&found);
    let node =
        |id: &str| found.iter().find(|node| node["node"] == id).unwrap_or_else(|| panic!("{id}: {found:?}"));
    let said = |id: &str, key: &str| node(id)[key].as_str().unwrap_or_default().to_owned();
    let row =
        |id: &str| (said(id, "type"), said(id, "kind"), said(id, "value"), node(id)["is_writable"] == true);
    let expected = |a: &str, b: &str, c: &str, d| (a.to_owned(), b.to_owned(), c.to_owned(), d);
    assert_eq!(row("ns=2;s=bed"), expected("f32", "Float", "20", false));
    assert_eq!(row("ns=2;s=offset"), expected("i32", "Int32", "0", true));
    assert_eq!(row("ns=2;s=text"), expected("", "String", "text", true));
    assert_eq!((&found[0]["node"], &found[0]["name"]), (&"i=85".into(), &"Objects".into()));
    // Nodes that OPC UA itself defines are listed, but not browsed.
    assert!(found.iter().any(|node| node["name"] == "Server"));
    assert!(found.iter().all(|node| node["name"] != "ServerStatus"));
    let text = read(&server, &["--browse"]);
    assert!(text.out.contains("\n  ns=2;s=offset  offset  i32 (Int32)  read, write  0\n"), "{}", text.out);
}

#[test]
fn no_more_nodes_are_shown_than_asked_for_and_as_deep_as_asked_for_however_few_the_server_gives_at_once() {
    for few in [&[][..], &["--few", "2"], &["--few", "1", "--most", "3"]] {
        let server = Server::start(few);
        let all = names(&read(&server, &["--browse", "ns=2;s=folder", "--json"]));
        assert_eq!(all, ["folder", "a", "below", "b", "c", "d", "e"], "{few:?}");
        let shallow = names(&read(&server, &["--browse", "ns=2;s=folder", "--depth", "1", "--json"]));
        assert_eq!(shallow, ["folder", "a", "b", "c", "d", "e"]);
        let cut = read(&server, &["--browse", "ns=2;s=folder", "--most", "4", "--json"]);
        assert_eq!((names(&cut).len(), cut.json()["is_cut"].as_bool()), (4, Some(true)));
        let whole = read(&server, &["--browse", "ns=2;s=folder", "--most", "7", "--json"]);
        assert_eq!((names(&whole).len(), whole.json()["is_cut"].as_bool()), (7, Some(false)));
    }
}

#[test]
fn a_look_around_leaves_no_place_taken_at_the_server() {
    let mut server = Server::start(&["--few", "1"]);
    let before = server.does("taken");
    for most in ["2", "3", "200"] {
        assert_eq!(read(&server, &["--browse", "--most", most]).code, Some(0));
    }
    assert_eq!(server.does("taken"), before);
}

#[test]
fn a_node_that_is_not_there_is_told_with_what_to_do() {
    let server = Server::start(&[]);
    let bus = format!("opc.tcp://127.0.0.1:{}", server.port);
    let home = tempfile::tempdir().unwrap();
    let scan = typing(isotherm(home.path()).args(["scan", "--bus", &bus]), "");
    assert!(!scan.out.contains("user ="), "anybody is let in: {}", scan.out);
    let ended = read(&server, &["--browse", "ns=2;s=bet"]);
    assert_eq!(ended.code, Some(1));
    assert!(
        ended.said.contains("ns=2;s=bet: the server answers BadNodeIdUnknown: there is no such node"),
        "{}",
        ended.said
    );
    let ended = read(&server, &["--register", "holding:0", "--unit", "1"]);
    let said = format!("{bus} is an OPC UA server, without registers; `isotherm read --browse`");
    assert!(ended.said.contains(&said), "{}", ended.said);
    for (more, remedy) in
        [(&[][..], "add --browse"), (&["--register", "holding:0"], "replace --register with --browse")]
    {
        let ended = read(&server, more);
        let said = format!("an OPC UA server has nodes, not registers: {remedy}");
        assert!(ended.said.contains(&said), "{}", ended.said);
    }
}

fn check(directory: &Path, text: &str) -> Ended {
    let path = directory.join("machine.toml");
    // A server on a busy computer may need more than a second. A failed read waits for three timeouts.
    std::fs::write(&path, text.replace("timeout = \"1s\"", "timeout = \"3s\"")).unwrap();
    typing(isotherm(directory).arg("check").arg(path).arg("--online"), "")
}

/// Starts a proxy to this port, and returns its own port. A message of the client with more than `most` bytes ends the
/// connection with BadTcpMessageTooLarge, as some servers do.
fn closes_beyond(most: usize, server: u16) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let (mut here, mut there) = (stream.unwrap(), TcpStream::connect(("127.0.0.1", server)).unwrap());
            let (mut from, mut to) = (there.try_clone().unwrap(), here.try_clone().unwrap());
            std::thread::spawn(move || std::io::copy(&mut from, &mut to));
            std::thread::spawn(move || {
                let mut head = [0; 8];
                while here.read_exact(&mut head).is_ok() {
                    let length = u32::from_le_bytes(head[4..].try_into().unwrap());
                    let mut body = vec![0; usize::try_from(length).unwrap() - head.len()];
                    if here.read_exact(&mut body).is_err() {
                        return;
                    }
                    if head.len() + body.len() > most {
                        let numbers = [16, 0x8080_0000, u32::MAX].map(u32::to_le_bytes).concat();
                        let _ = here.write_all(&[b"ERRF", numbers.as_slice()].concat());
                        let _ = here.shutdown(Shutdown::Both);
                        return;
                    }
                    if there.write_all(&[&head, body.as_slice()].concat()).is_err() {
                        return;
                    }
                }
            });
        }
    });
    port
}

#[test]
fn a_server_that_closes_the_connection_at_a_long_message_is_read_in_shorter_ones() {
    let server = Server::start(&["--many", "300"]);
    let home = tempfile::tempdir().unwrap();
    let text = with_many(&machine(closes_beyond(8192, server.port), ""), 300);
    let ended = check(home.path(), &text);
    // On a busy computer, the readings of so many nodes may be older than their `max_age`.
    assert!(!ended.said.contains("closed"), "{}{}", ended.out, ended.said);
    for place in 0..300 {
        let line = format!("  signal many{place} at ns=2;s=many{place}: ");
        assert!(ended.out.contains(&line), "{line}\n{}{}", ended.out, ended.said);
    }
}

#[test]
fn what_of_a_profile_does_not_fit_its_server_is_told_node_by_node() {
    let server = Server::start(&[]);
    let home = tempfile::tempdir().unwrap();
    let good = machine(server.port, "");
    let ended = check(home.path(), &good);
    assert_eq!(ended.code, Some(0), "{}{}", ended.out, ended.said);
    for line in [
        "  signal bed at ns=2;s=bed: f32 (Float)  read  20\n",
        "  signal scale at ns=2;s=scale: i32 (Int32)  read, write  100000\n",
        "  output offset at ns=2;s=offset: i32 (Int32)  read, write  0\n",
    ] {
        assert!(ended.out.contains(line), "{line}: {}", ended.out);
    }
    let cases = [
        (
            ("ns=2;s=offset\"\ntype = \"i32\"", "ns=2;s=k0\"\ntype = \"i32\""),
            "the value is a Double, but the profile says i32: write type = \"f64\"",
        ),
        (
            ("ns=2;s=offset\"\ntype = \"i32\"", "ns=2;s=a\"\ntype = \"f64\""),
            "this user may not write the node: give the user this right at the server",
        ),
        (
            ("ns=2;s=scale", "ns=2;s=skale"),
            "there is no such node at the server: `isotherm read --browse` shows",
        ),
        (
            ("ns=2;s=scale\"\ntype = \"i32\"", "ns=2;s=scale\"\ntype = \"i16\""),
            "the value is an Int32, but the profile says i16: write type = \"i32\"",
        ),
        (("ns=2;s=bed", "ns=2;s=text"), "the value is a String, not a number"),
        (("ns=2;s=bed", "ns=2;s=folder"), "the node is not a variable"),
        (("ns=2;s=bed", "ns=2;s=several"), "the node holds several values"),
        (("ns=2;s=bed", "ns=2;s=hidden"), "this user may not read the node"),
    ];
    for ((from, to), words) in cases {
        assert!(good.contains(from), "{from}");
        let ended = check(home.path(), &good.replace(from, to));
        assert_eq!(ended.code, Some(1), "{to}: {}{}", ended.out, ended.said);
        let is_told = |line: &str| line.starts_with("    warning: ") && line.contains(words);
        assert!(ended.out.lines().any(is_told), "{words}: {}", ended.out);
        assert!(ended.said.contains(words), "{words}: {}", ended.said);
    }
}

#[test]
fn the_nodes_of_sets_and_of_the_heartbeat_are_looked_at_as_well() {
    let server = Server::start(&[]);
    let home = tempfile::tempdir().unwrap();
    let set = "[set.offsets]\nheartbeat = { node = \"ns=2;s=beat\", type = \"i16\" }\ncontrol = { node = \"ns=2;s=control\", type = \
               \"u16\" }\nversion = { node = \"ns=2;s=version\", type = \"u8\", value = 17 }\nhandshake = { strobe = { node = \
               \"ns=2;s=strobe\", type = \"bool\" }, acknowledge = { node = \"ns=2;s=taken\" }, timeout = \"4s\" }\n";
    let life = "[heartbeat]\ndevice = \"cnc\"\nnode = \"ns=2;s=life\"\ntype = \"i16\"\nevery = \"500ms\"\n";
    let text =
        machine(server.port, "").replace("writes = \"offset\"", "writes = \"offset\"\nset = \"offsets\"");
    let good = format!("{}{set}{life}", text.replace("every = \"200ms\"", "every = \"10s\""));
    let ended = check(home.path(), &good);
    assert_eq!(ended.code, Some(0), "{}{}", ended.out, ended.said);
    let cases = [
        ("s=beat", "heartbeat of set offsets at ns=2;s=gone"),
        ("s=control", "control of set offsets at ns=2;s=gone"),
        ("s=version", "version of set offsets at ns=2;s=gone"),
        ("s=strobe", "strobe of set offsets at ns=2;s=gone"),
        ("s=taken", "acknowledge of set offsets at ns=2;s=gone"),
        ("s=life", "heartbeat at ns=2;s=gone"),
    ];
    for (node, words) in cases {
        let ended = check(home.path(), &good.replace(node, "s=gone"));
        assert_eq!(ended.code, Some(1), "{node}: {}{}", ended.out, ended.said);
        assert!(
            ended.said.contains(&format!("{words}: the server answers BadNodeIdUnknown")),
            "{}",
            ended.said
        );
    }
    let ended = check(home.path(), &good.replace("s=control", "s=boots").replace("\"u16\"", "\"u32\""));
    assert!(
        ended.said.contains("control of set offsets at ns=2;s=boots: this user may not write the node"),
        "{}",
        ended.said
    );
}

#[test]
fn a_server_that_stamps_only_changes_is_told_with_the_key_that_says_so() {
    let mut server = Server::start(&[]);
    server.does("stamp bed -96");
    let home = tempfile::tempdir().unwrap();
    let ended = check(home.path(), &machine(server.port, ""));
    assert_eq!(ended.code, Some(1), "{}{}", ended.out, ended.said);
    let hint = "to do: if the server updates the timestamp only when the value changes, write source_time = \
                \"changed\" at device cnc\n";
    for text in [&ended.out, &ended.said] {
        assert!(text.contains("stale: the server's timestamp is 9") && text.contains(" s old"), "{text}");
    }
    // The hint is below the signal only.
    assert!(ended.out.contains(&format!(" s old\n      {hint}")), "{}", ended.out);
    assert!(!ended.said.contains("source_time"), "{}", ended.said);
    let changed =
        machine(server.port, "").replace("every = \"100ms\"", "every = \"100ms\"\nsource_time = \"changed\"");
    let ended = check(home.path(), &changed);
    assert_eq!(ended.code, Some(0), "{}{}", ended.out, ended.said);
    assert!(ended.out.contains("): connected") && !ended.out.contains("not connected"), "{}", ended.out);
}

#[test]
fn a_scan_shows_what_a_server_offers_and_what_a_profile_says_to_take_the_best_of_it() {
    let given = certificates();
    let server = serve(given.path(), "server", &["--user", "isotherm:hot-and-cold"]);
    let bus = format!("opc.tcp://127.0.0.1:{}", server.port);
    let scan = |more: &[&str]| typing(isotherm(given.path()).args(["scan", "--bus", &bus]).args(more), "");
    let found = scan(&["--json"]).json();
    let offers = found["endpoints"].as_array().unwrap();
    let offered = |security: &str, policy: &str| {
        let is_it = |offer: &&Value| offer["security"] == security && offer["policy"] == policy;
        offers.iter().find(is_it).unwrap_or_else(|| panic!("{found}")).clone()
    };
    assert_eq!(offers.len(), 4);
    assert_eq!(offered("none", "None")["is_spoken"], true);
    let best = offered("sign-and-encrypt", "Aes256_Sha256_RsaPss");
    assert_eq!((&best["is_spoken"], &best["users"][0]), (&true.into(), &"password".into()));
    assert_eq!(best["certificate"]["application"], "urn:freeopcua:python:server");
    let text = scan(&[]);
    let lines = format!("type = \"opcua\"\naddress = \"{bus}\"\nsecurity = \"sign-and-encrypt\"\n");
    assert!(text.out.contains(&lines), "{}{}", text.out, text.said);
    let user = "trusted = \"trusted\"\n# a user of the server; the file contains only the password\nuser = { name = \"isotherm\", \
                password_file = \"opcua.password\" }\n";
    assert!(text.out.contains(user), "{}", text.out);
    assert!(text.out.contains("  sign              Basic256Sha256        password\n"), "{}", text.out);
    let none = typing(isotherm(given.path()).args(["scan", "--bus", "opc.tcp://127.0.0.1:1"]), "");
    assert_eq!(none.code, Some(1));
    assert!(
        none.said.contains("no program listens at this port: is the port right (usually 4840)"),
        "{}",
        none.said
    );
}
