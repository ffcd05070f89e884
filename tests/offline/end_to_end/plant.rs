//! A simulated machine, its days as logs, and runs of the verbs.

use std::fmt::Write;
use std::path::Path;

use crate::end_to_end::process::{file, isotherm};

pub(crate) const PROFILE: &str = r#"
[machine]
name = "plant"
settle = "3min"
[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:1"
timeout = "300ms"
[device.module]
bus = "cell"
unit = 1
every = "1s"
[device.cnc]
bus = "cell"
unit = 2
every = "1s"
[signal.bearing]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[signal.oil]
device = "module"
register = "input:1"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[signal.post]
device = "module"
register = "input:2"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }
"#;

pub(crate) const OUTPUT: &str = "[output.cnc_z]\naxis = \"z\"\ndevice = \"cnc\"\nwrites = \"offset\"\nregister = \"holding:104\"\n\
                      type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1\nverify = \"read-back\"\n";

pub(crate) const READOUT: &str = "[signal.scale]\ndevice = \"module\"\nregister = \"input:8\"\ntype = \"i32\"\nword_order = \"msw-first\"\n\
                       scale = 0.001\nunit = \"mm\"\nmax_age = \"5s\"\n\
                       [output.readout_z]\naxis = \"z\"\ndevice = \"cnc\"\nwrites = \"corrected\"\nposition = \"scale\"\n\
                       register = \"holding:104\"\ntype = \"i32\"\nword_order = \"msw-first\"\nscale = 0.001\n";

pub(crate) const HEADER: [&str; 6] = ["time", "bearing", "oil", "post", "spindle_rpm", "z_error_um"];

/// Rows of a day, one per minute. The bearing deforms the machine with a lag of 25 minutes, the oil immediately. The
/// sensor on the post measures the air of the hall.
pub(crate) fn rows(day: u32) -> Vec<Vec<f64>> {
    let (mut bearing, mut bent, mut oil) = (0.0_f64, 0.0, 0.0);
    let of_minute = |minute: u32| {
        let runs = (minute / (60 + 10 * day)).is_multiple_of(2);
        let pump = if (minute / (35 + 7 * day)) % 2 == 1 { 6.0 } else { 0.0 };
        bearing += (if runs && minute > 25 { 8.0 + f64::from(day) } else { 0.0 } - bearing) / 15.0;
        bent += (bearing - bent) / 25.0;
        oil += (pump - oil) / 20.0;
        let wave = (f64::from(minute) / 9.0 + f64::from(day)).sin();
        let hall = 20.0 + (f64::from(minute) / 80.0 + f64::from(day)).sin();
        let rpm = if runs && minute > 25 { 3000.0 } else { 0.0 };
        let error = 3.0 * bent - 2.0 * oil + 0.2 * wave;
        vec![f64::from(minute) * 60.0, 20.0 + bearing, 20.0 + oil + 0.02 * wave, hall, rpm, error]
    };
    (0..300).map(of_minute).collect()
}

pub(crate) fn written(header: &[&str], rows: &[Vec<f64>]) -> String {
    let mut text = header.join(",") + "\n";
    for row in rows {
        let cells: Vec<String> = row.iter().map(f64::to_string).collect();
        writeln!(text, "{}", cells.join(",")).unwrap();
    }
    text
}

pub(crate) fn day(number: u32) -> String {
    written(&HEADER, &rows(number))
}

/// Log of a day with a function applied to every value of a column.
pub(crate) fn with_column(number: u32, column: usize, change: impl Fn(f64) -> f64) -> String {
    let mut rows = rows(number);
    rows.iter_mut().for_each(|row| row[column] = change(row[column]));
    written(&HEADER, &rows)
}

pub(crate) struct Answer {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) said: String,
}

/// Runs a verb with these logs.
pub(crate) fn asked(home: &Path, before: &[&str], logs: &[(&str, String)], after: &[&str]) -> Answer {
    let logs: Vec<_> = logs.iter().map(|(name, text)| file(home, name, text)).collect();
    let ended = isotherm(home).current_dir(home).args(before).args(logs).args(after).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Answer { code: ended.status.code(), out: text(ended.stdout), said: text(ended.stderr) }
}

pub(crate) fn identify(home: &Path, profile: &str, logs: &[(&str, String)], after: &[&str]) -> Answer {
    let profile = file(home, "plant.toml", profile);
    asked(home, &["identify", profile.to_str().unwrap()], logs, after)
}
