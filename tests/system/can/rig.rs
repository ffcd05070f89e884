//! A gateway on its own CAN interface, in parallel to a test.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::kinds::can::{ReceivedFrame, Socket};
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::{GatewayApi, SignalStatus, Status};

/// Timeout of a test. A user-mode kernel on a busy computer is slow.
const PATIENCE: Duration = Duration::from_secs(60);

/// Waits for the next frame or error.
pub(crate) async fn receive(socket: &Socket) -> Result<ReceivedFrame, Fault> {
    loop {
        if let Some(heard) = socket.receive_now()? {
            return Ok(heard);
        }
        socket.ready().await;
    }
}

/// A virtual interface, until it is dropped.
pub(crate) struct Interface(String);

impl Interface {
    /// Creates an interface that is up.
    pub(crate) fn new(name: &str) -> Interface {
        // Only if the runner has prepared a place for it.
        crate::can::interface();
        let interface = Interface::absent(name);
        interface.appears();
        interface
    }

    /// Name of an interface that does not exist.
    pub(crate) fn absent(name: &str) -> Interface {
        crate::can::interface();
        let interface = Interface(name.to_owned());
        interface.vanishes();
        interface
    }

    pub(crate) fn name(&self) -> &str {
        &self.0
    }

    pub(crate) fn appears(&self) {
        shell(&format!("ip link add dev {} type vcan", self.0));
        self.up();
    }

    pub(crate) fn vanishes(&self) {
        let _ = Command::new("ip").args(["link", "del", "dev", &self.0]).output();
    }

    pub(crate) fn up(&self) {
        shell(&format!("ip link set dev {} up", self.0));
    }

    pub(crate) fn down(&self) {
        self.goes_down_after("true");
    }

    /// Runs a command, and takes the interface down directly after it.
    pub(crate) fn goes_down_after(&self, command: &str) {
        let command = command.replace("INTERFACE", &self.0);
        shell(&format!("{command}; ip link set dev {} down", self.0));
    }

    /// Sends a frame in the notation of cansend.
    pub(crate) fn send(&self, frame: &str) {
        shell(&format!("cansend {} {frame}", self.0));
    }
}

impl Drop for Interface {
    fn drop(&mut self) {
        self.vanishes();
    }
}

#[track_caller]
pub(crate) fn shell(command: &str) {
    let ended = Command::new("sh").args(["-c", command]).output().unwrap();
    assert!(ended.status.success(), "{command}: {}", String::from_utf8_lossy(&ended.stderr));
}

/// Loads the profile in this text, with its interface.
pub(crate) fn load(text: &str, interface: &Interface) -> isotherm_profile::Profile {
    let text = text.replace("INTERFACE", interface.name());
    let loaded = isotherm_profile::parse(Path::new("can.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Runs a gateway in parallel to a script, until the script ends.
pub(crate) fn beside(
    profile: isotherm_profile::Profile,
    dry_run: bool,
    script: impl FnOnce(&dyn GatewayApi) + Send + 'static,
) {
    with_source(profile, dry_run, move |source| script(source.as_ref()));
}

/// Runs a gateway in parallel to a script whose devices query the gateway too.
pub(crate) fn with_source(
    profile: isotherm_profile::Profile,
    dry_run: bool,
    script: impl FnOnce(Arc<dyn GatewayApi>) + Send + 'static,
) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), Options { dry_run, ..Options::default() });
        let source = gateway.source();
        let done = tokio::task::spawn_blocking(move || script(source));
        let (tell, reported) = tokio::sync::oneshot::channel();
        let stop = async move { drop(tell.send(done.await)) };
        gateway.run(stop, std::future::ready(())).await;
        if let Err(failed) = reported.await.unwrap() {
            std::panic::resume_unwind(failed.into_panic());
        }
    });
}

/// Checks the status every few milliseconds until the condition is true.
#[track_caller]
pub(crate) fn wait_until(source: &dyn GatewayApi, what: &str, found: impl Fn(&Status) -> bool) -> Status {
    let clock = Clock::wall();
    let begun = clock.now();
    loop {
        let status = source.status();
        if found(&status) {
            return status;
        }
        let late = clock.now().since(begun) >= PATIENCE;
        let bad: Vec<_> = status.signals.iter().map(|one| (&one.name, one.quality, one.value)).collect();
        assert!(!late, "{what}: {bad:?}\n{:#?}\n{:?}", events(&status), status.devices);
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Texts of the reported events, oldest first.
pub(crate) fn events(status: &Status) -> Vec<&str> {
    status.events.iter().map(|event| event.text.as_str()).collect()
}

/// Number of reported events of this kind.
pub(crate) fn count(status: &Status, kind: &str) -> u64 {
    status.event_counts.get(kind).copied().unwrap_or_default()
}

pub(crate) fn signal<'a>(status: &'a Status, name: &str) -> &'a SignalStatus {
    status.signals.iter().find(|signal| signal.name == name).unwrap()
}

/// Text of the reported event that contains this part.
#[track_caller]
pub(crate) fn reported<'a>(status: &'a Status, part: &str) -> &'a str {
    let events = events(status);
    let found = events.iter().find(|event| event.contains(part));
    found.unwrap_or_else(|| panic!("{part} was not told: {events:#?}"))
}
