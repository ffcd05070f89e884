//! `isotherm opcua certificate`: the gateway's own certificate.

use std::path::Path;
use std::time::Duration;

use anyhow::Context;

use super::{LineArguments, OwnFiles};
use crate::cli::backup::write_new;
use crate::cli::port::hostname;
use crate::cli::print::print_json;
use crate::cli::print::{say, say_all};
use crate::cli::service_user;
use crate::clock::Clock;
use crate::discovery::opcua::{Certificate, NewCertificate, make};
use crate::fieldbus::explain;

const YEAR: Duration = Duration::from_hours(365 * 24);
const OF_A_KEY: u32 = 0o600;
const OF_A_CERTIFICATE: u32 = 0o644;

/// Shows the gateway's own certificate of an OPC UA line or of its OPC UA server: its subject, its thumbprint, and its validity.
///
/// If certificate and key are both missing, the verb creates them in the files that the profile names. The certificate
/// is self-signed, has an RSA key of 2048 bits, and contains the URI of the application. Existing files are never
/// overwritten.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm opcua certificate my-machine.toml\n  isotherm opcua certificate my-machine.toml --bus nck --years 5\n  isotherm opcua certificate my-machine.toml --server"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    line: LineArguments,
    /// Uses the certificate of the OPC UA server, which [opcua_server] names
    #[arg(long, conflicts_with = "bus")]
    server: bool,
    /// Validity of a new certificate in years
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=30))]
    years: u32,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let own = if arguments.server { arguments.line.own_of_server() } else { arguments.line.own_of_line() }?;
    let (cert, key) = (own.beside.join(&own.cert.name), own.beside.join(&own.key.name));
    let (shown_cert, shown_key) = (cert.display(), key.display());
    if cert == key && !cert.exists() {
        anyhow::bail!(
            "`cert` and `key` of {} both name {shown_cert}: write another file for `key`",
            own.owner
        );
    }
    let made = match (cert.exists(), key.exists()) {
        (true, true) => None,
        (false, false) => Some(made(&own, &cert, &key, arguments.years)?),
        (true, false) => anyhow::bail!(
            "{shown_cert} exists, but its key {shown_key} is missing. Copy the key to this path, or move the \
             certificate away so that both are created"
        ),
        (false, true) => anyhow::bail!(
            "the key {shown_key} exists, but its certificate {shown_cert} is missing. Copy the certificate to this \
             path, or move the key away so that both are created"
        ),
    };
    let (is_new, bytes) = (made.is_some(), made.unwrap_or(own.cert.bytes));
    let certificate = Certificate::read(&bytes)
        .with_context(|| format!("{shown_cert} is not a certificate in DER or PEM form"))?;
    if arguments.line.json {
        return print_json(&serde_json::json!({
            "bus": own.bus, "made": is_new, "cert": cert, "key": key, "certificate": certificate,
        }));
    }
    match is_new {
        true => say!("created for {}: certificate {shown_cert}, and its key {shown_key}", own.owner)?,
        false => say!("{} uses {shown_cert}", own.owner)?,
    }
    say_all!("{}", certificate.text(Clock::wall().time_of_day()))?;
    say!("{}: add {shown_cert} to its trusted certificates, as its manual describes", own.next)?;
    Ok(())
}

/// Creates certificate and key, and returns the bytes of the certificate.
fn made(own: &OwnFiles, cert: &Path, key: &Path, years: u32) -> anyhow::Result<Vec<u8>> {
    let host: String =
        hostname().chars().filter(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '.')).collect();
    let (subject, application) =
        (format!("isotherm {}", own.machine), format!("urn:{host}:isotherm:{}", own.machine));
    let now = Clock::wall().time_of_day();
    let NewCertificate { cert: bytes, key: secret } =
        make(&subject, &application, &host, now, YEAR * years).map_err(anyhow::Error::msg)?;
    put(key, secret.as_bytes(), OF_A_KEY)?;
    put(cert, &bytes, OF_A_CERTIFICATE).inspect_err(|_| {
        // A key without its certificate would keep the next attempt from making both.
        let _ = std::fs::remove_file(key);
    })?;
    service_user::give(key)?;
    Ok(bytes)
}

/// Writes a new file with this file mode, and creates its directory if needed.
pub(super) fn put(path: &Path, bytes: &[u8], mode: u32) -> anyhow::Result<()> {
    let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty());
    let done =
        directory.map_or(Ok(()), std::fs::create_dir_all).and_then(|()| write_new(path, bytes, mode, None));
    done.map_err(|error| anyhow::anyhow!("{} cannot be written: {}", path.display(), explain::system(&error)))
}
