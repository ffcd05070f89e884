//! The shipped profiles against their plants, without sockets: no other gains are clearly better on the days on which
//! theirs were identified, and they hold on others. `profiles/identify --check` finds them again to the digit.

mod fit;
mod machines;
mod rig;

/// The first of the days that `profiles/identify` records.
const RECORDED: [u64; 4] = [101, 102, 103, 104];
