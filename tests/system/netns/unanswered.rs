//! Name without an answer of the name server: only one query is under way, however often a message is tried.

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use isotherm::observe::notify::{Post, Server};
use isotherm_profile::{ALARM, Notify, Url};

/// File with the name servers of this computer. It may be a link to a missing file.
fn settings() -> PathBuf {
    let place = PathBuf::from("/etc/resolv.conf");
    let place = std::fs::read_link(&place).map_or(place, |behind| Path::new("/etc").join(behind));
    if !place.exists() {
        std::fs::create_dir_all(place.parent().unwrap()).unwrap();
        std::fs::write(&place, "").unwrap();
    }
    place
}

/// Name server in this namespace that never answers. Returns the number of received queries.
fn nobody_answers(home: &Path) -> Arc<AtomicUsize> {
    let socket = UdpSocket::bind("127.0.0.1:53").unwrap();
    let asks_here = home.join("resolv.conf");
    // The resolver sends one query, and its timeout is longer than the test.
    std::fs::write(&asks_here, "nameserver 127.0.0.1\noptions timeout:30 attempts:1\n").unwrap();
    let bound = Command::new("mount").arg("--bind").arg(&asks_here).arg(settings()).status().unwrap();
    assert!(bound.success(), "{} cannot be another one here", settings().display());
    let count = Arc::new(AtomicUsize::new(0));
    let counts = count.clone();
    std::thread::spawn(move || {
        let mut question = [0; 512];
        while socket.recv(&mut question).is_ok() {
            counts.fetch_add(1, Ordering::SeqCst);
        }
    });
    count
}

#[test]
fn a_name_that_nobody_answers_for_is_asked_for_once_however_often_a_message_is_tried() {
    let home = tempfile::tempdir().unwrap();
    let count = nobody_answers(home.path());
    let url = Url::parse("http://alarms.plant.example/").unwrap();
    let notify =
        Notify { name: "notify[0]".into(), url, on: vec![ALARM], token_file: None, ca: None, body: None };
    let server = Server::of(&notify, Err("nobody is trusted".to_owned()));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        for attempt in 0..10 {
            let posted = tokio::time::timeout(Duration::from_millis(100), server.post("{}")).await;
            assert!(posted.is_err(), "attempt {attempt}: {posted:?}");
        }
        while count.load(Ordering::SeqCst) == 0 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    });
    runtime.shutdown_background();
    // One query for each kind of address.
    let count = count.load(Ordering::SeqCst);
    assert!(count <= 2, "{count} questions");
}
