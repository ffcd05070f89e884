//! README and the manual say what is so: each profile in them is taken, each command runs, each link leads somewhere.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod beside;
mod book;
#[path = "../certificates/mod.rs"]
mod certificates;
mod commands;
mod generated;
mod links;
#[path = "../process/mod.rs"]
mod process;
mod profiles;
#[path = "../device/server.rs"]
#[allow(dead_code, reason = "each of the tests uses its part")]
mod server;
mod shop;
mod tables;
#[path = "../sysfs/tree.rs"]
#[allow(dead_code, reason = "each of the tests uses its part")]
mod tree;
