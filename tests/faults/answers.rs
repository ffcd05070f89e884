//! Devices that answer wrongly, late, or not at all.

use std::time::Duration;

use crate::law;
use crate::rig::bench;

const MINUTE: Duration = Duration::from_secs(60);

#[test]
fn without_faults_the_axis_arms_steps_up_to_its_model_and_follows_it() {
    let trace = bench("", 3 * MINUTE);
    law::holds(&trace);
    assert_eq!(trace.states(), ["off", "active"], "{}", trace.lines());
    assert!(trace.writes("cnc_z").iter().any(|(_, value)| *value > 5.0), "{:?}", trace.writes("cnc_z"));
    assert!(trace.outcome.rested && !trace.outcome.failed, "{:?}", trace.outcome);
    println!("{}", trace.lines());
}
