//! Tests of the offline verbs: from logs and meshes to models, sensor places and reports.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "../support/mod.rs"]
mod support;

#[path = "../../crates/placement/tests/bodies/mod.rs"]
mod bodies;
mod end_to_end;
#[cfg(feature = "parquet")]
mod export;
mod identify;
#[cfg(all(feature = "parquet", feature = "tables"))]
mod logs;
#[cfg(feature = "onnx")]
mod onnx;
mod place;
mod placement;
mod report;
