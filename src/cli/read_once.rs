//! Reads every device once. For this, the gateway runs without writing until each signal was read or has failed.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;

use super::hints::{Hints, cause};
use crate::cli::print::say_beside;
use crate::clock::Clock;
use crate::discovery::new_connection::{self, NewConnectionAdvice};
use crate::fieldbus::line::LONGEST_GATEWAY_WAIT;
use crate::gateway::{Gateway, Options};
use crate::observe::events::LoggedText;
use crate::observe::status::{DeviceStatus, Status};
use isotherm_profile::{Bus, BusId, Device, DeviceId, Profile, Signal};
use isotherm_profile::{counted, duration_text};

/// Longest time to wait for a frame that a CAN device sends by itself.
const LONGEST_PERIOD: Duration = Duration::from_secs(10);
/// Time after which a message on stderr names the devices without a result.
const NAMED_AFTER: Duration = Duration::from_secs(1);
/// Maximum number of devices that are named individually; the others are only counted.
const MOST_NAMES: usize = 5;
/// Indentation of a hint below the line of its signal or device, in characters.
const UNDER: usize = 6;
/// Longest duration of the first request to a device, as a multiple of the timeout. On a serial line, the gateway first
/// waits for late answers to requests of an earlier program.
const FIRST_REQUEST: u32 = 10;

/// Reads every device once, and returns the status of the gateway. `directory` is the state directory of the machine's
/// gateway, which contains the known OPC UA namespaces.
pub(super) fn once(profile: Profile, directory: PathBuf) -> anyhow::Result<Status> {
    let mut last = None;
    watch(profile, directory, |status| {
        last = Some(status);
        false
    })?;
    last.context("the devices could not be read")
}

