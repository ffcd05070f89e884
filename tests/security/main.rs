//! Attacks on a gateway, and their results. Each module contains one kind of attack.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

mod another_user;
mod corpus;
mod crowd;
mod files;
mod https;
mod layers;
mod leaving;
mod on_time;
mod port;
mod posted;
mod proxied;
mod rates;
mod requests;
mod rig;
mod site;
mod starved;
#[path = "../support/mod.rs"]
mod support;
mod unseen;
mod who;

use support::{certificates, device, encode, fake, process};
