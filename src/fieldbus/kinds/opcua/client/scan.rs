//! Scan of an OPC UA server: its endpoints, the users that they accept and its certificate, with matching lines for a
//! profile.

use std::time::Duration;

use super::offer::{Offer, offers};
use crate::clock::Clock;
use crate::fieldbus::error::Fault;
use crate::fieldbus::kinds::kind::ScanReport;
use crate::fieldbus::wire::Boxed;
use isotherm_profile::{Bus, Security};

/// Requests the endpoints of the server, and describes them.
pub(in crate::fieldbus::kinds::opcua) fn report(
    bus: &Bus,
    _: Option<Duration>,
) -> Boxed<'_, Result<ScanReport, Fault>> {
    Box::pin(async move {
        let url = &bus.address;
        let offers = offers(url, bus.timeout).await?;
        let mut certificates: Vec<_> = offers.iter().filter_map(|offer| offer.certificate.as_ref()).collect();
        certificates.dedup();
        let now = Clock::wall().time_of_day();
        let shown = certificates
            .iter()
            .map(|certificate| format!("The server shows a certificate\n{}", certificate.text(now)));
        let text = format!(
            "The server at {url} offers these endpoints:\n{}{}",
            table(&offers),
            shown.collect::<String>()
        );
        let profile = strongest(&offers).map(|security| {
            let files = match security {
                Security::None => "",
                _ => "cert = \"own.der\"\nkey = \"own.pem\"\ntrusted = \"trusted\"\n",
            };
            let user = user(&offers, security);
            ("control", format!("security = \"{}\"\n{files}{user}", word(security)))
        });
        let profile = profile.ok_or_else(|| {
            "the gateway supports none of these endpoints. At the server, switch on Basic256Sha256 or better, binary \
             over TCP, for anonymous users or users with a password or certificate"
                .to_owned()
        });
        let json = serde_json::json!({ "url": url, "endpoints": offers });
        Ok(ScanReport { is_empty: false, json, text, profile })
    })
}

/// Formats the endpoints as text, one line each.
fn table(offers: &[Offer]) -> String {
    let width = offers.iter().map(|offer| offer.policy.len()).max().unwrap_or(0);
    let lines = offers.iter().map(|Offer { security, policy, is_spoken, users, .. }| {
        let users = if users.is_empty() { "nobody".to_owned() } else { users.join(", ") };
        let spoken = if *is_spoken { "" } else { "  (not supported by the gateway)" };
        let security = security.map_or("?", word);
        format!("  {security:<16}  {policy:<width$}  {users}{spoken}\n")
    });
    lines.collect()
}

/// Returns the strongest security mode with which the gateway could log in to the server, with any kind of user; `None`
/// if no endpoint that the gateway supports accepts such a user.
fn strongest(offers: &[Offer]) -> Option<Security> {
    let order = [Security::SignAndEncrypt, Security::Sign, Security::None];
    let offered = |security: &Security| {
        ["anonymous", "password", "certificate"].iter().any(|user| lets_in(offers, *security, user))
    };
    order.into_iter().find(offered)
}

fn lets_in(offers: &[Offer], security: Security, user: &str) -> bool {
    let fitting = offers.iter().filter(|offer| offer.is_spoken && offer.security == Some(security));
    fitting.flat_map(|offer| &offer.users).any(|known| *known == user)
}

/// Returns lines for a profile with an example of a user; empty if the server accepts anonymous users.
fn user(offers: &[Offer], security: Security) -> &'static str {
    if lets_in(offers, security, "anonymous") {
        return "";
    }
    match lets_in(offers, security, "password") {
        true => {
            "# a user of the server; the file contains only the password\n\
             user = { name = \"isotherm\", password_file = \"opcua.password\" }\n"
        }
        false => {
            "# a user of the server, by certificate\nuser = { cert = \"user.der\", key = \"user.pem\" }\n"
        }
    }
}

/// Returns the value of the key `security` in a profile for this security mode.
const fn word(security: Security) -> &'static str {
    match security {
        Security::None => "none",
        Security::Sign => "sign",
        Security::SignAndEncrypt => "sign-and-encrypt",
    }
}
