//! Tests of Modbus/TCP Security: a line to a virtual machine with a TLS proxy, and the faults if the ends do not trust
//! each other.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex};

use isotherm::clock::Clock;
use isotherm::fieldbus::dial;
use isotherm::fieldbus::error::{Fault, LinkFault};
use isotherm::fieldbus::explain::explain;
use isotherm::fieldbus::line::DeviceLine;
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::{Answer, Request};
use isotherm::tls::TlsFault;
use isotherm::virtual_machine::{Ports, Setup, VirtualMachine};
use isotherm_core::codec::{Register, Table};
use isotherm_profile::preview::Preview;
use isotherm_profile::{BusId, DeviceId, Errors, Profile, ProfileError};
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::version::{TLS12, TLS13};
use tokio_rustls::rustls::{RootCertStore, ServerConfig, SupportedProtocolVersion};

use crate::support::certificates;

use certificates::{Authority, Signed, signs_itself};

const NOW: (i32, i32) = (2020, 2099);
const READ: Request<'static> = Request::read_registers(Register { table: Table::Input, offset: 0 }, 2);
const PROFILE: &str = include_str!("../interop/machine.toml");

/// Returns the machine of the tests with foreign servers. Its line is secured by these files.
fn secured(address: &str, more: &str, ca: &str, ours: &Signed) -> Result<Profile, Errors> {
    let tls = format!("tls = {{ ca = \"ca.pem\", cert = \"gw.pem\", key = \"gw.key\"{more} }}");
    let text = PROFILE.replacen("address = \"127.0.0.1:1\"", &format!("address = \"{address}\"\n{tls}"), 1);
    // Longer than a busy computer needs for a handshake.
    let text = text.replace("timeout = \"300ms\"", "timeout = \"5s\"");
    let files =
        [("ca.pem", ca.as_bytes()), ("gw.pem", ours.cert.as_bytes()), ("gw.key", ours.key.as_bytes())];
    let profile = isotherm_profile::parse_with(Path::new("machine.toml"), &text, &files, &[], &[])?.profile;
    isotherm::fieldbus::tls::check(&profile)?;
    Ok(profile)
}

#[track_caller]
fn refused(address: &str, more: &str, ca: &str, ours: &Signed) -> Vec<ProfileError> {
    match secured(address, more, ca, ours) {
        Ok(_) => panic!("the profile was taken"),
        Err(Errors(errors)) => errors,
    }
}

/// Starts a virtual machine with a TLS proxy, as stunnel in practice. The proxy asks for a certificate.
async fn serve(
    ours: &Signed,
    trusts: &Authority,
    versions: &[&'static SupportedProtocolVersion],
) -> (SocketAddr, VirtualMachine) {
    serve_whoever(ours, Some(trusts), versions).await
}

/// Starts a virtual machine with a TLS proxy. Without `trusts`, the proxy does not ask for a certificate.
async fn serve_whoever(
    ours: &Signed,
    trusts: Option<&Authority>,
    versions: &[&'static SupportedProtocolVersion],
) -> (SocketAddr, VirtualMachine) {
    let plain = isotherm_profile::parse(Path::new("machine.toml"), PROFILE, &[], &[]).unwrap().profile;
    let setup = Setup { ports: Ports::Free, ..Setup::default() };
    let machine = VirtualMachine::start(&plain, setup, &Clock::wall()).await.unwrap();
    let behind = machine.address(BusId(0)).unwrap();
    let provider = Arc::new(default_provider());
    let chain = vec![CertificateDer::from_pem_slice(ours.cert.as_bytes()).unwrap()];
    let key = PrivateKeyDer::from_pem_slice(ours.key.as_bytes()).unwrap();
    let config =
        ServerConfig::builder_with_provider(provider.clone()).with_protocol_versions(versions).unwrap();
    let config = match trusts {
        None => config.with_no_client_auth(),
        Some(trusts) => {
            let mut roots = RootCertStore::empty();
            roots.add(CertificateDer::from_pem_slice(trusts.cert.as_bytes()).unwrap()).unwrap();
            let clients = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider).build();
            config.with_client_cert_verifier(clients.unwrap())
        }
    };
    let config = config.with_single_cert(chain, key).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        let acceptor = TlsAcceptor::from(Arc::new(config));
        while let Ok((stream, _)) = listener.accept().await {
            if let Ok(mut stream) = acceptor.accept(stream).await {
                let mut plain = TcpStream::connect(behind).await.unwrap();
                tokio::spawn(async move {
                    let _ = tokio::io::copy_bidirectional(&mut stream, &mut plain).await;
                });
            }
        }
    });
    (address, machine)
}

