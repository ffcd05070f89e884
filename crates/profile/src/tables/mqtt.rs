//! `[mqtt]`: publication of values and events to an MQTT broker.
//!
//! The certificate, key and password files are read together with the profile, so that a missing file is
//! reported at its key. The module that connects to the broker checks their content, because only that module
//! has a TLS library.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bus::tls::{NamedFile, file, own_pair, password};
use super::{KeyContext, optional};
use crate::duration::Timespan;
use crate::error::ProfileError;
use crate::host_port::is_loopback;
use crate::size::Size;
use broker::BrokerUrl;

pub(crate) mod broker;
mod preview;

/// Default period of publication.
const EVERY: Duration = Duration::from_secs(1);
/// Shortest allowed period of publication. A shorter one would cost too much time, because the state is copied for each
/// publication.
const SHORTEST: Duration = Duration::from_millis(100);
/// Default time after which unchanged values are published again.
const REFRESH: Duration = Duration::from_secs(60);
/// Default size in bytes of the buffer on disk, which stores values while the broker is unreachable.
const BUFFER: u64 = 100_000_000;
/// Largest length of a group or host in bytes. The length is limited because every message contains its topic.
const LONGEST_NAME: usize = 100;

/// Publication to a broker.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Mqtt")]
pub(crate) struct RawMqtt {
    /// Address of the broker: "mqtts://broker.plant.example:8883", or mqtt:// without TLS.
    #[schemars(required)]
    broker: Option<String>,
    /// Format of the messages. Default "json".
    format: Option<MqttFormat>,
    /// First part of every topic, default "isotherm". With format "sparkplug-b" the Sparkplug group, which is required.
    group: Option<String>,
    /// User of the gateway on the broker.
    user: Option<RawMqttUser>,
    /// Trusted certificates, and the certificate of the gateway. Only with mqtts://.
    tls: Option<RawMqttTls>,
    /// Shortest time between two messages of one topic, at least "100ms". Default "1s".
    every: Option<Timespan>,
    /// Time after which an unchanged value is published again. Default "1min".
    refresh: Option<Timespan>,
    /// Size of the buffer on disk, which stores values while the broker is unreachable, with format "sparkplug-b".
    /// Default "100MB".
    buffer: Option<Size>,
    /// Name of the Sparkplug host that must be online before values are published, with format "sparkplug-b". While the
    /// host is offline, values and events are stored, and published later. Default: the gateway waits for no host.
    primary_host: Option<String>,
    /// Commands that are accepted from the broker: none, or "measured". No message can arm, disarm or move an axis.
    #[serde(default)]
    commands: Vec<MqttCommand>,
    /// Whether discovery topics for Home Assistant are published. Default false.
    home_assistant: Option<bool>,
}

/// User of the gateway.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "MqttUser")]
struct RawMqttUser {
    /// Name of the user on the broker.
    #[schemars(required)]
    name: Option<String>,
    /// File next to the profile that contains only the password, not readable by others.
    password_file: Option<String>,
}

/// Certificate files, in PEM form.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "MqttTls")]
struct RawMqttTls {
    /// Certificate of the authority that signed the broker's certificate, or the broker's certificate itself. Default:
    /// the authorities that this computer trusts.
    ca: Option<String>,
    /// Certificate of the gateway, for a broker that requires one.
    cert: Option<String>,
    /// Private key of `cert`.
    key: Option<String>,
}

/// Format of the messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "MqttFormatWord", description = "")]
pub enum MqttFormat {
    /// JSON, with a topic for each item.
    #[default]
    Json,
    /// Sparkplug B.
    SparkplugB,
}

/// Command that is accepted from the broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "MqttCommandWord", description = "")]
enum MqttCommand {
    /// Measured error of an axis, which corrects its models.
    Measured,
}

