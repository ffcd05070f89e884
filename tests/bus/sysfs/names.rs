//! Tests of the search by name, with any directory numbers.

use super::tree::{PROBE, Tree};
use isotherm::fieldbus::kinds::sysfs::find::{all, find};
use isotherm::fieldbus::kinds::sysfs::scan::temperatures;
use isotherm_core::codec::PcSensor;
use isotherm_core::reading::Reason;
use std::time::Duration;

fn sensor(text: &str) -> PcSensor {
    text.parse().unwrap()
}

/// Returns the files of a sensor, relative to the root of the tree.
fn found(tree: &Tree, text: &str) -> Result<String, Reason> {
    let files = find(tree.root(), &sensor(text))?;
    Ok(files.to_string().trim_start_matches(tree.root().to_str().unwrap()).to_owned())
}

/// Returns the values of all sensors, with their names.
fn values(tree: &Tree) -> Vec<(String, Result<f64, String>)> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let found = runtime.block_on(temperatures(tree.root(), Duration::from_secs(30)));
    found.into_iter().map(|found| (found.sensor, found.value.ok_or(found.reason))).collect()
}

#[test]
fn a_sensor_is_found_by_its_name_under_whatever_number_it_has_today() {
    for (first, second) in [(0, 1), (7, 3)] {
        let tree = Tree::new();
        let label = ("temp1_label", "Package id 0");
        tree.hwmon(
            first,
            "coretemp",
            "coretemp.0",
            &[("temp1_input", "41000"), label, ("temp2_input", "39000")],
        );
        tree.hwmon(second, "acpitz", "thermal_zone0", &[("temp1_input", "30000")]);
        let class = "/class/hwmon/hwmon";
        assert_eq!(found(&tree, "hwmon:coretemp/Package id 0"), Ok(format!("{class}{first}/temp1_input")));
        assert_eq!(found(&tree, "hwmon:coretemp/temp2"), Ok(format!("{class}{first}/temp2_input")));
        assert_eq!(found(&tree, "hwmon:acpitz"), Ok(format!("{class}{second}/temp1_input")));
        assert_eq!(found(&tree, "hwmon:coretemp"), Err(Reason::SeveralFound));
        assert_eq!(found(&tree, "hwmon:coretemp/Core 9"), Err(Reason::NotFound));
        assert_eq!(found(&tree, "iio:acpitz"), Err(Reason::NotFound));
    }
}

#[test]
fn of_several_chips_of_one_name_the_device_says_which() {
    let tree = Tree::new();
    tree.hwmon(0, "lm75", "i2c-1/1-0048", &[("temp1_input", "20000")]);
    tree.hwmon(1, "lm75", "i2c-1/1-0049", &[("temp1_input", "21000")]);
    tree.iio(0, "mcp9808", "i2c-1/1-0018", &[("in_temp_raw", "400"), ("in_temp_scale", "62.5")]);
    assert_eq!(found(&tree, "hwmon:lm75/temp1"), Err(Reason::SeveralFound));
    assert_eq!(found(&tree, "hwmon:lm75@1-0049/temp1"), Ok("/class/hwmon/hwmon1/temp1_input".to_owned()));
    assert_eq!(found(&tree, "iio:mcp9808@1-0018"), Ok("/bus/iio/devices/iio:device0/in_temp_*".to_owned()));
    let names: Vec<String> = all(tree.root()).iter().map(|present| present.sensor.to_string()).collect();
    assert_eq!(names, ["hwmon:lm75@1-0048/temp1", "hwmon:lm75@1-0049/temp1", "iio:mcp9808/temp"]);
    for name in names {
        assert!(find(tree.root(), &sensor(&name)).is_ok(), "{name} is what it was listed by");
    }
}

#[test]
fn what_the_kernel_says_becomes_degrees_celsius() {
    let tree = Tree::new();
    tree.hwmon(
        0,
        "nct6775",
        "nct6775.656",
        &[("temp1_input", "-12500"), ("temp2_input", "0"), ("temp2_fault", "1")],
    );
    let shared = [
        ("in_temp0_raw", "400"),
        ("in_temp1_raw", "400"),
        ("in_temp0_offset", "-16"),
        ("in_temp_scale", "62.5"),
    ];
    tree.iio(0, "adt7410", "spi0.0", &shared);
    tree.iio(
        1,
        "mlx90614",
        "1-005a",
        &[("in_temp_object_input", "36600"), ("in_temp_object_label", "bed/left")],
    );
    tree.measures(PROBE, 23_125);
    tree.hwmon(1, "w1_slave_temp", PROBE, &[("temp1_input", "23125")]);
    let value = |value| Ok::<f64, String>(value);
    let broken = Err("sensor fault".to_owned());
    let expected = [
        ("hwmon:nct6775/temp1", value(-12.5)),
        ("hwmon:nct6775/temp2", broken),
        ("iio:adt7410/temp0", value(24.0)),
        ("iio:adt7410/temp1", value(25.0)),
        ("iio:mlx90614/bed/left", value(36.6)),
        ("w1:28-0316a2794f01", value(23.125)),
    ];
    assert_eq!(values(&tree), expected.map(|(name, value)| (name.to_owned(), value)));
}

#[test]
fn a_computer_without_sensors_has_none() {
    assert_eq!(all(Tree::new().root()), []);
    assert_eq!(all(std::path::Path::new("/nowhere")), []);
}
