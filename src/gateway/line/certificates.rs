//! Certificates of OPC UA lines. Their expiry is reported a month before it, and when they have expired.

use std::sync::Arc;
use std::time::Duration;

use crate::clock::Sleeper;
use crate::fieldbus::kinds::opcua::client::certificate::Certificate;
use crate::gateway::shared::shared_state::Shared;
use crate::observe::events::{CertificateOwner, Event, Expiry};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, NamedFile, Profile, User};

/// Time before the expiry at which the expiry is reported. The user can replace the certificate in this time.
const BEFORE: Duration = Duration::from_hours(30 * 24);
const LOOK_EVERY: Duration = Duration::from_hours(1);

/// Certificates of a profile that expire within 30 days of `now`, or have expired.
pub fn expiring(profile: &Profile, now: Moment) -> Vec<Expiry> {
    let lines = profile.buses.iter().flat_map(of_line);
    let soon = lines.filter(|expiry| expiry.until <= now.after(BEFORE));
    soon.map(|expiry| Expiry { is_over: expiry.until < now, ..expiry }).collect()
}

/// Returns whether the profile has a certificate that can expire.
pub(in crate::gateway) fn has_some(profile: &Profile) -> bool {
    profile.buses.iter().any(|bus| !of_line(bus).is_empty())
}

/// Reports each certificate once before its expiry and once after it, according to the clock of the computer.
pub(in crate::gateway) async fn watch(shared: Arc<Shared>, mut sleeper: Sleeper) {
    let mut reported: Vec<Expiry> = Vec::new();
    loop {
        let now = expiring(&shared.profile, shared.clock.time_of_day());
        now.iter()
            .filter(|expiry| !reported.contains(expiry))
            .for_each(|expiry| shared.report(&Event::Certificate(expiry.clone())));
        reported = now;
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
    let own = line.own.iter().map(|(cert, _)| (cert, CertificateOwner::Gateway));
    let user = match &line.user {
        User::Certified { cert, .. } => Some((cert, CertificateOwner::User)),
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
    ours.chain(servers.map(|(file, cert)| expiry(file, CertificateOwner::Server, cert.to))).collect()
}
