//! Remedies after the first reading of a new profile, by the causes of the missing values.

use crate::observe::status::SignalStatus;

/// Cause for which a signal has no usable value, as far as the remedies differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Cause {
    /// The device gives no valid answer.
    NoAnswer,
    /// A setting of the device is not as the profile or its template expects.
    Setting,
    /// The device reports a fault of the sensor.
    Sensor,
    /// The lines of the signal do not fit the device.
    Lines,
}

impl Cause {
    /// Returns the cause of a quality; `None` if the value may be used.
    fn of(quality: &str) -> Option<Cause> {
        Some(match quality {
            "good" => return None,
            "timeout" | "link-down" | "bad-reply" | "never-read" => Cause::NoAnswer,
            "not-as-expected" => Cause::Setting,
            "sentinel" | "open-circuit" | "short-circuit" | "switched-off" | "above-range"
            | "below-range" | "not-available" | "sensor-fault" | "fault-bit" | "all-zero"
            | "power-on-value" => Cause::Sensor,
            _ => Cause::Lines,
        })
    }
}

/// Returns one sentence for each cause of missing values. `profile`: the file of the profile.
pub(super) fn remedies(signals: &[SignalStatus], profile: &str) -> Vec<String> {
    let mut found: Vec<(Cause, Vec<&str>)> = Vec::new();
    for signal in signals {
        let Some(cause) = Cause::of(signal.quality) else { continue };
        let name = match cause {
            Cause::NoAnswer | Cause::Setting => signal.device.as_str(),
            Cause::Sensor | Cause::Lines => signal.name.as_str(),
        };
        match found.iter_mut().find(|(known, _)| *known == cause) {
            Some((_, names)) if names.contains(&name) => {}
            Some((_, names)) => names.push(name),
            None => found.push((cause, vec![name])),
        }
    }
    found.sort_by_key(|(cause, _)| *cause);
    let sentence = |(cause, names): (Cause, Vec<&str>)| {
        let names = names.join(", ");
        match cause {
            Cause::NoAnswer => format!(
                "no valid answer from {names}: correct address, unit and settings of the line in {profile}, or the wiring"
            ),
            Cause::Setting => format!(
                "a setting of {names} is not as expected: correct it at the device, or the variant of its template in \
                 {profile}"
            ),
            Cause::Sensor => {
                format!("the device reports a fault of {names}: correct the sensor or its wiring")
            }
            Cause::Lines => format!(
                "the values of {names} cannot be used: correct the lines of these signals in {profile}"
            ),
        }
    };
    found.into_iter().map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(name: &str, device: &str, quality: &'static str) -> SignalStatus {
        SignalStatus {
            name: name.to_owned(),
            label: String::new(),
            device: device.to_owned(),
            value: None,
            unit: "degC",
            quality,
            reason: String::new(),
            hint: None,
            age_s: None,
        }
    }

    #[test]
    fn each_cause_of_missing_values_has_its_own_remedy() {
        let only = |quality| remedies(&[signal("bed", "module", quality)], "m.toml").join("\n");
        assert_eq!(only("good"), "");
        for (quality, words) in [
            ("not-as-expected", "a setting of module is not as expected: correct it at the device"),
            ("timeout", "no valid answer from module: correct address, unit"),
            ("open-circuit", "a fault of bed: correct the sensor"),
            ("out-of-range", "correct the lines of these signals in m.toml"),
        ] {
            assert!(only(quality).contains(words), "{quality}: {}", only(quality));
            assert_eq!(only(quality).contains("lines of these signals"), quality == "out-of-range");
        }
        let several = [
            signal("bed", "module", "not-as-expected"),
            signal("column", "module", "not-as-expected"),
            signal("oil", "other", "good"),
            signal("spindle", "other", "exception"),
            signal("air", "third", "link-down"),
        ];
        let found = remedies(&several, "m.toml");
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].contains("third") && found[1].contains("of module is"), "{found:?}");
        assert!(found[2].contains("values of spindle cannot"), "{found:?}");
    }
}