/// Sends a read to the first device on the line of this profile, and returns the answer.
async fn asked(profile: &Profile) -> Result<Answer, Fault> {
    let devices: Vec<_> =
        profile.devices.iter().enumerate().map(|(place, device)| (DeviceId(place), device)).collect();
    let mut line =
        DeviceLine::new(&profile.buses[0], &devices, dial(&profile.buses[0]).unwrap(), &Clock::wall());
    line.request(DeviceId(0), READ, SendDeadline::None).await.map(|answered| answered.answer)
}

fn tls(fault: TlsFault) -> Result<Answer, Fault> {
    Err(Fault::Link(LinkFault::Tls(fault)))
}

#[tokio::test]
async fn a_secured_line_reads_over_either_version_of_tls() {
    let authority = Authority::new();
    let (device, ours) = (authority.signs("127.0.0.1", NOW), authority.signs("gateway", NOW));
    for version in [&TLS12, &TLS13] {
        let (address, _machine) = serve(&device, &authority, &[version]).await;
        let profile = secured(&address.to_string(), "", &authority.cert, &ours).unwrap();
        let answer = asked(&profile).await;
        assert!(
            matches!(&answer, Ok(Answer::Registers(words)) if words.len() == 2),
            "{version:?}: {answer:?}"
        );
    }
}

#[tokio::test]
async fn a_device_that_cannot_show_who_it_is_is_not_asked() {
    let (authority, namesake, stranger) = (Authority::new(), Authority::new(), Authority::named("stranger"));
    let ours = authority.signs("gateway", NOW);
    let cases = [
        (authority.signs("127.0.0.1", (2001, 2002)), "", tls(TlsFault::Expired)),
        (authority.signs("127.0.0.1", (2098, 2099)), "", tls(TlsFault::NotYetValid)),
        (authority.signs("plc-7", NOW), "", tls(TlsFault::OtherName)),
        (authority.signs("127.0.0.1", NOW), ", name = \"plc-7\"", tls(TlsFault::OtherName)),
        (stranger.signs("127.0.0.1", NOW), "", tls(TlsFault::UnknownAuthority)),
        (namesake.signs("127.0.0.1", NOW), "", tls(TlsFault::UnknownAuthority)),
        (signs_itself("127.0.0.1", NOW), "", tls(TlsFault::BadCertificate)),
    ];
    for (place, (device, more, expected)) in cases.into_iter().enumerate() {
        let (address, _machine) = serve(&device, &authority, &[&TLS12, &TLS13]).await;
        let profile = secured(&address.to_string(), more, &authority.cert, &ours).unwrap();
        assert_eq!(asked(&profile).await, expected, "case {place}");
    }
}

