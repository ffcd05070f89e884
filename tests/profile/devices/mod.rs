//! Device templates: decoding, settings, and mistakes that are reported before arming.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::path::Path;

use isotherm_profile::{Errors, Loaded, Profile, parse};

mod can;
mod decoded;
mod opcua;
mod shipped;
mod text;

/// Returns the text of a machine with one device.
fn around(device: &str, rest: &str) -> String {
    format!(
        "[machine]\nname = \"bench\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"\n\
         [device.d]\nbus = \"cell\"\nunit = 1\n{device}\n{rest}\n"
    )
}

fn taken(device: &str, rest: &str) -> Result<Loaded, Errors> {
    parse(Path::new("machine.toml"), &around(device, rest), &[], &[])
}

#[track_caller]
fn profile(device: &str, rest: &str) -> Profile {
    taken(device, rest).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Returns a profile with a device of one template and one signal.
#[track_caller]
fn signal(device: &str, channel: &str, more: &str) -> Profile {
    profile(device, &format!("[signal.s]\ndevice = \"d\"\nchannel = {channel}\n{more}"))
}
