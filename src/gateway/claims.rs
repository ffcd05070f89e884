//! Claims: each gateway of this computer publishes a claim, the list of registers that it writes to. A second gateway
//! that would write to one of these registers does not start.
//!
//! A gateway that writes listens on an abstract socket of its network namespace, and sends its claim to each
//! client (module `sockets`). An abstract socket needs no directory and no permission. Every user can see the
//! socket, and the kernel removes the socket when its process ends. A bus address means the same device to
//! all programs of one network namespace, so a claim need not be visible outside this namespace.
//!
//! A gateway that starts opens its own socket first, and then compares its claim with the others. If two gateways start
//! at the same moment, the one with the lower random number continues.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::clock::BootClock;
use crate::gateway::api::control::{self, Presence};
use crate::gateway::line_names;
use isotherm_profile::Profile;
use sockets::{Answer, Listener};

mod sockets;

/// Maximum wait for another gateway that starts at the same moment and must end.
const PATIENCE: Duration = Duration::from_secs(5);
const LOOK_AGAIN: Duration = Duration::from_millis(20);

/// Claim of one gateway: the registers to which it writes. The claim is sent to other gateways.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Claim {
    process: u32,
    /// Random number: if two gateways start at the same moment, the lower one continues.
    order: u32,
    machine: String,
    /// State directory of the gateway that publishes the claim.
    state: PathBuf,
    /// Whether the claim is valid: the gateway has compared its claim with the claims of the other gateways, and may
    /// write.
    is_held: bool,
    lines: Vec<Line>,
}

/// Claimed registers on one bus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Line {
    /// Address of the bus, as in the profile.
    address: String,
    /// Canonical names of the bus address. Two addresses with a common name lead to the same bus.
    names: Vec<String>,
    places: BTreeSet<String>,
}

impl Claim {
    fn of(profile: &Profile, directory: &Path) -> Claim {
        let written = profile.buses.iter().zip(profile.written_places());
        let written: Vec<_> = written.filter(|(_, places)| !places.is_empty()).collect();
        let buses: Vec<_> = written.iter().map(|(bus, _)| *bus).collect();
        let lines = line_names::of_each(&buses).into_iter().zip(written);
        let lines = lines.map(|(names, (bus, places))| Line { address: bus.address.clone(), names, places });
        Claim {
            process: std::process::id(),
            order: random(),
            machine: profile.name.clone(),
            state: directory.to_owned(),
            is_held: false,
            lines: lines.collect(),
        }
    }

    /// Returns the canonical names of all bus addresses of the claim.
    fn names(&self) -> BTreeSet<&str> {
        self.lines.iter().flat_map(|line| &line.names).map(String::as_str).collect()
    }

    /// Returns a register to which both gateways write, as text for a message. `None` if they have no common
    /// register.
    fn shares_with(&self, other: &Claim) -> Option<String> {
        let mut named: BTreeMap<&str, Vec<&Line>> = BTreeMap::new();
        for line in &other.lines {
            line.names.iter().for_each(|name| named.entry(name).or_default().push(line));
        }
        self.lines.iter().find_map(|own| {
            let mut same = own.names.iter().filter_map(|name| named.get(name.as_str())).flatten();
            let shared = |line: &&Line| own.places.intersection(&line.places).next().cloned();
            let place = same.find_map(shared)?;
            Some(format!("{place} at {}", own.address))
        })
    }
}

/// Claims every register to which a gateway with this profile writes, until the process ends. Returns a sentence with
/// the reason if another gateway could not be checked.
///
/// # Errors
/// Another gateway of this computer writes to one of the registers. The error is a message for the operator.
pub fn claim(profile: &Profile, directory: &Path) -> Result<Option<String>, String> {
    let claim = Claim::of(profile, directory);
    if claim.lines.is_empty() {
        return Ok(None);
    }
    let listener = match Listener::open(claim.clone()) {
        Ok(listener) => listener,
        Err(error) => return Ok(Some(format!("no socket can be opened for this check: {error}"))),
    };
    let unseen = compare_with_others(&claim, |_| false)?;
    listener.hold();
    Ok(unseen)
}

/// Checks that a gateway with this profile can replace the gateway that runs in the parent of this process.
///
/// # Errors
/// Those of [`claim`].
pub fn could_claim(profile: &Profile, directory: &Path) -> Result<(), String> {
    let claim = Claim { order: u32::MAX, ..Claim::of(profile, directory) };
    let parent = std::os::unix::process::parent_id();
    compare_with_others(&claim, |other| other.process == parent && other.state == directory).map(drop)
}

