//! Cutting of a part while the offset changes ten times per second.

use std::time::Duration;

use isotherm::clock::Clock;

use crate::linuxcnc::bench::Bench;
use crate::linuxcnc::samples::Samples;

/// Cuts for this time, and moves Z by this offset meanwhile.
fn cuts(span: Duration, offset: impl Fn(f64) -> f64) -> Samples {
    let mut bench = Bench::start();
    bench.mill.command("run part.ngc");
    bench.mill.records();
    let clock = Clock::wall();
    let begun = clock.now();
    let mut arrived = 0;
    loop {
        let now = clock.now().since(begun);
        if now >= span {
            break;
        }
        bench.wants(offset(now.as_secs_f64()));
        std::thread::sleep(Duration::from_millis(50));
        arrived += 1;
    }
    assert!(arrived > 10);
    let samples = bench.mill.recorded();
    bench.blames_nobody();
    samples
}

/// Duration; `tests/run long` sets a longer one.
fn span() -> Duration {
    let asked = std::env::var("TEST_SOAKS_FOR").ok().and_then(|text| text.parse().ok());
    Duration::from_secs(asked.unwrap_or(14))
}

#[test]
fn while_a_part_is_cut_no_move_is_above_a_step_and_nothing_follows_worse() {
    // The part takes 40 s.
    let plain = cuts(span().min(Duration::from_secs(40)), |_| 0.0);
    // Offsets of ±30 µm, as fast as the axis can move: a step in each of ten decisions per second.
    let moved = cuts(span(), |now| if now % 12.0 < 6.0 { 30.0 } else { -30.0 });
    moved.never_jump();
    let most = |samples: &Samples| samples.largest(|one| one.following_error);
    let (without, with) = (most(&plain), most(&moved));
    let reach = moved.largest(|one| one.request);
    println!("following error {without} mm without, {with} mm with offsets; they reached {reach} mm");
    assert!(with <= without.max(1e-9) * 1.01, "{with} mm with offsets, {without} mm without");
    assert!(reach > 0.005, "the offset moved: {reach} mm");
    assert!(moved.largest(|one| one.programmed) > 1.0, "and so did the program");
}
