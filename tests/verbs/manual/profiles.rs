//! Every TOML block is accepted: a whole profile as it is, a part of one within `base.toml`.

use std::path::Path;

use isotherm::virtual_machine::{FaultScript, PlantSpec};
use isotherm_profile::{Errors, Loaded, parse_with};
use toml::{Table, Value};

use crate::support::encode as onnx;

use super::book::{Block, chapters, read};
use super::certificates::{Authority, signs_itself};

/// Profile with everything that the parts refer to.
fn base() -> Table {
    read("tests/verbs/manual/base.toml").parse().unwrap()
}

/// Device templates of the manual, which the parts use.
fn templates() -> impl Iterator<Item = (String, Vec<u8>)> {
    let named =
        |block: Block| Some((format!("devices/{}.toml", block.says("template")?), block.text.into_bytes()));
    toml_blocks().into_iter().filter_map(named)
}

/// Files that the parts name.
fn beside() -> Vec<(String, Vec<u8>)> {
    const DBC: &str = "VERSION \"\"\n\nBU_: Module\n\nBO_ 256 Top: 8 Module\n SG_ TL_Temp : 0|16@1- (0.0625,0) [0|0] \"degC\" Module\n";
    const MATRIX: &str = r#"{ "format": "isotherm-matrix", "version": 1, "blocks": ["base", "front", "back"], "guide_mm": [0, 400],
        "P": [[0, 0, 0], [0, 0, 0], [0.001, 0.001, -0.001], [0, 0, 0], [0, 0, 0], [0.002, 0.002, -0.002]] }"#;
    const ENVELOPE: &str = r#"{ "format": "isotherm-envelope", "version": 1, "covariance": [[4.0]],
        "inputs": [{ "signal": "bearing", "mean": 24.1, "min": 20.0, "max": 30.5 }] }"#;
    let weights = vec![vec![0.5, -0.25, 0.1]];
    let network = onnx::network(&[20.0; 3], &[4.0; 3], &[(&weights, &[0.0], "Tanh")], Some(3));
    let texts = [
        ("module.dbc", DBC),
        ("column.json", MATRIX),
        ("spindle.envelope.json", ENVELOPE),
        ("server.der", "certificate"),
        ("server.pem", "key"),
        ("mes.password", "password"),
        ("probe.der", "certificate"),
    ];
    let texts = texts.into_iter().map(|(name, text)| (name, text.as_bytes().to_vec()));
    let authority = Authority::new();
    let (gateway, page) = (authority.signs("gateway", (2020, 2090)), signs_itself("page", (2020, 2090)));
    let pem = [
        ("ca.pem", authority.cert),
        ("gateway.pem", gateway.cert),
        ("gateway.key", gateway.key),
        ("page.pem", page.cert),
        ("page.key", page.key),
    ];
    let pem = pem.into_iter().map(|(name, text)| (name, text.into_bytes()));
    let files = texts.chain(pem).chain([("spindle.onnx", network)]);
    files.map(|(name, bytes)| (name.to_owned(), bytes)).chain(templates()).collect()
}

fn taken(text: &str) -> Result<Loaded, Errors> {
    let beside = beside();
    let files: Vec<(&str, &[u8])> =
        beside.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    parse_with(Path::new("manual.toml"), text, &files, &[], &[])
}

