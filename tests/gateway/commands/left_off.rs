//! An axis that an operator keeps off is no fault of the gateway: a supervisor must not restart it for that.

use crate::commands::bench::{Bench, OPEN_CIRCUIT};

#[test]
fn an_axis_that_a_person_keeps_off_leaves_the_gateway_healthy_and_is_named() {
    let bench = Bench::manual();
    bench.why("not armed yet");
    let (code, said) = bench.ask(&["status", "--healthy"]);
    assert_eq!((code, said.as_str()), (0, "healthy; axis z is off: not armed yet\n"));
    assert_eq!(bench.ask(&["arm"]).0, 0);
    bench.is_in_state("active");
    assert_eq!(bench.ask(&["status", "--healthy"]), (0, "healthy\n".to_owned()));
    assert_eq!(bench.ask(&["disarm"]).0, 0);
    let (code, said) = bench.ask(&["status", "--healthy"]);
    assert_eq!(
        (code, said.as_str()),
        (0, "healthy; axis z is off: switched off by a person; arm the axis again\n")
    );
    assert_eq!(bench.http("GET", "/readyz", ""), (200, "[]".to_owned()));
}

#[test]
fn an_axis_that_is_to_be_armed_and_waits_is_not_healthy() {
    let bench = Bench::manual();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("open circuit");
    assert_eq!(bench.ask(&["arm", "--no-wait"]).0, 1);
    bench.is_in_state("waiting");
    let (code, said) = bench.ask(&["status", "--healthy"]);
    assert!(code == 1 && said.contains("axis z: waiting: "), "{said}");
}