/// Reads every device continuously. Calls `look` for the first time when every signal, device and offset
/// register was tried, or when the time limit is over. Then calls `look` each second, until `look` returns
/// `false`.
pub(super) fn watch(
    profile: Profile,
    directory: PathBuf,
    mut look: impl FnMut(Status) -> bool,
) -> anyhow::Result<()> {
    let timeout = profile.buses.iter().map(|bus| bus.timeout).max().unwrap_or_default();
    let devices = u32::try_from(profile.devices.len()).unwrap_or(u32::MAX).max(1);
    let patience = timeout * 3 * devices + Duration::from_millis(500);
    // A silent unit behind a Modbus gateway delays the others.
    let mut known = (0..profile.devices.len()).map(DeviceId);
    let waits = known.any(|device| profile.is_behind_gateway(device));
    let patience = patience + if waits { LONGEST_GATEWAY_WAIT } else { Duration::ZERO };
    // The gateway cannot request these frames: it waits for the next one.
    let comes = |signal: &Signal| signal.address.is_in_frames();
    let ages = profile.signals.iter().filter(|signal| comes(signal));
    let patience = ages.map(|signal| signal.max_age.min(LONGEST_PERIOD)).fold(patience, Duration::max);
    // The first request to each device ends with an answer or with a fault.
    let requested: Vec<bool> = profile.signals.iter().map(|signal| !comes(signal)).collect();
    let buses = profile.buses.iter().enumerate().map(|(place, bus)| {
        let devices = profile.devices_on(BusId(place)).count();
        bus.timeout * FIRST_REQUEST * u32::try_from(devices).unwrap_or(u32::MAX)
    });
    let longest = patience + buses.max().unwrap_or_default();
    super::runtime::start()?.block_on(async {
        let clock = Clock::wall();
        // The verbs print the hints below their tables, each hint once.
        let options = Options {
            dry_run: true,
            remembered_in: Some(directory),
            logged_text: LoggedText::WithoutHint,
            ..Options::default()
        };
        let gateway = Gateway::new(profile, &clock, options);
        let source = gateway.source();
        let mut sleeper = clock.join();
        let looking = async {
            let begun = clock.now();
            let mut is_named = false;
            while clock.now() < begun.after(longest) {
                let status = source.status();
                if is_complete(&status)
                    || (clock.now() >= begun.after(patience) && is_tried(&status, &requested))
                {
                    break;
                }
                if !is_named && clock.now() >= begun.after(NAMED_AFTER) {
                    is_named = true;
                    let most = duration_text(Duration::from_secs(longest.as_secs() + 1));
                    say_beside!("waiting for {}, at most {most} in total", awaited(&status));
                }
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

/// Returns whether the read is complete. Each signal must have a value or a fault, and each device and offset register
/// must have been tried.
fn is_complete(status: &Status) -> bool {
    is_tried(status, &vec![true; status.signals.len()])
        && status.outputs.iter().all(|output| output.writes != "offset" || output.value.is_some())
}

/// Returns whether each requested signal has a value or a fault, and each device was tried. `requested`: for each
/// signal, whether the gateway requests it.
fn is_tried(status: &Status, requested: &[bool]) -> bool {
    let mut signals = status.signals.iter().zip(requested).filter(|(_, is_requested)| **is_requested);
    signals.all(|(signal, _)| signal.quality != "never-read")
        && status.devices.iter().all(|device| device.state != "never-answered" || device.requests == 0)
}

/// Returns the names of the devices without a result. Such a device was not tried yet, or has a signal or an offset
/// register that was not read.
fn awaited(status: &Status) -> String {
    let is_awaited = |device: &&DeviceStatus| {
        let mut signals = status.signals.iter().filter(|signal| signal.device == device.name);
        let mut outputs = status.outputs.iter().filter(|output| output.device == device.name);
        (device.state == "never-answered" && device.requests > 0)
            || signals.any(|signal| signal.quality == "never-read")
            || outputs.any(|output| output.writes == "offset" && output.value.is_none())
    };
    let awaited: Vec<String> = status
        .devices
        .iter()
        .filter(is_awaited)
        .map(|device| format!("device {} on bus {}", device.name, device.bus))
        .collect();
    match awaited.len().checked_sub(MOST_NAMES).filter(|more| *more > 0) {
        Some(more) => format!("{} and {}", awaited[..MOST_NAMES].join(", "), counted(more, "other device")),
        None => awaited.join(", "),
    }
}

/// Tests each Modbus bus on which no device answers on a new connection, see [`new_connection`]. Does nothing if all
/// devices have answered all reads of signals. Prints a line on stderr for each bus whose test takes long.
pub(super) fn examined(profile: &Profile, status: &Status) -> anyhow::Result<Vec<NewConnectionAdvice>> {
    // A device that loses the first request may have answered a later one. A device without signals is only written to.
    let is_missing = status.signals.iter().any(|signal| signal.quality == "timeout");
    let has_signals =
        |device: &DeviceStatus| status.signals.iter().any(|signal| signal.device == device.name);
    let is_silent =
        |device: &DeviceStatus| device.state != "ok" && device.requests > 0 && !has_signals(device);
    if !is_missing && !status.devices.iter().any(is_silent) {
        return Ok(Vec::new());
    }
    let begins = |bus: &Bus, device: &Device| {
        say_beside!(
            "no device on bus {} answers: testing whether device {} answers after a pause, or at the second request",
            bus.name,
            device.name
        );
    };
    Ok(super::runtime::start()?.block_on(new_connection::examined(profile, begins)))
}

/// Returns an error if a signal cannot be used. The error lists such signals by reason.
pub(super) fn assess(status: &Status) -> anyhow::Result<()> {
    let bad = status.signals.iter().filter(|signal| signal.quality != "good");
    let mut of_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    // The hints are below the signals.
    for signal in bad {
        let reason = cause(&signal.reason, signal.hint.as_deref());
        of_reason.entry(reason).or_default().push(&signal.name);
    }
    let (count, all) = (of_reason.values().map(Vec::len).sum::<usize>(), status.signals.len());
    let bad = of_reason.iter().map(|(reason, names)| format!("{} ({reason})", names.join(", ")));
    anyhow::ensure!(
        count == 0,
        "{count} of {} cannot be used: {}",
        counted(all, "signal"),
        bad.collect::<Vec<_>>().join("; ")
    );
    Ok(())
}

/// Formats the signals as text, one line each. A hint is below the first line that needs it.
pub(super) fn signals(status: &Status, hints: &mut Hints) -> String {
    let width = status.signals.iter().map(|signal| signal.name.len()).max().unwrap_or(0).max(6);
    let lines = status.signals.iter().map(|signal| {
        let value = signal.value.map_or("—".to_owned(), |value| format!("{value:.4}"));
        let hint = signal.hint.as_deref();
        let quality = if signal.quality == "good" { "good" } else { cause(&signal.reason, hint) };
        let line = format!("  {:<width$}  {value:>14} {:<6}  {quality}\n", signal.name, signal.unit);
        line + &hints.line(UNDER, hint)
    });
    lines.collect()
}

/// Formats the buses, devices and offset registers as text, one line each. A hint that was not printed yet is below its
/// device.
pub(super) fn fieldbus(status: &Status, hints: &mut Hints) -> String {
    let buses = status.buses.iter().map(|bus| {
        // `connected` is set at the end of a turn (one action of the line task), which may not have come yet.
        let answers = status.devices.iter().any(|device| device.bus == bus.name && device.state == "ok");
        let link = if bus.connected || answers { "connected" } else { "not connected" };
        format!("  bus {} ({}): {link}\n", bus.name, bus.address)
    });
    let devices = status.devices.iter().map(|device| {
        let state = match (device.state, device.requests) {
            ("never-answered", 0) => "no signal is read from it",
            (state, _) => state,
        };
        let hint = device.hint.as_deref();
        let fault = cause(&device.fault, hint);
        let fault = if fault.is_empty() { String::new() } else { format!(": {fault}") };
        format!("  device {}{}: {state}{fault}\n", device.name, device.at) + &hints.line(UNDER, hint)
    });
    let offsets = status.outputs.iter().filter(|output| output.writes == "offset").map(|output| {
        let value = output.value.map_or("not read".to_owned(), |value| format!("{value:.4} µm"));
        format!("  output {} at {}: holds {value}\n", output.name, output.register)
    });
    buses.chain(devices).chain(offsets).collect()
}
