//! The gateway with all its functions: quality, model, guard, and the echo of each write.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options, Pace};

use super::Work;

/// Runs the gateway without pauses, with a step of the axis in each loop, and up to `pipeline` requests under way.
pub(super) fn closed_loop(port: u16, pipeline: u8) {
    let work = Work { devices: 1, period: Duration::from_secs(1), reads_only: false };
    let polls = Duration::from_micros(1);
    run(
        profile(port, &work, pipeline),
        Options { pace: Some(Pace { polls, axes: polls }), ..Options::default() },
    );
}

pub(super) fn fleet(port: u16, work: &Work) {
    run(profile(port, work, 1), Options::default());
}

fn run(text: String, options: Options) {
    let loaded = isotherm_profile::parse(Path::new("peers.toml"), &text, &[], &[]);
    // The verb `run` reads the profile from a file, and does not keep its text either.
    drop(text);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), options);
        gateway.run(std::future::pending(), std::future::pending()).await;
    });
}

/// Profile in which each device has its own bus, axis and output: each read is followed by the write of a corrected
/// position.
fn profile(port: u16, work: &Work, pipeline: u8) -> String {
    let period = humantime::format_duration(work.period);
    let timeout = humantime::format_duration(work.period.mul_f64(0.9).min(Duration::from_millis(300)));
    let mut text = String::from("[machine]\nname = \"peers\"\narm = \"auto\"\n");
    for device in 0..work.devices {
        write!(
            text,
            "[bus.b{device}]\ntype = \"modbus-tcp\"\naddress = \"127.0.{}.{}:{port}\"\ntimeout = \"{timeout}\"\n\
             pipeline = {pipeline}\n[device.d{device}]\nbus = \"b{device}\"\nunit = 1\nevery = \"{period}\"\n",
            device / 250,
            device % 250 + 1
        )
        .unwrap();
        for (register, (unit, scale)) in [("degC", 0.1); 7].into_iter().chain([("mm", 0.01)]).enumerate() {
            write!(
                text,
                "[signal.s{device}_{register}]\ndevice = \"d{device}\"\nregister = \"input:{register}\"\n\
                 type = \"i16\"\nscale = {scale}\nunit = \"{unit}\"\nmax_age = \"5s\"\n"
            )
            .unwrap();
        }
        write!(
            text,
            "[axis.z{device}]\nlimit = 40.0\nstep = 5.0\nrate = 20.0\nevery = \"{period}\"\n\
             on_fault = {{ action = \"hold\" }}\n[[axis.z{device}.model]]\nname = \"difference\"\nkind = \"linear\"\n\
             terms = [ {{ signal = \"s{device}_0\", gain = 2.4, reference = 0.0 }}, \
             {{ signal = \"s{device}_1\", gain = -2.4, reference = 0.0 }} ]\n"
        )
        .unwrap();
        if work.reads_only {
            continue;
        }
        write!(
            text,
            "[output.o{device}]\naxis = \"z{device}\"\ndevice = \"d{device}\"\nregister = \"holding:10\"\n\
             type = \"i16\"\nverify = \"echo\"\nwrites = \"corrected\"\nposition = \"s{device}_7\"\nscale = 0.01\n"
        )
        .unwrap();
    }
    text
}
