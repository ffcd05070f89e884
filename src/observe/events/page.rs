//! Events about the port of the web page, and about its tokens.

use serde::Serialize;

use super::{EventDescription, error, info, warning};
use isotherm_core::explained::Explained;

/// State of the web page that the profile requires.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PagePort {
    /// The web page cannot listen at its address.
    Closed {
        /// Host and port.
        listen: String,
        /// Reason as a sentence.
        why: String,
    },
    /// The web page listens now.
    Open {
        /// Host and port.
        listen: String,
    },
}

impl PagePort {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            PagePort::Closed { listen, why } => warning(
                "page-closed",
                format!("the web page cannot listen on {listen} (another address: --listen)"),
                Explained::new(
                    why.as_str(),
                    "free the address or name another one; the gateway tries again every ten seconds, and \
                     the compensation continues",
                ),
            ),
            PagePort::Open { listen } => info("page-open", format!("the web page listens on {listen}")),
        }
    }
}

/// A token file of the web page has changed while the gateway runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PageToken {
    /// The file contains another token.
    Changed {
        /// Role of the token: scraper, viewer or operator.
        role: &'static str,
    },
    /// The file contains no valid token.
    Gone {
        /// Role of the token: scraper, viewer or operator.
        role: &'static str,
        /// Reason as a sentence.
        why: String,
    },
}

impl PageToken {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            PageToken::Changed { role } => info(
                "token-changed",
                format!("the {role}'s token has changed; sessions with the old token have ended"),
            ),
            PageToken::Gone { role, why } => error(
                "token-gone",
                format!("the {role}'s token is not valid any more"),
                Explained::new(
                    why.as_str(),
                    "`isotherm token --out FILE` makes a token file that only its owner can read",
                ),
            ),
        }
    }
}