/// Merges a block into the base. Tables are merged, other values are replaced.
fn laid_over(base: &mut Table, part: Table) {
    for (key, value) in part {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => laid_over(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// Completes a block to a whole profile.
pub(crate) fn completed(block: &Block) -> String {
    let part: Table = block.text.parse().unwrap_or_else(|error| panic!("{}: {error}", block.place));
    let mut whole = base();
    // With this mark, tables of the base with the same name are removed before merging.
    for (table, new) in part.iter().filter(|_| block.is("anew")) {
        if let (Some(Value::Table(old)), Value::Table(new)) = (whole.get_mut(table), new) {
            old.retain(|name, _| !new.contains_key(name));
        }
    }
    laid_over(&mut whole, part);
    toml::to_string(&whole).unwrap()
}

fn toml_blocks() -> Vec<Block> {
    chapters().iter().flat_map(|chapter| chapter.blocks()).filter(|block| block.language == "toml").collect()
}

#[test]
fn every_profile_and_every_part_of_one_is_taken() {
    let mut refused = Vec::new();
    let mut counted = [0; 4];
    for block in toml_blocks() {
        if block.is("faults") {
            counted[0] += 1;
            let profile =
                taken(&toml::to_string(&base()).unwrap()).unwrap_or_else(|why| panic!("{why}")).profile;
            if let Err(error) = FaultScript::parse(&block.text, &profile) {
                refused.push(format!("{}: {error}", block.place));
            }
        } else if block.is("plant") {
            counted[1] += 1;
            let shipped = read("profiles/column-hmc.plant.toml");
            let mut plant: Table = shipped.parse().unwrap();
            // The column of the chapter has other names than the shipped one for three of its five surfaces.
            let names = [("air_high", "front"), ("air_low", "back"), ("inside", "sides")];
            if let Some(Value::Table(sinks)) = plant["structure"].get_mut("sinks") {
                sinks.retain(|name, _| names.iter().all(|(known, _)| *known != name));
            }
            laid_over(&mut plant, block.text.parse().unwrap());
            let modes = |_: &str| {
                let shipped = read("profiles/column-hmc/modes.json");
                let quoted = |name: &str| format!("\"{name}\"");
                Some(names.iter().fold(shipped, |text, (from, to)| text.replace(&quoted(from), &quoted(to))))
            };
            if let Err(error) = PlantSpec::parse_with(&toml::to_string(&plant).unwrap(), &modes) {
                refused.push(format!("{}: {error}", block.place));
            }
        } else if let Some(template) = block.says("template") {
            // The parts that use a template accept it.
            let user = format!("template = \"{template}\"");
            if !toml_blocks().iter().any(|other| other.is("part") && other.text.contains(&user)) {
                refused.push(format!("{}: no part of a profile has {user}", block.place));
            }
        } else if block.is("part") {
            counted[2] += 1;
            if let Err(errors) = taken(&completed(&block)) {
                refused.push(format!("{}:\n{errors}", block.place));
            }
        } else {
            counted[3] += 1;
            match taken(&block.text) {
                Ok(loaded) if loaded.warnings.is_empty() => {}
                Ok(loaded) => refused.push(format!("{}: {:?}", block.place, loaded.warnings)),
                Err(errors) => refused.push(format!("{}:\n{errors}", block.place)),
            }
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
    let [faults, plants, parts, whole] = counted;
    assert!(
        faults > 0 && plants > 0 && parts > 10 && whole == 2,
        "{counted:?}: the whole profile that is explained, the one of an OPC UA server, and the rest"
    );
}

/// An unknown key is also rejected within the base.
#[test]
fn a_part_with_a_key_that_does_not_exist_is_refused() {
    let block = toml_blocks().into_iter().find(|block| block.is("part")).unwrap();
    let wrong = Block { text: block.text + "\n[axis.z]\ndedband = 0.1\n", ..block };
    let errors = taken(&completed(&wrong)).map(|_| ()).unwrap_err();
    assert!(errors.to_string().contains("did you mean `deadband`"), "{errors}");
}

#[test]
fn the_base_of_the_parts_is_a_profile_itself() {
    taken(&toml::to_string(&base()).unwrap()).unwrap_or_else(|why| panic!("{why}"));
}

/// The profile of the manual, on its serial line, has the preview that the chapter on serial lines shows.
#[test]
fn the_serial_lines_are_explained_as_check_explains_them() {
    let whole = toml_blocks().into_iter().find(|block| block.marks.is_empty()).unwrap();
    let serial = read("docs/serial.md");
    let lines = toml_blocks().into_iter().find(|block| block.place.starts_with("docs/serial.md")).unwrap();
    let text = whole.text.replace("bus   = \"cell\"", "bus   = \"rs485\"") + &lines.text;
    let profile = taken(&text).unwrap_or_else(|why| panic!("{why}")).profile;
    let reported = isotherm_profile::preview::Preview::of(&profile).to_string();
    let shown = serial.split("```text\n").find(|text| text.starts_with("bus rs485")).unwrap();
    let shown = shown.split("```").next().unwrap();
    assert!(reported.contains(shown), "{shown} is not in\n{reported}");
}