#[tokio::test]
async fn a_device_is_known_by_the_name_that_the_profile_says_or_by_its_very_certificate() {
    let authority = Authority::new();
    let ours = authority.signs("gateway", NOW);
    let named = authority.signs("plc-7", NOW);
    let own = signs_itself("factory-default", NOW);
    let other = signs_itself("factory-default", NOW);
    let old = signs_itself("factory-default", (2001, 2002));
    let good = |answer: &Result<Answer, Fault>| answer.is_ok();
    let cases: [(&Signed, &str, &str, bool); 4] = [
        (&named, ", name = \"plc-7\"", &authority.cert, true),
        (&own, "", &own.cert, true),
        (&own, "", &other.cert, false),
        (&old, "", &old.cert, false),
    ];
    for (place, (device, more, ca, expected)) in cases.into_iter().enumerate() {
        let (address, _machine) = serve(device, &authority, &[&TLS13]).await;
        let profile = secured(&address.to_string(), more, ca, &ours).unwrap();
        let answer = asked(&profile).await;
        assert_eq!(good(&answer), expected, "case {place}: {answer:?}");
    }
}

#[tokio::test]
async fn a_device_that_does_not_take_our_certificate_is_reported_as_such() {
    let (authority, stranger) = (Authority::new(), Authority::new());
    let device = authority.signs("127.0.0.1", NOW);
    let cases = [
        (stranger.signs("gateway", NOW), TlsFault::OursRefused),
        (authority.signs("gateway", (2001, 2002)), TlsFault::OursExpired),
    ];
    for (ours, expected) in cases {
        for version in [&TLS12, &TLS13] {
            let (address, _machine) = serve(&device, &authority, &[version]).await;
            let profile = secured(&address.to_string(), "", &authority.cert, &ours).unwrap();
            assert_eq!(asked(&profile).await, tls(expected), "{version:?}");
        }
    }
}

#[tokio::test]
async fn a_plain_server_is_no_secured_one() {
    let authority = Authority::new();
    let ours = authority.signs("gateway", NOW);
    let plain = isotherm_profile::parse(Path::new("machine.toml"), PROFILE, &[], &[]).unwrap().profile;
    let setup = Setup { ports: Ports::Free, ..Setup::default() };
    let machine = VirtualMachine::start(&plain, setup, &Clock::wall()).await.unwrap();
    let address = machine.address(BusId(0)).unwrap().to_string();
    let profile = secured(&address, "", &authority.cert, &ours).unwrap();
    let fault = asked(&profile).await.unwrap_err();
    assert_eq!(fault, Fault::Link(LinkFault::Tls(TlsFault::Silent)));
    assert!(explain(fault).contains("does the device support TLS"), "{fault}");
}

