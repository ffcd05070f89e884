//! Discovery messages for Home Assistant: they describe the metrics, so that Home Assistant displays them without
//! configuration.

use serde_json::{Value as Document, json};

use super::JsonSettings;
use crate::interface::{Message, Metric, Qos, Snapshot, Subject};

/// Makes a discovery message for each metric that Home Assistant can display. Home Assistant identifies the metrics by
/// `unique_id`.
pub(super) fn messages(settings: &JsonSettings, snapshot: &Snapshot) -> Vec<Message> {
    snapshot
        .metrics
        .iter()
        .filter(|metric| is_shown(metric))
        .map(|metric| message(settings, metric))
        .collect()
}

fn is_shown(metric: &Metric) -> bool {
    match metric.subject {
        Subject::Signal(_) => metric.name == "value",
        Subject::Axis(_) => {
            matches!(metric.name, "verified_um" | "verified_age_s" | "shown" | "state" | "cz_um")
        }
        Subject::Gateway => metric.name == "alarms",
        Subject::Output(_) | Subject::Device(_) | Subject::Bus(_) => false,
    }
}

fn message(settings: &JsonSettings, metric: &Metric) -> Message {
    let (group, machine) = (&settings.group, &settings.machine);
    let (sort, name) = metric.subject.parts();
    let node = format!("isotherm-{machine}");
    let object = [sort, name, metric.name].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>();
    let shown = match metric.subject {
        Subject::Signal(_) => name.to_owned(),
        _ => object.join(" "),
    };
    let mut config = json!({
        "name": shown,
        "unique_id": format!("{node}-{}", object.join("-")),
        "state_topic": format!("{group}/{machine}/{}", metric.subject),
        "value_template": format!("{{{{ value_json.{} }}}}", metric.name),
        "availability_topic": format!("{group}/{machine}/state"),
        "device": {
            "identifiers": [node],
            "name": machine,
            "manufacturer": "isotherm",
            "sw_version": settings.version,
        },
    });
    let (unit, class) = unit(metric);
    let texts = [("unit_of_measurement", unit), ("device_class", class)];
    for (key, text) in texts.into_iter().filter(|(_, text)| !text.is_empty()) {
        config[key] = Document::from(text);
    }
    if !unit.is_empty() {
        config["state_class"] = Document::from("measurement");
    }
    Message {
        topic: format!("homeassistant/sensor/{node}/{}/config", object.join("_")),
        payload: config.to_string().into_bytes(),
        qos: Qos::AtLeastOnce,
        retained: true,
    }
}

/// Returns the unit in the notation of Home Assistant, and the device class of the sensor. A text is empty if Home
/// Assistant has no such unit or device class.
fn unit(metric: &Metric) -> (&'static str, &'static str) {
    match metric.unit {
        "degC" => ("°C", "temperature"),
        "K" => ("K", "temperature"),
        "mm" => ("mm", "distance"),
        "um" => ("µm", ""),
        "percent" => ("%", ""),
        "bool" | "1" => ("", ""),
        other => (other, ""),
    }
}
