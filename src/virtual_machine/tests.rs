use super::*;

mod can;
mod client;
mod faults;
mod machine;
mod shipped;
pub(super) mod support;

use client::Client;
use support::{CNC, THERMOCOUPLES, profile, start};
