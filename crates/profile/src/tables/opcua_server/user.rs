//! Users of the OPC UA server: how they log in, and the commands that they may give.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::key_context::KeyContext;
use crate::tables::bus::tls::{NamedFile, password};

/// Largest length of the name of a user, in bytes.
const LONGEST: usize = 100;
/// User name that the OPC UA library reserves for clients without a user.
const RESERVED: &str = "ANONYMOUS";

/// User that may log in to the server.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "OpcUaServerUser")]
pub(crate) struct RawServerUser {
    /// Name of the user, for events and for the login with a password.
    #[schemars(required)]
    name: Option<String>,
    /// File next to the profile that contains only the password, not readable by others.
    password_file: Option<String>,
    /// Certificate of the user, in DER or PEM form, instead of a password.
    cert: Option<String>,
    /// Commands that the user may give: none, or "measured". No client can arm, disarm or move an axis.
    #[serde(default)]
    commands: Vec<ServerCommand>,
}

/// Command that is accepted from a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "OpcUaServerCommandWord", description = "")]
enum ServerCommand {
    /// Measured error of an axis, which corrects its models.
    Measured,
}

/// User that may log in to the server.
#[derive(Clone, Debug, PartialEq)]
pub struct ServerUser {
    /// Name of the user.
    pub name: String,
    /// Secret with which the user logs in.
    pub login: ServerLogin,
    /// Whether the user may send measured errors of an axis. Measured errors correct the models of the axis.
    pub takes_measured: bool,
}

/// Secret with which a user logs in.
#[derive(Clone, Debug, PartialEq)]
pub enum ServerLogin {
    /// File that contains the password. A newline at the end of the file is not part of the password.
    Password(NamedFile),
    /// Certificate of the user.
    Certificate(NamedFile),
}

impl ServerUser {
    /// Returns the file with the password. `None` if the user logs in with a certificate.
    pub(super) fn password(&self) -> Option<&NamedFile> {
        match &self.login {
            ServerLogin::Password(file) => Some(file),
            ServerLogin::Certificate(_) => None,
        }
    }
}

impl RawServerUser {
    /// Returns whether the user logs in with a password.
    pub(super) fn has_password(&self) -> bool {
        self.password_file.is_some()
    }

    fn resolve(&self, at: &KeyContext<'_>, is_secured: bool) -> Option<ServerUser> {
        let name = self.name.as_ref().and_then(|name| is_name(&at.key("name"), name));
        let login = match (&self.password_file, &self.cert) {
            (Some(file), None) => password(at, Some(file)).map(ServerLogin::Password),
            (None, Some(file)) => {
                let help = "write the name of the file with the user's certificate, in DER or PEM form";
                if !is_secured {
                    let help = "write `password_file`, or security = \"sign-and-encrypt\" of the server";
                    at.not_applicable(&["cert"], "a secured server", help);
                }
                NamedFile::read(&at.key("cert"), file, help).map(ServerLogin::Certificate)
            }
            (Some(_), Some(_)) => {
                at.invalid("a user has either a password or a certificate", "keep one of the two keys");
                None
            }
            (None, None) => {
                let help = "write password_file = \"…\", or cert = \"…\"";
                at.invalid("the user has no password and no certificate", help);
                None
            }
        };
        let takes_measured = self.commands.contains(&ServerCommand::Measured);
        Some(ServerUser { name: name?, login: login?, takes_measured })
    }
}

/// Resolves all users. Reports every error. `None` if a user cannot be resolved.
pub(super) fn resolve(
    at: &KeyContext<'_>,
    raw: &[RawServerUser],
    is_secured: bool,
) -> Option<Vec<ServerUser>> {
    let users = raw.iter().enumerate().map(|(place, raw)| raw.resolve(&at.item(place), is_secured));
    let users: Vec<Option<ServerUser>> = users.collect();
    for (place, user) in users.iter().enumerate().filter_map(|(place, user)| Some((place, user.as_ref()?))) {
        let is_same =
            |other: &Option<ServerUser>| other.as_ref().is_some_and(|other| other.name == user.name);
        if users[..place].iter().any(is_same) {
            let message = format!("a user named `{}` is listed twice", user.name);
            at.item(place).key("name").invalid(message, "give each user a name of its own");
        }
    }
    users.into_iter().collect()
}

fn is_name(at: &KeyContext<'_>, name: &str) -> Option<String> {
    let is_plain = !name.is_empty() && name.len() <= LONGEST && !name.chars().any(char::is_control);
    if !is_plain || name == RESERVED {
        let help = format!("write a short name, as \"mes\"; `{RESERVED}` means clients without a user");
        return at.reject(format!("`{name}` cannot be the name of a user"), help);
    }
    Some(name.to_owned())
}
