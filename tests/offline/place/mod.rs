//! `isotherm place` as a person starts it, on a column of our own.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::calculix;
mod column;
mod found;
use crate::support::process;
mod wrong;
