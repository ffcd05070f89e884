//! Thermal compensation gateway for machine tools.
//!
//! # Modules
//! The decisions are in separate crates, so that Cargo enforces their dependencies. `isotherm-core` depends on no other
//! crate of the project, and `isotherm-profile` on core. No crate in `crates` depends on tokio, rustls or clap.
//! `isotherm-identify` and `isotherm-placement` work offline, on logs and meshes, and draw with `isotherm-html`.
//! `isotherm-plant` converts between the state and MQTT messages. The modules of this crate:
//!
//! - [`clock`] — the only source of time: wall-clock time, or virtual time in tests and in the demo.
//! - [`tls`] — causes of failed TLS handshakes.
//! - [`net`] — connections to servers: name lookup, TCP and TLS.
//! - [`fieldbus`] — communication with devices over Modbus, CAN or OPC UA. One task owns each line.
//! - [`gateway`] — polls devices, passes readings to the pure steps, executes their actions, keeps state and logs.
//! - [`observe`] — events, status, metrics and the web page, for users and programs.
//! - [`discovery`] — a line without a profile: which units answer, and the values of registers.
//! - [`virtual_machine`] — virtual hardware: devices, plants, and faults by script.
//! - [`cli`] — the verbs, one file each.
//!
//! An arrow points from a module to one that it uses. `tests/rules/main.rs` checks these dependencies.
//!
//! ```text
//! clock ← fieldbus ← gateway ← cli        clock, the CAN socket and faults of fieldbus ← virtual_machine ← cli
//! clock ← observe ← cli                   events, askers and status of observe ← gateway
//! fieldbus ← discovery ← cli              tls ← net ← { fieldbus, observe }
//! ```
//!
//! Begin reading in `isotherm_core::compensation`, then `isotherm_core::output`, then [`gateway`].

pub mod cli;
pub mod clock;
pub mod discovery;
pub mod fieldbus;
pub mod gateway;
pub mod net;
pub mod observe;
pub mod tls;
pub mod virtual_machine;
