//! Tests of `isotherm place` as a user starts it, on the column of the test bodies.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::calculix;
mod column;
mod converted;
mod decks;
mod found;
use crate::support::process;
mod wrong;
