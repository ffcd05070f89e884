#![no_main]
#![allow(dead_code)]

#[path = "../../corpus/targets.rs"]
mod targets;

libfuzzer_sys::fuzz_target!(|data: &[u8]| targets::tables(data));