/// Compares the claim `own` of this gateway with the claims of all other gateways, except those for which
/// `is_ignored` is true. If another gateway starts at the same moment, the gateway with the lower random
/// number waits until the other gateway has ended. Returns a sentence with the reason if a gateway could not
/// be checked. An error means that another gateway writes to a common register, or does not send its claim.
/// The error is a message for the operator.
fn compare_with_others(own: &Claim, is_ignored: impl Fn(&Claim) -> bool) -> Result<Option<String>, String> {
    let begun = BootClock::default().passed();
    loop {
        let mut unseen = None;
        let mut waits_for = None;
        let others = match sockets::others(own) {
            Ok(others) => others,
            Err(error) => return Ok(Some(format!("/proc/net/unix cannot be read: {error}"))),
        };
        for other in others {
            let rival = match other.ask() {
                Answer::Gone => continue,
                Answer::Claim(rival) => rival,
                Answer::Silent if other.shares_line => return Err(silent(own, other.process)),
                // The gateway is asked again, until it has ended.
                Answer::Cut if other.shares_line => {
                    waits_for = Some(silent(own, other.process));
                    continue;
                }
                Answer::Cut => continue,
                Answer::Silent => {
                    unseen = Some(format!("process {} does not answer", other.process));
                    continue;
                }
                Answer::Failed(error) => {
                    unseen = Some(format!(
                        "the gateway of process {} did not report its registers: {error}",
                        other.process
                    ));
                    continue;
                }
            };
            if is_ignored(&rival) || is_same_gateway(own, &rival) {
                continue;
            }
            let Some(place) = own.shares_with(&rival) else { continue };
            if rival.is_held || rival.order < own.order {
                return Err(refusal(&place, &rival));
            }
            waits_for = Some(refusal(&place, &rival));
        }
        match waits_for {
            None => return Ok(unseen),
            Some(why) if BootClock::default().passed() - begun > PATIENCE => return Err(why),
            Some(_) => std::thread::sleep(LOOK_AGAIN),
        }
    }
}

/// Returns whether both claims have the same machine name and state directory, and the gateway of `other` answers on
/// its command socket. Such claims are not compared, because the second gateway fails when it opens its command
/// socket.
fn is_same_gateway(own: &Claim, other: &Claim) -> bool {
    let socket = control::path(&own.state, &own.machine);
    socket == control::path(&other.state, &other.machine) && control::presence(&socket) != Presence::Absent
}

/// Returns a random number. If two gateways start at the same moment, the one with the lower number continues.
fn random() -> u32 {
    let [a, b, c, d, ..] = RandomState::new().hash_one(0).to_be_bytes();
    u32::from_be_bytes([a, b, c, d])
}

fn refusal(place: &str, other: &Claim) -> String {
    let Claim { process, machine, state, .. } = other;
    format!(
        "{place} is written by another gateway of this computer: process {process}, machine {machine}, state \
         directory {}. Stop that gateway, or give each gateway its own register (--dry-run writes nothing)",
        state.display()
    )
}

fn silent(own: &Claim, process: u32) -> String {
    let addresses: Vec<&str> = own.lines.iter().map(|line| line.address.as_str()).take(5).collect();
    format!(
        "another gateway of this computer, process {process}, writes to a device at {}, and does not say to \
         which registers. Stop that gateway, or resume it if it is suspended (--dry-run writes nothing)",
        addresses.join(" or ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(lines: &[(&[&str], &[&str])]) -> Claim {
        let line = |(names, places): &(&[&str], &[&str])| Line {
            address: names[0].to_owned(),
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            places: places.iter().map(|place| (*place).to_owned()).collect(),
        };
        let lines = lines.iter().map(line).collect();
        let (machine, state) = ("mill".to_owned(), PathBuf::from("/var/lib/isotherm"));
        Claim { process: 7, order: 1, machine, state, is_held: true, lines }
    }

    #[test]
    fn only_the_same_place_at_the_same_address_is_shared() {
        let own = claim(&[(&["a", "b"], &["unit 1 holding:104", "unit 1 holding:105"])]);
        let shared = |names: &[&str], places: &[&str]| own.shares_with(&claim(&[(names, places)]));
        let place = Some("unit 1 holding:105 at a".to_owned());
        assert_eq!(shared(&["b"], &["unit 1 holding:105", "unit 1 holding:106"]), place);
        assert_eq!(shared(&["c"], &["unit 1 holding:105"]), None);
        assert_eq!(shared(&["b"], &["unit 2 holding:105", "unit 1 holding:106"]), None);
    }
}
