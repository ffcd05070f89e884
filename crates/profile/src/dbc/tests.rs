use super::*;
use crate::Unit;
use isotherm_core::reading::Reason;

const FILE: &str = r#"VERSION ""

NS_ :

BS_:

BU_: Module

BO_ 2 Top: 8 Module
 SG_ T_Status : 16|2@1+ (1,0) [0|3] "" Vector__XXX
 SG_ T_Temp : 18|22@1+ (0.0078125,-16384) [0|0] "degC" Vector__XXX
 SG_ Slow : 7|16@0- (0.5,0) [0|0] "" Vector__XXX

BO_ 768 Muxed: 8 Module
 SG_ Page M : 0|4@1+ (1,0) [0|0] "" Vector__XXX
 SG_ Two m2 : 8|16@1- (0.1,0) [0|0] "µm" Vector__XXX
 SG_ Sub m3M : 8|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ Deep m0 : 16|16@1+ (1,0) [0|0] "" Vector__XXX
 SG_ Long : 56|16@1+ (1,0) [0|0] "" Vector__XXX

BO_ 2566844158 ET1: 8 Module
 SG_ Oil : 16|16@1+ (0.03125,-273) [0|0] "deg C" Vector__XXX

BO_ 2147484032 Wide: 64 Module
 SG_ Real : 256|32@1- (1,0) [0|0] "mm" Vector__XXX

BO_ 419361278 Cut: 8 Module
 SG_ X : 0|8@1+ (1,0) [0|0] "" Vector__XXX

BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2566844158 3;
SIG_VALTYPE_ 2147484032 Real : 1;
SG_MUL_VAL_ 768 Sub Page 3-3;
SG_MUL_VAL_ 768 Deep Sub 5-5, 16-24;
"#;

fn file() -> DbcFile {
    DbcFile::read(FILE.as_bytes().to_vec()).unwrap()
}

fn shown(name: &str) -> String {
    file().signal(name, None).unwrap().field.to_string()
}

#[test]
fn a_signal_is_where_its_file_says_with_scale_offset_and_unit() {
    let found = file().signal("Top.T_Temp", None).unwrap();
    assert_eq!(found.field.to_string(), "0x002, 22 bits from 18 up (Intel), unsigned");
    assert_eq!((found.scale, found.offset), (0.0078125, -16384.0));
    assert_eq!(found.unit, FileUnit::Known(Unit("degC")));
    assert_eq!(shown("Top.Slow"), "0x002, 16 bits from 7 down (Motorola), signed");
    let wide = file().signal("Wide.Real", None).unwrap();
    assert_eq!(wide.field.to_string(), "0x00000180, 32 bits from 256 up (Intel), float");
    assert_eq!((wide.field.is_fd, wide.unit), (true, FileUnit::Known(Unit("mm"))));
}

#[test]
fn multiplexers_are_followed_through_each_other() {
    let two = file().signal("Muxed.Two", None).unwrap();
    assert_eq!(two.unit, FileUnit::Known(Unit("um")));
    assert_eq!(two.field.read(&[2, 0xfe, 0xff]).unwrap().unwrap().registers(), [0xfffe]);
    assert_eq!(two.field.read(&[3, 0xfe, 0xff]), None);
    let deep = file().signal("Muxed.Deep", None).unwrap().field;
    assert_eq!(deep.multiplex.len(), 2);
    assert_eq!(deep.multiplex[1].values, [(5, 5), (16, 24)]);
    assert_eq!(deep.read(&[3, 20, 7, 0]).unwrap().unwrap().registers(), [7]);
    assert_eq!((deep.read(&[3, 6, 7, 0]), deep.read(&[2, 20, 7, 0])), (None, None));
    assert_eq!(deep.read(&[3, 20, 7]), Some(Err(Reason::ShortFrame)));
}

