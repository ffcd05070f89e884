//! Benchmark of identification: 43 runs of six hours, 24 sensors with the usual lags, and two axes.
//!
//! Every run is held out in turn, and every choice is made on inner folds. The benchmark measures each linear method
//! that is compared, the default method with substitutes for the sensors, and a network on 24 days. It prints seconds
//! and peak memory, each with its limit and reached or MISSED.
//!
//! Run it with `cargo bench --bench identify`; progress goes to stderr.

#![allow(clippy::unwrap_used, reason = "a bench that cannot go on fails")]

use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;
use isotherm_identify::dataset::{Column, Dataset, Kind, Run};
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::{Identified, identify};
use isotherm_profile::Profile;
use rand::{RngExt, SeedableRng};

const RUNS: u64 = 43;
const MINUTES: u64 = 6 * 60;
const SENSORS: usize = 24;
/// Limits of elapsed time on two cores: all linear methods with both axes; a network on 24 of the days with one axis.
const LINEAR_SECONDS: f64 = 5.0;
const NETWORK_SECONDS: f64 = 20.0;
const NETWORK_DAYS: usize = 24;
/// Limits of processor time: the default method for one axis; the same with the substitutes of each sensor.
const DEFAULT_SECONDS: f64 = 5.0;
const WHOLE_SECONDS: f64 = 20.0;
const MEGABYTES: f64 = 500.0;
const LINEAR: [Method; 5] =
    [Method::Whitened, Method::Ols, Method::Stepwise, Method::SparseLag, Method::RidgeLag];

fn main() {
    let profile = machine();
    let mut dataset = campaign();
    let clock = Clock::wall();
    // Returns elapsed time and processor time.
    let spent = |what: &mut dyn FnMut()| {
        let (begun, before) = (clock.now(), processor_seconds());
        what();
        eprint!("\r");
        (clock.now().since(begun).as_secs_f64(), processor_seconds() - before)
    };
    let (mut total, mut processor, mut default) = (0.0, 0.0, 0.0);
    for method in LINEAR {
        let mut ranges = Vec::new();
        let (seconds, own) = spent(&mut || {
            for axis in ["y", "z"] {
                let found = identified(&profile, &dataset, axis, method, false);
                let (left, before) = (found.means.mean_range_um, found.uncompensated.mean_range_um);
                ranges.push(format!("{axis} {left:.1} of {before:.1} µm"));
            }
        });
        (total, processor) = (total + seconds, processor + own);
        if method == Method::default() {
            default = 0.5 * own;
        }
        let ranges = ranges.join(", ");
        println!(
            "{:<10} {seconds:6.2} s ({own:.2} s of processor time)   mean held-out range: {ranges}",
            method.name()
        );
    }
    let is_in_time = reached(total, LINEAR_SECONDS);
    println!(
        "all linear {total:6.2} s ({processor:.2} s of processor time), at most {LINEAR_SECONDS} s by the clock on two cores: {is_in_time}"
    );
    let assessed = reached(default, DEFAULT_SECONDS);
    println!(
        "whitened   {default:6.2} s of processor time for an axis, at most {DEFAULT_SECONDS} s: {assessed}"
    );
    let (_, whole) = spent(&mut || drop(identified(&profile, &dataset, "z", Method::Whitened, true)));
    let assessed = reached(whole, WHOLE_SECONDS);
    println!(
        "whitened   {whole:6.2} s of processor time with what stands in for its sensors, at most {WHOLE_SECONDS} s: {assessed}"
    );
    dataset.runs.truncate(NETWORK_DAYS);
    let mut left = 0.0;
    let (network, own) = spent(&mut || {
        left = identified(&profile, &dataset, "z", Method::Network, false).means.mean_range_um;
    });
    let assessed = reached(network, NETWORK_SECONDS);
    println!(
        "network    {network:6.2} s ({own:.2} s of processor time) for {NETWORK_DAYS} days, at most {NETWORK_SECONDS} s by the clock on \
         two cores: {assessed}; z {left:.1} µm"
    );
    let peak = peak_megabytes();
    println!("{peak:17.0} MB at its peak, at most {MEGABYTES} MB: {}", reached(peak, MEGABYTES));
}

