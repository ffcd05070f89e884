//! isotherm holds a machine tool to its cold geometry.
//!
//! # The map
//! What decides lives in crates of its own, so that Cargo holds the arrows: `isotherm-core` knows nobody,
//! `isotherm-profile` knows core, and neither knows tokio, rustls or clap. `isotherm-identify` and `isotherm-placement`
//! work offline, on logs and meshes, and draw with `isotherm-html`. The rooms of this crate, from the wire up:
//!
//! - [`clock`] — the only one who knows what time it is: the wall's, or a virtual one that tests and the demo turn.
//! - [`tls`] — what is wrong with the other end's certificate, or with ours, in words.
//! - [`fieldbus`] — one task owns a line; one way to ask a device, over Modbus or CAN.
//! - [`gateway`] — polls, hands readings to the pure steps, carries out what they want, keeps state and logs.
//! - [`observe`] — events, status, metrics and the page: what people and programs see of a running gateway.
//! - [`discovery`] — a line without a profile: which units answer, and what stands in a register.
//! - [`virtual_machine`] — the hardware that is not there: devices, plants and faults by script.
//! - [`cli`] — the verbs, one small file each.
//!
//! Further left knows nothing of further right; `tests/rules/main.rs` holds what Cargo cannot:
//!
//! ```text
//! clock ← fieldbus ← gateway ← cli        clock, fieldbus's socket of CAN and faults ← virtual_machine ← cli
//! clock ← observe ← cli                   observe's events, askers and status ← gateway
//! fieldbus ← discovery ← cli              tls ← { fieldbus, observe }
//! ```
//!
//! Begin reading in `isotherm_core::compensation`, then `isotherm_core::output`, then [`gateway`].

pub mod cli;
pub mod clock;
pub mod discovery;
pub mod fieldbus;
pub mod gateway;
pub mod observe;
pub mod tls;
pub mod virtual_machine;