/// Resolved settings of the publication of values and events to an MQTT broker.
#[derive(Clone, Debug, PartialEq)]
pub struct Mqtt {
    /// Address of the broker.
    pub broker: BrokerUrl,
    /// Format of the messages.
    pub format: MqttFormat,
    /// First part of every topic. With Sparkplug B, the Sparkplug group.
    pub group: String,
    /// User of the gateway. `None` for an anonymous user.
    pub user: Option<MqttUser>,
    /// File with the trusted certificate. `None` for the certificate authorities that this computer trusts.
    pub ca: Option<NamedFile>,
    /// Certificate and private key of the gateway. `None` if the profile names none.
    pub own: Option<(NamedFile, NamedFile)>,
    /// Shortest time between two messages of one topic.
    pub every: Duration,
    /// Time after which an unchanged value is published again.
    pub refresh: Duration,
    /// Size in bytes of the buffer on disk, which stores values while the broker is unreachable.
    pub buffer: u64,
    /// Name of the Sparkplug host that must be online before values are published. `None` if there is none.
    pub primary_host: Option<String>,
    /// Whether measured errors are accepted from the broker.
    pub takes_measured: bool,
    /// Whether discovery topics for Home Assistant are published.
    pub home_assistant: bool,
    table_at: ProfileError,
}

/// User as which the gateway logs in to the broker.
#[derive(Clone, Debug, PartialEq)]
pub struct MqttUser {
    /// Name of the user.
    pub name: String,
    /// File that contains the password. A newline at the end of the file is not part of the password. `None` for a user
    /// without a password.
    pub password: Option<NamedFile>,
}

impl Mqtt {
    /// Creates an error that points to the table `[mqtt]` in the profile.
    pub fn invalid(&self, message: &str, help: &str) -> ProfileError {
        let (message, help) = (message.to_owned(), Some(help.to_owned()));
        ProfileError { message, help, ..self.table_at.clone() }
    }

    /// Returns the secret files: password and private key.
    pub fn secrets(&self) -> impl Iterator<Item = &NamedFile> {
        let password = self.user.as_ref().and_then(|user| user.password.as_ref());
        self.own.iter().map(|(_, key)| key).chain(password)
    }
}

impl RawMqtt {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<Mqtt> {
        let broker = self.broker.as_ref().and_then(|broker| {
            let wrong = |(message, help)| at.key("broker").invalid(message, help);
            BrokerUrl::parse(broker).map_err(wrong).ok()
        });
        let format = self.format.unwrap_or_default();
        let group = self.group(at, format);
        let user = optional(self.user.as_ref(), |user| user.resolve(&at.key("user")));
        if let Some(broker) = &broker {
            self.doubts(at, broker);
        }
        let tls = self.tls.as_ref().map(|tls| tls.resolve(&at.key("tls")));
        let (ca, own) = tls.unwrap_or((Some(None), Some(None)));
        if format == MqttFormat::SparkplugB {
            let help = "remove this key: the birth message of a Sparkplug node lists all values";
            at.not_applicable(&["home_assistant"], "format = \"json\"", help);
        } else {
            let help = "remove this key: after a lost connection only the newest values are published; \
                        events wait in memory";
            at.not_applicable(&["buffer"], "format = \"sparkplug-b\"", help);
            let help = "remove this key: only Sparkplug hosts publish their state";
            at.not_applicable(&["primary_host"], "format = \"sparkplug-b\"", help);
        }
        let primary_host =
            optional(self.primary_host.as_ref(), |host| primary_host(&at.key("primary_host"), host));
        let every = self.every(at);
        let refresh = at.key("refresh").duration(self.refresh).unwrap_or(REFRESH);
        if refresh < every {
            let help = "write a longer duration, or remove `refresh` (default one minute)";
            at.key("refresh").invalid("`refresh` is shorter than `every`", help);
        }
        let buffer = match self.buffer {
            Some(Size(size)) if size < 100_000 => {
                let help = "write a larger size, as \"100MB\"";
                at.key("buffer").invalid("this size is too small for one minute of values", help);
                BUFFER
            }
            size => size.map_or(BUFFER, |Size(size)| size),
        };
        Some(Mqtt {
            broker: broker?,
            format,
            group: group?,
            user: user?,
            ca: ca?,
            own: own?,
            every,
            refresh,
            buffer,
            primary_host: primary_host?,
            takes_measured: self.commands.contains(&MqttCommand::Measured),
            home_assistant: self.home_assistant.unwrap_or(false),
            table_at: at.report.spans.at_key(&at.path, "", None),
        })
    }

