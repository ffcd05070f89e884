//! Thirty-two units on one line.

use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::virtual_machine::{FaultScript, Ports, Setup, VirtualMachine};
use isotherm_profile::{Profile, parse};

use crate::support::frames::Frames;
use crate::support::tell;

const DEAD: [usize; 3] = [5, 17, 30];
const SPAN: Duration = Duration::from_secs(12);
/// Minimum number of polls in [`SPAN`] without dead units. A line with RTU has time for 740.
///
/// Both lines run at the same time. A busy computer slows both, and their ratio stays the same. With less than half of
/// the polls, the pauses of the dead units have too much weight, and the run is void. It is also void if live units
/// have lost answers, because they then back off as well.
const LEAST: usize = 370;
const TRIES: usize = 5;

/// Returns a profile of units with four temperatures each, polled as fast as the line allows.
fn profile(frames: Frames, units: &[usize]) -> Profile {
    // An ASCII frame has two characters for each byte.
    let (kind, baud) = match frames {
        Frames::Rtu => ("modbus-rtu", 19_200),
        Frames::Ascii => ("modbus-ascii", 57_600),
    };
    let mut text = format!(
        "[machine]\nname = \"shared-line\"\n[bus.rs485]\ntype = \"{kind}\"\nport = \"/dev/serial/by-id/usb-x\"\n\
         baud = {baud}\ntimeout = \"100ms\"\n",
    );
    for unit in units {
        text += &format!("[device.u{unit}]\nbus = \"rs485\"\nunit = {unit}\nevery = \"2s\"\n");
        for channel in 0..4 {
            text += &format!(
                "[signal.t{unit}_{channel}]\ndevice = \"u{unit}\"\nregister = \"input:{channel}\"\ntype = \"i16\"\n\
                 scale = 0.1\nunit = \"degC\"\n"
            );
        }
    }
    let loaded = parse(Path::new("line.toml"), &text, &[], &[]);
    let mut profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    for device in &mut profile.devices {
        device.every = Duration::from_millis(1);
    }
    profile
}

/// Returns the number of polls of each unit in [`SPAN`], and of its failures.
async fn polls(profile: Profile, faults: &str) -> Vec<(usize, u64)> {
    let clock = Clock::wall();
    let faults = FaultScript::parse(faults, &profile).unwrap();
    let setup = Setup { ports: Ports::Free, faults, journal: true, ..Setup::default() };
    let machine = VirtualMachine::start(&profile, setup, &clock).await.unwrap();
    let gateway = Gateway::new(machine.serving(profile.clone()), &clock, Options::default());
    let source = gateway.source();
    gateway.run(tokio::time::sleep(SPAN), std::future::pending()).await;
    let mut polls = vec![0; profile.devices.len()];
    machine.window().requests().iter().for_each(|seen| polls[seen.device.0] += 1);
    let failed = source.status().devices.into_iter().map(|device| device.failures.values().sum::<u64>());
    polls.into_iter().zip(failed).collect()
}

#[tokio::test]
async fn three_dead_of_thirty_two_units_leave_the_live_ones_four_fifths_of_what_the_line_allows_without_them()
{
    live_units_keep_their_polls(Frames::Rtu).await;
}

#[tokio::test]
async fn three_dead_units_with_modbus_ascii_leave_the_live_ones_four_fifths_of_what_the_line_allows() {
    live_units_keep_their_polls(Frames::Ascii).await;
}

/// Slower than other tests: dead units have pauses of seconds, and both runs must be much longer.
async fn live_units_keep_their_polls(frames: Frames) {
    let all: Vec<usize> = (1..=32).collect();
    let live: Vec<usize> = all.iter().copied().filter(|unit| !DEAD.contains(unit)).collect();
    let faults: String =
        DEAD.iter().map(|unit| format!("[[fault]]\ndevice = \"u{unit}\"\nkind = \"silent\"\n")).collect();
    let mut tries = 0;
    let (allowed, with) = loop {
        let (without, with) =
            tokio::join!(polls(profile(frames, &live), ""), polls(profile(frames, &all), &faults));
        let allowed: usize = without.iter().map(|(polls, _)| polls).sum();
        let of_live = live.iter().map(|unit| &with[unit - 1]);
        let lost: u64 = without.iter().chain(of_live).map(|(_, failed)| failed).sum();
        if allowed >= LEAST && lost == 0 {
            break (allowed, with.into_iter().map(|(polls, _)| polls).collect::<Vec<_>>());
        }
        tries += 1;
        println!("void: {allowed} polls of at least {LEAST}, {lost} lost: the computer was too busy");
        if tries == TRIES {
            return tell(&format!("32 units on a line: {TRIES} runs are void, the computer was too busy"));
        }
    };
    let of_live = |unit: usize| with[unit - 1];
    let least = live.iter().map(|unit| of_live(*unit)).min().unwrap();
    let kept: usize = live.iter().map(|unit| of_live(*unit)).sum();
    #[expect(clippy::cast_precision_loss, reason = "a few thousand")]
    let share = kept as f64 / allowed as f64;
    let asked: Vec<usize> = DEAD.iter().map(|unit| with[unit - 1]).collect();
    println!(
        "live units: {kept} polls beside dead ones, {allowed} without: {:.1} %; {asked:?} timeouts",
        100.0 * share
    );
    assert!(share >= 0.8, "{share}");
    assert!(least * live.len() * 10 >= 8 * allowed, "the unit that was asked least: {least}");
    assert!(asked.iter().all(|asked| (1..=5).contains(asked)), "{asked:?}");
}
