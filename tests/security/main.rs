//! What somebody tries who means no good, and what stands afterwards. Each module is one kind of attack.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on fails")]

mod another_user;
#[path = "../certificates/mod.rs"]
mod certificates;
mod crowd;
#[path = "../device/mod.rs"]
mod device;
#[path = "../onnx/encode.rs"]
#[allow(dead_code, reason = "others write whole networks")]
mod encode;
#[path = "../http/fake.rs"]
mod fake;
mod files;
mod https;
mod layers;
mod leaving;
mod on_time;
mod port;
mod posted;
#[path = "../process/mod.rs"]
mod process;
mod rates;
mod requests;
mod rig;
mod site;
mod starved;
mod unseen;
mod who;