#[test]
fn a_parameter_group_is_taken_from_any_sender_or_from_the_device_s_own() {
    let frames = |source| file().signal("ET1.Oil", source).unwrap().field.frames;
    let sent = |raw| CanId::extended(raw).unwrap();
    assert!(frames(None).takes(sent(0x18fe_ee00)) && frames(None).takes(sent(0x0cfe_ee27)));
    assert!(frames(Some(0x27)).takes(sent(0x0cfe_ee27)) && !frames(Some(0x27)).takes(sent(0x18fe_ee00)));
    assert!(file().signal("Top.T_Temp", Some(1)).unwrap_err().message.contains("11 bits"));
}

#[test]
fn what_the_file_does_not_have_is_reported_with_the_nearest_word() {
    let reported = |name: &str| {
        let wrong = file().signal(name, None).unwrap_err();
        format!("{}; {}", wrong.message, wrong.help)
    };
    assert!(
        reported("Tpo.T_Temp").contains("no message `Tpo`; did you mean `Top`?"),
        "{}",
        reported("Tpo.T_Temp")
    );
    assert!(reported("Top.T_temp").contains("did you mean `T_Temp`? allowed: T_Status, T_Temp, Slow"));
    assert!(reported("T_Temp").contains("write \"Message.Signal\"; messages: Top, Muxed"));
}

#[test]
fn what_is_wrong_in_the_file_is_reported_at_the_file_s_own_line() {
    let long = file().signal("Muxed.Long", None).unwrap_err();
    assert_eq!(
        file().line(long.at.unwrap().0).unwrap().trim(),
        "SG_ Long : 56|16@1+ (1,0) [0|0] \"\" Vector__XXX"
    );
    assert!(long.message.contains("ends beyond the 8 bytes"));
    let cut = file().signal("Cut.X", None).unwrap_err();
    assert!(file().line(cut.at.unwrap().0).unwrap().starts_with("BO_ 419361278 Cut"));
    assert!(cut.help.contains("2147483648"));
    let broken = DbcFile::read(FILE.replace("16|2@1+", "16;2@1+").into_bytes()).unwrap_err();
    assert_eq!(broken.at, Some((10, 15)));
}

#[test]
fn a_file_in_the_western_code_page_is_read_as_well() {
    let bytes: Vec<u8> = FILE.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    assert!(std::str::from_utf8(&bytes).is_err());
    let found = DbcFile::read(bytes).unwrap().signal("Muxed.Two", None).unwrap();
    assert_eq!(found.unit, FileUnit::Known(Unit("um")));
}

#[test]
fn a_file_in_wide_characters_is_read_as_well() {
    for order in [u16::to_le_bytes, u16::to_be_bytes] {
        let wide = std::iter::once(0xfeff).chain(FILE.encode_utf16()).flat_map(order).collect();
        let found = DbcFile::read(wide).unwrap().signal("Muxed.Two", None).unwrap();
        assert_eq!(found.unit, FileUnit::Known(Unit("um")));
    }
}

#[test]
fn no_text_makes_the_reading_panic() {
    for cut in (0..FILE.len()).step_by(7).filter(|cut| FILE.is_char_boundary(*cut)) {
        if let Ok(file) = DbcFile::read(FILE.as_bytes()[..cut].to_vec()) {
            let _ = (file.signal("Muxed.Deep", None), file.signal("Top.Slow", Some(3)));
        }
    }
}

/// The file with more text at its end.
fn with(more: &str) -> DbcFile {
    DbcFile::read(format!("{FILE}{more}").into_bytes()).unwrap()
}

fn line_of(file: &DbcFile, name: &str) -> (String, String) {
    let wrong = file.signal(name, None).unwrap_err();
    let line = wrong.at.and_then(|(line, _)| file.line(line)).unwrap_or_default().trim().to_owned();
    (wrong.message, line)
}

