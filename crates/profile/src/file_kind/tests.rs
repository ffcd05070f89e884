use super::*;

const PROFILE: &str = "# A bench.\n[machine]\nname = \"bench\"\n[bus.cell]\ntype = \"modbus-tcp\"\n";
const BLOCK: &str = "# Held out: 1.2 µm.\n[[axis.z.model]]\nname = \"ridge\"\nkind = \"linear\"\nterms = [\n  \
                     { signal = \"bed\", gain = 1.0 },\n]\n";
const EDS: &str = "[FileInfo]\nFileName=node.eds\n[DeviceInfo]\nVendorName=Somebody\n";

#[test]
fn each_kind_is_recognised_by_its_content() {
    for (text, kind) in [
        (PROFILE, FileKind::Profile),
        ("machine = { name = \"bench\" }\n", FileKind::Profile),
        (
            "title = \"A module\"\nsource = \"Its manual\"\n[channel.t]\nregister = \"input:0\"\n",
            FileKind::Template,
        ),
        ("start = \"2026-01-05T06:00:00Z\"\nsoak = \"72h\"\n[ambient]\nmean = 21.0\n", FileKind::Plant),
        (BLOCK, FileKind::ModelBlock),
        ("[[axis.z.model]]\nkind = \"x\"\nlist = [\n  [1.0, 2.0],\n]\n", FileKind::ModelBlock),
        ("[[fault]]\ndevice = \"module\"\nkind = \"silent\"\n", FileKind::FaultScript),
        ("time,bed,spindle\n0,20.1,20.5\n60,20.2,20.9\n", FileKind::Log),
        ("time,bed\n", FileKind::Log),
        ("time|bed\n0|20.1\n60|20.2\n", FileKind::Log),
        (
            "Logger 7\nSerial: 12\nDate;Bed\n05.01.2026 06:00:10;20,1\n05.01.2026 06:00:20;20,2\n",
            FileKind::Log,
        ),
        ("VERSION \"\"\n\nBU_: Module\n\nBO_ 2 Top: 8 Module\n", FileKind::Dbc),
        (EDS, FileKind::Eds),
        ("<?xml version=\"1.0\"?>\n<AUTOSAR xmlns=\"x\">\n", FileKind::Arxml),
        ("<AR:AUTOSAR xmlns:AR=\"http://autosar.org/schema/r4.0\">\n", FileKind::Arxml),
        ("<NetworkDefinition xmlns=\"http://kayak.2codeornot2code.org/1.0\">\n", FileKind::Kcd),
        (
            "<?xml version=\"1.0\"?>\n<!-- from AUTOSAR -->\n<ns0:NetworkDefinition\nxmlns:ns0=\"x\">\n",
            FileKind::Kcd,
        ),
        ("<note about=\"html\">see <b>FIBEX</b></note>\n", FileKind::Xml),
        ("<?xml version=\"1.0\"?><ISO15745ProfileContainer>\n", FileKind::Xdd),
        ("<fx:FIBEX VERSION=\"4\">\n", FileKind::Fibex),
        ("<!DOCTYPE html>\n<title>module.dbc</title>\n", FileKind::Html),
        ("<note/>\n", FileKind::Xml),
        ("FormatVersion=6.0 // comment\nTitle=\"x\"\n", FileKind::Sym),
        ("\nLIN_description_file;\n", FileKind::Ldf),
        ("ASAP2_VERSION 1 60\n/begin PROJECT x\n", FileKind::A2l),
        ("** a deck\n*Node\n1, 0., 0., 0.\n2, 1., 0., 0.\n", FileKind::Mesh),
        (
            "** a load case\n*INCLUDE, INPUT=column.inp\n*STEP\n*FILM\nFRONT, F, 26, 0.008\nBACK, F, 22, 0.008\n",
            FileKind::Mesh,
        ),
        ("{\"format\": \"isotherm-envelope\"}\n", FileKind::Json),
        ("---\n# a press\nmachine:\n  name: press-7\nbus:\n  cell: { type: modbus-tcp }\n", FileKind::Yaml),
        ("signals:\n  - name: bed\n    unit: degC\n", FileKind::Yaml),
        ("PAR1\0\0", FileKind::Parquet),
        ("PK\u{3}\u{4}\0", FileKind::Workbook),
        ("MDF     4.10", FileKind::Measurement),
        ("TDSm", FileKind::Measurement),
        ("BZh91AY", FileKind::Packed),
        ("ARROW1\0\0", FileKind::OtherTable),
        ("MATLAB 5.0 MAT-file, Platform: x", FileKind::OtherTable),
        ("%PDF-1.7", FileKind::Pdf),
    ] {
        assert_eq!(FileKind::of(text.as_bytes()), Some(kind), "{text}");
    }
    assert_eq!(FileKind::of(b"\x1f\x8b\x08"), Some(FileKind::Compressed));
}

