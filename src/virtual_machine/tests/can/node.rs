use super::machine::{DISPLAY, DRIVE, offset, shown};
use super::*;
use isotherm_core::codec::{DataType, Object};
use proptest::prelude::*;

#[test]
fn a_node_boots_up_waits_to_be_started_and_beats() {
    let mut rig = Rig::new("");
    assert_eq!(rig.heard(2500, &["705", "185"]), ["0 705#00", "1000 705#7F", "2000 705#7F"]);
    assert_eq!(rig.give(2500, "000#0106"), [""; 0], "another node");
    assert_eq!(rig.heard(3500, &["705"]), ["3000 705#7F"]);
    rig.give(3500, "000#0105");
    assert_eq!(rig.heard(4500, &["705"]), ["4000 705#05"]);
    rig.give(4500, "000#0200");
    assert_eq!(rig.heard(5500, &["705"]), ["5000 705#04"]);
    rig.give(5500, "000#8005");
    assert_eq!(rig.heard(6500, &["705"]), ["6000 705#7F"]);
    let others = rig.heard(9500, &["707", "70C", "714"]);
    assert_eq!(others, [""; 0], "heartbeats are off unless somebody wants them");
}

#[test]
fn a_node_that_starts_by_itself_does() {
    let mut rig = Rig::new("");
    rig.until(0);
    assert_eq!(rig.give(1, "20C#E8030000"), [""; 0]);
    assert_eq!(rig.cell(DISPLAY, &shown(), 2), [0, 1000]);
}

#[test]
fn a_pdo_whose_timer_the_setup_list_writes_is_silent_until_it_is_written() {
    let mut rig =
        Rig::new("[[fault]]\ndevice = \"axtc\"\nkind = \"value\"\nsignal = \"bed\"\nvalue = 25.0\n");
    rig.start_all();
    assert_eq!(rig.heard(2000, &["185"]), [""; 0]);
    let written = rig.give(2000, "605#2B001805C8000000");
    assert_eq!(written, ["585#6000180500000000"]);
    let sent = rig.heard(2500, &["185"]);
    assert_eq!(sent.len(), 2);
    assert!(sent[0].starts_with("2200 185#9001") && sent[1].starts_with("2400 185#9001"), "{sent:?}");
    rig.give(2500, "605#2B00180500000000");
    assert_eq!(rig.heard(9000, &["185"]), [""; 0]);
}

#[test]
fn an_encoder_s_cycle_is_the_timer_of_its_first_pdo_and_its_second_comes_with_sync() {
    let mut rig = Rig::new("");
    rig.start_all();
    assert_eq!(rig.give(0, "607#2B00620032000000"), ["587#6000620000000000"]);
    assert_eq!(rig.heard(220, &["187"]).len(), 4);
    assert_eq!(rig.give(220, "607#4000180500000000"), ["587#4B00180532000000"], "50 ms");
    assert_eq!(rig.give(220, "607#2F01180202000000"), ["587#6001180200000000"]);
    let mut of_second = Vec::new();
    for tick in 0..6 {
        let sent = rig.give(300 + tick, "080#");
        of_second.push(sent.iter().filter(|text| text.starts_with("287#")).count());
    }
    assert_eq!(of_second, [0, 1, 0, 1, 0, 1], "with every second one");
}

#[test]
fn a_pdo_that_is_switched_off_or_given_another_identifier_does_not_come() {
    let mut rig = Rig::new("");
    rig.start_all();
    rig.give(0, "607#2B00620032000000");
    assert_eq!(rig.heard(100, &["187"]).len(), 2);
    rig.give(100, "607#2300180187010080");
    assert_eq!(rig.heard(1000, &["187"]), [""; 0]);
    rig.give(1000, "607#2300180187010000");
    assert_eq!(rig.heard(1100, &["187"]).len(), 2);
}

#[test]
fn what_is_measured_and_what_is_verified_is_read_by_sdo() {
    let broken = "[[fault]]\ndevice = \"axtc\"\nkind = \"sentinel\"\nsignal = \"bed_object\"\n";
    let mut rig = Rig::new(broken);
    rig.until(0);
    assert_eq!(rig.give(1, "605#4030710100000000"), ["585#4B30710100FE0000"], "-512, open circuit");
    assert_eq!(rig.give(1, "605#4010610100000000"), ["585#4F10610103000000"]);
    assert_eq!(rig.give(1, "605#2F10610104000000"), ["585#8010610102000106"], "it can only be read");
    assert_eq!(rig.give(1, "605#4008100000000000"), ["585#4308100061787463"], "axtc");
    rig.give(1, "000#0205");
    assert_eq!(rig.give(1, "605#4030710100000000"), [""; 0], "a stopped node answers no SDO");
}

