use super::super::sdo::{Client, Data, Progress};
use super::*;
use crate::fieldbus::error::{Fault, PeerFault};
use isotherm_core::codec::Entry;

const SPEED: Entry = Entry::new(0x7130, 1);
const MALFORMED: Fault = Fault::Peer(PeerFault::Malformed);

fn client() -> Client {
    Client::new(node(5))
}

fn request(data: [u8; 8]) -> Frame {
    frame(0x605, &data)
}

fn answer(data: [u8; 8]) -> Frame {
    frame(0x585, &data)
}

fn read(progress: Option<Progress>) -> Data {
    match progress {
        Some(Progress::Read(data)) => data,
        other => panic!("nothing was read: {other:?}"),
    }
}

#[test]
fn a_short_entry_is_read_with_one_answer() {
    for (command, bytes) in [
        (0x4f, &[0x00][..]),
        (0x4b, &[0x00, 0xfe]),
        (0x47, &[0x00, 0xfe, 0x12]),
        (0x43, &[0x00, 0xfe, 0x12, 0x34]),
    ] {
        let mut client = client();
        assert_eq!(client.read(SPEED), request([0x40, 0x30, 0x71, 0x01, 0, 0, 0, 0]));
        let data = read(client.take(&answer([command, 0x30, 0x71, 0x01, 0x00, 0xfe, 0x12, 0x34])));
        assert_eq!(data.bytes(), bytes);
        assert_eq!(data.of_width(bytes.len()), Ok(bytes));
        assert_eq!(data.of_width(8), Err(Fault::Peer(PeerFault::Width)));
    }
}

#[test]
fn an_answer_that_does_not_say_its_width_has_that_of_the_type() {
    let mut client = client();
    client.read(SPEED);
    let data = read(client.take(&answer([0x42, 0x30, 0x71, 0x01, 0x00, 0xfe, 0, 0])));
    assert_eq!(data.of_width(2), Ok(&[0x00, 0xfe][..]));
    assert_eq!(data.of_width(4), Ok(&[0x00, 0xfe, 0, 0][..]));
    assert!(data.of_width(8).is_err());
}

#[test]
fn a_long_entry_is_read_in_segments_with_alternating_toggle() {
    let mut client = client();
    client.read(Entry::new(0x1008, 0));
    let next = client.take(&answer([0x41, 0x08, 0x10, 0, 9, 0, 0, 0]));
    assert_eq!(next, Some(Progress::Send(request([0x60, 0, 0, 0, 0, 0, 0, 0]))));
    let next = client.take(&answer([0x00, b'A', b'X', b'T', b'C', b'4', b'C', b'O']));
    assert_eq!(next, Some(Progress::Send(request([0x70, 0, 0, 0, 0, 0, 0, 0]))));
    let data = read(client.take(&answer([0x1b, b'-', b'1', 0, 0, 0, 0, 0])));
    assert_eq!(data.bytes(), b"AXTC4CO-1");
}

