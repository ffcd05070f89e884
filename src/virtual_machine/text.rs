//! Virtual devices that send lines of text: readouts, gauges, and DCON modules (input modules with an ASCII protocol).
//!
//! The hardware of the virtual machine has registers. Each value of a text is therefore stored in registers, at an
//! address that `group` assigns. Plant, faults and counters of requests then apply to the value as to any other. The
//! answer of the registers, with its fault, then becomes text.
//!
//! - `group` — values of one answer, and their registers. `answer` — their text, with its faults.
//! - `line` — the conversation with a client. `server` and `terminal` — sockets and pseudo-terminals.

mod answer;
mod group;
mod line;
mod server;
mod terminal;
#[cfg(test)]
mod tests;

pub(super) use group::{TextGroup, in_registers};
pub(super) use line::{Ask, TextLine};
pub(super) use server::serve;
pub(super) use terminal::serve as serve_port;
