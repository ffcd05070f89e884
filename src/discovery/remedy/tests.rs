use super::*;
use crate::fieldbus::error::LinkFault;
use crate::fieldbus::kinds::modbus::text::TextProtocol;

#[test]
fn every_fault_is_reported_with_what_to_do() {
    let line: LineAddress = "tcp://10.0.0.7".parse().unwrap();
    let question = |register: &str| Question {
        line: &line,
        unit: 3,
        from: register.parse().unwrap(),
        count: 1,
        values: 1,
        timeout: Duration::from_millis(500),
    };
    for (fault, register, words) in [
        (Fault::Timeout, "input:0", &["unit 3 within 500ms: no answer in time", "isotherm scan"][..]),
        (Fault::Exception(1), "input:4", &["unit 3: exception 1 (illegal function)", "Try holding:4"]),
        (Fault::Exception(2), "40101", &["holding:100 (40101): exception 2", "try holding:99"]),
        (Fault::Exception(2), "holding:0", &["holding:0 (40001): exception 2"]),
        (Fault::Exception(3), "holding:0", &["smaller --count"]),
        (Fault::Exception(6), "holding:0", &["busy", "try again later"]),
        (Fault::Exception(11), "holding:0", &["unit 3: exception 11", "not the device behind it"]),
        (
            Fault::Link(LinkFault::Refused),
            "holding:0",
            &["tcp://10.0.0.7:502: no program listens at this port"],
        ),
        (Fault::Link(LinkFault::Broken), "holding:0", &["one client at a time"]),
        (Fault::Peer(PeerFault::Malformed), "holding:0", &["rtu+tcp://"]),
        (
            Fault::Peer(PeerFault::LongException(2)),
            "40101",
            &["exception 2", "surplus bytes", "try holding:99"],
        ),
        (Fault::Peer(PeerFault::Unit(1)), "holding:0", &["unit 3: the reply names unit 1", "`unit`"]),
        (
            Fault::Peer(PeerFault::Text(TextProtocol::ModbusAscii)),
            "holding:0",
            &["tcp://10.0.0.7:502: Modbus ASCII", "to Modbus RTU"],
        ),
        (
            Fault::Peer(PeerFault::Echoed),
            "holding:0",
            &["tcp://10.0.0.7:502: the request itself", "loopback"],
        ),
    ] {
        let said = remedy(fault, question(register));
        assert!(words.iter().all(|word| said.contains(word)), "{fault:?}: {said}");
        assert!(said.contains(&explain(fault)), "the same words as everywhere: {said}");
    }
}

#[test]
fn a_failed_read_of_several_values_names_the_key_that_helps_and_a_smaller_count() {
    let line: LineAddress = "tcp://10.0.0.7".parse().unwrap();
    let (from, timeout) = ("holding:100".parse().unwrap(), Duration::from_millis(500));
    let question = Question { line: &line, unit: 3, from, count: 20, values: 20, timeout };
    for (fault, key) in [
        (Fault::Timeout, "max_registers_per_request"),
        (Fault::Exception(2), "one_request_per_field"),
        (Fault::Exception(3), "max_registers_per_request"),
        (Fault::Peer(PeerFault::Length), "max_registers_per_request"),
    ] {
        let said = remedy(fault, question);
        assert!(said.contains(key) && said.ends_with("Try a smaller --count"), "{said}");
        assert!(!said.contains(".. ") && !said.contains("?."), "{said}");
    }
    let said = remedy(Fault::Peer(PeerFault::Length), Question { count: 2, values: 1, ..question });
    assert!(said.contains("`type`") && !said.contains("--count"), "{said}");
}
