//! Thermal compensation gateway for machine tools.
//!
//! # Modules
//! The decisions are made in separate crates, so that Cargo enforces their dependencies. `isotherm-core` depends on no
//! other crate of the project, and `isotherm-profile` only on `isotherm-core`. No crate in `crates` depends on tokio,
//! rustls or clap. `isotherm-identify` and `isotherm-placement` work offline, on logs and meshes, and draw with
//! `isotherm-html`. `isotherm-plant` converts between the state of the gateway and MQTT messages. The modules of this
//! crate:
//!
//! - [`clock`] — the only source of time: wall-clock time, or virtual time in tests and in the demo.
//! - [`tls`] — explanations of failed TLS handshakes.
//! - [`net`] — connections to servers: name lookup, TCP and TLS.
//! - [`fieldbus`] — communication with devices over Modbus, CAN or OPC UA. One task owns each line.
//! - [`gateway`] — polls devices, gives the readings to the functions of `isotherm-core`, executes the resulting
//!   actions, keeps state and logs.
//! - [`observe`] — events, status, metrics and the web page, for users and programs.
//! - [`discovery`] — search on a line without a profile: which units answer, and the values of their registers.
//! - [`virtual_machine`] — virtual hardware: devices, simulated machines, and scripts of faults.
//! - [`cli`] — the verbs of the command line, one file each.
//!
//! In this diagram, `a ← b` means that the module `b` uses the module `a`. `tests/rules/main.rs` checks these
//! dependencies.
//!
//! ```text
//! clock ← fieldbus ← gateway ← cli        clock, CAN socket, OPC UA values, faults ← virtual_machine ← cli
//! clock ← observe ← cli                   events, requesters and status of observe ← gateway
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
