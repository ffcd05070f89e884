//! State of the primary host, from its messages on `spBv1.0/STATE/HOST`.
//!
//! ```text
//! { "online": true, "timestamp": 1800000000000 }     the host is online since this time, ms since 1970
//! { "online": false, "timestamp": 1800000000000 }    offline; in a last will, the time of the host's birth
//! ```
//!
//! A message is ignored if its time is older than the time of the last accepted message. At the start of each
//! connection, the gateway forgets the last accepted time, because the message that the broker has retained
//! is the newest. Otherwise a host whose clock was once ahead would be ignored until the gateway is
//! restarted. If an offline host reports itself as online with an older time, the message is refused with a
//! reason, because the node keeps waiting.

use serde::Deserialize;

use crate::interface::PrimaryHost;

/// Maximum length of a state message, in bytes.
const LONGEST: usize = 1000;

/// Subscription to the state messages of one host, and the last accepted state.
#[derive(Debug)]
pub(super) struct HostWatch {
    topic: String,
    /// Last accepted state on this connection.
    last: Option<State>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct State {
    online: bool,
    /// Time of the state by the clock of the host, ms since 1970.
    timestamp: u64,
}

impl HostWatch {
    /// Creates the state of the host that publishes to this topic. No message has been received yet.
    pub(super) fn at(topic: String) -> HostWatch {
        HostWatch { topic, last: None }
    }

    pub(super) fn topic(&self) -> &str {
        &self.topic
    }

    /// Forgets the last state of the host, because a new connection begins.
    pub(super) fn connects(&mut self) {
        self.last = None;
    }

    /// Evaluates a state message from an untrusted sender. Returns the reason if it is invalid.
    pub(super) fn receive(&mut self, payload: &[u8]) -> Result<(), String> {
        let form = "send { \"online\": true, \"timestamp\": 1800000000000 }, as Sparkplug B 3.0 requires";
        if payload.len() > LONGEST {
            return Err(format!("{} bytes are too many for the state of a host: {form}", payload.len()));
        }
        let state: State = serde_json::from_slice(payload).map_err(|error| format!("{form} ({error})"))?;
        if let Some(last) = self.last.filter(|last| state.timestamp < last.timestamp) {
            if last.online || !state.online {
                return Ok(());
            }
            let why = "the timestamp is too old: the host is online with an older time than in its last \
                       offline state. Check the clock of the host. If it is right, restart the gateway";
            return Err(why.to_owned());
        }
        self.last = Some(state);
        Ok(())
    }

    pub(super) fn state(&self) -> PrimaryHost {
        match self.last {
            None => PrimaryHost::Unknown,
            Some(State { online: true, .. }) => PrimaryHost::Online,
            Some(State { online: false, .. }) => PrimaryHost::Offline,
        }
    }
}
