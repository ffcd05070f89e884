//! Modbus RTU and Modbus ASCII on real pseudo-terminals and sockets: late, lost and garbled answers, dead units,
//! unplugged ports.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]
#![allow(clippy::disallowed_types, reason = "a real line takes the wall's time")]

mod answers;
mod plugs;
mod port;
mod second_master;
mod shared_line;
