//! Events about the listening port and the access tokens of the web page.

use serde::Serialize;

use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_core::explained::Explained;

/// Change of the port on which the web page listens: closed, not served, or open.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PagePort {
    /// The web page cannot listen at its address.
    Closed {
        /// Host and port on which the server listens.
        listen: String,
        /// Reason why the page cannot listen, as a sentence.
        why: String,
    },
    /// The gateway does not open the port of the web page, because a token file or the certificate of the
    /// page cannot be used.
    NotServed {
        /// Host and port on which the server listens.
        listen: String,
        /// Reason why the page is not served, as a sentence with its remedy.
        why: String,
    },
    /// The web page listens now.
    Open {
        /// Host and port on which the server listens.
        listen: String,
    },
}

impl PagePort {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            PagePort::Closed { listen, why } => {
                caused(format!("the web page cannot listen on {listen} (another address: --listen)"), why)
                    .of(EventKind::PageClosed)
            }
            PagePort::NotServed { listen, why } => {
                let again =
                    "the gateway reads the file again every ten seconds, and the compensation continues";
                caused(format!("the web page on {listen} is not served"), Explained::new(why, again))
                    .of(EventKind::PageClosed)
            }
            PagePort::Open { listen } => {
                plain(format!("the web page listens on {listen}")).of(EventKind::PageOpen)
            }
        }
    }
}

/// Change of a token file of the web page while the gateway runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PageToken {
    /// The token file contains another token than before.
    Changed {
        /// Role of the token: scraper, viewer or operator.
        role: &'static str,
    },
    /// The token file contains no valid token.
    Gone {
        /// Role of the token: scraper, viewer or operator.
        role: &'static str,
        /// Reason why the token file is invalid, as a sentence.
        why: String,
    },
}

impl PageToken {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            PageToken::Changed { role } => {
                plain(format!("the {role}'s token has changed; sessions with the old token have ended"))
                    .of(EventKind::TokenChanged)
            }
            PageToken::Gone { role, why } => {
                caused(format!("the {role}'s token is no longer valid"), why).of(EventKind::TokenGone)
            }
        }
    }
}
