//! Tests on CAN of a real kernel. `tests/vcan/run` builds them, and runs them with a virtual interface.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod demo;
mod gateway;
mod machine;
mod node;
mod rig;
mod utils;
mod verbs;
mod wrong_replies;

/// Interface for the tests, which `tests/vcan/run` creates.
pub(crate) fn interface() -> String {
    std::env::var("ISOTHERM_VCAN").unwrap_or_else(|_| {
        panic!(
            "these tests need a CAN interface of their own: `tests/vcan/run` makes one and runs them on it"
        )
    })
}
