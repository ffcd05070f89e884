//! Days of a simulated machine with known parameters, as logs in a directory, and its profile.

use std::path::{Path, PathBuf};

use isotherm_identify::dataset::{BadLog, Dataset, Split, every_column};
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Choice, Ready, ready};
use isotherm_identify::{Identified, identify};
use isotherm_profile::{Profile, ProfileError};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Contribution of one sensor to the error: µm per °C, through a lag with this time constant in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub(crate) sensor: usize,
    pub(crate) gain: f64,
    pub(crate) constant: f64,
}

/// A machine with sensors; the other properties of a day are random.
#[derive(Clone, Debug)]
pub(crate) struct Machine {
    pub(crate) sensors: usize,
    pub(crate) parts: Vec<Part>,
    /// Time between two rows, s.
    pub(crate) step: f64,
    pub(crate) rows: usize,
    /// Standard deviation of the probe, µm.
    pub(crate) noise: f64,
}

/// One day, with temperatures and an error for each time.
#[derive(Clone, Debug)]
pub(crate) struct Day {
    pub(crate) times: Vec<f64>,
    pub(crate) temperatures: Vec<Vec<f64>>,
    pub(crate) error: Vec<f64>,
}

impl Machine {
    pub(crate) fn day(&self, seed: u64) -> Day {
        let mut chance = Pcg64Mcg::seed_from_u64(seed);
        let times: Vec<f64> = (0..self.rows).map(|row| row as f64 * self.step).collect();
        // Each sensor warms towards random values with its own time constant, in four periods.
        let temperatures: Vec<Vec<f64>> = (0..self.sensors)
            .map(|_| {
                let pace: f64 = chance.random_range(900.0..5400.0);
                let ends: Vec<f64> = (0..4).map(|_| chance.random_range(0.0..8.0)).collect();
                let cold: f64 = chance.random_range(19.0..22.0);
                let mut now = cold;
                (0..self.rows)
                    .map(|row| {
                        if row as f64 * self.step > 300.0 {
                            let end = cold + ends[row * 4 / self.rows];
                            now += (1.0 - (-self.step / pace).exp()) * (end - now);
                        }
                        now
                    })
                    .collect()
            })
            .collect();
        let mut error = vec![0.0; self.rows];
        for part in &self.parts {
            let input = &temperatures[part.sensor];
            let mut follower = input[0];
            for row in 0..self.rows {
                if row > 0 && part.constant > 0.0 {
                    // Exact solution for a straight line between two rows.
                    let share = self.step / part.constant;
                    let gone = 1.0 - (-share).exp();
                    let (before, now) = (input[row - 1], input[row]);
                    follower += gone * (before - follower) + (1.0 - gone / share) * (now - before);
                } else {
                    follower = input[row];
                }
                error[row] += part.gain * (follower - input[0]);
            }
        }
        for value in &mut error {
            // The sum of four uniform random numbers is nearly normal.
            let sum: f64 = (0..4).map(|_| chance.random_range(-1.0..1.0)).sum();
            *value += self.noise * sum * (3.0_f64 / 4.0).sqrt();
        }
        Day { times, temperatures, error }
    }
}

impl Day {
    pub(crate) fn log(&self) -> String {
        let names: Vec<String> = (0..self.temperatures.len()).map(|place| format!("s{place}")).collect();
        let mut log = format!("time,{},z_error_um\n", names.join(","));
        for (row, time) in self.times.iter().enumerate() {
            let cell = |value: f64| if value.is_nan() { String::new() } else { value.to_string() };
            let values: Vec<String> = self.temperatures.iter().map(|sensor| cell(sensor[row])).collect();
            log += &format!("{time},{},{}\n", values.join(","), cell(self.error[row]));
        }
        log
    }
}

/// Profile with these signals and this model.
pub(crate) fn profile_with(sensors: usize, model: &str) -> String {
    let mut text = "[machine]\nname = \"bench\"\nsettle = \"3min\"\n[bus.b]\ntype = \"modbus-tcp\"\n\
                    address = \"127.0.0.1:1502\"\ntimeout = \"300ms\"\n[device.m]\nbus = \"b\"\nunit = 1\n\
                    every = \"1s\"\n"
        .to_owned();
    for place in 0..sensors {
        text += &format!(
            "[signal.s{place}]\ndevice = \"m\"\nregister = \"input:{}\"\ntype = \"f32\"\n\
             word_order = \"msw-first\"\nunit = \"degC\"\nmax_age = \"5s\"\n",
            2 * place
        );
    }
    text + "[axis.z]\nlimit = 500.0\nstep = 500.0\nrate = 500.0\nevery = \"10s\"\non_fault = { action = \"hold\" }\n"
        + model
        + "\n[output.z]\naxis = \"z\"\ndevice = \"m\"\nwrites = \"offset\"\nregister = \"holding:100\"\n\
           type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.001\nverify = \"read-back\"\n"
}

pub(crate) const NO_MODEL: &str = "[[axis.z.model]]\nname = \"none yet\"\nkind = \"linear\"\n\
                                   terms = [ { signal = \"s0\", gain = 0.0, reference = \"start\" } ]\n";

pub(crate) fn profile(sensors: usize) -> Profile {
    parsed(Path::new("bench.toml"), &profile_with(sensors, NO_MODEL))
}

pub(crate) fn parsed(path: &Path, text: &str) -> Profile {
    isotherm_profile::parse(path, text, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Loads a profile with these files next to it, as the gateway does.
pub(crate) fn pasted(text: &str, files: &[(String, String)]) -> Profile {
    let directory = tempfile::tempdir().unwrap();
    for (name, content) in files {
        std::fs::write(directory.path().join(name), content).unwrap();
    }
    let path = directory.path().join("pasted.toml");
    std::fs::write(&path, text).unwrap();
    let loaded = isotherm_profile::load(&path, &[], &[]).unwrap_or_else(|errors| panic!("{errors}\n{text}"));
    let of_model = loaded.warnings.iter().filter(|warning| warning.key.starts_with("axis.z.model"));
    assert_eq!(
        of_model.collect::<Vec<_>>(),
        Vec::<&ProfileError>::new(),
        "what is written is taken without a word: {text}"
    );
    loaded.profile
}

/// Writes the logs of these days to a directory, and returns their paths in order.
pub(crate) fn logs(directory: &Path, days: &[String]) -> Vec<PathBuf> {
    let write = |(place, log): (usize, &String)| {
        let path = directory.join(format!("day{place}.csv"));
        std::fs::write(&path, log).unwrap();
        path
    };
    days.iter().enumerate().map(write).collect()
}

pub(crate) fn dataset(days: &[String]) -> Result<Dataset, BadLog> {
    let directory = tempfile::tempdir().unwrap();
    Dataset::read(&logs(directory.path(), days), &Split::default(), &|_| None, &every_column)
}

pub(crate) fn choice() -> Choice {
    Choice { resample: std::time::Duration::from_secs(60), ..Choice::default() }
}

pub(crate) fn found(sensors: usize, days: &[String], settings: &Settings) -> Identified {
    let dataset = dataset(days).unwrap();
    let ready: Ready<'_> = ready(&profile(sensors), &dataset, &choice()).unwrap();
    identify(&ready, settings, None, true, &|_, _| {}).unwrap()
}

/// Error message of `identify` for these days.
pub(crate) fn refused(sensors: usize, days: &[String], choice: &Choice) -> String {
    match dataset(days) {
        Err(wrong) => wrong.to_string(),
        Ok(dataset) => ready(&profile(sensors), &dataset, choice).expect_err("it is refused").to_string(),
    }
}
