//! Remedies for signals without a value, after `isotherm init` has read every signal once. Each remedy names the place
//! of the correction: profile, device, sensor, or wiring.

use crate::observe::status::SignalStatus;
use isotherm_core::reading::Remedy;

/// Returns one sentence for each kind of remedy that a signal without a value needs. `profile`: the file of the profile.
pub(super) fn remedies(signals: &[SignalStatus], profile: &str) -> Vec<String> {
    let mut found: Vec<(Remedy, Vec<&str>)> = Vec::new();
    for signal in signals {
        let Some(remedy) = signal.remedy else { continue };
        let name = match remedy {
            Remedy::Connection | Remedy::DeviceSettings => signal.device.as_str(),
            Remedy::Sensor | Remedy::Profile => signal.name.as_str(),
        };
        match found.iter_mut().find(|(known, _)| *known == remedy) {
            Some((_, names)) if names.contains(&name) => {}
            Some((_, names)) => names.push(name),
            None => found.push((remedy, vec![name])),
        }
    }
    found.sort_by_key(|(remedy, _)| *remedy);
    let sentence = |(remedy, names): (Remedy, Vec<&str>)| {
        let names = names.join(", ");
        match remedy {
            Remedy::Connection => format!(
                "no valid answer from {names}: correct address, unit and settings of the line in {profile}, or the wiring"
            ),
            Remedy::DeviceSettings => format!(
                "a setting of {names} is not as expected: correct the setting at the device, or correct the \
                 variant of the device's template in {profile}"
            ),
            Remedy::Sensor => {
                format!("the device reports a fault of {names}: correct the sensor or its wiring")
            }
            Remedy::Profile => format!(
                "the values of {names} cannot be used: correct the tables of these signals in {profile}"
            ),
        }
    };
    found.into_iter().map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use isotherm_core::reading::Reason;

    use super::*;

    fn signal(name: &str, device: &str, bad: Option<Reason>) -> SignalStatus {
        SignalStatus {
            name: name.to_owned(),
            label: String::new(),
            device: device.to_owned(),
            value: None,
            unit: "degC",
            quality: bad.map_or("good", Reason::code),
            reason: String::new(),
            hint: None,
            remedy: bad.map(Reason::remedy),
            age_s: None,
        }
    }

    #[test]
    fn each_cause_of_missing_values_has_its_own_remedy() {
        let only = |bad| remedies(&[signal("bed", "module", bad)], "m.toml").join("\n");
        assert_eq!(only(None), "");
        for (reason, words) in [
            (
                Reason::NotAsExpected,
                "a setting of module is not as expected: correct the setting at the device",
            ),
            (Reason::Timeout, "no valid answer from module: correct address, unit"),
            (Reason::OpenCircuit, "a fault of bed: correct the sensor"),
            (Reason::OutOfRange, "correct the tables of these signals in m.toml"),
        ] {
            let said = only(Some(reason));
            assert!(said.contains(words), "{reason:?}: {said}");
            assert_eq!(said.contains("tables of these signals"), reason == Reason::OutOfRange);
        }
        let several = [
            signal("bed", "module", Some(Reason::NotAsExpected)),
            signal("column", "module", Some(Reason::NotAsExpected)),
            signal("oil", "other", None),
            signal("spindle", "other", Some(Reason::Exception(2))),
            signal("air", "third", Some(Reason::LinkDown)),
        ];
        let found = remedies(&several, "m.toml");
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].contains("third") && found[1].contains("of module is"), "{found:?}");
        assert!(found[2].contains("values of spindle cannot"), "{found:?}");
    }
}
