//! Certificates of OPC UA lines and of the OPC UA server. The gateway reports a certificate that expires within a
//! month, has expired, or is not valid yet. `check` also reports weak certificates.

use std::sync::Arc;
use std::time::Duration;

use crate::clock::Sleeper;
use crate::fieldbus::kinds::opcua::client::certificate::Certificate;
use crate::gateway::shared::shared_state::Shared;
use crate::observe::events::{CertificateOwner, EarlyCertificate, Event, Expiry};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, NamedFile, OpcUaServer, Profile, ServerLogin, User};

/// Time between the report of a coming expiry and the expiry. The user can replace the certificate in this time.
const BEFORE: Duration = Duration::from_hours(30 * 24);
const LOOK_EVERY: Duration = Duration::from_hours(1);
/// Name of the gateway's OPC UA server in messages about certificates. It replaces the name of a bus.
const SERVER: &str = "opcua_server";

/// Returns the certificates of a profile that expire within 30 days of `now`, or have expired.
pub fn expiring(profile: &Profile, now: Moment) -> Vec<Expiry> {
    let all = used(profile).into_iter().map(|(bus, Used { file, whose, certificate })| {
        let (bus, file) = (bus.to_owned(), file.name.clone());
        Expiry { bus, file, whose, until: certificate.to, is_over: false }
    });
    let soon = all.filter(|expiry| expiry.until <= now.after(BEFORE));
    soon.map(|expiry| Expiry { is_over: expiry.until < now, ..expiry }).collect()
}

/// Returns the certificates of a profile that are not valid yet at `now`.
pub fn early(profile: &Profile, now: Moment) -> Vec<EarlyCertificate> {
    let early = used(profile).into_iter().filter(|(_, used)| used.certificate.from > now);
    let early = early.map(|(bus, Used { file, whose, certificate })| EarlyCertificate {
        bus: bus.to_owned(),
        file: file.name.clone(),
        whose,
        from: certificate.from,
    });
    early.collect()
}

/// Returns a sentence for each certificate of a profile with a short key or a broken digest. The gateway uses such
/// certificates nevertheless. Only its OPC UA server refuses a client with a short key, because the security policies
/// of OPC UA forbid this.
pub fn weak(profile: &Profile) -> Vec<String> {
    let clients = profile.opcua_server.iter().flat_map(|server| &server.trusted);
    let clients: Vec<&str> = clients.map(|file| file.name.as_str()).collect();
    let weak = used(profile).into_iter().filter_map(|(bus, Used { file, whose, certificate })| {
        let weakness = certificate.weakness()?;
        let (owner, remedy) = match whose {
            CertificateOwner::Gateway => (
                "gateway",
                "Move the certificate and its key away, and create both again (`isotherm opcua certificate PROFILE`)",
            ),
            CertificateOwner::User => ("user", "Create a new certificate with 2048 bits and SHA-256"),
            CertificateOwner::Server => (
                "server",
                "If the server supports 2048 bits and SHA-256, renew its certificate there, then run `isotherm \
                 opcua trust PROFILE`",
            ),
            CertificateOwner::OwnServer => (
                "OPC UA server",
                "Move the certificate and its key away, and create both again (`isotherm opcua certificate \
                 PROFILE --server`)",
            ),
            CertificateOwner::Client => (
                "client",
                "If the client supports 2048 bits and SHA-256, renew its certificate there, and replace this file",
            ),
        };
        let about = if bus == SERVER { format!("[{bus}]") } else { format!("bus {bus}") };
        let is_refused =
            bus == SERVER && certificate.has_short_key() && clients.contains(&file.name.as_str());
        let (effect, remedy) = match is_refused {
            true => ("The server refuses this client", "Replace this file by a certificate with 2048 bits and SHA-256"),
            false => ("The gateway uses it", remedy),
        };
        let file = &file.name;
        Some(format!("{about}: the {owner}'s certificate {file} is weak: {weakness}. {effect}. {remedy}"))
    });
    weak.collect()
}

/// Returns whether the profile uses a certificate whose validity must be watched.
pub(in crate::gateway) fn has_some(profile: &Profile) -> bool {
    !used(profile).is_empty()
}

/// Reports each certificate that is not valid yet, that will soon expire, or that has expired, according to the
/// computer's clock. Each of these states is reported once.
pub(in crate::gateway) async fn watch(shared: Arc<Shared>, mut sleeper: Sleeper) {
    let mut reported: Vec<Expiry> = Vec::new();
    let mut reported_early: Vec<EarlyCertificate> = Vec::new();
    loop {
        let time = shared.clock.time_of_day();
        let now = expiring(&shared.profile, time);
        now.iter()
            .filter(|expiry| !reported.contains(expiry))
            .for_each(|expiry| shared.report(&Event::Certificate(expiry.clone())));
        reported = now;
        let now = early(&shared.profile, time);
        now.iter()
            .filter(|early| !reported_early.contains(early))
            .for_each(|early| shared.report(&Event::CertificateNotYetValid(early.clone())));
        reported_early = now;
        sleeper.sleep(LOOK_EVERY).await;
    }
}

/// Certificate that a bus line or the OPC UA server uses.
struct Used<'b> {
    file: &'b NamedFile,
    whose: CertificateOwner,
    certificate: Certificate,
}

/// Returns the certificates that a profile uses, each with the name of its bus.
fn used(profile: &Profile) -> Vec<(&str, Used<'_>)> {
    let lines = profile.buses.iter();
    let lines = lines.flat_map(|bus| in_use(bus).into_iter().map(move |used| (bus.name.as_str(), used)));
    let server = profile.opcua_server.iter().flat_map(of_server);
    lines.chain(server.map(|used| (SERVER, used))).collect()
}

/// Returns the certificates that the OPC UA server uses: its own certificate, and those of its clients and users.
fn of_server(server: &OpcUaServer) -> Vec<Used<'_>> {
    let own = server.own.iter().map(|(cert, _)| (cert, CertificateOwner::OwnServer));
    let users = server.users.iter().filter_map(|user| match &user.login {
        ServerLogin::Certificate(cert) => Some(cert),
        ServerLogin::Password(_) => None,
    });
    let clients = server.trusted.iter().chain(users).map(|cert| (cert, CertificateOwner::Client));
    let all = own.chain(clients);
    all.filter_map(|(file, whose)| Some(Used { file, whose, certificate: Certificate::read(&file.bytes)? }))
        .collect()
}

/// Returns the certificates that a bus line uses. A trusted certificate is left out if a newer certificate with the
/// same name exists.
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
        file,
        whose: CertificateOwner::Server,
        certificate: cert.clone(),
    });
    ours.chain(servers).collect()
}