#[test]
fn values_are_written_at_once_and_longer_ones_in_segments() {
    for (bytes, first) in [
        (&[7][..], [0x2f, 0, 0x20, 1, 7, 0, 0, 0]),
        (&[7, 8], [0x2b, 0, 0x20, 1, 7, 8, 0, 0]),
        (&[7, 8, 9], [0x27, 0, 0x20, 1, 7, 8, 9, 0]),
        (&[7, 8, 9, 10], [0x23, 0, 0x20, 1, 7, 8, 9, 10]),
    ] {
        let mut client = client();
        assert_eq!(client.write(Entry::new(0x2000, 1), bytes), request(first));
        assert_eq!(client.take(&answer([0x60, 0, 0x20, 1, 0, 0, 0, 0])), Some(Progress::Written));
    }
    let mut client = client();
    let first = client.write(Entry::new(0x2000, 1), &[1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(first, request([0x21, 0, 0x20, 1, 8, 0, 0, 0]));
    let next = client.take(&answer([0x60, 0, 0x20, 1, 0, 0, 0, 0]));
    assert_eq!(next, Some(Progress::Send(request([0x00, 1, 2, 3, 4, 5, 6, 7]))));
    let next = client.take(&answer([0x20, 0, 0, 0, 0, 0, 0, 0]));
    assert_eq!(next, Some(Progress::Send(request([0x1d, 8, 0, 0, 0, 0, 0, 0]))));
    assert_eq!(client.take(&answer([0x30, 0, 0, 0, 0, 0, 0, 0])), Some(Progress::Written));
}

#[test]
fn a_refusal_is_reported_in_the_words_of_its_code() {
    let mut client = client();
    client.read(SPEED);
    let progress = client.take(&answer([0x80, 0x30, 0x71, 1, 0, 0, 2, 6]));
    let refused = Fault::Aborted(AbortCode::NO_OBJECT);
    assert_eq!(progress, Some(Progress::Failed(refused, None)));
    assert_eq!(refused.to_string(), "refused: there is no such object (abort 0602 0000h)");
}

#[test]
fn what_cannot_be_the_answer_is_left_alone() {
    let right = answer([0x4b, 0x30, 0x71, 1, 0x34, 0x12, 0, 0]);
    let mut client = client();
    assert_eq!(client.take(&right), None, "nothing was asked");
    client.read(SPEED);
    for other in [
        answer([0x4b, 0x30, 0x71, 2, 9, 9, 0, 0]),
        answer([0x4b, 0x31, 0x71, 1, 9, 9, 0, 0]),
        answer([0x80, 0x30, 0x71, 2, 0, 0, 2, 6]),
        answer([0x60, 0x30, 0x71, 1, 0, 0, 0, 0]),
        answer([0x00, 1, 2, 3, 4, 5, 6, 7]),
        frame(0x586, right.data()),
        frame(0x585, &right.data()[..7]),
        frame(0x585, &[]),
    ] {
        assert_eq!(client.take(&other), None, "{other:?}");
    }
    assert_eq!(read(client.take(&right)).bytes(), [0x34, 0x12]);
}

#[test]
fn a_write_that_is_not_the_one_under_way_does_not_confirm_it() {
    let mut client = client();
    client.write(SPEED, &[1, 0]);
    assert_eq!(client.take(&answer([0x60, 0x30, 0x71, 2, 0, 0, 0, 0])), None);
    assert_eq!(client.take(&answer([0x4b, 0x30, 0x71, 1, 1, 0, 0, 0])), None);
    assert_eq!(client.take(&answer([0x60, 0x30, 0x71, 1, 0, 0, 0, 0])), Some(Progress::Written));
}

#[test]
fn segments_in_a_wrong_order_or_of_a_wrong_length_end_the_transfer() {
    let begun = || {
        let mut client = client();
        client.read(Entry::new(0x1008, 0));
        client.take(&answer([0x41, 0x08, 0x10, 0, 9, 0, 0, 0]));
        client
    };
    let toggle = begun().take(&answer([0x10, 1, 2, 3, 4, 5, 6, 7]));
    let abort = request([0x80, 0x08, 0x10, 0, 0, 0, 3, 5]);
    assert_eq!(toggle, Some(Progress::Failed(MALFORMED, Some(abort))));
    let too_short = begun().take(&answer([0x01, 1, 2, 3, 4, 5, 6, 7]));
    let abort = request([0x80, 0x08, 0x10, 0, 0x10, 0, 7, 6]);
    assert_eq!(too_short, Some(Progress::Failed(MALFORMED, Some(abort))));
    let mut long = begun();
    long.take(&answer([0x00, 1, 2, 3, 4, 5, 6, 7]));
    let too_long = long.take(&answer([0x11, 1, 2, 3, 4, 5, 6, 7]));
    assert_eq!(too_long, Some(Progress::Failed(MALFORMED, Some(abort))));
}

#[test]
fn nothing_is_read_without_end() {
    let mut client = client();
    let entry = Entry::new(0x1008, 0);
    client.read(entry);
    let announced = client.take(&answer([0x41, 0x08, 0x10, 0, 0, 0, 0, 1]));
    assert!(matches!(announced, Some(Progress::Failed(MALFORMED, Some(_)))));

    let mut client = Client::new(node(5));
    client.read(entry);
    client.take(&answer([0x40, 0x08, 0x10, 0, 0, 0, 0, 0]));
    let mut toggle = 0;
    for _ in 0..1000 {
        match client.take(&answer([toggle, 1, 2, 3, 4, 5, 6, 7])) {
            Some(Progress::Send(_)) => toggle ^= 0x10,
            other => return assert!(matches!(other, Some(Progress::Failed(MALFORMED, _)))),
        }
    }
    panic!("7000 bytes were read");
}

#[test]
fn a_time_out_ends_the_transfer_at_both_ends() {
    let mut client = client();
    assert_eq!(client.timed_out(), None, "nothing was awaited");
    client.read(SPEED);
    let abort = request([0x80, 0x30, 0x71, 1, 0, 0, 4, 5]);
    assert_eq!(client.timed_out(), Some(abort));
    assert_eq!(client.take(&answer([0x4b, 0x30, 0x71, 1, 9, 9, 0, 0])), None, "it comes too late");
}

#[test]
fn after_a_time_out_a_late_answer_is_not_taken_for_the_next_one() {
    let device_type = request([0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
    let mut client = client();
    client.write(SPEED, &[1, 0]);
    client.timed_out();
    assert_eq!(client.write(SPEED, &[2, 0]), device_type, "it settles first");
    let late = answer([0x60, 0x30, 0x71, 1, 0, 0, 0, 0]);
    assert_eq!(client.take(&late), None, "the confirmation of the first write");
    let settled = client.take(&answer([0x43, 0x00, 0x10, 0, 4, 1, 0, 0]));
    assert_eq!(settled, Some(Progress::Begin(request([0x2b, 0x30, 0x71, 1, 2, 0, 0, 0]))));
    assert_eq!(client.take(&late), Some(Progress::Written));
    assert_eq!(client.read(SPEED), request([0x40, 0x30, 0x71, 1, 0, 0, 0, 0]), "and is settled");
}

#[test]
fn the_late_answer_to_one_settling_question_is_not_taken_for_that_to_the_next() {
    let mut client = client();
    client.read(SPEED);
    client.timed_out();
    client.write(SPEED, &[1, 0]);
    let settled = client.take(&answer([0x43, 0x00, 0x10, 0, 4, 1, 0, 0]));
    assert!(matches!(settled, Some(Progress::Begin(_))));
    client.timed_out();
    client.write(SPEED, &[2, 0]);
    client.timed_out();
    client.write(SPEED, &[3, 0]);
    let first = client.take(&answer([0x4f, 0x01, 0x10, 0, 0, 0, 0, 0]));
    assert_eq!(first, None, "the confirmation of 1 may still be under way");
    let second = client.take(&answer([0x4f, 0x18, 0x10, 0, 4, 0, 0, 0]));
    assert_eq!(second, Some(Progress::Begin(request([0x2b, 0x30, 0x71, 1, 3, 0, 0, 0]))));
}

#[test]
fn a_node_that_stays_silent_costs_one_time_out_each_time() {
    let mut client = client();
    client.read(SPEED);
    client.timed_out();
    for [low, high, sub] in
        [[0x00, 0x10, 0], [0x01, 0x10, 0], [0x18, 0x10, 0], [0x18, 0x10, 1], [0x00, 0x10, 0]]
    {
        client.read(SPEED);
        let abort = request([0x80, low, high, sub, 0, 0, 4, 5]);
        assert_eq!(client.timed_out(), Some(abort));
        assert_eq!(client.timed_out(), None);
    }
}

#[test]
fn a_node_without_a_device_type_settles_with_its_refusal() {
    let mut client = client();
    client.read(SPEED);
    client.timed_out();
    client.read(SPEED);
    let settled = client.take(&answer([0x80, 0x00, 0x10, 0, 0, 0, 2, 6]));
    assert_eq!(settled, Some(Progress::Begin(request([0x40, 0x30, 0x71, 1, 0, 0, 0, 0]))));
}