    fn every(&self, at: &KeyContext<'_>) -> Duration {
        let every = at.key("every").duration(self.every).unwrap_or(EVERY);
        if every < SHORTEST {
            let help = "write \"100ms\" or longer: faster changes are in the logs";
            at.key("every").invalid("the gateway does not publish a topic this often", help);
        }
        every
    }

    fn group(&self, at: &KeyContext<'_>, format: MqttFormat) -> Option<String> {
        let is_sparkplug = format == MqttFormat::SparkplugB;
        let at = at.key("group");
        if is_sparkplug {
            let help = "write group = \"plant-1\"";
            at.missing("`group` is missing: to which group does this node belong?", help);
        }
        let Some(group) = &self.group else { return (!is_sparkplug).then(|| "isotherm".to_owned()) };
        let is_meant =
            |one: char| one.is_control() || matches!(one, '+' | '#') || (one == '/' && is_sparkplug);
        if is_sparkplug && group == "STATE" {
            let message = "the group `STATE` is reserved: hosts publish their own state in this group";
            return at.reject(message, "give the group another name");
        }
        let is_whole = !group.is_empty() && group.split('/').all(|part| !part.is_empty());
        if !is_whole || group.contains(is_meant) || group.starts_with('$') || group.len() > LONGEST_NAME {
            let slash = if is_sparkplug { "no `/`, " } else { "" };
            let help =
                format!("write a short name, as \"plant-1\": {slash}no `+`, no `#`, no `$` at its beginning");
            return at.reject(format!("`{group}` cannot begin a topic"), help);
        }
        Some(group.clone())
    }

    /// Warns about publication without encryption.
    fn doubts(&self, at: &KeyContext<'_>, broker: &BrokerUrl) {
        if broker.tls {
            return;
        }
        let help = "remove this key, or write mqtts:// in `broker`";
        at.not_applicable(&["tls"], "mqtts://", help);
        if is_loopback(&broker.host) {
            return;
        }
        let help = "write mqtts:// in `broker`, if the broker supports it";
        if self.user.as_ref().is_some_and(|user| user.password_file.is_some()) {
            at.key("broker").warn("the password goes over the network in plain text", help);
        } else {
            let message = "nothing is encrypted: every computer on the network can read the messages, and \
                           publish as this gateway";
            at.key("broker").warn(message, help);
        }
        if !self.commands.is_empty() {
            let message = "every computer on the network can send measured errors";
            at.key("commands").warn(message, help);
        }
        if self.primary_host.is_some() {
            let message = "every computer on the network can report this host as offline, and so delay what is \
                           published";
            at.key("primary_host").warn(message, help);
        }
    }
}

/// Checks the name of a Sparkplug host. Returns `None` if it cannot be one level of a topic.
fn primary_host(at: &KeyContext<'_>, host: &str) -> Option<String> {
    let is_special = |one: char| one.is_control() || matches!(one, '+' | '#' | '/');
    if host.is_empty() || host.contains(is_special) || host.len() > LONGEST_NAME {
        let help = "write the host ID as the host application shows it, as \"scada\": no `/`, no `+`, no `#`";
        return at.reject(format!("`{host}` cannot be the name of a Sparkplug host"), help);
    }
    Some(host.to_owned())
}

impl RawMqttUser {
    fn resolve(&self, at: &KeyContext<'_>) -> Option<MqttUser> {
        let password = optional(self.password_file.as_ref(), |name| password(at, Some(name)))?;
        Some(MqttUser { name: self.name.clone()?, password })
    }
}

/// Trusted certificate, and the gateway's certificate with its private key. An inner `None` means that the profile
/// names no file. An outer `None` means that a file has an error.
type Files = (Option<Option<NamedFile>>, Option<Option<(NamedFile, NamedFile)>>);

impl RawMqttTls {
    fn resolve(&self, at: &KeyContext<'_>) -> Files {
        let help = "write the name of a PEM file next to the profile with the certificate of the broker, or \
                    of the authority that signed it";
        let ca = optional(self.ca.as_ref(), |name| file(at, "ca", Some(name), help));
        let named = (self.cert.is_some() || self.key.is_some()).then_some((&self.cert, &self.key));
        (ca, optional(named, |(cert, key)| own_pair(at, cert.as_ref(), key.as_ref())))
    }
}
