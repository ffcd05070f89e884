//! What becomes of the page's port.

use serde::Serialize;

use super::{Described, info, warning};

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
                format!(
                    "the page cannot listen on {listen} (another address: --listen): {why}; the machine is held without it, \
                     and it is tried again every ten seconds"
                ),
            ),
            PagePort::Open { listen } => info("page-open", format!("the page listens on {listen}")),
        }
    }
}
