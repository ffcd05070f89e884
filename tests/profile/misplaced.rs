//! Files of another kind in the place of a profile or a template: one error, which names the kind.

use super::*;

const TEMPLATE: &str = "title = \"ours\"\nsource = \"its manual\"\n[channel.t]\nname = \"{n}\"\ncount = 2\n\
                        register = \"input:40\"\ntype = \"i16\"\n";
const PLANT: &str = "start = \"2026-01-05T06:00:00Z\"\nsoak = \"72h\"\n[ambient]\nmean = 21.0\n[duty]\n\
                     on_after = [\"3min\", \"8min\"]\n[node.bed]\ncapacity = 1e5\n";
const BLOCK: &str = "# Held out: 1.2 µm.\n[[axis.z.model]]\nname = \"ridge\"\nkind = \"linear\"\n\
                     terms = [{ signal = \"bed\", gain = 1.0, reference = 20.0 }]\n";
const LOG: &str = "time,bed,z_error_um\n0,20.1,0.0\n60,20.2,0.4\n120,20.4,0.9\n";

/// Checks that the only error of this file is at the file, and contains these words.
#[track_caller]
fn is_named(bytes: &[u8], words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("given.toml");
    std::fs::write(&path, bytes).unwrap();
    let found = errors(isotherm_profile::load(&path, &[], &[]));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    let said = found[0].to_string();
    assert!(said.starts_with(&format!("{}: this is ", path.display())), "{said}");
    assert!(said.contains("\n  help: "), "{said}");
    for word in words {
        assert!(said.contains(word), "`{word}` is not in: {said}");
    }
}

#[test]
fn a_file_of_another_kind_as_the_profile_is_one_error_that_names_it() {
    is_named(LOG.as_bytes(), &["a log, not a profile", "identify"]);
    is_named(LOG.replace(',', ";").replace('.', ",").as_bytes(), &["a log, not a profile"]);
    is_named(TEMPLATE.as_bytes(), &["a device template, not a profile", "devices/NAME.toml"]);
    is_named(PLANT.as_bytes(), &["the description of a plant, not a profile", "isotherm virtual"]);
    is_named(BLOCK.as_bytes(), &["a model block, not a profile", "replace the tables [[axis."]);
    is_named(b"[[fault]]\ndevice = \"m\"\nkind = \"silent\"\n", &["a fault script", "--faults"]);
    is_named(b"BU_: A\nBO_ 2 Top: 8 A\n", &["a DBC file, not a profile", "dbc = "]);
    is_named(b"[FileInfo]\nFileName=a.eds\n", &["an EDS file, not a profile"]);
    is_named(
        b"{ \"format\": \"isotherm-envelope\" }",
        &["a JSON document, not a profile", "a profile is TOML"],
    );
    is_named(b"machine:\n  name: press-7\n", &["a YAML document, not a profile", "TOML", "[machine]"]);
}

#[test]
fn a_file_that_is_no_text_or_too_large_is_named_as_well() {
    is_named(b"PAR1\x00\xff\xfe", &["a log in a Parquet file", "identify"]);
    is_named(b"PK\x03\x04\xff\xff", &["a workbook", "CSV"]);
    is_named(b"\x1f\x8b\x08\xff", &["a compressed file", "gunzip"]);
    let large = LOG.to_owned() + &"180,20.5,1.1\n".repeat(400_000);
    is_named(large.as_bytes(), &["a log, not a profile"]);
}

#[test]
fn the_local_file_of_a_profile_names_the_profile() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mill.local.toml");
    std::fs::write(&path, "[bus.cell]\naddress = \"10.0.0.1:502\"\n").unwrap();
    let found = errors(isotherm_profile::load(&path, &[], &[]));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert!(found[0].to_string().contains("give the profile: mill.toml"), "{}", found[0]);
}

#[test]
fn a_wrong_profile_stays_a_profile() {
    for text in ["[machine]\nname = \"m\"\n[device.a]\nbus = \"x\"\n", "[signal.bed]\nunit = \"degC\"\n"] {
        let found = errors(parse(text));
        assert!(
            found.iter().all(|error| !error.message.starts_with("this is ")),
            "{}",
            Errors(found.clone())
        );
    }
}

#[test]
fn another_file_in_the_place_of_a_template_is_one_error_that_names_it() {
    const MACHINE: &str = "[machine]\nname = \"m\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"\n\
                           [device.module]\nbus = \"cell\"\nunit = 1\ntemplate = \"ours\"\n\
                           [signal.bed]\ndevice = \"module\"\nchannel = 0\n";
    let load = |template: &str| {
        let files = [("devices/ours.toml", template.as_bytes())];
        isotherm_profile::parse_with(Path::new("m.toml"), MACHINE, &files, &[], &[])
    };
    if let Err(errors) = load(TEMPLATE) {
        panic!("{errors}");
    }
    for (text, words) in [
        (GRINDER, "a profile, not a device template"),
        (PLANT, "the description of a plant, not a device template"),
        (BLOCK, "a model block, not a device template"),
        (LOG, "a log, not a device template"),
    ] {
        let found = errors(load(text));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert!(
            found[0].file.ends_with("devices/ours.toml") && found[0].message.contains(words),
            "{}",
            found[0]
        );
    }
}

#[test]
fn a_signal_with_the_name_of_a_column_of_the_log_is_refused() {
    for name in ["time", "machine_zero", "machine_clock", "z_cz_um", "z_state", "z_permit", "z_measured_um"] {
        let signal =
            format!("[signal.{name}]\ndevice = \"module\"\nregister = \"input:60\"\ntype = \"i16\"\n");
        let found = errors(parse(&format!("{GRINDER}\n{signal}")));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, format!("signal.{name}"));
        let said = found[0].to_string();
        assert!(said.contains("is a column of") && said.contains("give the signal another name"), "{said}");
    }
    for name in ["y_cz_um", "bed_state", "z_error_um"] {
        let signal =
            format!("[signal.{name}]\ndevice = \"module\"\nregister = \"input:60\"\ntype = \"i16\"\n");
        assert!(parse(&format!("{GRINDER}\n{signal}")).is_ok(), "{name}");
    }
}
