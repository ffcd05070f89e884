//! Operators: they check the page, correct registers, and arm axes again. At the end of a calm, everything must be
//! correct.

use std::sync::Arc;
use std::time::Duration;

use isotherm::observe::requester::{Channel, Requester};
use isotherm::observe::status::{Command, GatewayApi, Status};

use crate::link::{Note, World};
use crate::machine::{BEAT, CNC, X, Y};

/// Maximum error of a register in µm: the deadband, the wait for a step, and the drift in a second.
const TOLERANCE: f64 = 0.6;

/// Maximum time in which a change by another client is reported after the gateway has read it.
const TOLD_WITHIN: Duration = Duration::from_secs(60);
/// Time in which a heartbeat with one beat per second must have changed.
const BEATS_WITHIN: Duration = Duration::from_secs(3);

const AXES: [&str; 4] = ["x", "y", "z", "w"];

#[derive(Clone, Debug, Default)]
pub(crate) struct People {
    /// Number of reported changes by other clients.
    blames: u64,
    /// Value of the heartbeat at the last visit, with the time.
    beat: Option<(Duration, i64)>,
}

impl People {
    /// Simulates a visit of an operator, who reads the register values on the page before arming.
    pub(crate) fn visit(&mut self, world: &mut World, source: &Arc<dyn GatewayApi>, now: Duration) {
        world.pass(now);
        let status = source.status();
        self.beat = Some((now, world.machine.stands(CNC, BEAT)));
        if let Some(why) = self.is_blamed(world, &status) {
            world.machine.laws.broken.get_or_insert(why);
        }
        if let Some(why) = is_not_reported(world, &status, now) {
            world.machine.laws.broken.get_or_insert(why);
        }
        if status.axes.iter().all(|axis| axis.arming.armed) {
            return;
        }
        // The operator writes nothing while a request is delayed, because the page may not show the latest value.
        if (0..world.lines.len()).any(|line| world.is_held(line)) {
            return;
        }
        let x = world.machine.stands(CNC, X);
        if !armed(&status, "x") && x.abs() > 80 {
            world.note(now, Note::Did("a person clears x", x));
            world.machine.puts(CNC, X, 0, now);
            return;
        }
        if !armed(&status, "y") {
            let output = status.outputs.iter().find(|output| output.name == "cnc_y");
            let axis = status.axes.iter().find(|axis| axis.name == "y");
            // Register value, and the gateway share in it, as shown on the page.
            let shown = output.and_then(|output| output.value).zip(axis.and_then(|axis| axis.verified_um));
            let Some((shown, share)) = shown.map(|(shown, share)| (tenths(shown), tenths(share))) else {
                return;
            };
            let mut his = world.machine.laws.registers[1].his;
            if share != 0 && his + share == 0 {
                his += 11;
            }
            world.machine.laws.registers[1].his = his;
            let right = his + share;
            if world.machine.stands(CNC, Y) != right {
                world.note(now, Note::Did("a person makes y right", right));
                world.machine.puts(CNC, Y, right, now);
                return;
            }
            if shown != right {
                return;
            }
        }
        world.note(now, Note::Did("a person arms", 0));
        world.machine.laws.arms(|axis| !armed(&status, axis));
        let _ = source.command(Command::Arm, None, &Arc::new(Requester::new(Channel::Api, "a person")));
    }

    /// Returns a violation if the gateway reports a change by another client without a recent change or restart of a
    /// control.
    fn is_blamed(&mut self, world: &World, status: &Status) -> Option<String> {
        let count = |kind: &str| status.event_counts.get(kind).copied().unwrap_or_default();
        let blames = count("foreign-change") + count("operator-change");
        // The counts of a restarted gateway begin at zero.
        let more = blames > std::mem::replace(&mut self.blames, blames) && blames > 0;
        let is_long_ago = world.passage.awake().saturating_sub(world.machine.laws.news_at) > TOLD_WITHIN;
        (more && is_long_ago)
            .then(|| format!("R2: somebody is blamed, and nobody has touched anything; {}", reported(status)))
    }

    /// Returns an incorrect state at the end of a calm.
    pub(crate) fn what_is_wrong(
        &self,
        world: &mut World,
        source: &Arc<dyn GatewayApi>,
        now: Duration,
    ) -> Option<String> {
        world.pass(now);
        let status = source.status();
        let wrong = |what: String| Some(format!("at the end of a calm {what}; {}", reported(&status)));
        let wanted = world.machine.wanted(now);
        for ((axis, wanted), register) in AXES.into_iter().zip(wanted).zip(&world.machine.laws.registers) {
            if !armed(&status, axis) {
                return wrong(format!("{axis} is off"));
            }
            let ours = (register.value - register.his) as f64 / 10.0;
            if (ours - wanted).abs() > TOLERANCE {
                let (value, his) = (register.value, register.his);
                return wrong(format!(
                    "{axis} holds {ours} µm ({value} counts, {his} the operator's), not {wanted}"
                ));
            }
        }
        let cz = world.machine.laws.corrected.map(|cz| cz as f64 / 10.0);
        let [.., wanted_u] = wanted;
        if cz.is_none_or(|cz| (cz - wanted_u).abs() > TOLERANCE) {
            return wrong(format!("u is corrected by {cz:?}, not {wanted_u}"));
        }
        let beat = world.machine.stands(CNC, BEAT);
        if self.beat.is_some_and(|(at, last)| last == beat && now.saturating_sub(at) > BEATS_WITHIN) {
            return wrong(format!("the heartbeat stands at {beat}"));
        }
        None
    }
}

/// After the detection of another master, an alarm must be active until ten minutes after its last sign.
fn is_not_reported(world: &World, status: &Status, now: Duration) -> Option<String> {
    let is_reported = status.alarms.iter().any(|alarm| alarm.id == "trouble of bus sensors");
    let must_be = world.machine.laws.signs.must_be_reported(now);
    (must_be && !is_reported)
        .then(|| format!("another master is on the line, and there is no alarm; {}", reported(status)))
}

fn armed(status: &Status, axis: &str) -> bool {
    status.axes.iter().any(|known| known.name == axis && known.arming.armed)
}

fn reported(status: &Status) -> String {
    let lines = status.events.iter().rev().take(25).rev();
    lines.map(|event| format!("\n    {} {}: {}", event.at, event.kind, event.text)).collect()
}

#[allow(clippy::cast_possible_truncation, reason = "tenths of a micrometre")]
fn tenths(micrometres: f64) -> i64 {
    (10.0 * micrometres).round() as i64
}
