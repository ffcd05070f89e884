//! Tests of the shipped profiles with their plants, without sockets. No other gains are clearly better on the days from
//! which theirs were identified, and theirs are valid on other days. `profiles/identify --check` identifies them again
//! to the digit.

mod fit;
mod machines;
mod rig;

/// The first days that `profiles/identify` records.
const RECORDED: [u64; 4] = [101, 102, 103, 104];
