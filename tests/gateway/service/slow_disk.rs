//! Slow disk while another program is to take over: the lines poll and send heartbeats until the disk has stored the
//! state and the ledger.

use std::io::{self, BufRead, BufReader, Write};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Disk, Files, Gateway, Options, Program, control};

use crate::service::device::{Device, State, What, profile};
use crate::service::process::file;
use crate::service::rig::TIMES;

/// Disk that becomes slow. It then stores no document before the device has had three more polls and three more beats.
struct SlowDisk {
    device: Device,
    is_slow: AtomicBool,
    taken: AtomicUsize,
    /// Documents that were stored without that, because it took too long.
    alone: AtomicUsize,
}

impl SlowDisk {
    fn wait(&self) {
        if !self.is_slow.load(Ordering::Relaxed) {
            return;
        }
        let count = |state: &State| {
            let polls = state.seen.iter().filter(|seen| matches!(seen.what, What::Asked { .. })).count();
            [polls, state.beats.len()]
        };
        let before = count(&self.device.state());
        let is_more = |now: [usize; 2]| now.iter().zip(before).all(|(now, before)| *now >= before + 3);
        let waited = self.device.wait(Duration::from_secs(20), |state| is_more(count(state)).then_some(()));
        let counted = if waited.is_some() { &self.taken } else { &self.alone };
        counted.fetch_add(1, Ordering::Relaxed);
    }
}

impl Disk for SlowDisk {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        Files.read(path)
    }

    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()> {
        self.wait();
        Files.replace(path, document)
    }

    fn keep(&self, path: &Path, aside: &Path) -> io::Result<()> {
        Files.keep(path, aside)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        Files.rename(from, to)
    }

    fn forget(&self, path: &Path) {
        Files.forget(path);
    }

    fn has(&self, path: &Path) -> bool {
        Files.has(path)
    }
}

#[tokio::test]
async fn while_the_disk_takes_state_and_ledger_the_lines_are_polled_and_beat() {
    let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
    let home = tempfile::tempdir().unwrap();
    let text = profile(device.address(), TIMES).replace("100ms", "5ms")
        + "[heartbeat]\ndevice = \"cnc\"\nregister = \"holding:20\"\nevery = \"50ms\"\n";
    let loaded = isotherm_profile::parse(Path::new("walker.toml"), &text, &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let program = file(home.path(), "program", "#!/bin/sh\nexit 0\n");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let disk = Arc::new(SlowDisk {
        device: device.clone(),
        is_slow: AtomicBool::new(false),
        taken: AtomicUsize::new(0),
        alone: AtomicUsize::new(0),
    });
    let options =
        Options { directory: Some(home.path().to_owned()), disk: disk.clone(), ..Options::default() };
    let gateway = Gateway::new(profile, &Clock::wall(), options);
    let socket = control::path(home.path(), "walker");
    let listener = control::open(&socket).unwrap();
    let successor = gateway.successor(Program::new(program, Vec::new()), socket.clone());
    let (source, wire_log, serves) = (gateway.source(), gateway.wire_log(), successor.clone());
    let serving = tokio::spawn(control::serve(listener, source, wire_log, Some(serves), 8));
    let (beating, asking) = (device.clone(), disk.clone());
    let asked = std::thread::spawn(move || {
        beating.asks(30);
        let arrived = |state: &State| (state.beats.len() > 3 && state.offset() == 30).then_some(());
        assert!(beating.wait(Duration::from_secs(60), arrived).is_some(), "it compensates and beats");
        asking.is_slow.store(true, Ordering::Relaxed);
        let mut stream = UnixStream::connect(socket).unwrap();
        stream.write_all(b"restart within=30\n").unwrap();
        let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
        lines.find(|line| line.starts_with("ok") || line.starts_with("error")).unwrap()
    });
    let outcome = gateway.run(std::future::pending(), std::future::pending()).await;
    serving.abort();
    assert!(asked.join().unwrap().starts_with("ok"));
    assert!(outcome.handover.is_some_and(|handover| handover.armed.contains_key("z")));
    assert!(successor.take_checked().is_some_and(|checked| !checked.prepared.has_profile()));
    let [taken, alone] = [&disk.taken, &disk.alone].map(|count| count.load(Ordering::Relaxed));
    assert!(taken >= 2 && alone == 0, "{taken} documents while the lines were polled, {alone} without");
}
