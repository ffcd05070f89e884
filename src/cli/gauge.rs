//! One look at every device, reading only: the gateway in a dry run, until each signal has been read or has failed.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use super::Failure;
use crate::clock::Clock;
use crate::gateway::{Gateway, Options};
use crate::observe::status::{Source, Status};
use isotherm_profile::Profile;

/// The longest that a frame is waited for which comes by itself.
const LONGEST_PERIOD: Duration = Duration::from_secs(10);

/// The signals of a status as a table.
pub(super) struct Gauge<'a>(pub(super) &'a Status);

/// The buses, devices and output registers of a status as a list.
pub(super) struct Fieldbus<'a>(pub(super) &'a Status);

/// Reads everything once.
pub(super) fn once(profile: Profile) -> Result<Status, Failure> {
    let mut last = None;
    watch(profile, |status| {
        last = Some(status);
        false
    })?;
    last.ok_or_else(|| anyhow::anyhow!("the devices could not be asked").into())
}

/// Reads everything, and goes on each second as long as `look` says so.
pub(super) fn watch(profile: Profile, mut look: impl FnMut(Status) -> bool) -> Result<(), Failure> {
    let patience = profile.buses.iter().map(|bus| bus.timeout * 3).max().unwrap_or_default();
    let devices = u32::try_from(profile.devices.len()).unwrap_or(u32::MAX);
    let patience = patience * devices.max(1) + Duration::from_millis(500);
    // What comes by itself comes when it comes.
    let comes = profile.signals.iter().filter(|signal| signal.address.is_in_frames());
    let patience = comes.map(|signal| signal.max_age.min(LONGEST_PERIOD)).fold(patience, Duration::max);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let clock = Clock::wall();
        let gateway = Gateway::new(profile, &clock, Options { dry_run: true, ..Options::default() });
        let source = gateway.source();
        let mut sleeper = clock.join();
        let looking = async {
            let deadline = clock.now().after(patience);
            while !is_complete(&source) && clock.now() < deadline {
                sleeper.sleep(Duration::from_millis(20)).await;
            }
            while look(source.status()) {
                sleeper.sleep(Duration::from_secs(1)).await;
            }
        };
        gateway.run(looking, std::future::ready(())).await;
    });
    Ok(())
}

/// Every signal has a value or a reason, and every output register has been tried.
fn is_complete(source: &Arc<dyn Source>) -> bool {
    let status = source.status();
    status.signals.iter().all(|signal| signal.quality != "never-read")
        && status.devices.iter().all(|device| device.state != "never-answered" || device.requests == 0)
        && status.outputs.iter().all(|output| output.writes != "offset" || output.value.is_some())
}

/// A device that cannot be read is a failure of the verb.
pub(super) fn judge(status: &Status) -> Result<(), Failure> {
    let bad: Vec<String> = status
        .signals
        .iter()
        .filter(|signal| signal.quality != "good")
        .map(|signal| format!("{} ({})", signal.name, signal.reason))
        .collect();
    if bad.is_empty() {
        return Ok(());
    }
    Err(anyhow::anyhow!(
        "{} of {} signals cannot be used: {}",
        bad.len(),
        status.signals.len(),
        bad.join(", ")
    )
    .into())
}

impl fmt::Display for Gauge<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.0.signals.iter().map(|signal| signal.name.len()).max().unwrap_or(0).max(6);
        for signal in &self.0.signals {
            let value = signal.value.map_or("—".to_owned(), |value| format!("{value:.4}"));
            let quality = if signal.quality == "good" { "good" } else { &signal.reason };
            writeln!(f, "  {:<width$}  {value:>14} {:<6}  {quality}", signal.name, signal.unit)?;
        }
        Ok(())
    }
}

impl fmt::Display for Fieldbus<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for bus in &self.0.buses {
            let link = if bus.connected { "connected" } else { "not connected" };
            writeln!(f, "  bus {} ({}): {link}", bus.name, bus.address)?;
        }
        for device in &self.0.devices {
            let state = match (device.state, device.requests) {
                ("never-answered", 0) => "nothing is read from it",
                (state, _) => state,
            };
            let fault = if device.fault.is_empty() { String::new() } else { format!(": {}", device.fault) };
            writeln!(f, "  device {}{}: {state}{fault}", device.name, device.at)?;
        }
        for output in self.0.outputs.iter().filter(|output| output.writes == "offset") {
            let value = output.value.map_or("not read".to_owned(), |value| format!("{value:.4} µm"));
            writeln!(f, "  output {} at {}: holds {value}", output.name, output.register)?;
        }
        Ok(())
    }
}
