//! Table `[[notify]]`: servers to which events are posted, as JSON over HTTP.

use std::fmt;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::bus::tls::NamedFile;
use super::{KeyContext, optional};
use crate::document::{Section, entries};
use crate::host_port::is_loopback;
use crate::source_map::element;
use body::BodyTemplate;
use isotherm_core::events::EventKind;
pub use isotherm_core::events::{CLOCK, UNVERIFIED};
use url::Url;

pub(crate) mod body;
pub(crate) mod url;

/// Maximum number of servers. Each has a queue and a connection.
const MOST: usize = 16;

/// Trigger in the key `on`: an alarm begins.
pub const ALARM: &str = "alarm";
/// Trigger in the key `on`: an alarm ends.
pub const ALARM_OVER: &str = "alarm-over";
/// Trigger in the key `on`: an axis stops following its model, but not because the gateway is being stopped.
pub const AXIS_OFF: &str = "axis-off";

/// Triggers in the key `on` that are not the name of one kind of event.
const WORDS: [&str; 5] = [ALARM, ALARM_OVER, AXIS_OFF, UNVERIFIED, CLOCK];

/// All words for the key `on`: the triggers in `WORDS`, and the name of every kind of event.
pub const TRIGGERS: [&str; WORDS.len() + EventKind::ALL.len()] = {
    let mut all = [""; WORDS.len() + EventKind::ALL.len()];
    let mut place = 0;
    while place < all.len() {
        all[place] = match place.checked_sub(WORDS.len()) {
            None => WORDS[place],
            Some(place) => EventKind::ALL[place].name(),
        };
        place += 1;
    }
    all
};

/// Server that receives messages about events.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Notify")]
pub(crate) struct RawNotify {
    /// Address of the server: "https://alarms.plant.example/isotherm", or http. It must not have a user or a password.
    /// `{token}` is the place of the token, if the token is a part of the address.
    #[schemars(required)]
    url: Option<String>,
    /// Events that are posted: kinds of events by their names, or one of the following words. "alarm" and "alarm-over":
    /// begin and end of an alarm. "axis-off": an axis no longer follows its model. "unverified": a register value is
    /// not known, or differs from the written value. "clock": the time of this computer was not as expected.
    #[schemars(required, schema_with = "words")]
    on: Option<Vec<String>>,
    /// File next to the profile with the token, not readable by others. The token is sent as `Authorization: Bearer …`,
    /// or in the place of `{token}`. The file is read again for every message.
    token_file: Option<String>,
    /// PEM file next to the profile with the certificate of the authority that signed the server's certificate, or with
    /// the server's certificate itself. Default: the authorities that this computer trusts.
    ca: Option<String>,
    /// Form of the posted JSON: a JSON text in which `{machine}`, `{text}` and other fields of a message stand inside
    /// quotation marks. The fields are escaped as JSON. Default: a document with all fields.
    #[schemars(extend("x-lines" = true))]
    body: Option<String>,
}

/// Formats the table without its address, because a part of the address may be secret.
impl fmt::Debug for RawNotify {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RawNotify").field("on", &self.on).finish_non_exhaustive()
    }
}

fn words(_: &mut SchemaGenerator) -> Schema {
    schemars::json_schema!({ "type": "array", "items": { "type": "string", "enum": TRIGGERS.as_slice() } })
}

/// Server to which events are posted.
#[derive(Clone, Debug, PartialEq)]
pub struct Notify {
    /// Path of the table in the profile, for example `notify[0]`.
    pub name: String,
    /// Address of the server.
    pub url: Url,
    /// Words of [`TRIGGERS`] that cause a message to this server.
    pub on: Vec<&'static str>,
    /// File with the token; `None` if no token is sent.
    pub token_file: Option<PathBuf>,
    /// Trusted certificates. `None` means the certificate authorities that this computer trusts.
    pub ca: Option<NamedFile>,
    /// Template of the posted JSON. `None` if a document with all fields is posted.
    pub body: Option<BodyTemplate>,
}

/// Resolves all servers. Reports every error.
pub(super) fn resolve(at: &KeyContext<'_>, raw: &[RawNotify]) -> Vec<Notify> {
    if raw.len() > MOST {
        let help = "configure one server to forward the messages to the other servers";
        at.wrong_key(
            format!("the profile has {} tables [[notify]]; at most {MOST} are allowed", raw.len()),
            help,
        );
        return Vec::new();
    }
    raw.iter().enumerate().filter_map(|(place, raw)| raw.resolve(&at.item(place), place)).collect()
}

