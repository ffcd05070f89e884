//! Endpoints of an OPC UA server, with the users that it accepts and its certificate, also as lines for a profile.

use crate::cli::opcua::shown;
use crate::cli::print::{say, say_all};
use crate::cli::print_json;
use crate::cli::target::Line;
use crate::discovery::opcua::{Offer, offers};
use isotherm_profile::Security;

pub(super) fn run(line: &Line, json: bool) -> anyhow::Result<()> {
    let url = &line.bus.address;
    let asked = offers(url, line.bus.timeout);
    let offers = crate::cli::runtime()?.block_on(asked).map_err(anyhow::Error::msg)?;
    if json {
        return print_json(&serde_json::json!({ "url": url, "endpoints": offers }));
    }
    say!("The server at {url} offers")?;
    say_all!("{}", table(&offers))?;
    let mut certificates: Vec<_> = offers.iter().filter_map(|offer| offer.certificate.as_ref()).collect();
    certificates.dedup();
    for certificate in certificates {
        say!("The server shows a certificate")?;
        say_all!("{}", shown(certificate))?;
    }
    let Some(security) = strongest(&offers) else {
        anyhow::bail!(
            "the gateway supports none of these endpoints. At the server, switch on Basic256Sha256 or \
             better, binary over TCP, for anonymous users or users with a password or certificate"
        )
    };
    if line.known.is_none() {
        let files = match security {
            Security::None => String::new(),
            _ => "cert = \"own.der\"\nkey = \"own.pem\"\ntrusted = \"trusted\"\n".to_owned(),
        };
        let files = files + user(&offers, security);
        let lines = line.address.profile_lines();
        say_all!("\n# for a profile:\n[bus.control]\n{lines}security = \"{}\"\n{files}", word(security))?;
    }
    Ok(())
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

/// Returns the strongest security with which the gateway could log in to the server with some kind of user; `None` if
/// there is none.
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

/// Returns lines for a profile with a user, if the server does not accept anonymous users; otherwise nothing.
fn user(offers: &[Offer], security: Security) -> &'static str {
    if lets_in(offers, security, "anonymous") {
        return "";
    }
    match lets_in(offers, security, "password") {
        true => {
            "# a user of the server; the file holds the password alone\n\
             user = { name = \"isotherm\", password_file = \"opcua.password\" }\n"
        }
        false => {
            "# a user of the server, by certificate\nuser = { cert = \"user.der\", key = \"user.pem\" }\n"
        }
    }
}

/// Returns the word for a kind of security in a profile.
const fn word(security: Security) -> &'static str {
    match security {
        Security::None => "none",
        Security::Sign => "sign",
        Security::SignAndEncrypt => "sign-and-encrypt",
    }
}