#[test]
fn a_log_with_the_ending_of_another_format_is_named() {
    for (kind, ending, says) in [
        (FileKind::Parquet, "csv", Some(".parquet")),
        (FileKind::Parquet, "Parquet", None),
        (FileKind::Compressed, "csv", Some(".csv.gz")),
        (FileKind::Workbook, "zip", Some(".xlsx")),
        (FileKind::Workbook, "xls", None),
        (FileKind::Log, "xls", Some(".csv")),
        (FileKind::Log, "gz", Some(".csv")),
        (FileKind::Log, "txt", None),
        (FileKind::Profile, "csv", None),
    ] {
        let said = kind.of_another_ending(ending);
        assert_eq!(said.is_some(), says.is_some(), "{kind:?} {ending}");
        assert!(
            said.is_none_or(|said| says.is_some_and(|says| said.ends_with(says) || said.contains(says))),
            "{said:?}"
        );
    }
}

#[test]
fn other_texts_and_bytes_are_no_known_kind() {
    for text in [
        "",
        "\n\n",
        "a sentence, and another one\nwith, commas\n",
        "[signal.bed]\nregister = 3\n",
        "\0\0\0",
        "Note: a\ntext\n",
        "Serial: 7\n",
    ] {
        assert_eq!(FileKind::of(text.as_bytes()), None, "{text:?}");
    }
    // The lines above the head of a log may look like another file.
    for above in [
        "[DeviceInfo]\nSerial=7\n",
        "machine=VMC 1\n",
        "title=Run 5\nsource=channel 1\n",
        "*** Logger 7 ***\n",
        "* Logger 7\n",
    ] {
        let log = format!("{above}Date;Bed\n05.01.2026 06:00:10;20,1\n05.01.2026 06:00:20;20,2\n");
        assert_eq!(FileKind::of(log.as_bytes()), Some(FileKind::Log), "{above}");
    }
    // A list of numbers in a table of a profile is no log.
    assert_eq!(
        FileKind::of(format!("{PROFILE}x = [\n1.0, 2.0,\n3.0, 4.0,\n]\n").as_bytes()),
        Some(FileKind::Profile)
    );
}

#[test]
fn a_log_is_recognised_in_wide_characters_and_when_it_is_cut() {
    let log = "time;bed\r\n0;20,1\r\n60;20,2\r\n";
    let wide: Vec<u8> =
        std::iter::once(0xfeff).chain(log.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    assert_eq!(FileKind::of(&wide), Some(FileKind::Log));
    let long = "time,bed\n".to_owned() + &"60,20.2\n".repeat(HEAD);
    assert_eq!(FileKind::of(long.as_bytes()), Some(FileKind::Log));
}

#[test]
fn every_shipped_file_is_recognised_as_what_it_is() {
    let profiles = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../profiles");
    let of = |directory: &Path| -> Vec<(String, FileKind)> {
        let files = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
        let files =
            files.filter(|path| path.extension().is_some_and(|ending| ending == "toml" || ending == "dbc"));
        files.map(|path| (path.display().to_string(), FileKind::of_file(&path).unwrap())).collect()
    };
    let (machines, devices) = (of(&profiles), of(&profiles.join("devices")));
    assert!(machines.len() > 10 && devices.len() > 20);
    for (path, kind) in machines {
        let is_plant = path.ends_with(".plant.toml");
        assert_eq!(kind, if is_plant { FileKind::Plant } else { FileKind::Profile }, "{path}");
    }
    for (path, kind) in devices {
        let is_dbc = path.ends_with(".dbc");
        assert_eq!(kind, if is_dbc { FileKind::Dbc } else { FileKind::Template }, "{path}");
    }
}

#[test]
fn a_file_in_the_place_of_another_is_named_with_what_to_do() {
    let said = |found: FileKind, wanted| {
        let Misplaced { message, help } = found.instead_of(wanted).unwrap();
        format!("{message}; {help}")
    };
    assert_eq!(
        said(FileKind::Log, FileKind::Profile),
        "this is a log, not a profile; give the profile of the machine first and the log after it, as `isotherm \
         identify machine.toml day.csv`"
    );
    assert!(
        said(FileKind::Eds, FileKind::Dbc)
            .starts_with("this is an EDS file, not a DBC file; this file describes")
    );
    assert!(said(FileKind::Kcd, FileKind::Dbc).contains("`cantools convert THIS_FILE module.dbc`"));
    assert!(said(FileKind::Profile, FileKind::Log).contains("a profile, not a log; give the profile first"));
    assert!(said(FileKind::Template, FileKind::Profile).contains("devices/NAME.toml"));
    assert!(said(FileKind::ModelBlock, FileKind::Profile).contains("[[axis."));
}

#[test]
fn a_file_that_serves_is_not_reported() {
    for (found, wanted) in [
        (FileKind::Profile, FileKind::Profile),
        (FileKind::Profile, FileKind::ModelBlock),
        (FileKind::Parquet, FileKind::Log),
        (FileKind::Workbook, FileKind::Log),
        (FileKind::Compressed, FileKind::Log),
    ] {
        assert_eq!(found.instead_of(wanted), None, "{found:?} as {wanted:?}");
    }
}
