//! isotherm holds a machine tool to its cold geometry.
//!
//! # Layout
//! An arrow points from who knows to who is known, and only to the left; `tests/house.rs` holds the table and fails
//! where a `crate::` path runs the other way.
//!
//! ```text
//! quantity ← reading ← { codec, compensation } ← profile ← fieldbus ← gateway ← cli
//! quantity ← clock ← { fieldbus, gateway, virtual_machine, cli }
//! quantity ← output                                             nobody knows it yet: gateway is to
//! quantity, the states of compensation ← observe ← cli           observe's events and status ← gateway
//! { codec, profile, clock } ← virtual_machine ← cli              nobody else knows virtual_machine
//! { codec, profile, fieldbus } ← survey ← cli                    nobody else knows survey
//! { compensation, profile, sheet } ← identify ← cli            nobody else knows identify
//! sheet ← placement ← cli                                      nobody else knows placement
//! quantity ← sheet: pages for people
//! { profile, the read plan of fieldbus } ← explain ← cli         nobody else knows explain
//! ```
//!
//! fieldbus and compensation never know each other. compensation and output have no tokio, no input or output and no
//! clock: time is an argument of their steps. Only clock knows what time it is.

pub mod cli;
pub mod clock;
pub mod codec;
pub mod compensation;
pub mod explain;
pub mod fieldbus;
pub mod gateway;
pub mod identify;
pub mod observe;
pub mod output;
pub mod placement;
pub mod profile;
pub mod quantity;
pub mod reading;
pub mod sheet;
pub mod survey;
pub mod virtual_machine;