#[test]
fn the_port_of_a_secured_line_is_802_where_none_is_written() {
    let authority = Authority::new();
    let ours = authority.signs("gateway", NOW);
    let profile = secured("plc.local", "", &authority.cert, &ours).unwrap();
    assert_eq!(profile.buses[0].address, "plc.local:802");
    let reported = Preview::of(&profile).to_string();
    for words in
        ["Modbus TCP inside TLS (Modbus/TCP Security) at plc.local:802", "for plc.local", "ca.pem", "gw.pem"]
    {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn files_of_no_use_are_reported_at_their_keys_all_at_once() {
    let authority = Authority::new();
    let (ours, others) = (authority.signs("gateway", NOW), authority.signs("gateway", NOW));
    let mixed = Signed { cert: ours.cert.clone(), key: others.key };
    let found = refused("plc:802", "", &authority.cert, &mixed);
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!((found[0].key.as_str(), found[0].line.is_some()), ("bus.cell.tls.key", true));
    assert!(found[0].message.contains("is not the key of the certificate"), "{}", found[0]);

    let swapped = Signed { cert: ours.key.clone(), key: ours.cert.clone() };
    let found = refused("plc:802", "", "nothing", &swapped);
    let keys: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(keys, ["bus.cell.tls.ca", "bus.cell.tls.cert", "bus.cell.tls.key"]);
    assert!(found.iter().all(|error| error.message.contains("in PEM form")), "{}", Errors(found.clone()));

    let locked = ours.key.replace("PRIVATE KEY", "ENCRYPTED PRIVATE KEY");
    let found = refused("plc:802", "", &authority.cert, &Signed { cert: ours.cert.clone(), key: locked });
    assert!(found[0].message.contains("the key is encrypted"), "{}", found[0]);

    let found = refused("plc:802", ", name = \"no name\"", &authority.cert, &ours);
    assert_eq!(found[0].key, "bus.cell.tls.name");

    let text = PROFILE.replacen(
        "address = \"127.0.0.1:1\"",
        "address = \"plc\"\ntls = { ca = \"ca.pem\", cert = \"gw.pem\", key = \"gw.key\" }",
        1,
    );
    let Err(Errors(found)) = isotherm_profile::parse_with(Path::new("machine.toml"), &text, &[], &[], &[])
    else {
        panic!("taken without its files");
    };
    assert_eq!(found.len(), 3, "{}", Errors(found.clone()));
    assert!(found.iter().all(|error| error.line.is_some()), "{}", Errors(found.clone()));
}

/// Log of this thread.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u8>>>);

impl std::io::Write for Log {
    fn write(&mut self, text: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(text)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[tokio::test]
async fn a_device_that_asks_for_no_certificate_is_warned_of_once() {
    let authority = Authority::new();
    let (device, ours) = (authority.signs("127.0.0.1", NOW), authority.signs("gateway", NOW));
    for (version, trusts, warnings) in
        [(&TLS12, None, 1), (&TLS13, None, 1), (&TLS12, Some(&authority), 0), (&TLS13, Some(&authority), 0)]
    {
        let (address, _machine) = serve_whoever(&device, trusts, &[version]).await;
        let profile = secured(&address.to_string(), "", &authority.cert, &ours).unwrap();
        let log = Log::default();
        let writer = log.clone();
        let subscriber = tracing_subscriber::fmt().with_writer(move || writer.clone()).finish();
        let guard = tracing::subscriber::set_default(subscriber);
        let mut device = profile.devices[0].clone();
        device.quirks.close_after_each = true;
        let (bus, devices) = (&profile.buses[0], [(DeviceId(0), &device)]);
        let mut line = DeviceLine::new(bus, &devices, dial(bus).unwrap(), &Clock::wall());
        for _ in 0..3 {
            line.request(DeviceId(0), READ, SendDeadline::None).await.unwrap();
        }
        drop(guard);
        let said = String::from_utf8(log.0.lock().unwrap().clone()).unwrap();
        assert_eq!(
            said.matches("127.0.0.1 requests no certificate").count(),
            warnings,
            "{version:?}: {said}"
        );
    }
}

#[test]
fn a_key_that_anybody_may_read_is_warned_of_at_its_place() {
    use std::os::unix::fs::PermissionsExt;
    let authority = Authority::new();
    let ours = authority.signs("gateway", NOW);
    let home = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| std::fs::write(home.path().join(name), text).unwrap();
    let tls = "address = \"plc:802\"\ntls = { ca = \"ca.pem\", cert = \"gw.pem\", key = \"gw.key\" }";
    file("machine.toml", &PROFILE.replacen("address = \"127.0.0.1:1\"", tls, 1));
    file("ca.pem", &authority.cert);
    file("gw.pem", &ours.cert);
    file("gw.key", &ours.key);
    for (mode, is_warned) in [(0o644, true), (0o602, true), (0o640, false), (0o600, false)] {
        let key = home.path().join("gw.key");
        std::fs::set_permissions(&key, std::fs::Permissions::from_mode(mode)).unwrap();
        let loaded = isotherm_profile::load(&home.path().join("machine.toml"), &[], &[]).unwrap();
        let warned = loaded.warnings.iter().find(|warning| warning.key == "bus.cell.tls.key");
        assert_eq!(warned.is_some(), is_warned, "{mode:o}: {:?}", loaded.warnings);
        if let Some(warning) = warned {
            assert!(warning.line.is_some() && warning.to_string().contains("`chmod o= "), "{warning}");
        }
    }
}
