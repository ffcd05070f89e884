use super::*;

fn fixed(values: &[(&str, &str, &str)]) -> String {
    let fault = |(signal, kind, value): &(&str, &str, &str)| {
        format!("[[fault]]\ndevice = \"canmod\"\nkind = \"{kind}\"\nsignal = \"{signal}\"\n{value}\n")
    };
    values.iter().map(fault).collect()
}

#[test]
fn a_device_that_only_sends_sends_in_its_period_from_the_beginning() {
    let mut rig = Rig::new("");
    let sent = rig.heard(1000, &["002"]);
    let when: Vec<_> = sent.iter().map(|sent| sent.split(' ').next().unwrap()).collect();
    assert_eq!(when, ["0", "200", "400", "600", "800", "1000"]);
}

#[test]
fn values_stand_at_their_bits_and_bytes_that_nobody_needs_are_not_sent() {
    let faults = fixed(&[
        ("junction", "value", "value = 25.0"),
        ("status", "value", "value = 2"),
        ("oil", "value", "value = 100.5"),
    ]);
    // 25 °C: (25 + 512) · 64 = 8640h; 100.5 °C: (100.5 + 16384) · 128 = 203240h, from bit 18 on.
    let oil = 0x20_3240_u64 << 18 | 2 << 16 | 0x8640;
    let bytes: String = oil.to_le_bytes()[..5].iter().map(|byte| format!("{byte:02X}")).collect();
    assert_eq!(Rig::new(&faults).heard(0, &["002"]), [format!("0 002#{bytes}")]);
}

#[test]
fn each_selection_of_a_multiplexed_frame_comes_in_one_of_its_own() {
    let faults = fixed(&[("third", "value", "value = 1.0"), ("seventh", "sentinel", "")]);
    assert_eq!(Rig::new(&faults).heard(0, &["300"]), ["0 300#031000", "0 300#0700FE"]);
}

#[test]
fn a_parameter_group_is_sent_with_29_bits_and_a_long_frame_as_can_fd() {
    let faults = fixed(&[("coolant", "value", "value = 60.0"), ("far", "value", "value = -1.0")]);
    let mut rig = Rig::new(&faults);
    let sent: Vec<_> = rig.until(0).iter().filter_map(|(_, sent)| text(sent)).collect();
    assert!(sent.contains(&"18FEEE00#64".to_owned()), "{sent:?}");
    assert!(sent.contains(&"302##0000000000000000000F0FF00".to_owned()), "{sent:?}");
}
