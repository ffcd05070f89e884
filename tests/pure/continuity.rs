//! Search over every order of up to six events around one device. It is replaced, restarted or silent while polls,
//! writes and checks are under way. No reading of another device is used, and nothing is written to another device.

use std::time::Duration;

use isotherm_core::continuity::{Break, CheckFailure, DeviceContinuity, Difference, Identity};
use isotherm_core::quantity::Moment;

const DEPTH: usize = 6;

/// Rule that the search can deactivate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rule {
    /// A lost connection breaks continuity.
    Connection,
    /// Two poll periods without an answer break continuity.
    Silence,
    /// A check that was read before a break confirms nothing.
    Order,
    /// A device is unconfirmed at the start.
    Start,
}

/// Kind of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    /// A device that is replaced breaks its connection.
    Tcp,
    /// A device that is replaced is silent for two poll periods.
    Serial,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Replaced,
    Restarted,
    Poll,
    Write,
    CheckAsked,
    CheckDone,
    Missed,
}

const EVENTS: [Event; 7] = [
    Event::Replaced,
    Event::Restarted,
    Event::Poll,
    Event::Write,
    Event::CheckAsked,
    Event::CheckDone,
    Event::Missed,
];

#[derive(Clone)]
struct World {
    line: Line,
    without: Option<Rule>,
    /// Whether the device that answers is the expected one.
    is_right: bool,
    is_connected: bool,
    continuity: DeviceContinuity,
    /// Checks that were read and not processed yet: the number of breaks, and whether the correct device was read.
    read: Option<(u64, bool)>,
    now: Moment,
}

impl World {
    fn new(line: Line, without: Option<Rule>, is_right: bool) -> World {
        let now = Moment::default().after(Duration::from_secs(1000));
        let identity = if without == Some(Rule::Start) { Identity::None } else { Identity::Checks };
        let continuity = DeviceContinuity::new(identity, Duration::from_secs(1), now);
        World { line, without, is_right, is_connected: true, continuity, read: None, now }
    }

    /// Connects again if the connection was lost.
    fn connect(&mut self) {
        if !self.is_connected && self.without != Some(Rule::Connection) {
            self.continuity.breaks(Break::ConnectionLost, self.now);
        }
        self.is_connected = true;
        self.continuity.answers(self.now);
    }

    fn misses(&mut self) {
        self.now = self.now.after(Duration::from_secs(1));
        if self.without != Some(Rule::Silence) {
            self.continuity.misses(self.now);
        }
    }

    /// Executes an event, seen from the gateway's requests on the line. A write that meets a lost connection is not
    /// sent again before the checks.
    fn apply(&mut self, event: Event) -> Result<(), &'static str> {
        match event {
            Event::Replaced => {
                self.is_right = !self.is_right;
                self.goes();
            }
            Event::Restarted => self.goes(),
            Event::Poll | Event::Write => {
                self.connect();
                if self.continuity.is_confirmed() && !self.is_right {
                    return Err("a reading of another device is used, or it is written to");
                }
            }
            Event::CheckAsked => {
                self.connect();
                self.read = Some((self.continuity.breaks_so_far(), self.is_right));
            }
            Event::CheckDone => {
                let Some((after, is_right)) = self.read.take() else { return Ok(()) };
                let after =
                    if self.without == Some(Rule::Order) { self.continuity.breaks_so_far() } else { after };
                self.continuity.verified(after, if is_right { Vec::new() } else { vec![other()] });
            }
            Event::Missed => self.misses(),
        }
        Ok(())
    }

    fn goes(&mut self) {
        match self.line {
            Line::Tcp => self.is_connected = false,
            Line::Serial => (0..3).for_each(|_| self.misses()),
        }
    }

    /// Checks that the device is identified correctly after the faults.
    fn comes_to_rest(mut self) -> Result<(), &'static str> {
        self.apply(Event::CheckAsked)?;
        self.apply(Event::CheckDone)?;
        if self.continuity.is_confirmed() == self.is_right {
            Ok(())
        } else {
            Err("its checks do not decide what it is")
        }
    }
}

fn other() -> Difference {
    let is = CheckFailure::Value("8".into());
    Difference {
        what: "holding:200".into(),
        was: "7".into(),
        is,
        meaning: String::new(),
        remedy: String::new(),
    }
}

/// Returns the shortest counterexample, if there is one, and the number of worlds.
fn search(line: Line, without: Option<Rule>) -> (Option<(Vec<Event>, &'static str)>, usize) {
    let mut layer: Vec<(Vec<Event>, World)> =
        [true, false].map(|is_right| (Vec::new(), World::new(line, without, is_right))).into();
    let mut worlds = layer.len();
    for _ in 0..DEPTH {
        let mut next = Vec::new();
        for (way, world) in &layer {
            for event in EVENTS {
                let (mut way, mut world) = (way.clone(), world.clone());
                way.push(event);
                let outcome = world.apply(event).and_then(|()| world.clone().comes_to_rest());
                if let Err(why) = outcome {
                    return (Some((way, why)), worlds);
                }
                next.push((way, world));
            }
        }
        worlds += next.len();
        layer = next;
    }
    (None, worlds)
}

#[test]
fn no_order_of_events_lets_another_device_in() {
    for line in [Line::Tcp, Line::Serial] {
        let (broken, worlds) = search(line, None);
        assert_eq!(broken, None, "{line:?}");
        println!("{line:?}: {worlds} worlds");
    }
}

#[test]
fn without_each_rule_another_device_is_let_in() {
    let out = [
        (Line::Tcp, Rule::Connection),
        (Line::Serial, Rule::Silence),
        (Line::Tcp, Rule::Order),
        (Line::Serial, Rule::Order),
        (Line::Tcp, Rule::Start),
    ];
    for (line, rule) in out {
        let (broken, _) = search(line, Some(rule));
        let (way, _) = broken.unwrap_or_else(|| panic!("{line:?} without {rule:?}: nothing is found"));
        println!("{line:?} without {rule:?}: {way:?}");
    }
}
