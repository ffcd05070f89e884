//! What takes the place of a sensor, and which sensors nothing replaces.

use isotherm_identify::identify;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::ready;

use super::rig::{self, Machine, Part, dataset, found};
use super::whitened::alike;

#[test]
fn a_probe_makes_no_sensor_irreplaceable() {
    let dataset = dataset(&alike(5)).unwrap();
    let ready = ready(&rig::profile(4), &dataset, &rig::choice()).unwrap();
    let of = |probe| identify(&ready, &Settings::default(), probe, true, &|_, _| {}).unwrap();
    let (without, with) = (of(None), of(Some(3600.0)));
    assert!(with.means.mean_range_um < without.means.mean_range_um);
    assert_eq!(with.irreplaceable, without.irreplaceable);
    assert_eq!(with.irreplaceable, ["s2"]);
}

#[test]
fn the_only_sensor_of_a_machine_is_irreplaceable() {
    let parts = [Part { sensor: 0, gain: 3.0, constant: 900.0 }];
    let machine = Machine { sensors: 1, parts: parts.to_vec(), step: 60.0, rows: 300, noise: 0.1 };
    let logs: Vec<String> = (0..3).map(|seed| machine.day(seed).log()).collect();
    assert_eq!(found(1, &logs, &Settings::default()).irreplaceable, ["s0"]);
}
