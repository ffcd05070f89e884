//! Replies that a gateway must never accept: early, wrong and late ones.
//!
//! Each of a hundred attempts has a temperature, or an echo, that no correct answer has.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::disallowed_types, reason = "real sockets and ports take the wall's time")]

mod before;
mod late;
mod peer;
mod question;
mod rig;
mod table;
mod wrong;
