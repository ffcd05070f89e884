use super::*;

fn fault(device: &str, kind: &str, more: &str) -> String {
    format!("[[fault]]\ndevice = \"{device}\"\nkind = \"{kind}\"\n{more}\n")
}

fn complaint(text: &str) -> String {
    FaultScript::parse(text, &can_machine()).unwrap_err().to_string()
}

#[test]
fn what_makes_no_sense_on_a_can_line_is_refused() {
    for (text, expected) in [
        (
            fault("axtc", "exception", "code = 4"),
            "not possible on a CAN line; allowed: silent, late, garbage",
        ),
        (fault("axtc", "refuse", ""), "not possible on a CAN line"),
        (fault("axtc", "emergency", ""), "`code` is missing, for example 0x5030"),
        (fault("axtc", "emergency", "code = 0x10000"), "`code` must be from 1 to 0xFFFF"),
        (fault("axtc", "emergency", "code = 1\nfor = 2"), "write `for_time`"),
        (fault("axtc", "error-frame", ""), "`error` is missing, one of no-acknowledge, stuff"),
        (fault("axtc", "error-frame", "error = \"tired\""), "`error` is one of no-acknowledge"),
        (
            fault("axtc", "error-frame", "error = \"stuff\"\nfor_time = \"1s\""),
            "happens once: write `every`, or remove `for`",
        ),
        (fault("axtc", "babbling", "id = 0x20000000"), "`id` must be at most 0x1FFFFFFF"),
        (fault("axtc", "babbling", "every = \"1us\""), "at least 100 µs"),
        (fault("axtc", "short-frame", "id = 5"), "`id` has no effect for this kind of fault"),
    ] {
        let error = complaint(&text);
        assert!(error.contains(expected), "{error}");
    }
    let modbus = FaultScript::parse(&fault("cnc", "babbling", ""), &profile()).unwrap_err().to_string();
    assert_eq!(modbus, "fault 1 (babbling): `cnc` is not a device on a CAN line");
}

#[test]
fn a_silent_node_neither_speaks_nor_hears() {
    let mut rig = Rig::new(&fault("axtc", "silent", "at = \"1500ms\"\nfor_time = \"2s\""));
    assert_eq!(rig.heard(2000, &["705"]), ["0 705#00", "1000 705#7F"]);
    assert_eq!(rig.give(2000, "605#4010610100000000"), [""; 0]);
    rig.give(2000, "000#0105");
    assert_eq!(rig.heard(4500, &["705"]), ["4000 705#7F"], "the command to start was lost on it");
}

#[test]
fn a_node_that_is_reset_boots_up_and_is_not_operational_any_more() {
    let mut rig = Rig::new(&fault("axtc", "restart", "at = \"1250ms\""));
    rig.start_all();
    rig.give(0, "605#2B001805F4010000");
    let sent = rig.heard(3000, &["705", "185"]);
    let sent: Vec<_> = sent.iter().map(|text| text.split_inclusive("#").next().unwrap()).collect();
    assert_eq!(sent, ["500 185#", "1000 705#", "1000 185#", "1250 705#", "2250 705#"]);
}

#[test]
fn short_frames_lack_the_last_byte_and_garbage_has_them_all() {
    let mut rig = Rig::new(&fault("canmod", "short-frame", "for = 3"));
    let sent: Vec<_> = rig.until(400).into_iter().filter_map(|(_, sent)| text(&sent)).collect();
    let lengths: Vec<_> =
        sent.iter().filter(|text| text.starts_with("002#")).map(|text| text.len()).collect();
    // The first two lengths belong to the multiplexed frame.
    assert_eq!(lengths, [12, 14, 14], "{sent:?}");
    let mut good = Rig::new("");
    let mut bad = Rig::new(&fault("canmod", "garbage", ""));
    let (good, bad) = (good.heard(0, &["002"]), bad.heard(0, &["002"]));
    assert_eq!(good[0].len(), bad[0].len());
    assert_ne!(good, bad);
}

#[test]
fn an_emergency_and_its_end_are_sent() {
    let mut rig = Rig::new(&fault("axtc", "emergency", "code = 0x5030\nat = \"1s\"\nfor_time = \"500ms\""));
    let reported = rig.heard(9000, &["085"]);
    assert_eq!(reported, ["1000 085#3050010000000000", "1500 085#0000000000000000"]);
    let mut rig = Rig::new(&fault("axtc", "emergency", "code = 0x4210"));
    assert_eq!(rig.heard(9000, &["085"]), ["0 085#1042090000000000"]);
    assert_eq!(rig.give(9000, "605#4001100000000000"), ["585#4F01100009000000"], "it stands in 1001h");
}

#[test]
fn a_babbling_node_sends_what_nobody_asked_for() {
    let mut rig = Rig::new(&fault("drive", "babbling", "at = \"10ms\"\nfor_time = \"5ms\""));
    let sent = rig.heard(100, &["7FF"]);
    let when: Vec<_> = sent.iter().map(|sent| sent.split(' ').next().unwrap()).collect();
    assert_eq!(when, ["10", "11", "12", "13", "14"]);
    let more = "id = 0x1ABCDE00\nevery = \"2ms\"\nfor = 3";
    assert_eq!(Rig::new(&fault("drive", "babbling", more)).heard(100, &["1ABCDE00"]).len(), 3);
}

#[test]
fn a_controller_s_trouble_is_reported_once_or_again_and_again() {
    let named = |name| BusError::named(name).unwrap();
    let errors = |more: &str| {
        let mut rig = Rig::new(&fault("drive", "error-frame", more));
        let sent = rig.until(2000);
        let error = |(at, sent)| match sent {
            Sent::Error(error) => Some((at, error)),
            Sent::Frame(..) => None,
        };
        sent.into_iter().filter_map(error).collect::<Vec<_>>()
    };
    assert_eq!(errors("error = \"bus-off\"\nat = \"1s\""), [(1000, named("bus-off"))]);
    let again = errors("error = \"passive\"\nat = \"1s\"\nevery = \"100ms\"\nfor = 3");
    assert_eq!(again, [1000, 1100, 1200].map(|at| (at, named("passive"))));
}

#[test]
fn sdo_requests_are_refused_answered_for_another_object_late_or_only_in_word() {
    let read = "614#4000200100000000";
    let mut rig = Rig::new(&fault("drive", "sdo-abort", "code = 0x06060000\nfor = 1"));
    rig.until(0);
    assert_eq!(rig.give(0, read), ["594#8000200100000606"]);
    assert_eq!(rig.give(0, read), ["594#4300200100000000"]);

    let mut rig = Rig::new(&fault("drive", "wrong-index", "for = 1"));
    rig.until(0);
    assert_eq!(rig.give(0, read), ["594#4301200100000000"]);

    let mut rig = Rig::new(&fault("drive", "ignored-write", ""));
    rig.until(0);
    assert_eq!(rig.give(0, "614#2300200107000000"), ["594#6000200100000000"]);
    assert_eq!(rig.give(0, read), ["594#4300200100000000"]);

    let mut rig = Rig::new(&fault("drive", "late", "delay = \"40ms\""));
    rig.until(0);
    let sent = rig.hardware.can_take(&rig.places, &frame(read), at(0));
    assert_eq!(sent, [Sent::Frame(frame("594#4300200100000000"), Some(Duration::from_millis(40)))]);
}
