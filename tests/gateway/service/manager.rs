//! Service manager like systemd: a socket that receives the notifications of a service.

use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use isotherm::clock::Clock;

use crate::service::process::PATIENCE;

pub(crate) struct Manager {
    said: Receiver<String>,
    pub(crate) path: PathBuf,
    /// Datagrams in the order of their arrival.
    pub(crate) heard: Vec<String>,
}

impl Manager {
    pub(crate) fn listen(home: &Path) -> Manager {
        let path = home.join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        let (says, said) = channel();
        // The thread receives at once, as systemd does. Ten datagrams may wait, and further ones are lost.
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(length) = socket.recv(&mut bytes)
                && says.send(String::from_utf8_lossy(&bytes[..length]).into_owned()).is_ok()
            {}
        });
        Manager { said, path, heard: Vec::new() }
    }

    /// Waits for a datagram that contains this text.
    #[track_caller]
    pub(crate) fn receives(&mut self, text: &str) -> String {
        let clock = Clock::wall();
        let begun = clock.now();
        while clock.now().since(begun) < PATIENCE {
            if let Some(reported) = self.next().filter(|reported| reported.contains(text)) {
                return reported;
            }
        }
        panic!("{text:?} was not told; heard: {:#?}", self.heard);
    }

    /// Datagrams that have arrived and were not returned yet.
    pub(crate) fn rest(&mut self) -> Vec<String> {
        std::iter::from_fn(|| self.next()).collect()
    }

    fn next(&mut self) -> Option<String> {
        let reported = self.said.recv_timeout(Duration::from_millis(200)).ok()?;
        self.heard.push(reported.clone());
        Some(reported)
    }
}
