//! DBC files as people have them: other units, names that occur twice, files of another kind. One mistake is one error.

use super::*;
use crate::can::{DBC, LATHE, changed, lathe, lathe_with_dbc};

const TEMP: &str = "dbc    = \"Top.TL_Temp\"";
const SCALED: &str = "(0.0078125,-16384) [0|0] \"degC\"";

/// Loads the lathe with keys of the signal, and this unit in the DBC file.
fn with_unit(unit: &str, scaled: &str, keys: &str) -> Result<Loaded, Errors> {
    assert!(DBC.contains(SCALED));
    let dbc = DBC.replacen(SCALED, &format!("{scaled} [0|0] \"{unit}\""), 1);
    lathe_with_dbc(&changed(TEMP, &format!("{TEMP}\n{keys}")), &dbc)
}

/// Returns the unit of the signal, and its value at 212 counts.
fn at_212(unit: &str, scaled: &str, keys: &str) -> (&'static str, f64) {
    let loaded = with_unit(unit, scaled, keys).unwrap_or_else(|errors| panic!("{unit}, {keys}: {errors}"));
    let signal = &loaded.profile.signals[0];
    (signal.unit.0, 212.0 * signal.encoding.scale.get() + signal.encoding.offset)
}

#[test]
fn a_unit_that_a_profile_does_not_have_is_converted_to_its_unit() {
    for (unit, scaled, keys, expected) in [
        ("degF", "(1,0)", "", ("degC", 100.0)),
        ("°F", "(0.1,190.8)", "unit = \"degC\"", ("degC", 100.0)),
        ("degF", "(1,0)", "unit = \"degC\"\ndifference = true", ("degC", 212.0 * 5.0 / 9.0)),
        ("Rankine", "(1,279.67)", "", ("K", 273.15)),
        ("kPa", "(1,0)", "unit = \"bar\"", ("bar", 2.12)),
        ("m", "(0.01,0)", "unit = \"mm\"", ("mm", 2120.0)),
        ("degC", "(0.1,-40)", "", ("degC", -18.8)),
        ("deg C", "(0.1,-40)", "unit = \"degC\"", ("degC", -18.8)),
        // Without a unit in the profile, only a temperature is converted.
        ("kPa", "(1,0)", "", ("1", 212.0)),
        ("km/h", "(1,0)", "", ("1", 212.0)),
        ("km/h", "(1,0)", "unit = \"count\"", ("count", 212.0)),
        // Scale and offset of the profile are not converted.
        ("degF", "(1,0)", "unit = \"degC\"\nscale = 0.5\noffset = -6.0", ("degC", 100.0)),
        ("furlong", "(1,0)", "unit = \"mm\"\nscale = 2.0\noffset = 0.0", ("mm", 424.0)),
    ] {
        let (found, value) = at_212(unit, scaled, keys);
        assert_eq!(found, expected.0, "{unit}, {keys}");
        assert!((value - expected.1).abs() < 1e-6, "{unit}, {keys}: {value}");
    }
}

#[test]
fn a_unit_that_cannot_be_converted_is_refused_with_what_to_write() {
    for (unit, keys, key, words) in [
        ("degF", "unit = \"K\"", "unit", ["the unit \"degF\"", "write unit = \"degC\""]),
        ("kPa", "unit = \"degC\"", "unit", ["the unit \"kPa\"", "write unit = \"bar\""]),
        ("km/h", "unit = \"m/s\"", "unit", ["the unit \"km/h\"", "write scale = 1.0 and offset = 0.0"]),
        (
            "degF",
            "scale = 0.1\nunit = \"degC\"",
            "scale",
            ["converted from \"degF\"", "write `offset` as well"],
        ),
    ] {
        let found = errors(with_unit(unit, "(1,0)", keys));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, format!("signal.wheelhead.{key}"));
        for word in words {
            assert!(found[0].to_string().contains(word), "`{word}` is not in: {}", found[0]);
        }
    }
}

#[test]
fn a_message_that_occurs_twice_is_one_error_at_its_second_place() {
    let dbc = format!("{DBC}\nBO_ 7 Top: 8 Module\n SG_ TL_Temp : 0|8@1+ (1,0) [0|0] \"degC\" Vector__XXX\n");
    let found = errors(lathe_with_dbc(LATHE, &dbc));
    assert_eq!(found.len(), 1, "two signals name it: {}", Errors(found.clone()));
    assert_eq!(found[0].file, "module.dbc");
    let line = dbc.lines().nth(found[0].line.unwrap() - 1).unwrap();
    assert_eq!(
        (line, found[0].message.as_str()),
        ("BO_ 7 Top: 8 Module", "the DBC file has two messages `Top`")
    );
    assert!(found[0].help.as_ref().unwrap().contains("0x002 and 0x007"));
}

#[test]
fn a_file_of_another_kind_is_one_error_that_names_it() {
    for (text, words) in [
        ("[FileInfo]\nFileName=module.eds\n[DeviceInfo]\n", ["an EDS file", "sdo = \"7130:01\""]),
        ("<NetworkDefinition>\n</NetworkDefinition>\n", ["a KCD file", "cantools convert"]),
        ("<?xml version=\"1.0\"?>\n<AUTOSAR/>\n", ["an ARXML file", "cantools convert"]),
        ("time,bed\n0,20.0\n60,20.1\n", ["a log", "identify"]),
    ] {
        let found = errors(lathe_with_dbc(LATHE, text));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!((found[0].file.as_str(), found[0].line), ("module.dbc", None));
        for word in words {
            assert!(found[0].to_string().contains(word), "`{word}` is not in: {}", found[0]);
        }
    }
}

#[test]
fn a_device_without_its_dbc_file_is_one_error_at_the_device() {
    let found = errors(lathe(&changed("dbc = \"module.dbc\"\n", "")));
    assert_eq!(found.len(), 1, "two signals need it: {}", Errors(found.clone()));
    assert_eq!(found[0].key, "device.canmod.dbc");
    assert!(found[0].message.contains("`canmod` has no DBC file"), "{}", found[0]);
}

#[test]
fn a_device_on_a_bus_that_does_not_exist_is_one_error() {
    let found = errors(lathe(&changed("bus = \"field\"\ndbc", "bus = \"feild\"\ndbc")));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!(found[0].key, "device.canmod.bus");
}
