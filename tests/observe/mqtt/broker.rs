//! mosquitto as a separate process, with its clients.

use std::cell::{Ref, RefCell};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::process::{Running, file, free_port, until};

const LACKS: &str = "is not installed: `tests/run mqtt` does it";

/// A broker that listens at a port of this computer.
pub(crate) struct Broker {
    pub(crate) port: u16,
    configuration: PathBuf,
    running: RefCell<Option<Running>>,
    home: tempfile::TempDir,
}

impl Broker {
    /// Starts a broker that allows everything without a password.
    pub(crate) fn open() -> Broker {
        Broker::with(|_, _| "allow_anonymous true\n".to_owned())
    }

    /// Starts a broker with additional lines of configuration, made from its directory and port.
    pub(crate) fn with(lines: impl FnOnce(&Path, u16) -> String) -> Broker {
        let (home, port) = (tempfile::tempdir().unwrap(), free_port());
        let lines = lines(home.path(), port);
        let text = format!("user root\nlog_type all\nlistener {port} 127.0.0.1\n{lines}");
        let configuration = file(home.path(), "mosquitto.conf", &text);
        let mut broker = Broker { port, configuration, running: RefCell::new(None), home };
        broker.starts();
        broker
    }

    /// Directory of the broker.
    pub(crate) fn home(&self) -> &Path {
        self.home.path()
    }

    /// Starts the broker, or starts it again at the same port.
    pub(crate) fn starts(&mut self) {
        let found = ["/usr/sbin/mosquitto", "/usr/local/sbin/mosquitto", "/usr/bin/mosquitto"];
        let program = found.iter().find(|path| Path::new(path).exists());
        let program = program.unwrap_or_else(|| panic!("mosquitto {LACKS}"));
        let begun = Running::start(Command::new(program).arg("-c").arg(&self.configuration));
        self.running.replace(Some(begun));
        let port = self.port;
        until("the broker listens", || {
            std::net::TcpStream::connect(("127.0.0.1", port)).map(drop).map_err(|error| error.to_string())
        });
    }

    /// Kills the broker.
    pub(crate) fn dies(&mut self) {
        self.running.replace(None).unwrap().killed();
    }

    /// Process of the broker, which a test can stop and continue.
    pub(crate) fn process(&self) -> Ref<'_, Running> {
        Ref::map(self.running.borrow(), |running| running.as_ref().unwrap())
    }

    /// Output of the broker so far.
    pub(crate) fn so_far(&self) -> String {
        self.running.borrow_mut().as_mut().unwrap().so_far().join("\n")
    }

    /// Starts a subscriber of these topics, and waits until it is subscribed. It prints each message as `RETAINED TOPIC
    /// PAYLOAD`.
    pub(crate) fn reads(&self, topics: &str, more: &[&str]) -> Running {
        let port = self.port.to_string();
        static READERS: AtomicUsize = AtomicUsize::new(0);
        let name = format!("reader-{}", READERS.fetch_add(1, Ordering::Relaxed));
        let mut command = Command::new("mosquitto_sub");
        command
            .args(["-h", "127.0.0.1", "-p", &port, "-q", "1", "-t", topics, "-i", &name, "-F", "%r %t %p"])
            .args(more);
        assert!(Command::new("mosquitto_sub").arg("--help").output().is_ok(), "mosquitto_sub {LACKS}");
        let reader = Running::start(&mut command);
        let taken = format!("Sending SUBACK to {name}");
        until("it is a reader", || {
            if self.so_far().lines().any(|line| line.ends_with(&taken)) { Ok(()) } else { Err(taken.clone()) }
        });
        reader
    }

    /// Publishes one message.
    pub(crate) fn tells(&self, topic: &str, payload: &str, more: &[&str]) {
        self.publishes(topic, &[&["-m", payload], more].concat());
    }

    /// Publishes with these options of mosquitto_pub.
    pub(crate) fn publishes(&self, topic: &str, what: &[&str]) {
        let port = self.port.to_string();
        let mut command = Command::new("mosquitto_pub");
        command.args(["-h", "127.0.0.1", "-p", &port, "-q", "1", "-t", topic]).args(what);
        let done = command.output().unwrap_or_else(|error| panic!("mosquitto_pub {LACKS} ({error})"));
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
}
