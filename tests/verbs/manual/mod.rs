//! Tests of README and the manual: each profile is accepted, each command runs, each link works.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod beside;
mod book;
use crate::support::certificates;
mod commands;
mod first_day;
mod generated;
mod links;
use crate::support::process;
mod profiles;
use crate::support::device::server;
mod shop;
mod tables;
use crate::support::tree;