#[test]
fn what_a_frame_writes_is_kept_and_read_again_by_sdo() {
    let mut rig = Rig::new("");
    rig.until(0);
    rig.give(1, "20C#40E2010000000000");
    assert_eq!(rig.cell(DISPLAY, &shown(), 2), [1, 0xe240]);
    assert_eq!(rig.give(1, "60C#40105F0000000000"), ["58C#43105F0040E20100"]);
    rig.give(1, "60C#23105F0007000000");
    assert_eq!(rig.cell(DISPLAY, &shown(), 2), [0, 7], "somebody else changes it");
    let seen = rig.hardware.journal.clone().unwrap();
    let wanted: Vec<_> = seen.iter().map(|seen| (&seen.address, seen.wanted.clone())).collect();
    let again = Address::Object(Object::new(0x5f10, 0, DataType::I32));
    let (process, object) = (&shown(), &again);
    assert_eq!(
        wanted,
        [(process, vec![1, 0xe240]), (object, vec![1, 0xe240]), (object, vec![0, 7]), (process, vec![0, 7])]
    );
}

#[test]
fn what_the_node_says_of_itself_is_not_measured() {
    let mut rig = Rig::new("");
    rig.until(0);
    assert_eq!(rig.give(1, "605#4017100000000000"), ["585#4B171000E8030000"], "its heartbeat, 1 s");
    assert_eq!(rig.give(1, "605#2B171000C8000000"), ["585#6017100000000000"]);
    assert_eq!(rig.heard(601, &["705"]), ["201 705#7F", "401 705#7F", "601 705#7F"]);
    assert_eq!(rig.give(700, "605#4017100000000000"), ["585#4B171000C8000000"]);
}

#[test]
fn a_frame_that_is_too_short_is_not_taken_and_complained_of() {
    let mut rig = Rig::new("");
    rig.until(0);
    assert_eq!(rig.give(1, "20C#40E201"), ["08C#1082110000000000"]);
    assert_eq!(rig.cell(DISPLAY, &shown(), 2), [0, 0]);
}

#[test]
fn process_data_is_taken_only_while_operational_and_sdo_before_too() {
    let mut rig = Rig::new("");
    rig.until(0);
    rig.give(1, "000#800C");
    rig.give(1, "20C#40E2010000000000");
    assert_eq!(rig.cell(DISPLAY, &shown(), 2), [0, 0]);
    assert_eq!(rig.give(1, "614#230020016AFFFFFF"), ["594#6000200100000000"]);
    assert_eq!(rig.cell(DRIVE, &offset(), 2), [0xffff, 0xff6a]);
    let applied = rig.hardware.applied_um(isotherm_profile::AxisId(0));
    assert!((applied + 0.15).abs() < 1e-9, "{applied}");
}

#[test]
fn a_reset_forgets_what_was_written_and_that_of_the_communication_only_its_part() {
    let mut rig = Rig::new("");
    rig.start_all();
    rig.give(1, "607#2B00620032000000");
    rig.give(1, "614#230020016AFFFFFF");
    assert_eq!(rig.give(2, "000#8200").iter().filter(|text| text.starts_with("70")).count(), 3);
    assert_eq!(rig.cell(DRIVE, &offset(), 2), [0xffff, 0xff6a]);
    assert_eq!(rig.give(2, "607#4000180500000000"), ["587#4B00180500000000"], "the timer is communication");
    assert_eq!(rig.give(3, "000#8114"), ["714#00"]);
    assert_eq!(rig.cell(DRIVE, &offset(), 2), [0, 0]);
    assert_eq!(rig.give(4, "614#4000200100000000"), ["594#4300200100000000"]);
}

proptest! {
    #[test]
    fn no_frame_makes_a_node_panic_and_a_start_brings_each_back(
        frames in prop::collection::vec((0..0x800u32, prop::collection::vec(any::<u8>(), 0..=8)), 0..80),
        requests in prop::collection::vec((0..8u8, 0..4usize, any::<[u8; 4]>()), 0..80),
    ) {
        const OBJECTS: [(u16, u8); 4] = [(0x1017, 0), (0x1800, 5), (0x6200, 0), (0x2000, 1)];
        let mut rig = Rig::new("");
        rig.until(0);
        for (place, (id, data)) in (1..).zip(frames) {
            let frame = Frame::classic(CanId::standard(id).unwrap(), &data).unwrap();
            rig.hardware.can_take(&rig.places, &frame, at(place));
        }
        for (place, (command, object, [a, b, c, d])) in (100..).zip(requests) {
            let (index, sub) = OBJECTS[object];
            let [low, high] = index.to_le_bytes();
            for node in [5u16, 7, 12, 20] {
                let data = [command << 5 | a & 0x1f, low, high, sub, a, b, c, d];
                let frame = Frame::classic(CanId::of_11_bits(0x600 + node), &data).unwrap();
                rig.hardware.can_take(&rig.places, &frame, at(place));
            }
        }
        rig.until(400);
        rig.give(400, "000#8100");
        rig.give(400, "000#0100");
        prop_assert_eq!(rig.give(401, "605#4010610100000000"), ["585#4F10610103000000"]);
    }
}