fn identified(
    profile: &Profile,
    dataset: &Dataset,
    axis: &str,
    method: Method,
    is_whole: bool,
) -> Identified {
    let choice =
        Choice { axis: Some(axis.to_owned()), resample: Duration::from_secs(60), ..Choice::default() };
    let ready = ready(profile, dataset, &choice).unwrap();
    assert_eq!(ready.notes.excluded, []);
    let progress = |done: usize, all: usize| eprint!("\r{method} {axis}: {done} of {all} runs   ");
    let settings = Settings { method, ..Settings::default() };
    identify(&ready, &settings, None, is_whole, &progress).unwrap()
}

fn reached(figure: f64, most: f64) -> &'static str {
    if figure <= most { "reached" } else { "MISSED" }
}

/// Profile with the signals, and two axes whose models are not known yet.
fn machine() -> Profile {
    let mut text = "[machine]\nname = \"bench\"\nsettle = \"3min\"\n[bus.cell]\ntype = \"modbus-tcp\"\n\
                    address = \"127.0.0.1:1502\"\ntimeout = \"300ms\"\n[device.module]\nbus = \"cell\"\nunit = 1\n\
                    every = \"1s\"\n"
        .to_owned();
    for sensor in 0..SENSORS {
        text += &format!(
            "[signal.t{sensor}]\ndevice = \"module\"\nregister = \"input:{sensor}\"\ntype = \"i16\"\nscale = 0.1\n\
             unit = \"degC\"\nrange = [-10.0, 90.0]\nmax_age = \"5s\"\n"
        );
    }
    for axis in ["y", "z"] {
        text += &format!(
            "[axis.{axis}]\nlimit = 100.0\nstep = 1.0\nrate = 0.5\nevery = \"10s\"\non_fault = {{ action = \"hold\" }}\n\
             [[axis.{axis}.model]]\nname = \"none yet\"\nkind = \"linear\"\noffset = 0.0\n\
             terms = [{{ signal = \"t0\", gain = 1.0, reference = \"start\" }}]\n"
        );
    }
    isotherm_profile::parse(Path::new("bench.toml"), &text, &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}"))
        .profile
}

/// Simulated data: sensors that follow three sources of heat, each with its own time constant, and errors that follow
/// some of them with a delay.
fn campaign() -> Dataset {
    let mut chance = rand_pcg::Pcg64::seed_from_u64(43);
    let mut runs = Vec::new();
    for run in 0..RUNS {
        let load =
            [chance.random_range(4.0..12.0), chance.random_range(1.0..5.0), chance.random_range(-2.0..3.0)];
        let mut values = vec![Vec::new(); SENSORS + 2];
        let mut late = [0.0_f64; 3];
        let mut wander = [0.0_f64; SENSORS + 2];
        for minute in 0..MINUTES {
            let runs = minute / 90 % 2 == run % 2;
            for (source, late) in late.iter_mut().enumerate() {
                let wanted = if runs || source == 2 { load[source] } else { 0.0 };
                *late += (wanted - *late) / [15.0, 60.0, 240.0][source];
            }
            for (place, values) in values.iter_mut().enumerate() {
                wander[place] = 0.98 * wander[place] + chance.random_range(-0.02..0.02);
                let share = |source: usize| ((place * 7 + source * 11) % 10) as f64 / 10.0;
                let sum: f64 = (0..3).map(|source| share(source) * late[source]).sum();
                values.push(if place < SENSORS {
                    20.0 + sum + wander[place]
                } else {
                    3.0 * sum + 10.0 * wander[place]
                });
            }
        }
        let times = (0..MINUTES).map(|minute| Moment::from_nanos(minute * 60_000_000_000)).collect();
        runs.push(Run::recorded(format!("run {run}"), "bench".into(), times, values));
    }
    let sensors = (0..SENSORS).map(|place| Column { name: format!("t{place}"), kind: Kind::Temperature });
    let errors =
        ["y_error_um", "z_error_um"].map(|name| Column { name: name.to_owned(), kind: Kind::Displacement });
    Dataset { columns: sensors.chain(errors).collect(), runs, ..Dataset::default() }
}

/// Peak memory of this process, in MB.
fn peak_megabytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1000.0
}

/// Processor time of all threads, in seconds. It stays comparable on a busy computer.
fn processor_seconds() -> f64 {
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    // User and system time are the 14th and 15th field; the 3rd is the first after the name.
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_SECOND
}
