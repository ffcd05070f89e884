//! Position of the joint, and its display on the page.

use std::time::Duration;

use crate::linuxcnc::bench::Bench;
use crate::linuxcnc::modbus;
use crate::linuxcnc::process::until;

#[test]
fn on_every_plateau_joint_page_and_register_agree_to_a_nanometre() {
    let mut bench = Bench::start();
    for (um, z) in [(5.0, 0.0), (-12.3, -10.0), (20.0, -3.5), (0.1, -20.0), (0.0, 0.0)] {
        bench.mill.command(&format!("mdi G0 Z{z}"));
        bench.mill.records();
        bench.wants(um);
        bench.arrives_at(um);
        let walk = bench.mill.recorded();
        walk.never_jump();
        walk.joint_never_jumps();
        // On a busy computer, there are few servo periods in that time.
        let mut stands = (0..100).map(|_| {
            bench.mill.records();
            std::thread::sleep(Duration::from_millis(300));
            bench.mill.recorded()
        });
        stands.find(|samples| samples.0.len() > 50).unwrap().stand_at(um);
        let offset = bench.mill.offset_um();
        until("the page says what is applied", || {
            let status = bench.status()?;
            let shown = status["axes"][0]["verified_um"].as_f64().unwrap_or(f64::NAN);
            let is_so = (shown - offset).abs() < 1e-3;
            if is_so { Ok(()) } else { Err(format!("{shown} µm where {offset} µm are applied")) }
        });
    }
    bench.blames_nobody();
}

#[test]
fn what_somebody_else_writes_switches_the_axis_off_and_the_control_word_says_so() {
    let mut bench = Bench::start();
    bench.wants(8.0);
    bench.arrives_at(8.0);
    let port = bench.mill.port;
    let enabled = |block: &[u16]| block[modbus::CONTROL] & 1;
    assert_eq!(enabled(&modbus::block(port)), 1);
    crate::linuxcnc::process::until("somebody gets between two writes", || {
        match modbus::writes(port, 75)[0] {
            16 => Ok(()),
            other => Err(format!("refused: {other}")),
        }
    });
    bench.is_in_state("off", "the axis is off");
    crate::linuxcnc::process::until("the control word says so", || match enabled(&modbus::block(port)) {
        0 => Ok(()),
        one => Err(one.to_string()),
    });
    assert_eq!(modbus::z(&modbus::block(port)), 75, "what he wrote is left alone");
    let beat = modbus::block(port)[modbus::HEARTBEAT];
    crate::linuxcnc::process::until("the heartbeat goes on", || {
        match modbus::block(port)[modbus::HEARTBEAT] {
            same if same == beat => Err(same.to_string()),
            _ => Ok(()),
        }
    });
    let said = bench.said();
    assert!(
        said.iter().any(|line| line.contains("holds 7.5 µm, which this gateway did not write")),
        "{said:#?}"
    );
}
