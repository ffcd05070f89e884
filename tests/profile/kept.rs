//! Kept sources of a profile: the same profile is loaded after its files have changed.

use std::fs::File;
use std::path::Path;

use isotherm_profile::{Loaded, Sources};

use super::can::DBC;
use super::data::{ENVELOPE, NETWORK};

const MACHINE: &str = r#"
[machine]
name = "mill"
[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:1"
[bus.frames]
type = "can"
interface = "vcan7"
[bus.secured]
type = "modbus-tcp"
address = "127.0.0.1:2"
tls = { ca = "certs/ca.pem", cert = "certs/own.pem", key = "certs/own.key" }
[device.cnc]
bus = "cell"
unit = 1
[device.shown]
bus = "secured"
unit = 1
[device.own]
template = "ours"
bus = "cell"
unit = 2
[device.module]
bus = "frames"
dbc = "nets/module.dbc"
[signal.bed]
device = "cnc"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "2s"
[signal.wheelhead]
device = "own"
channel = 0
max_age = "2s"
[signal.frame]
device = "module"
dbc = "Top.TL_Temp"
max_age = "2s"
[axis.z]
limit = 20.0
step = 1.0
rate = 10.0
every = "1s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "net"
kind = "network"
file = "nets/n.json"
inputs = ["bed", "wheelhead"]
envelope = "e.json"
outside = "shrink"
"#;
const TEMPLATE: &str = "title = \"ours\"\nsource = \"measured by ourselves\"\n[channel.t]\nname = \"{n}\"\ncount = 2\n\
                        register = \"input:40\"\ntype = \"i16\"\nscale = 0.5\n";
/// Every file that the profile reads, with another text for it.
const FILES: [(&str, &str, &str); 9] = [
    ("mill.toml", MACHINE, "[machine]\nname = \"lathe\"\n"),
    ("mill.local.toml", "[machine]\ndescription = \"in the corner\"\n", "no TOML"),
    ("devices/ours.toml", TEMPLATE, "no TOML"),
    ("nets/module.dbc", DBC, ""),
    ("nets/n.json", NETWORK, "{}"),
    ("e.json", ENVELOPE, "{}"),
    ("certs/ca.pem", "an authority", "another"),
    ("certs/own.pem", "a certificate", "another"),
    ("certs/own.key", "a key", "another"),
];

fn pairs(name: &str, value: &str) -> Vec<(String, String)> {
    vec![(name.to_owned(), value.to_owned())]
}

/// Loads the profile from its files, and keeps its sources.
fn kept(path: &Path) -> (Loaded, Sources) {
    let environment = pairs("ISOTHERM__BUS__CELL__ADDRESS", "127.0.0.1:77");
    let settings = pairs("machine.label", "M 7");
    let sources = Sources::create(tempfile::tempfile().unwrap(), &environment, &settings);
    isotherm_profile::load_and_keep(path, sources).unwrap_or_else(|errors| panic!("{errors}"))
}

fn opened(sources: Sources) -> Sources {
    let (file, length) = sources.finish().unwrap();
    assert_eq!(file.metadata().unwrap().len(), length);
    Sources::open(file, length).unwrap()
}

fn write_all(directory: &Path) -> std::path::PathBuf {
    for (name, text, _) in FILES {
        let path = directory.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    directory.join("mill.toml")
}

#[test]
fn whatever_becomes_of_its_files_the_profile_is_the_one_that_was_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = write_all(directory.path());
    let (loaded, sources) = kept(&path);
    assert_eq!(
        (loaded.profile.label.as_str(), loaded.profile.buses[0].address.as_str()),
        ("M 7", "127.0.0.1:77")
    );
    assert_eq!(loaded.files.len(), FILES.len(), "{:?}", loaded.files);
    let sources = opened(sources);
    assert!(sources.has_file(&path));
    let again = || isotherm_profile::load_from(&path, &sources).unwrap_or_else(|errors| panic!("{errors}"));
    let is_same = |again: Loaded| {
        assert_eq!((again.profile, again.warnings), (loaded.profile.clone(), loaded.warnings.clone()))
    };
    let now = |name: &str, value: &str| {
        sources.differences(
            &path,
            &pairs("ISOTHERM__BUS__CELL__ADDRESS", value),
            &pairs("machine.label", name),
        )
    };
    is_same(again());
    assert_eq!(now("M 7", "127.0.0.1:77"), [""; 0]);
    assert_eq!(now("M 8", "127.0.0.1:7").len(), 2);
    for (name, _, other) in FILES {
        let file = directory.path().join(name);
        let before = std::fs::read(&file).unwrap();
        std::fs::write(&file, other).unwrap();
        is_same(again());
        assert_eq!(now("M 7", "127.0.0.1:77"), [name]);
        std::fs::remove_file(&file).unwrap();
        is_same(again());
        assert_eq!(now("M 7", "127.0.0.1:77"), [name]);
        std::fs::write(&file, before).unwrap();
    }
    std::fs::remove_dir_all(directory.path()).unwrap();
    is_same(again());
    assert_eq!(now("M 7", "127.0.0.1:77").len(), FILES.len());
}

#[test]
fn a_layer_a_template_and_a_certificate_that_come_later_are_no_part_of_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("mill.toml");
    let opcua = "[bus.server]\ntype = \"opcua\"\naddress = \"opc.tcp://127.0.0.1:3\"\nsecurity = \"sign\"\ncert = \"own.der\"\n\
                 key = \"own.key\"\ntrusted = \"trusted\"\n[device.server]\nbus = \"server\"\n";
    let template = "[machine]\nname = \"mill\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1\"\n[device.own]\n\
                    template = \"icp-das-m7019r\"\nbus = \"cell\"\nunit = 2\n[signal.bed]\ndevice = \"own\"\nchannel = 0\n";
    std::fs::write(&path, format!("{template}{opcua}")).unwrap();
    std::fs::create_dir(directory.path().join("trusted")).unwrap();
    for name in ["own.der", "own.key", "trusted/one.der"] {
        std::fs::write(directory.path().join(name), name).unwrap();
    }
    let (loaded, sources) = kept(&path);
    let sources = opened(sources);
    std::fs::create_dir(directory.path().join("devices")).unwrap();
    for name in ["mill.local.toml", "devices/icp-das-m7019r.toml", "trusted/two.der"] {
        std::fs::write(directory.path().join(name), "no TOML").unwrap();
    }
    let again = isotherm_profile::load_from(&path, &sources).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(again.profile, loaded.profile);
    let (environment, settings) = (sources.environment().to_vec(), sources.settings().to_vec());
    let differences = sources.differences(&path, &environment, &settings);
    assert_eq!(differences, ["devices/icp-das-m7019r.toml", "mill.local.toml", "trusted/*.der"]);
}

#[test]
fn sources_that_were_cut_or_are_of_another_form_are_refused_and_nothing_panics() {
    let directory = tempfile::tempdir().unwrap();
    let path = write_all(directory.path());
    let (file, length) = kept(&path).1.finish().unwrap();
    let whole = {
        use std::os::unix::fs::FileExt;
        let mut bytes = vec![0; usize::try_from(length).unwrap()];
        file.read_exact_at(&mut bytes, 0).unwrap();
        bytes
    };
    let open = |bytes: &[u8]| {
        let path = directory.path().join("sources");
        std::fs::write(&path, bytes).unwrap();
        Sources::open(File::open(path).unwrap(), bytes.len() as u64)
    };
    assert!(open(&whole).is_ok());
    for form in ["isotherm-sources 2\n", "isotherm\n", ""] {
        assert!(open(form.as_bytes()).is_err(), "{form}");
    }
    // A cut after a record gives a shorter list, which the checksum of the handover detects.
    for end in 0..whole.len() {
        if let Ok(sources) = open(&whole[..end]) {
            let _ = isotherm_profile::load_from(&path, &sources);
        }
    }
}
