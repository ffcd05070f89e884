//! Exhaustive search of the pure step from a decision to a register. Line, device, operator, disk and kills behave
//! arbitrarily, but the register never moves by more than a step.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod allocates;
mod budget;
mod moves;
mod pair;
mod rig;
mod rows;
mod search;
mod searched;
mod second;
mod set;
mod set_world;
mod traces;
mod world;
