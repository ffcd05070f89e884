use std::time::Duration;

use super::abort::AbortCode;
use super::emergency::{Emergency, ErrorRegister};
use super::node::{NodeState, start};
use super::*;

mod bus;
mod master;
mod sdo;

fn node(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

fn frame(raw: u16, data: &[u8]) -> Frame {
    Frame::classic(CanId::of_11_bits(raw), data).unwrap()
}

#[test]
fn there_are_127_nodes() {
    assert_eq!(NodeId::new(0), None);
    assert_eq!(NodeId::new(128), None);
    assert_eq!((node(1).get(), node(127).get()), (1, 127));
}

#[test]
fn the_command_to_start_names_its_node() {
    assert_eq!(start(node(5)), frame(0, &[1, 5]));
}

#[test]
fn a_heartbeat_tells_the_state_whatever_its_top_bit() {
    for (byte, state, words) in [
        (0x00, NodeState::BootedUp, "booted up"),
        (0x04, NodeState::Stopped, "stopped"),
        (0x05, NodeState::Operational, "operational"),
        (0x85, NodeState::Operational, "operational"),
        (0x7f, NodeState::PreOperational, "pre-operational"),
        (0xff, NodeState::PreOperational, "pre-operational"),
        (0x11, NodeState::Unknown(0x11), "in an undefined state (11h)"),
    ] {
        assert_eq!(NodeState::of(&frame(0x705, &[byte])), Some((node(5), state)));
        assert_eq!(state.to_string(), words);
    }
    assert_eq!(NodeState::of(&frame(0x705, &[])), None, "a guarding request has no byte");
    assert_eq!(NodeState::of(&frame(0x700, &[5])), None, "there is no node 0");
    assert_eq!(NodeState::of(&frame(0x780, &[5])), None, "there is no node 128");
    assert_eq!(NodeState::of(&frame(0x685, &[5])), None);
}

#[test]
fn an_emergency_is_reported_with_what_stands() {
    let reported =
        |data: &[u8]| Emergency::of(&frame(0x085, data)).map(|(_, emergency)| emergency.to_string());
    for (data, words) in [
        (&[0x00, 0x00, 0x00, 0, 0, 0, 0, 0][..], "0000h"),
        (&[0x10, 0x42, 0x09, 0, 0, 0, 0, 0], "4210h; error register: generic, temperature"),
        (
            &[0x30, 0x50, 0x81, 1, 0, 0, 0, 0xa0],
            "5030h; error register: generic, maker's own; 01 00 00 00 A0",
        ),
        (&[0x01, 0xff, 0x00], "FF01h"),
    ] {
        assert_eq!(reported(data).as_deref(), Some(words));
    }
    assert_eq!(reported(&[0x10, 0x42]), None, "without an error register it is too short");
    assert_eq!(Emergency::of(&frame(0x080, &[])), None, "SYNC is no emergency");
    let (_, over) = Emergency::of(&frame(0x085, &[0, 0, 0])).unwrap();
    assert!(over.is_over());
    assert_eq!(ErrorRegister(0).to_string(), "error register clear");
}

#[test]
fn an_abort_is_reported_in_words_and_with_its_code() {
    assert_eq!(AbortCode(0x0602_0000).to_string(), "there is no such object (abort 0602 0000h)");
    assert_eq!(AbortCode(0x0609_0030).to_string(), "the value is not allowed (abort 0609 0030h)");
    assert_eq!(AbortCode(0x1234_5678).to_string(), "a manufacturer-specific reason (abort 1234 5678h)");
}
