//! Offline: from a finite-element mesh of a structure to where its temperature sensors belong.

pub mod methods;
mod parallel;
pub mod problem;
