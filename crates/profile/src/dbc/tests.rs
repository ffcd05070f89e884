use super::*;
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
    assert_eq!(found.unit, Unit::named("degC"));
    assert_eq!(shown("Top.Slow"), "0x002, 16 bits from 7 down (Motorola), signed");
    let wide = file().signal("Wide.Real", None).unwrap();
    assert_eq!(wide.field.to_string(), "0x00000180, 32 bits from 256 up (Intel), float");
    assert_eq!((wide.field.is_fd, wide.unit), (true, Unit::named("mm")));
}

#[test]
fn multiplexers_are_followed_through_each_other() {
    let two = file().signal("Muxed.Two", None).unwrap();
    assert_eq!(two.unit, Unit::named("um"));
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
    assert_eq!(found.unit, Unit::named("um"));
}

#[test]
fn no_text_makes_the_reading_panic() {
    for cut in (0..FILE.len()).step_by(7).filter(|cut| FILE.is_char_boundary(*cut)) {
        if let Ok(file) = DbcFile::read(FILE.as_bytes()[..cut].to_vec()) {
            let _ = (file.signal("Muxed.Deep", None), file.signal("Top.Slow", Some(3)));
        }
    }
}
