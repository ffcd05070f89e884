//! The certificates of OPC UA lines: that one expires is told a month before, and when it has.

use std::sync::Arc;
use std::time::Duration;

use super::shared::Shared;
use crate::clock::Sleeper;
use crate::fieldbus::opcua::certificate::Certificate;
use crate::observe::events::{Event, Expiry, Whose};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, NamedFile, Profile, User};

/// So long before somebody can still do something about it.
const BEFORE: Duration = Duration::from_hours(30 * 24);
const LOOK_EVERY: Duration = Duration::from_hours(1);

/// Those of a profile that expire within a month of this moment, or have.
pub fn expiring(profile: &Profile, now: Moment) -> Vec<Expiry> {
    let lines = profile.buses.iter().flat_map(of_line);
    let soon = lines.filter(|expiry| expiry.until <= now.after(BEFORE));
    soon.map(|expiry| Expiry { is_over: expiry.until < now, ..expiry }).collect()
}

/// Whether there is one that may expire.
pub(super) fn has_some(profile: &Profile) -> bool {
    profile.buses.iter().any(|bus| !of_line(bus).is_empty())
}

/// Tells of each once when it is about to expire, and once when it has, by the time of day.
pub(super) async fn watch(shared: Arc<Shared>, mut sleeper: Sleeper) {
    let mut told: Vec<Expiry> = Vec::new();
    loop {
        let now = expiring(&shared.profile, shared.clock.time_of_day());
        now.iter()
            .filter(|expiry| !told.contains(expiry))
            .for_each(|expiry| shared.report(&Event::Certificate(expiry.clone())));
        told = now;
        sleeper.sleep(LOOK_EVERY).await;
    }
}

fn of_line(bus: &Bus) -> Vec<Expiry> {
    let Some(line) = &bus.opcua else { return Vec::new() };
    let read = |file: &NamedFile| Certificate::read(&file.bytes);
    let expiry = |file: &NamedFile, whose, until| {
        let (bus, file) = (bus.name.clone(), file.name.clone());
        Expiry { bus, file, whose, until, is_over: false }
    };
    let own = line.own.iter().map(|(cert, _)| (cert, Whose::Gateway));
    let user = match &line.user {
        User::Certified { cert, .. } => Some((cert, Whose::User)),
        User::Anonymous | User::Named { .. } => None,
    };
    let ours = own.chain(user).filter_map(|(file, whose)| Some(expiry(file, whose, read(file)?.to)));
    let trusted: Vec<(&NamedFile, Certificate)> =
        line.trusted.iter().filter_map(|file| Some((file, read(file)?))).collect();
    let is_replaced = |old: &Certificate| {
        let names = |cert: &Certificate| (cert.subject.clone(), cert.application.clone());
        trusted.iter().any(|(_, other)| names(other) == names(old) && other.to > old.to)
    };
    let servers = trusted.iter().filter(|(_, cert)| !is_replaced(cert));
    ours.chain(servers.map(|(file, cert)| expiry(file, Whose::Server, cert.to))).collect()
}