impl RawNotify {
    fn resolve(&self, at: &KeyContext<'_>, place: usize) -> Option<Notify> {
        let url = self.url.as_ref().and_then(|url| {
            let wrong = |(message, help): (String, &str)| at.key("url").invalid(message, help);
            Url::parse(url).map_err(wrong).ok()
        });
        let on = self.on.as_ref().and_then(|on| triggers(&at.key("on"), on));
        if self.ca.is_some() && url.as_ref().is_some_and(|url| !url.tls) {
            at.not_applicable(&["ca"], "https", "remove this key, or write https:// in `url`");
        }
        let help = "write the name of a PEM file next to the profile with the certificate of the server, or \
                    of the authority that signed it";
        let ca = optional(self.ca.as_ref(), |name| NamedFile::read(&at.key("ca"), name, help));
        if self.token_file.is_none() && url.as_ref().is_some_and(Url::has_token) {
            let help = "write the path of the token file into `token_file`";
            at.key("url").invalid(
                "the address has a placeholder for a token, but the key `token_file` is missing",
                help,
            );
        }
        at.key("token_file").secret(self.token_file.as_ref());
        if self.token_file.is_some() && url.as_ref().is_some_and(|url| !url.tls && !is_loopback(&url.host)) {
            let help = "write https:// in `url`, if the server supports it";
            at.key("token_file").warn("the token goes over the network in plain text", help);
        }
        let token_file = self.token_file.as_ref().map(|name| PathBuf::from(at.report.files.path(name)));
        let body = optional(self.body.as_ref(), |text| template(&at.key("body"), text));
        Some(Notify { name: element("notify", place), url: url?, on: on?, token_file, ca: ca?, body: body? })
    }
}

fn template(at: &KeyContext<'_>, text: &str) -> Option<BodyTemplate> {
    let template = BodyTemplate::parse(text).map_err(|(message, help)| at.invalid(message, help)).ok()?;
    if !template.has_fields() {
        let help = "write a field of the message into the body: body = '{\"text\": \"{machine}: {text}\"}'";
        at.warn("every message would have the same body", help);
    }
    Some(template)
}

fn triggers(at: &KeyContext<'_>, written: &[String]) -> Option<Vec<&'static str>> {
    if written.is_empty() {
        let help = format!("write on = [\"{ALARM}\", \"{ALARM_OVER}\"]");
        return at.reject("the list is empty: nothing would be posted", help);
    }
    let mut on = Vec::new();
    for (place, word) in written.iter().enumerate() {
        // The word has been checked against the schema.
        let known = TRIGGERS.into_iter().find(|known| known == word)?;
        if on.contains(&known) {
            let help = "remove one of the two entries: each event is posted once";
            at.item(place).warn(format!("`{known}` is listed twice"), help);
        } else {
            on.push(known);
        }
    }
    Some(on)
}

impl Notify {
    /// Returns the preview of one server: its address, token file, trusted certificates, and the events that
    /// are posted.
    pub(crate) fn preview(&self) -> Section {
        let mut section = Section::default();
        let (to, on) = (self.url.to_string(), self.on.join(", "));
        let token = self.token_file.as_ref().map(|file| file.display().to_string());
        let with = token.as_ref().map_or(String::new(), |file| {
            let place = if self.url.has_token() { " as a part of the address" } else { "" };
            format!(", with the token in {file}{place}")
        });
        let trusts = match (&self.ca, self.url.tls) {
            (_, false) => ", in plain text".to_owned(),
            (Some(ca), true) => format!(", trusting {}", ca.name),
            (None, true) => ", trusting the certificate authorities of this computer".to_owned(),
        };
        let form = self.body.as_ref().map_or("", |_| ", in the form of `body`");
        section.line(format!("  {} to {to}{with}{trusts}{form}: {on}", self.name));
        entries!(section, name = &self.name, to, on = &self.on, token_file = token);
        entries!(section, trusts = self.ca.as_ref().map(|ca| &ca.name));
        entries!(section, body = self.body.as_ref().map(BodyTemplate::json));
        section
    }
}
