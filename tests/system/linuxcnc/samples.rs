//! What the mill did in each of its servo periods.

use std::time::Duration;

use crate::support::tell;

/// A nanometre, in millimetres.
const NANOMETRE: f64 = 1e-6;
/// A step of the axis: a micrometre, and what is left of floating point.
const STEP: f64 = 1e-3 + 1e-9;

/// One servo period, all in millimetres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// What the component asks for.
    pub(crate) request: f64,
    /// What the planner has made of it so far.
    pub(crate) offset: f64,
    /// Where the program is, without the offset.
    pub(crate) programmed: f64,
    /// Where the joint is told to be.
    pub(crate) joint: f64,
    pub(crate) following_error: f64,
}

/// A servo thread that waits so long for a processor may pass over a decision of the axis.
const STARVED: Duration = Duration::from_millis(50);

/// A scenario, period by period; and the longest wait of the servo thread for a processor meanwhile.
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

    /// What the joint has on top of the program is what is asked for, to a nanometre, in every period.
    #[track_caller]
    pub(crate) fn stand_at(&self, um: f64) {
        assert!(self.0.len() > 50, "{} periods", self.0.len());
        for (place, one) in self.0.iter().enumerate() {
            let added = one.joint - one.programmed;
            assert!((added - um / 1000.0).abs() <= NANOMETRE, "{place}: {added} mm, not {um} µm: {one:?}");
        }
    }

    /// Nothing is added to the program, and nothing asked for, that is more than a step further than a period before.
    #[track_caller]
    pub(crate) fn never_jump(&self) {
        self.moves_of("the offset", |one| one.offset);
        // The component does not stand still with the servo thread.
        let jumps = |pair: &[Sample]| (pair[1].request - pair[0].request).abs() > STEP;
        if self.1 >= STARVED && self.0.windows(2).any(jumps) {
            return tell(&format!("the request of a mill: void, its servo thread waited {:?}", self.1));
        }
        self.moves_of("the request", |one| one.request);
    }

    /// Nothing moves the joint further than a step in one period, while no program runs; also where the machine is
    /// switched off, and the planner calls the place its own at which it stands.
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

    /// The largest of this, without its sign.
    pub(crate) fn largest(&self, of: impl Fn(&Sample) -> f64) -> f64 {
        self.0.iter().map(|one| of(one).abs()).fold(0.0, f64::max)
    }
}
