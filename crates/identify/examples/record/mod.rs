//! Log files, signals and profiles of the two public data sets that the examples read: a machining centre (mill) and a
//! positioning machine (stage).

use std::path::{Path, PathBuf};

use isotherm_profile::Profile;

/// Makes the text of a placeholder model block for a profile. Its only term is the signal `signal`.
fn no_model(signal: &str) -> String {
    format!(
        "[[axis.z.model]]\nname = \"none yet\"\nkind = \"linear\"\noffset = 0.0\n\
         terms = [{{ signal = \"{signal}\", gain = 1.0, reference = \"start\" }}]\n"
    )
}

/// Returns the log files of the mill and of the stage from the command line. If the command line names no file, prints
/// the usage and returns `None`.
pub(crate) fn files(example: &str) -> Option<[Vec<PathBuf>; 2]> {
    let mut files: [Vec<PathBuf>; 2] = [Vec::new(), Vec::new()];
    let mut which = 0;
    for word in std::env::args().skip(1) {
        match word.as_str() {
            "--mill" => which = 0,
            "--stage" => which = 1,
            file => files[which].push(file.into()),
        }
    }
    if files.iter().all(Vec::is_empty) {
        eprintln!(
            "{example} --mill CYCLE.csv … --stage DAY.csv …: give the files of one data set or of both. The \
             head of the example held_out describes the data sets"
        );
        return None;
    }
    Some(files)
}

/// Returns the names of the temperature signals: `t01` to `t16` for 16 sensors, otherwise `t1`, `t2`, …
pub(crate) fn names(sensors: usize) -> Vec<String> {
    match sensors {
        16 => (1..=16).map(|sensor| format!("t{sensor:02}")).collect(),
        _ => (1..=sensors).map(|sensor| format!("t{sensor}")).collect(),
    }
}

/// Makes a profile with these signals and one axis with a placeholder model.
pub(crate) fn machine(names: &[String]) -> Profile {
    isotherm_profile::parse(Path::new("record.toml"), &text(names, &no_model(&names[0])), &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}"))
        .profile
}

/// Makes the text of a profile with these signals and one axis with the model `model` (TOML text).
pub(crate) fn text(names: &[String], model: &str) -> String {
    let mut text = "[machine]\nname = \"record\"\nsettle = \"3min\"\n[bus.cell]\ntype = \"modbus-tcp\"\n\
                    address = \"127.0.0.1:1502\"\ntimeout = \"300ms\"\n[device.module]\nbus = \"cell\"\nunit = 1\n\
                    every = \"1s\"\n"
        .to_owned();
    for (place, name) in names.iter().enumerate() {
        text += &format!(
            "[signal.{name}]\ndevice = \"module\"\nregister = \"input:{place}\"\ntype = \"i16\"\nscale = 0.1\n\
             unit = \"degC\"\nrange = [-10.0, 90.0]\nmax_age = \"5s\"\n"
        );
    }
    text += "[signal.spindle_rpm]\ndevice = \"module\"\nregister = \"input:90\"\ntype = \"u16\"\nunit = \"rpm\"\nmax_age = \"5s\"\n";
    text += "[axis.z]\nlimit = 100.0\nstep = 1.0\nrate = 0.5\nevery = \"10s\"\non_fault = { action = \"hold\" }\n";
    text + model
}

/// Returns the mean of the values.
#[allow(clippy::cast_precision_loss, reason = "a few hundred")]
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len() as f64
}
