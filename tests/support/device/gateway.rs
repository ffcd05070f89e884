//! Gateway in this process, in parallel with a script that observes it.

#![allow(dead_code, reason = "each of the tests uses its part")]

use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::{GatewayApi, Status};

/// Runs the gateway in parallel with `script`, which uses its state. The end of the script stops it. Returns its last
/// status.
pub(crate) fn beside(
    text: &str,
    options: Options,
    script: impl FnOnce(&dyn GatewayApi) + Send + 'static,
) -> Status {
    let loaded = isotherm_profile::parse(Path::new("machine.toml"), text, &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), options);
        let source = gateway.source();
        let seen = source.clone();
        let done = tokio::task::spawn_blocking(move || script(seen.as_ref()));
        let (sender, receiver) = tokio::sync::oneshot::channel();
        let stop = async move { drop(sender.send(done.await)) };
        gateway.run(stop, std::future::pending()).await;
        receiver.await.unwrap().unwrap();
        source.status()
    })
}

/// Checks the status repeatedly until the condition is true.
#[track_caller]
pub(crate) fn wait_until(source: &dyn GatewayApi, what: &str, found: impl Fn(&Status) -> bool) {
    let clock = Clock::wall();
    let begun = clock.now();
    loop {
        let status = source.status();
        if found(&status) {
            return;
        }
        let waited = clock.now().since(begun);
        assert!(waited < Duration::from_secs(120), "{what}: {:?} {:#?}", status.axes, events(&status));
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Texts of the events.
pub(crate) fn events(status: &Status) -> Vec<&str> {
    status.events.iter().map(|event| event.text.as_str()).collect()
}

/// Number of events of this kind.
pub(crate) fn reported(status: &Status, kind: &str) -> u64 {
    status.event_counts.get(kind).copied().unwrap_or_default()
}
