use super::*;
use crate::fieldbus::error::LinkFault;

#[test]
fn every_fault_is_reported_with_what_to_do() {
    let line: LineAddress = "tcp://10.0.0.7".parse().unwrap();
    let question = |register: &str| Question {
        line: &line,
        unit: 3,
        from: register.parse().unwrap(),
        count: 1,
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
    ] {
        let said = remedy(fault, question(register));
        assert!(words.iter().all(|word| said.contains(word)), "{fault:?}: {said}");
        assert!(said.contains(&explain(fault)), "the same words as everywhere: {said}");
    }
}
