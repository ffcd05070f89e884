//! Counterparts and helpers that several tests share.

#![allow(dead_code, unused_imports, reason = "each test program uses its part")]

pub(crate) mod calculix;
pub(crate) mod certificates;
pub(crate) mod device;
pub(crate) mod encode;
pub(crate) mod fake;
pub(crate) mod process;
pub(crate) mod tree;
