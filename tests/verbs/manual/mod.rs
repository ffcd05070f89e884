//! README and the manual say what is so: each profile in them is taken, each command runs, each link leads somewhere.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod beside;
mod book;
use crate::support::certificates;
mod commands;
mod generated;
mod links;
use crate::support::process;
mod profiles;
use crate::support::device::server;
mod shop;
mod tables;
use crate::support::tree;
