//! Offline: from a finite-element mesh of a structure to where its temperature sensors belong.
//!
//! ```text
//! deck ── mesh ──┬── heat ──────── temperatures of each load case
//! (file, words)  └── structure ─── displacements, and the sensitivity of the guideway to every node
//!
//! blocks ──┬── problem ── methods ── found ──┬── report    pictures
//! (sets,   │   (P, δ1)   (nodes)   (errors)  └── written   P and the model's block for a profile
//!  cuts)   └── one temperature each
//! ```
//!
//! # Units
//! Those of a deck in millimetres, newtons, seconds, tonnes and kelvin: coordinates and displacements in mm, Young's
//! modulus in MPa, density in t/mm³, specific heat in mJ/(t·K), conductivity in mW/(mm·K) (the same number as
//! W/(m·K)), film coefficients in mW/(mm²·K), surface fluxes in mW/mm², nodal fluxes in mW, temperatures in °C.
//! A number alone does not tell its unit; the reader refuses moduli and expansions that only fit another system.

pub mod blocks;
pub mod body;
pub mod ccx;
pub mod deck;
pub mod example;
pub mod found;
pub mod grid;
pub mod heat;
pub mod layout;
pub mod mesh;
pub mod methods;
pub mod problem;
pub mod reduced;
pub mod report;
pub mod structure;
pub mod views;
pub mod write;
pub mod written;

mod element;
mod graph;
mod restraint;
mod system;

// The column names this crate as the tests outside do, which share it.
#[cfg(test)]
extern crate self as isotherm_placement;

#[cfg(test)]
#[path = "../tests/column/mod.rs"]
mod column;
#[cfg(test)]
mod samples;
