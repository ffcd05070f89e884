//! What a gateway must never take for an answer: replies that were there before the question, wrong ones, late ones. Each
//! of a hundred attempts carries a temperature, or an echo, that no right answer has.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::disallowed_types, reason = "real sockets and ports take the wall's time")]

mod before;
mod late;
mod peer;
mod question;
mod rig;
mod table;
mod wrong;
