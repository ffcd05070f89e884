//! `isotherm opcua trust`: adds the server's certificate to the trusted certificates.

use std::path::PathBuf;

use super::own::put;
use super::{LineArguments, SecuredLine};
use crate::cli::print::print_json;
use crate::cli::print::{say, say_all, say_beside};
use crate::cli::runtime;
use crate::cli::values::typed;
use crate::clock::Clock;
use crate::discovery::opcua::{Certificate, Offer, offers};

const OF_A_CERTIFICATE: u32 = 0o644;
/// Answer of the user that confirms the thumbprint.
const YES: &str = "yes";

/// Requests the certificate of an OPC UA server and shows it. You compare its thumbprint with the one that the server
/// itself displays. After you confirm, the verb adds the certificate to the trusted ones. The comparison is needed
/// because another computer could answer instead of the server.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm opcua trust my-machine.toml\n  isotherm opcua trust my-machine.toml --thumbprint \
                  5F:3A:0C:96:1D:27:EB:44:80:B2:6E:19:55:F0:7C:A3:38:D1:02:9E"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    line: LineArguments,
    /// The thumbprint that the server itself displays, SHA-1 or SHA-256. The verb then asks no question, and accepts no
    /// other certificate
    #[arg(long, value_name = "HEX")]
    thumbprint: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let line = arguments.line.find()?;
    let asked = offers(&line.bus.address, line.bus.timeout);
    let offers = runtime::start()?.block_on(asked).map_err(anyhow::Error::msg)?;
    let certificate = of_the_server(&line, &offers)?;
    if !arguments.line.json {
        say!("The server at {} shows", line.bus.address)?;
        say_all!("{}", certificate.text(Clock::wall().time_of_day()))?;
    }
    let file = match trusted_already(&line, certificate) {
        Some(file) => (file, false),
        None => {
            agreed(arguments.thumbprint.as_deref(), certificate)?;
            let file = line.trusted.join(file_name(&line, certificate));
            put(&file, &certificate.der, OF_A_CERTIFICATE)?;
            (file, true)
        }
    };
    let (file, is_new) = file;
    if arguments.line.json {
        return print_json(&serde_json::json!({
            "bus": line.bus.name, "trusted": is_new, "file": file, "certificate": certificate,
        }));
    }
    match is_new {
        true => say!(
            "trusted: {}. A running gateway uses this file after `isotherm restart PROFILE --keep`",
            file.display()
        )?,
        false => say!("trusted already: {}", file.display())?,
    }
    Ok(())
}

/// Returns the certificate of the endpoint with the security of the profile. If the server does not offer that
/// endpoint, returns the certificate of another endpoint.
fn of_the_server<'o>(line: &SecuredLine, offers: &'o [Offer]) -> anyhow::Result<&'o Certificate> {
    let wanted = line.bus.opcua.as_ref().map(|opcua| opcua.security);
    let shown = |offer: &&Offer| offer.certificate.is_some();
    let found = offers.iter().filter(shown).find(|offer| offer.security == wanted);
    let found = found.or_else(|| offers.iter().find(shown)).and_then(|offer| offer.certificate.as_ref());
    found.ok_or_else(|| {
        anyhow::anyhow!(
            "the server at {} offers no certificate: enable security at the server, Basic256Sha256 or better",
            line.bus.address
        )
    })
}

/// Returns the path of the trusted file that contains this certificate; `None` if the certificate is not trusted yet.
fn trusted_already(line: &SecuredLine, certificate: &Certificate) -> Option<PathBuf> {
    let known = line.bus.opcua.iter().flat_map(|opcua| &opcua.trusted);
    let mut known = known.filter_map(|file| Some((file, Certificate::read(&file.bytes)?)));
    known.find(|(_, known)| known.der == certificate.der).map(|(file, _)| line.beside.join(&file.name))
}

/// Checks the thumbprint given as an option, or else asks the user to confirm it. Returns an error if the thumbprint is
/// not confirmed.
fn agreed(thumbprint: Option<&str>, certificate: &Certificate) -> anyhow::Result<()> {
    if let Some(thumbprint) = thumbprint {
        let is_it = certificate.has_thumbprint(thumbprint).map_err(anyhow::Error::msg)?;
        anyhow::ensure!(
            is_it,
            "the server shows another certificate ({}), which is not trusted. Check whether the \
             server has a new certificate, or whether another computer answers instead",
            certificate.thumbprint
        );
        return Ok(());
    }
    say_beside!(
        "Compare the thumbprint with the one that the server itself shows. If they are the same, type {YES} \
         to trust the certificate:"
    );
    let said = typed()?;
    anyhow::ensure!(
        said.as_deref().map(str::trim) == Some(YES),
        "the certificate is not trusted; in scripts, give the expected thumbprint with --thumbprint"
    );
    Ok(())
}

/// Returns a file name with the server's host and the start of the thumbprint, for example
/// `192.168.214.241-5F3A0C96.der`.
fn file_name(line: &SecuredLine, certificate: &Certificate) -> String {
    let url = &line.bus.address;
    let host =
        url.split("://").last().and_then(|rest| rest.rsplit_once(':')).map_or("server", |(host, _)| host);
    let host: String = host.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    let digits: String = certificate.thumbprint.chars().filter(|c| *c != ':').take(8).collect();
    format!("{host}-{digits}.der")
}
