//! Temperatures that the kernel of this computer reads, also as lines for a profile.

use std::path::Path;
use std::time::Duration;

use crate::cli::print::{say, say_all};
use crate::cli::print_json;
use crate::cli::target::Line;
use crate::discovery::sysfs::{Temperature, scan};

/// Default timeout. A 1-Wire sensor needs almost a second for a reading.
const TIMEOUT: Duration = Duration::from_secs(2);

pub(super) fn run(line: &Line, timeout: Option<Duration>, json: bool) -> anyhow::Result<()> {
    let root = &line.bus.address;
    let timeout = timeout.unwrap_or(line.bus.timeout.max(TIMEOUT));
    let found = crate::cli::runtime()?.block_on(scan(Path::new(root), timeout));
    if json {
        print_json(&serde_json::json!({ "address": root, "sensors": found }))?;
    } else if !found.is_empty() {
        say!("This computer has in {root}")?;
        say_all!("{}", table(&found))?;
        if line.known.is_none() {
            let (lines, sensor) = (line.address.profile_lines(), &found[0].sensor);
            say_all!(
                "\n# for a profile:\n[bus.pc]\n{lines}\n[device.pc]\nbus = \"pc\"\nevery = \"2s\"\n\n[signal.NAME]\n\
                 device = \"pc\"\nsensor = \"{sensor}\"\n"
            )?;
        }
    }
    anyhow::ensure!(
        !found.is_empty(),
        "no temperature was found in {root}: does the kernel show its devices in this directory, and are the \
         drivers of the sensors loaded?"
    );
    Ok(())
}

/// Formats the temperatures as text, one line each.
fn table(found: &[Temperature]) -> String {
    let width = found.iter().map(|found| found.sensor.chars().count()).max().unwrap_or(0);
    let lines = found.iter().map(|Temperature { sensor, read_in, value, reason }| {
        let value = value.map_or_else(|| reason.clone(), |value| format!("{value:.3} °C"));
        format!("  {sensor:<width$}  {value:>11}  {read_in}\n")
    });
    lines.collect()
}
