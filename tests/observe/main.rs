//! Tests of the page, the API, metrics, and everything that is published.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

mod api;
mod http;
#[cfg(feature = "mqtt")]
mod mqtt;
mod notify;
#[cfg(feature = "opcua")]
mod opcua_server;
mod page;
mod pages;
mod prometheus;
mod shell;