#[test]
fn a_name_that_occurs_twice_is_refused_at_its_second_place() {
    let top = "\nBO_ 3 Top: 8 Module\n SG_ T_Temp : 0|8@1+ (1,0) [0|0] \"degC\" Vector__XXX\n";
    let (message, line) = line_of(&with(top), "Top.T_Temp");
    assert_eq!(
        (message.as_str(), line.as_str()),
        ("the DBC file has two messages `Top`", "BO_ 3 Top: 8 Module")
    );
    let help = with(top).signal("Top.Slow", None).unwrap_err().help;
    assert!(help.contains("0x002 and 0x003"), "{help}");
    // Other messages of the same file are not concerned.
    assert!(with(top).signal("Muxed.Two", None).is_ok());
    let twice = "\nBO_ 4 Pair: 8 Module\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" X\n SG_ B : 8|8@1+ (1,0) [0|0] \"\" X\n \
                 SG_ A : 16|8@1+ (2,0) [0|0] \"\" X\n";
    let (message, line) = line_of(&with(twice), "Pair.A");
    assert_eq!(message, "message `Pair` of the DBC file has two signals `A`");
    assert!(line.starts_with("SG_ A : 16|8"), "{line}");
    assert!(with(twice).signal("Pair.B", None).is_ok());
}

#[test]
fn two_messages_of_one_identifier_are_refused_only_for_a_signal_that_both_have() {
    let same = "\nBO_ 2 Again: 8 Module\n SG_ Slow : 0|8@1+ (1,0) [0|0] \"\" X\n SG_ Own : 8|8@1+ (1,0) [0|0] \"\" X\n";
    for name in ["Top.Slow", "Again.Slow"] {
        let (message, line) = line_of(&with(same), name);
        let wanted = "messages `Top` and `Again` of the DBC file have the same identifier 0x002 and signals of the same \
                      name";
        assert_eq!((message.as_str(), line.as_str()), (wanted, "BO_ 2 Again: 8 Module"));
    }
    assert!(with(same).signal("Top.T_Temp", None).is_ok() && with(same).signal("Again.Own", None).is_ok());
}

#[test]
fn a_scale_that_no_number_holds_is_refused_at_its_line() {
    for scaled in ["(1e999,0)", "(1,-1e999)"] {
        let far = format!("\nBO_ 4 Far: 8 Module\n SG_ A : 0|8@1+ {scaled} [0|0] \"\" X\n");
        let (message, line) = line_of(&with(&far), "Far.A");
        assert_eq!(message, "scale or offset of `A` is too large");
        assert!(line.starts_with("SG_ A : 0|8"), "{line}");
    }
}

const LONG: &str = "
BO_ 5 A_message_whose_name_is_cut_at_t: 8 Module
 SG_ A_signal_whose_name_is_cut_at_th : 0|8@1+ (1,0) [0|0] \"degC\" X
 SG_ A_signal_whose_name_is_cut_at_0 : 8|8@1+ (2,0) [0|0] \"degC\" X

BA_DEF_ BO_ \"SystemMessageLongSymbol\" STRING ;
BA_DEF_ SG_ \"SystemSignalLongSymbol\" STRING ;
BA_DEF_DEF_ \"SystemMessageLongSymbol\" \"\";
BA_DEF_DEF_ \"SystemSignalLongSymbol\" \"\";
BA_ \"SystemMessageLongSymbol\" BO_ 5 \"A_message_whose_name_is_cut_at_the_limit\";
BA_ \"SystemSignalLongSymbol\" SG_ 5 A_signal_whose_name_is_cut_at_th \"A_signal_whose_name_is_cut_at_the_limit\";
BA_ \"SystemSignalLongSymbol\" SG_ 5 A_signal_whose_name_is_cut_at_0 \"A_signal_whose_name_is_cut_at_the_end\";
";

