//! Offline placement of temperature sensors, from a finite-element mesh of a structure.
//!
//! ```text
//! fe_input ── mesh ──┬── heat ──────── temperatures of each load case
//! (the files)        └── structure ─── displacements, and the sensitivity of the guideway to every node
//!
//! blocks ──┬── problem ── methods ── study ──┬── report    drawings
//! (sets,   │   (P, δ1)   (nodes)  (residuals)└── export    P and the model's block for a profile
//!  cuts)   └── one temperature each
//! ```
//! The matrix P contains the displacement of the guideway for each block that is 1 K warmer. δ1 is the
//! displacement of the guideway in a load case.
//!
//! # Units
//! The units are those of an FE input file in millimetres, newtons, seconds, tonnes and kelvin:
//!
//! - coordinates and displacements in mm, Young's modulus in MPa, density in t/mm³, specific heat in mJ/(t·K);
//! - conductivity in mW/(mm·K), which has the same number as W/(m·K), and film coefficients in mW/(mm²·K);
//! - surface fluxes in mW/mm², nodal fluxes in mW, temperatures in °C.
//!
//! A file does not state its units. The reader rejects a material value that is only plausible in other units.

pub mod blocks;
pub mod body;
pub mod ccx;
pub mod divisions;
pub mod example;
pub mod export;
pub mod fe_input;
pub mod grid;
pub mod guide_line;
pub mod heat;
pub mod mesh;
pub mod methods;
pub mod problem;
pub mod reduced;
pub mod report;
pub mod structure;
pub mod study;
pub mod views;
pub mod write;

mod drawing;
mod element;
mod graph;
mod parallel;
mod restraint;
mod system;

// The module `bodies` is shared with the external tests, and uses the name of this crate.
#[cfg(test)]
extern crate self as isotherm_placement;

#[cfg(test)]
#[path = "../tests/bodies/mod.rs"]
mod bodies;
