//! `isotherm identify` on machines whose truth is known.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]
#![allow(clippy::cast_precision_loss, reason = "rows of a test")]

mod balls;
mod command;
mod drift;
mod faulty;
mod fleet;
mod freezes;
mod frozen_days;
mod gaps;
mod harm;
mod into_profile;
mod learned;
mod lost;
mod position;
mod prior;
mod recovered;
mod rig;
mod runs;
mod speed;
mod stated;
mod touched;
mod trained;
mod whitened;
mod wrong;