#[test]
fn a_long_name_and_its_short_form_mean_the_same() {
    let file = with(LONG);
    let message = "A_message_whose_name_is_cut_at_the_limit";
    let scale = |name: &str| file.signal(name, None).unwrap().scale;
    for message in [message, "A_message_whose_name_is_cut_at_t"] {
        for (signal, expected) in [
            ("A_signal_whose_name_is_cut_at_the_limit", 1.0),
            ("A_signal_whose_name_is_cut_at_th", 1.0),
            ("A_signal_whose_name_is_cut_at_the_end", 2.0),
            ("A_signal_whose_name_is_cut_at_0", 2.0),
        ] {
            assert!((scale(&format!("{message}.{signal}")) - expected).abs() < 1e-12, "{message}.{signal}");
        }
    }
    let help =
        file.signal(&format!("{message}.A_signal_whose_name_is_cut_at_the_lim"), None).unwrap_err().help;
    assert!(help.starts_with("did you mean `A_signal_whose_name_is_cut_at_the_limit`?"), "{help}");
    // A message of one name may be the long name of another.
    let other =
        "\nBO_ 6 A_message_whose_name_is_cut_at_the_limit: 8 Module\n SG_ X : 0|8@1+ (1,0) [0|0] \"\" X\n";
    let twice = with(&format!("{LONG}{other}")).signal(&format!("{message}.X"), None).unwrap_err();
    assert!(twice.message.contains("two messages"), "{}", twice.message);
}

#[test]
fn the_frame_format_is_a_word_a_place_in_a_list_or_a_plain_number() {
    let definition =
        "BA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\",\"reserved\",\"J1939PG\";\n";
    let default = "BA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\n";
    let value = "BA_ \"VFrameFormat\" BO_ 2566844158 3;\n";
    let whole = [definition, default, value].concat();
    assert!(FILE.contains(&whole));
    let number = |kind: &str, format: &str| {
        let own = format!(
            "BA_DEF_ BO_ \"VFrameFormat\" {kind};\nBA_DEF_DEF_ \"VFrameFormat\" 0;\nBA_ \"VFrameFormat\" BO_ \
             2566844158 {format};\n"
        );
        DbcFile::read(FILE.replace(&whole, &own).into_bytes()).unwrap()
    };
    let sent = CanId::extended(0x0cfe_ee27).unwrap();
    let is_group = |file: &DbcFile| file.signal("ET1.Oil", None).unwrap().field.frames.takes(sent);
    assert!(is_group(&file()));
    for kind in ["INT 0 15", "HEX 0 15"] {
        assert!(is_group(&number(kind, "3")), "{kind}");
        assert!(!is_group(&number(kind, "1")) && !is_group(&number(kind, "40")), "{kind}");
        let is_fd = |format: &str| number(kind, format).signal("ET1.Oil", None).unwrap().field.is_fd;
        assert!(is_fd("15") && is_fd("14") && !is_fd("1"), "{kind}");
    }
    assert!(is_group(&number("STRING ", "\"J1939PG\"")) && is_group(&number("STRING ", "\"3\"")));
}

#[test]
fn a_text_that_is_no_dbc_file_is_refused_with_what_is_expected() {
    for text in ["hello\n", "ID;Frame;Signal\n123h;M;T\n", ";$FILEVERSION=1.1\n;$STARTTIME=43000.1\n"] {
        let wrong = DbcFile::read(text.as_bytes().to_vec()).unwrap_err();
        assert!(wrong.help.starts_with("give a DBC file"), "{text}: {}", wrong.help);
    }
    for text in ["", "\n\n", "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: Module\n"] {
        let wrong = DbcFile::read(text.as_bytes().to_vec()).unwrap().signal("Top.T_Temp", None).unwrap_err();
        assert_eq!(wrong.message, "the DBC file has no messages", "{text}");
    }
    for scaled in ["(0,1,0)", "(NaN,0)"] {
        let wrong = DbcFile::read(FILE.replace("(0.5,0)", scaled).into_bytes()).unwrap_err();
        assert_eq!(wrong.at.map(|(line, _)| line), Some(12), "{scaled}");
        assert!(wrong.help.contains("(0.1,0)") && wrong.help.contains("decimal points"), "{}", wrong.help);
    }
}

