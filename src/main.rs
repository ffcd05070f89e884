//! The isotherm command line.
fn main() {}
