//! isotherm holds a machine tool to its cold geometry.
//!
//! # Layout
//! Arrows only point left; a test reads the `use` lines and fails where one runs the other way.
//!
//! ```text
//! quantity ← reading ← { codec, compensation } ← profile ← fieldbus ← gateway ← cli
//! clock ← { fieldbus, gateway, virtual_machine }      observe ← gateway: events and the state they tell
//! explain ← cli      virtual_machine ← cli            compensation: no tokio, no I/O, no clock
//! ```

pub mod cli;
pub mod clock;
pub mod codec;
pub mod compensation;
pub mod explain;
pub mod fieldbus;
pub mod gateway;
pub mod observe;
pub mod profile;
pub mod quantity;
pub mod reading;
pub mod virtual_machine;
