//! State of the primary host: the Sparkplug host for which a publisher may have to wait.

/// State of the primary host (the Sparkplug host that must be online before the gateway publishes).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PrimaryHost {
    /// The gateway waits for no host before it publishes.
    #[default]
    NotNeeded,
    /// The broker has sent no state of the host on this connection.
    Unknown,
    /// The host is offline.
    Offline,
    /// The host is online.
    Online,
}

impl PrimaryHost {
    /// Returns whether messages may be published: the host is online, or the gateway waits for no host.
    pub fn is_present(self) -> bool {
        matches!(self, PrimaryHost::NotNeeded | PrimaryHost::Online)
    }

    /// Returns the name of the state in the status of the gateway; empty if no host is needed.
    pub fn name(self) -> &'static str {
        match self {
            PrimaryHost::NotNeeded => "",
            PrimaryHost::Unknown => "unknown",
            PrimaryHost::Offline => "offline",
            PrimaryHost::Online => "online",
        }
    }
}
