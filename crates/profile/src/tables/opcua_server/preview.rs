//! Preview of the OPC UA server, which `isotherm check` prints: its address, its protection, and the users
//! that may log in.

use super::user::{ServerLogin, ServerUser};
use super::{AnonymousClients, OpcUaServer};
use crate::document::{Section, entries};
use crate::duration::shown;
use crate::kinds::opcua::connection::{SCHEME, Security};

impl OpcUaServer {
    /// Preview of the server: address, protection, trusted clients, users, and period of the values.
    pub(crate) fn preview(&self) -> Section {
        let mut section = Section::default();
        let url = format!("{SCHEME}{}", self.listen);
        let protection = match self.security {
            Security::None => "neither signed nor encrypted",
            Security::Sign => "signed or encrypted",
            Security::SignAndEncrypt => "signed and encrypted",
        };
        section.line(format!("  OPC UA server at {url}: messages are {protection}"));
        let trusted: Vec<&str> = self.trusted.iter().map(|file| file.name.as_str()).collect();
        if let (Some((cert, _)), Some(directory)) = (&self.own, &self.trusted_in) {
            let known = if trusted.is_empty() { "none yet".to_owned() } else { trusted.join(", ") };
            section.line(format!(
                "    own certificate {}; trusts the clients in {directory}: {known}",
                cert.name
            ));
        }
        let users: Vec<String> = self.users.iter().map(described).collect();
        let without = match self.anonymous {
            AnonymousClients::Allowed => "clients without a user may read",
            AnonymousClients::Refused => "clients without a user are refused",
        };
        let named = if users.is_empty() { "none".to_owned() } else { users.join(", ") };
        section.line(format!("    users: {named}; {without}"));
        let every = shown(self.every);
        section.line(format!("    all nodes are read only, and are updated every {every}"));
        let shows = self.own.as_ref().map(|(cert, _)| &cert.name);
        entries!(section, listen = &self.listen, security = self.security, shows, trusts = trusted, users);
        entries!(section, anonymous = self.anonymous, every);
        section
    }
}

fn described(user: &ServerUser) -> String {
    let by = match &user.login {
        ServerLogin::Password(_) => "password".to_owned(),
        ServerLogin::Certificate(cert) => format!("certificate {}", cert.name),
    };
    let may = if user.takes_measured { ", may send measured errors" } else { "" };
    format!("{} ({by}{may})", user.name)
}
