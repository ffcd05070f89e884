use super::client::Answer;
use super::*;

const READ_BED: [u8; 5] = [4, 0, 0, 0, 1];

fn fault(device: &str, kind: &str, more: &str) -> String {
    format!("[[fault]]\ndevice = \"{device}\"\nkind = \"{kind}\"\n{more}\n")
}

/// Answer to one read of the bed during a fault that lasts one reply. Checks that the next answer is normal.
async fn once(kind: &str, more: &str) -> Answer {
    let run = start(&fault("thermocouples", kind, &format!("for = 1\n{more}"))).await;
    let mut cell = run.cell().await;
    let answer = cell.request(THERMOCOUPLES, &READ_BED).await;
    assert_eq!(run.cell().await.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1, "normal again");
    run.machine.stop().await.unwrap();
    answer
}

#[tokio::test]
async fn a_silent_device_leaves_the_others_on_its_line_alone() {
    let run = start(&fault("thermocouples", "silent", "for = 2")).await;
    let mut cell = run.cell().await;
    assert_eq!(cell.request(THERMOCOUPLES, &READ_BED).await, Answer::Silence);
    assert_eq!(cell.read(2, 3, 84, 2).await.len(), 2);
    assert_eq!(cell.request(THERMOCOUPLES, &READ_BED).await, Answer::Silence);
    assert_eq!(cell.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
}

#[tokio::test]
async fn wrong_answers_are_wrong_in_one_way_each() {
    let Answer::Frame { transaction: 1, unit: 1, pdu } = once("exception", "code = 6").await else {
        panic!()
    };
    assert_eq!(pdu, [0x84, 6]);
    assert!(matches!(once("wrong-unit", "").await, Answer::Frame { transaction: 1, unit: 2, .. }));
    assert!(matches!(once("wrong-transaction", "").await, Answer::Frame { transaction: 2, unit: 1, .. }));
    let Answer::Frame { pdu, .. } = once("wrong-function", "").await else { panic!() };
    assert_eq!((pdu[0], pdu[1]), (5, 2));
    let Answer::Frame { pdu, .. } = once("short-read", "").await else { panic!() };
    assert_eq!(pdu, [4, 0]);
    let Answer::Frame { pdu, .. } = once("long-read", "").await else { panic!() };
    assert_eq!((pdu.len(), pdu[1]), (6, 4));
    assert_eq!(once("close", "").await, Answer::Closed);
    assert_eq!(once("late", "delay = \"250ms\"").await, Answer::Silence);
}

#[tokio::test]
async fn a_late_answer_comes_nevertheless() {
    let run = start(&fault("thermocouples", "late", "delay = \"200ms\"\nfor = 1")).await;
    let mut cell = run.cell().await;
    assert_eq!(cell.request(THERMOCOUPLES, &READ_BED).await, Answer::Silence);
    assert!(matches!(cell.receive().await, Answer::Frame { transaction: 1, .. }));
}

#[tokio::test]
async fn garbage_is_no_modbus() {
    let run = start(&fault("thermocouples", "garbage", "for = 1")).await;
    let mut cell = run.cell().await;
    cell.send(&[0, 1, 0, 0, 0, 6, 1, 4, 0, 0, 0, 1]).await;
    let bytes = cell.raw().await;
    assert_eq!(bytes.len(), 16);
    assert!(super::super::modbus::Framing::Tcp.request(&bytes).is_err());
}

#[tokio::test]
async fn a_half_open_connection_stays_mute_and_a_new_one_does_not() {
    let run = start(&fault("thermocouples", "half-open", "after = 1\nfor = 1")).await;
    let mut cell = run.cell().await;
    assert_eq!(cell.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
    for _ in 0..2 {
        assert_eq!(cell.request(THERMOCOUPLES, &READ_BED).await, Answer::Silence);
    }
    assert_eq!(cell.request(2, &[3, 0, 84, 0, 2]).await, Answer::Silence);
    assert_eq!(run.cell().await.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
}

#[tokio::test]
async fn answers_can_stay_one_behind() {
    for (kind, stale) in [("one-behind", false), ("one-behind-stale", true)] {
        let run = start(&fault("counter", kind, "for = 3")).await;
        let mut cell = run.cell().await;
        assert_eq!(cell.request(2, &[3, 0, 84, 0, 1]).await, Answer::Silence);
        for (count, length) in [(2, 2), (1, 4)] {
            let answer = cell.request(2, &[3, 0, 84, 0, count]).await;
            let Answer::Frame { transaction, pdu, .. } = answer else { panic!("{answer:?}") };
            assert_eq!(pdu[1], length);
            assert_eq!(transaction, cell.transaction - u16::from(stale));
        }
        assert_eq!(cell.read(2, 3, 84, 2).await.len(), 2);
    }
}

#[tokio::test]
async fn a_wrong_echo_is_a_write_that_happened_and_an_ignored_write_one_that_did_not() {
    let run = start(&fault("cnc", "wrong-echo", "for = 1")).await;
    let mut control = run.control().await;
    assert_eq!(control.read(CNC, 3, 105, 1).await, [0], "a read is no concern of this fault");
    assert_eq!(control.write(CNC, 104, 84).await, [16, 0, 104, 0, 3]);
    assert_eq!(control.read(CNC, 3, 105, 1).await, [84]);
    let run = start(&fault("cnc", "ignored-write", "for = 1")).await;
    let mut control = run.control().await;
    assert_eq!(control.write(CNC, 104, 84).await, [16, 0, 104, 0, 2]);
    assert_eq!(control.read(CNC, 3, 105, 1).await, [0]);
}

#[tokio::test]
async fn a_refused_line_comes_back() {
    let mut run = start(&fault("thermocouples", "refuse", "at = \"10s\"\nfor_time = \"20s\"")).await;
    let address = run.machine.address(BusId(0)).unwrap();
    let mut cell = run.cell().await;
    run.sleeper.sleep(Duration::from_secs(10)).await;
    assert_eq!(cell.receive().await, Answer::Closed);
    assert!(tokio::net::TcpStream::connect(address).await.is_err());
    assert_eq!(run.control().await.read(CNC, 3, 104, 2).await, [0, 0]);
    run.sleeper.sleep(Duration::from_secs(20)).await;
    assert_eq!(run.cell().await.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
    run.machine.stop().await.unwrap();
}

#[tokio::test]
async fn broken_sensors_read_what_the_script_says() {
    let script = fault("thermocouples", "sentinel", "signal = \"bed\"\nfor = 2")
        + &fault("thermocouples", "value", "signal = \"wheelhead\"\nvalue = -12.3")
        + &fault("thermocouples", "nan", "signal = \"oil\"");
    let run = start(&script).await;
    let mut cell = run.cell().await;
    for bed_is_broken in [true, true, false] {
        let words = cell.read(THERMOCOUPLES, 4, 0, 4).await;
        assert_eq!(words[0] == 32767, bed_is_broken);
        assert_eq!(words[1].cast_signed(), -123);
        assert!(f32::from_bits(u32::from(words[2]) << 16 | u32::from(words[3])).is_nan());
    }
}

#[tokio::test]
async fn an_operator_writes_and_a_control_forgets() {
    let script = fault("cnc", "register", "register = \"holding:104\"\nwords = [0, 55]\nat = \"5s\"")
        + &fault("cnc", "restart", "after = 3");
    let mut run = start(&script).await;
    let mut control = run.control().await;
    control.write(CNC, 104, 84).await;
    run.sleeper.sleep(Duration::from_secs(4)).await;
    assert_eq!(control.read(CNC, 3, 105, 1).await, [84]);
    run.sleeper.sleep(Duration::from_secs(1)).await;
    assert_eq!(control.read(CNC, 3, 105, 1).await, [55]);
    assert_eq!(control.read(CNC, 3, 105, 1).await, [0]);
}

#[tokio::test]
async fn two_devices_of_one_unit_are_one_piece_of_hardware_with_the_same_faults() {
    let mut profile = profile();
    profile.devices[1].unit = THERMOCOUPLES;
    let faults = FaultScript::parse(&fault("counter", "silent", "for = 1"), &profile).unwrap();
    let run = super::support::start_with(&profile, Setup { faults, ..Setup::default() }).await;
    let mut cell = run.cell().await;
    assert_eq!(cell.request(THERMOCOUPLES, &READ_BED).await, Answer::Silence);
    assert_eq!(cell.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
    assert_eq!(cell.read(THERMOCOUPLES, 3, 84, 2).await.len(), 2);
}
