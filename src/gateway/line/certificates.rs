//! Certificates of OPC UA lines. Their expiry is reported a month before it, and when they have expired. `check` also
//! reports weak certificates.

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

/// Returns a sentence for each certificate of a profile with a short key or a broken digest. The gateway uses these
/// certificates.
pub fn weak(profile: &Profile) -> Vec<String> {
    let of_bus = |bus: &Bus| {
        let weak = in_use(bus).into_iter().filter_map(|Used { file, whose, certificate }| {
            let weakness = certificate.weakness()?;
            let (owner, remedy) = match whose {
                CertificateOwner::Gateway => (
                    "gateway",
                    "Move it and its key away, and make both again (`isotherm opcua certificate PROFILE`)",
                ),
                CertificateOwner::User => ("user", "Make a new one with 2048 bits and SHA-256"),
                CertificateOwner::Server => (
                    "server",
                    "If the server can make one with 2048 bits and SHA-256, renew it there, then run `isotherm \
                     opcua trust PROFILE`",
                ),
            };
            let (bus, file) = (&bus.name, &file.name);
            Some(format!(
                "bus {bus}: the {owner}'s certificate {file} is weak: {weakness}. The gateway uses it. {remedy}"
            ))
        });
        weak.collect::<Vec<_>>()
    };
    profile.buses.iter().flat_map(of_bus).collect()
}

/// Returns whether the profile has a certificate that can expire.
pub(in crate::gateway) fn has_some(profile: &Profile) -> bool {
    profile.buses.iter().any(|bus| !in_use(bus).is_empty())
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

/// Certificate that a line uses.
struct Used<'b> {
    file: &'b NamedFile,
    whose: CertificateOwner,
    certificate: Certificate,
}

fn of_line(bus: &Bus) -> Vec<Expiry> {
    let expiry = |Used { file, whose, certificate }: Used<'_>| {
        let (bus, file) = (bus.name.clone(), file.name.clone());
        Expiry { bus, file, whose, until: certificate.to, is_over: false }
    };
    in_use(bus).into_iter().map(expiry).collect()
}

/// Returns the certificates that a line uses. A trusted certificate is left out if a newer one of the same name
/// replaces it.
fn in_use(bus: &Bus) -> Vec<Used<'_>> {
    let Some(line) = &bus.opcua else { return Vec::new() };
    let read = |file: &NamedFile| Certificate::read(&file.bytes);
    let own = line.own.iter().map(|(cert, _)| (cert, CertificateOwner::Gateway));
    let user = match &line.user {
        User::Certified { cert, .. } => Some((cert, CertificateOwner::User)),
        User::Anonymous | User::Named { .. } => None,
    };
    let ours =
        own.chain(user).filter_map(|(file, whose)| Some(Used { file, whose, certificate: read(file)? }));
    let trusted: Vec<(&NamedFile, Certificate)> =
        line.trusted.iter().filter_map(|file| Some((file, read(file)?))).collect();
    let is_replaced = |old: &Certificate| {
        let names = |cert: &Certificate| (cert.subject.clone(), cert.application.clone());
        trusted.iter().any(|(_, other)| names(other) == names(old) && other.to > old.to)
    };
    let servers = trusted.iter().filter(|(_, cert)| !is_replaced(cert)).map(|(file, cert)| Used {
        file: *file,
        whose: CertificateOwner::Server,
        certificate: cert.clone(),
    });
    ours.chain(servers).collect()
}
