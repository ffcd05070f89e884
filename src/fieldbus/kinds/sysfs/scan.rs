//! Temperatures that the kernel of this computer reads, also as lines of a profile.

use std::path::Path;
use std::time::Duration;

use serde::Serialize;

use super::find::all;
use super::readers::Readers;
use crate::clock::WallTimeout;
use crate::fieldbus::error::Fault;
use crate::fieldbus::kinds::kind::ScanReport;
use crate::fieldbus::wire::Boxed;
use isotherm_core::codec::PcSensor;
use isotherm_profile::Bus;

/// Default timeout. A 1-Wire sensor needs almost a second.
const TIMEOUT: Duration = Duration::from_secs(2);

/// Temperature sensor of this computer, with its present value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Temperature {
    /// Name of the sensor in a profile.
    pub sensor: String,
    /// Path of the file that contains the temperature.
    pub read_in: String,
    /// Temperature in °C; `None` if there is no value now.
    pub value: Option<f64>,
    /// Reason why there is no value; empty if `value` is present.
    pub reason: String,
}

/// Reads each temperature sensor below the directory `root` (usually `/sys`) once.
pub async fn temperatures(root: &Path, timeout: Duration) -> Vec<Temperature> {
    let present = all(root);
    let sensors: Vec<PcSensor> = present.iter().map(|present| present.sensor.clone()).collect();
    let values = Readers::default().read(root, &sensors, timeout, &mut WallTimeout::new()).await;
    let found = present.iter().zip(values).map(|(present, value)| Temperature {
        sensor: present.sensor.to_string(),
        read_in: present.files.to_string(),
        value: value.ok(),
        reason: value.err().map(|reason| reason.to_string()).unwrap_or_default(),
    });
    found.collect()
}

/// Reads every temperature below the directory of the line, and describes the sensors as text and JSON.
pub(super) fn report(bus: &Bus, timeout: Option<Duration>) -> Boxed<'_, Result<ScanReport, Fault>> {
    Box::pin(async move {
        let root = &bus.address;
        let found = temperatures(Path::new(root), timeout.unwrap_or(bus.timeout.max(TIMEOUT))).await;
        let (text, profile) = match found.first() {
            Some(Temperature { sensor, .. }) => {
                let device = format!(
                    "\n[device.pc]\nbus = \"pc\"\nevery = \"2s\"\n\n[signal.NAME]\ndevice = \"pc\"\nsensor = \
                     \"{sensor}\"\n"
                );
                (
                    format!("This computer has these temperatures in {root}:\n{}", table(&found)),
                    Ok(("pc", device)),
                )
            }
            None => (
                String::new(),
                Err(format!(
                    "no temperature was found in {root}: does the kernel show its devices in this directory, and are \
                     the drivers of the sensors loaded?"
                )),
            ),
        };
        let json = serde_json::json!({ "address": root, "sensors": found });
        Ok(ScanReport { is_empty: found.is_empty(), json, text, profile })
    })
}

/// Formats the temperatures, one line each.
fn table(found: &[Temperature]) -> String {
    let width = found.iter().map(|found| found.sensor.chars().count()).max().unwrap_or(0);
    let lines = found.iter().map(|Temperature { sensor, read_in, value, reason }| {
        let value = value.map_or_else(|| reason.clone(), |value| format!("{value:.3} °C"));
        format!("  {sensor:<width$}  {value:>11}  {read_in}\n")
    });
    lines.collect()
}
