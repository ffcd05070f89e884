//! Recorded servo periods of the mill.

use std::time::Duration;

use crate::support::tell;

/// A nanometre, in millimetres.
const NANOMETRE: f64 = 1e-6;
/// Maximum step of the axis in mm: 1 µm, and the error of floating point.
const STEP: f64 = 1e-3 + 1e-9;

/// One servo period, in millimetres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// Offset that the component requests.
    pub(crate) request: f64,
    /// Offset that the planner has reached.
    pub(crate) offset: f64,
    /// Position of the program, without the offset.
    pub(crate) programmed: f64,
    /// Commanded position of the joint.
    pub(crate) joint: f64,
    pub(crate) following_error: f64,
}

/// Wait of a servo thread for a processor after which it may miss a decision of the axis.
const STARVED: Duration = Duration::from_millis(50);

/// Servo periods of a scenario, and the longest wait of the servo thread for a processor.
#[derive(Clone, Debug)]
pub(crate) struct Samples(pub(crate) Vec<Sample>, pub(crate) Duration);

impl Samples {
    pub(crate) fn parse(text: &str, columns: &[&str]) -> Samples {
        let place = |name: &str| columns.iter().position(|column| *column == name);
        let places = [
            "axis.z.eoffset-request",
            "axis.z.eoffset",
            "axis.z.pos-cmd",
            "joint.2.pos-cmd",
            "joint.2.f-error",
        ]
        .map(|name| place(name).unwrap_or_else(|| panic!("{name} is not recorded: {columns:?}")));
        let rows = text.lines().filter_map(|line| {
            let row: Vec<f64> = line.split_whitespace().map_while(|word| word.parse().ok()).collect();
            (row.len() >= columns.len()).then(|| places.map(|place| row[place]))
        });
        let samples = rows.map(|[request, offset, programmed, joint, following_error]| Sample {
            request,
            offset,
            programmed,
            joint,
            following_error,
        });
        Samples(samples.collect(), Duration::ZERO)
    }

    /// Checks that in every period, the joint has this offset in addition to the program, within a nanometre.
    #[track_caller]
    pub(crate) fn stand_at(&self, um: f64) {
        assert!(self.0.len() > 50, "{} periods", self.0.len());
        for (place, one) in self.0.iter().enumerate() {
            let added = one.joint - one.programmed;
            assert!((added - um / 1000.0).abs() <= NANOMETRE, "{place}: {added} mm, not {um} µm: {one:?}");
        }
    }

    /// Checks that neither the offset nor the requested offset changes by more than a step from one period to the next.
    #[track_caller]
    pub(crate) fn never_jump(&self) {
        self.moves_of("the offset", |one| one.offset);
        // The component continues to run while the servo thread waits.
        let jumps = |pair: &[Sample]| (pair[1].request - pair[0].request).abs() > STEP;
        if self.1 >= STARVED && self.0.windows(2).any(jumps) {
            return tell(&format!("the request of a mill: void, its servo thread waited {:?}", self.1));
        }
        self.moves_of("the request", |one| one.request);
    }

    /// Checks that the joint moves by at most a step per period, while no program runs. The check includes the time in
    /// which the machine is switched off, and the planner takes over the current position.
    #[track_caller]
    pub(crate) fn joint_never_jumps(&self) {
        self.moves_of("the joint", |one| one.joint);
    }

    #[track_caller]
    fn moves_of(&self, what: &str, of: impl Fn(&Sample) -> f64) {
        for (place, pair) in self.0.windows(2).enumerate() {
            let moved = of(&pair[1]) - of(&pair[0]);
            assert!(moved.abs() <= STEP, "{what} moved by {moved} mm in period {place}: {pair:?}");
        }
    }

    /// Largest absolute value.
    pub(crate) fn largest(&self, of: impl Fn(&Sample) -> f64) -> f64 {
        self.0.iter().map(|one| of(one).abs()).fold(0.0, f64::max)
    }
}
