use super::*;
use crate::quantity::{Shift, Shifted};

const LAG: f64 = 1800.0;

fn lagging() -> AxisSettings {
    axis(vec![linear("lag", 0.0, &[lagged(BED, 3.0, Reference::Start, Some(seconds(LAG)))])])
}

/// Runs an axis for ten minutes, saves its state, and restores it in a second run. No reading is taken for `off`
/// seconds between the runs. Then the bed is at 30 °C. `before` and `since` are the errors of the computer's clock in
/// the two runs, s. Returns the value that the model requests, and the running time of the machine.
fn after(settings: &AxisSettings, (before, since): (i64, i64), off: f64) -> (f64, Option<Duration>) {
    const SECOND: i64 = 1_000_000_000;
    let mut rig = Rig::new(settings.clone());
    rig.now = Moment::from_nanos(0).after(seconds(2e9));
    rig.show(20.0, 24.0).step();
    rig.show(25.0, 24.0).run(600.0);
    let (first, second) = (Shift::from_nanos(before * SECOND), Shift::from_nanos(since * SECOND));
    let kept = rig.compensation.remembered().counted_until(rig.now).shifted(first);
    let kept: Remembered = serde_json::from_str(&serde_json::to_string(&kept).unwrap()).unwrap();
    let stopped = rig.now.shifted(first);
    // The second run counts time from another start.
    let now = Moment::from_nanos(0).after(seconds(3e9));
    let by_the_clock = rig.now.after(seconds(off)).shifted(second);
    let resumed = kept.resumed(stopped, now, Stop::between(stopped, by_the_clock));
    let settings = vec![settings.clone()];
    rig.compensation = Compensation::new(rig.compensation.settings.clone(), settings, resumed);
    rig.now = now;
    let raw = rig.show(30.0, 24.0).step().raw.unwrap().get();
    (raw, rig.compensation.machine().on_time(now))
}

#[test]
fn the_clocks_of_two_runs_may_say_what_they_like_as_long_as_they_say_the_same() {
    let settings = lagging();
    let (wanted, on_time) = after(&settings, (0, 0), 900.0);
    assert_eq!(on_time, Some(Duration::from_secs(600)), "what was counted");
    for set in [-1_700_000_000, -3600, 3600, 86_400 * 3650] {
        let (raw, on_time) = after(&settings, (set, set), 900.0);
        assert_eq!((raw.to_bits(), on_time), (wanted.to_bits(), Some(Duration::from_secs(600))), "{set}");
    }
}

#[test]
fn a_stop_that_the_clock_cannot_have_measured_is_taken_for_a_long_one() {
    let settings = lagging();
    let (whole, _) = after(&settings, (0, 0), 86_400.0 * 30.0);
    // All of the rise except a share, as after a month on a straight line.
    assert!((whole - 30.0).abs() < 0.1, "{whole}");
    for set in [-1000, -86_400, -1_700_000_000, 86_400 * 31, 86_400 * 3650] {
        assert_eq!(after(&settings, (0, set), 900.0).0.to_bits(), whole.to_bits(), "{set}");
    }
    assert!(after(&settings, (0, 0), 900.0).0 < 20.0);
}

#[test]
fn a_reference_that_settles_needs_what_was_left_of_its_time() {
    let machine = MachineSettings { signals: 4, settle: seconds(180.0), ..MachineSettings::default() };
    let mut rig = Rig::with(machine.clone(), lagging());
    rig.now = Moment::from_nanos(0).after(seconds(2e9));
    rig.show(20.0, 24.0).step();
    rig.run(60.0);
    let back = Shift::from_nanos(-1_500_000_000_000_000_000);
    let kept = rig.compensation.remembered().counted_until(rig.now).shifted(back);
    for stop in [Stop::between(rig.now, rig.now.after(seconds(10.0))), Stop::default()] {
        let now = Moment::from_nanos(0).after(seconds(1.6e9));
        let resumed = kept.clone().resumed(rig.now.shifted(back), now, stop);
        rig.compensation = Compensation::new(machine.clone(), vec![lagging()], resumed);
        let clock = std::mem::replace(&mut rig.now, now);
        let complete =
            rig.show(20.0, 24.0).run(200.0).iter().filter(|decision| decision.raw.is_some()).count();
        assert!((7..=9).contains(&complete), "{complete} of 20 rows after two minutes more, {stop:?}");
        rig.now = clock;
    }
}
