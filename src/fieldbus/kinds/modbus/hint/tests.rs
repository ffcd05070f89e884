use super::*;
use isotherm_core::explained::Explained;

const SEVERAL: Asked = Asked::Read { values: 3, gap: 0 };
const OVER_GAP: Asked = Asked::Read { values: 3, gap: 5 };
const ONE: Asked = Asked::Read { values: 1, gap: 0 };
const QUIRKS: &str = "serial.md#quirks";

/// Rows of the table: fault, request, and the key and the chapter that the advice names.
#[test]
fn each_observation_leads_to_its_key_and_its_chapter() {
    let peer = Fault::Peer;
    let functions = (Some("functions"), "control.md#the-function-that-writes");
    let protocol = (None, "serial.md#another-protocol-on-the-line");
    let longest = (Some("max_registers_per_request"), QUIRKS);
    for (fault, asked, expected) in [
        (Fault::Exception(2), OVER_GAP, Some((Some("max_gap"), QUIRKS))),
        (peer(PeerFault::LongException(2)), OVER_GAP, Some((Some("max_gap"), QUIRKS))),
        (Fault::Exception(2), SEVERAL, Some((Some("one_request_per_field"), QUIRKS))),
        (Fault::Exception(2), ONE, None),
        (Fault::Exception(2), Asked::Write(6), None),
        (Fault::Exception(3), SEVERAL, Some(longest)),
        (Fault::Exception(3), OVER_GAP, Some(longest)),
        (Fault::Exception(3), ONE, None),
        (Fault::Timeout, SEVERAL, Some(longest)),
        (Fault::Timeout, OVER_GAP, Some(longest)),
        (Fault::Timeout, ONE, None),
        (Fault::Timeout, Asked::Any, None),
        (Fault::Exception(1), Asked::Write(6), Some(functions)),
        (Fault::Exception(1), Asked::Write(16), Some(functions)),
        (peer(PeerFault::LongException(1)), Asked::Write(6), Some(functions)),
        (Fault::Exception(1), Asked::Write(5), None),
        (Fault::Exception(1), SEVERAL, None),
        (peer(PeerFault::Unit(255)), ONE, Some((Some("unit"), "troubleshooting.md#find-the-units"))),
        (peer(PeerFault::Length), SEVERAL, Some(longest)),
        (peer(PeerFault::Length), ONE, Some((Some("type"), "troubleshooting.md#read-a-register"))),
        (peer(PeerFault::Length), Asked::Any, None),
        (peer(PeerFault::Function), ONE, Some((Some("register"), "troubleshooting.md#read-a-register"))),
        (peer(PeerFault::Function), Asked::Write(6), None),
        (peer(PeerFault::Text(TextProtocol::ModbusAscii)), ONE, Some((Some("type"), protocol.1))),
        (peer(PeerFault::Text(TextProtocol::Dcon)), ONE, Some(protocol)),
        (peer(PeerFault::Text(TextProtocol::Other)), ONE, Some(protocol)),
        (peer(PeerFault::Echoed), ONE, Some(protocol)),
        (peer(PeerFault::Malformed), ONE, None),
    ] {
        let found = advice(Seen::of(fault, asked)).map(|advice| (advice.key, advice.chapter));
        assert_eq!(found, expected, "{fault:?} to {asked:?}");
    }
}

/// The default of `functions` already contains function 06, so a write with function 16 has several registers.
#[test]
fn a_refused_write_of_several_registers_leads_to_a_value_of_one_register() {
    let seen = Seen::of(Fault::Exception(1), Asked::Write(16));
    let hint = advice(seen).unwrap().hint;
    assert!(hint.contains("write a `type` of 16 bits") && hint.contains("with \"write-single\""), "{hint}");
}

#[test]
fn a_read_that_is_silent_while_the_device_answers_others_has_other_advice() {
    let seen = Seen::of(Fault::Timeout, SEVERAL);
    let only_this = Seen { others: Others::Answered, ..seen };
    let [seen, only_this] = [seen, only_this].map(|seen| advice(seen).unwrap());
    assert!(seen.hint.starts_with(SILENT) && seen.hint.contains("`max_gap`"), "{}", seen.hint);
    assert!(only_this.hint.contains("answers other requests"), "{}", only_this.hint);
    assert_eq!((seen.key, seen.chapter), (only_this.key, only_this.chapter));
}

#[test]
fn each_key_is_in_its_hint_and_in_the_reference_and_each_chapter_is_in_the_manual() {
    let manual = |file: &str| {
        let path = format!("{}/docs/{file}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read_to_string(&path).unwrap_or_else(|why| panic!("{path}: {why}"))
    };
    let reference = manual("profile.md");
    for sight in ALL {
        let Advice { hint, key, chapter } = sight.advice();
        if let Some(key) = key {
            assert!(hint.contains(&format!("`{key}")) || hint.contains(&format!(" {key} =")), "{hint}");
            assert!(reference.contains(&format!("`{key}`")), "{key} is no key of a profile");
        }
        let (file, anchor) = chapter.split_once('#').unwrap();
        let anchors =
            |heading: &str| heading.trim_matches(['#', ' ']).to_lowercase().replace(' ', "-") == anchor;
        let chapter = manual(file);
        assert!(chapter.lines().filter(|line| line.starts_with('#')).any(anchors), "{file} has no {anchor}");
        let said = Explained::new("cause", sight.advice().text()).to_string();
        assert!(said.ends_with(&format!(" See docs/{file}#{anchor}")), "{said}");
        assert!(!said.contains("?.") && !said.contains(".."), "{said}");
    }
}

const ALL: [Sight; 15] = [
    Sight::GapRefused,
    Sight::ValuesRefused,
    Sight::CountRefused,
    Sight::SeveralUnanswered,
    Sight::OnlySeveralUnanswered,
    Sight::SingleWriteRefused,
    Sight::MultipleWriteRefused,
    Sight::OtherUnit,
    Sight::OtherCount,
    Sight::OtherLength,
    Sight::OtherFunction,
    Sight::ModbusAscii,
    Sight::Dcon,
    Sight::OtherText,
    Sight::Echoed,
];
