//! What becomes of the page's port, and of the tokens with which people come in.

use serde::Serialize;

use super::{Described, error, info, warning};
use isotherm_core::explained::Explained;

/// The page is not served although the profile says so, or is at last.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PagePort {
    /// It cannot listen at its address.
    Closed {
        /// Host and port.
        listen: String,
        /// A sentence.
        why: String,
    },
    /// It listens now.
    Open {
        /// Host and port.
        listen: String,
    },
}

impl PagePort {
    pub(super) fn described(&self) -> Described {
        match self {
            PagePort::Closed { listen, why } => warning(
                "page-closed",
                format!("the page cannot listen on {listen} (another address: --listen)"),
                Explained::new(
                    why.as_str(),
                    "free the address or name another one; the machine is compensated without the page, and the gateway tries \
                     again every ten seconds",
                ),
            ),
            PagePort::Open { listen } => info("page-open", format!("the page listens on {listen}")),
        }
    }
}

/// A token file of the page was changed while the gateway ran.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PageToken {
    /// It holds another one.
    Changed {
        /// Whose: scraper, viewer, operator.
        role: &'static str,
    },
    /// There is none to be had.
    Gone {
        /// Whose: scraper, viewer, operator.
        role: &'static str,
        /// A sentence.
        why: String,
    },
}

impl PageToken {
    pub(super) fn described(&self) -> Described {
        match self {
            PageToken::Changed { role } => info(
                "token-changed",
                format!("the {role}'s token is another one now; who signed in with the old one is gone"),
            ),
            PageToken::Gone { role, why } => error(
                "token-gone",
                format!("the {role}'s token is none any more"),
                Explained::new(
                    why.as_str(),
                    "`isotherm token --out FILE` makes one that only its owner can read",
                ),
            ),
        }
    }
}