#[test]
fn a_file_of_another_kind_is_named_as_what_it_is() {
    for (text, words) in [
        ("[FileInfo]\nFileName=node.eds\n", "this is an EDS file, not a DBC file"),
        ("<NetworkDefinition>\n", "this is a KCD file, not a DBC file"),
        ("<?xml version=\"1.0\"?>\n<AUTOSAR>\n", "this is an ARXML file, not a DBC file"),
        ("FormatVersion=6.0\n", "this is a SYM file, not a DBC file"),
        ("<!DOCTYPE html>\n<html>\n", "this is a web page, not a DBC file"),
        ("PK\u{3}\u{4}\0\0", "not a DBC file"),
        ("time,bed\n0,20.1\n", "this is a log, not a DBC file"),
        ("[machine]\nname = \"m\"\n", "this is a profile, not a DBC file"),
    ] {
        let wrong = DbcFile::read(text.as_bytes().to_vec()).unwrap_err();
        assert!(wrong.message.contains(words), "{text}: {}", wrong.message);
        assert_eq!(wrong.at, None, "{text}");
    }
    // A mistake in a DBC file is reported at its place.
    assert!(DbcFile::read(FILE.replace("16|2@1+", "16;2@1+").into_bytes()).unwrap_err().at.is_some());
}

/// The diagnostic message DM1 has 14 bytes with three faults. Engines send it by BAM, the broadcast of the transport
/// protocol (SAE J1939-21).
const DM1: &str = "
BO_ 2566834727 DM1: 14 Module
 SG_ Lamp : 0|8@1+ (1,0) [0|0] \"\" X
 SG_ Third : 80|16@1+ (1,0) [0|0] \"\" X
";

#[test]
fn a_parameter_group_that_needs_several_frames_is_refused_with_the_reason() {
    let group = format!("{DM1}BA_ \"VFrameFormat\" BO_ 2566834727 3;\n");
    // The first byte does not arrive in a frame of the group either.
    for name in ["DM1.Lamp", "DM1.Third"] {
        for (file, source) in [(with(&group), None), (with(&group), Some(0x27)), (with(DM1), Some(0x27))] {
            let wrong = file.signal(name, source).unwrap_err();
            assert!(wrong.message.contains("parameter group of 14 bytes"), "{}", wrong.message);
            assert!(wrong.message.contains("transport protocol") && wrong.at.is_none(), "{}", wrong.message);
            assert!(wrong.help.contains("at most 8 bytes") && wrong.help.contains("ExtendedCAN_FD"));
        }
    }
    let of_file = "BA_DEF_ \"ProtocolType\" STRING ;\nBA_DEF_DEF_ \"ProtocolType\" \"\";\nBA_ \"ProtocolType\" \"J1939\";\n";
    assert!(with(&format!("{DM1}{of_file}")).signal("DM1.Lamp", None).is_err());
    // Without a mark, the message is a frame of CAN FD. A group of eight bytes is read as before.
    assert!(with(DM1).signal("DM1.Lamp", None).unwrap().field.is_fd);
    assert!(!with(&group).signal("ET1.Oil", Some(0x27)).unwrap().field.is_fd);
}

#[test]
fn a_parameter_group_in_a_frame_of_can_fd_may_be_long() {
    let definition = "BA_DEF_ BO_ \"VFrameFormat\" INT 0 15;\nBA_DEF_DEF_ \"VFrameFormat\" 0;\n";
    let own = format!("{DM1}{definition}BA_ \"VFrameFormat\" BO_ 2566834727 15;\n");
    let begin = FILE.find("BA_DEF_ BO_").unwrap();
    let file = DbcFile::read(format!("{}{own}", &FILE[..begin]).into_bytes()).unwrap();
    let found = file.signal("DM1.Third", Some(0x27)).unwrap();
    assert!(found.field.is_fd && found.field.frames.takes(CanId::extended(0x18fe_ca27).unwrap()));
}
