//! Model around a set of two outputs: registers, number, strobe, program of the control, line, disk, and time in whole
//! seconds.

use std::time::Duration;

use isotherm_core::output::{
    Action, ArmState, Beat, CommitTrigger, Condition, Controller, Demand, Event, MemberDemand, Mode,
    OutputAnswer, OutputDecision, OutputHealth, OwnWords, SavedOutput, SetAction, SetController, SetDemand,
    SetInput, SetSettings, SetValue, SetWords, State, Strobe, StrobeResult, Who, WriteResult,
};
use isotherm_core::quantity::{Counts, Moment};

use super::world::{NOW, settings};

const SECOND: Duration = Duration::from_secs(1);

/// Number of times that each event may still happen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct SetBudget {
    /// A request or its answer is lost.
    pub(crate) losses: u8,
    /// A write arrives later.
    pub(crate) holds: u8,
    /// The wire of the acknowledge is broken.
    pub(crate) wires: u8,
    pub(crate) kills: u8,
    pub(crate) targets: u8,
    /// The control restarts.
    pub(crate) restarts: u8,
    /// The readings are too old for a second.
    pub(crate) stale: u8,
}

/// Rule by which a control takes a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Program {
    /// The control takes a set when the strobe rises or the number changes, whatever the number.
    Another,
    /// The control takes only the next number.
    NextOnly,
}

/// Values and number of one write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Content {
    values: [Counts; 2],
    own: OwnWords,
}

/// Request that has been sent and may arrive later.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Request {
    Values(Content),
    Strobe(bool),
}

/// Levels of the handshake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Wires {
    strobe: bool,
    acknowledge: bool,
}

/// Result of a check: the violated property.
pub(crate) type Broken = Result<(), String>;

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct SetWorld {
    gateway: Option<SetController>,
    pub(crate) action: SetAction,
    armed: [bool; 2],
    disk: [Option<SavedOutput>; 2],
    registers: Content,
    wires: Wires,
    /// Last number that the control took.
    number: u16,
    program: Program,
    taking: CommitTrigger,
    has_number: bool,
    /// Values that the control uses.
    taken: [Counts; 2],
    /// Whether the control restarted since the read before a write. A change of its value is then not a jump by the
    /// gateway.
    is_excused: bool,
    /// Whether the register values are from such a write.
    are_excused: bool,
    held: Option<(Request, u64)>,
    /// All pairs of values that were sent together, and the first one.
    pairs: Vec<[Counts; 2]>,
    wanted: Counts,
    guard: [Counts; 2],
    /// Seconds for which the latest decision may still be carried out.
    order: Option<u64>,
    pub(crate) left: SetBudget,
}

/// Creates the settings of a set of two outputs whose control takes it in this way. Step 1.
pub(crate) fn set_settings(taking: CommitTrigger, has_number: bool, words: SetWords) -> SetSettings {
    SetSettings {
        members: vec![settings(false, 2, 2); 2],
        taking,
        has_number,
        timeout: (taking == CommitTrigger::Strobe).then_some(SECOND),
        refresh: (words != SetWords::None).then_some(SECOND),
        words,
    }
}

impl SetWorld {
    pub(crate) fn new(settings: &SetSettings, program: Program, left: SetBudget) -> SetWorld {
        let bias = settings.members[0].bias;
        let kept = SavedOutput { in_order: true, stood: Some(bias), ..SavedOutput::default() };
        let own = OwnWords { number: Some(6), ..OwnWords::default() };
        let mut world = SetWorld {
            gateway: None,
            action: SetAction::Nothing { until: NOW },
            armed: [false; 2],
            disk: [Some(kept); 2],
            registers: Content { values: [bias; 2], own },
            wires: Wires::default(),
            number: 6,
            program,
            taking: settings.taking,
            has_number: settings.has_number,
            taken: [bias; 2],
            is_excused: false,
            are_excused: false,
            held: None,
            pairs: vec![[bias; 2]],
            wanted: settings.members[0].limit,
            guard: [Counts::ZERO; 2],
            order: None,
            left,
        };
        world.start(settings);
        world
    }

    fn start(&mut self, settings: &SetSettings) {
        let each = settings.members.iter().zip(&self.disk);
        let controllers: Vec<_> = each
            .map(|(settings, kept)| {
                Controller::new(settings, State::new(settings, kept.as_ref(), NOW), 0, NOW)
            })
            .collect();
        let was_in_order = controllers.iter().all(|one| one.state().is_settled());
        let gateway = SetController::new(settings, controllers, (Strobe::new(false), was_in_order), NOW);
        (self.gateway, self.order, self.armed) = (Some(gateway), None, [false; 2]);
    }

    /// Calls `to` with every possible next world, and with the violation on the way there.
    pub(crate) fn each(&self, settings: &SetSettings, to: &mut impl FnMut(&'static str, SetWorld, Broken)) {
        let mut go = |name: &'static str, change: &mut dyn FnMut(&mut SetWorld) -> Broken| {
            let mut next = self.clone();
            let broken = change(&mut next);
            to(name, next, broken);
        };
        let left = self.left;
        match (&self.gateway, &self.action) {
            (None, _) => go("start", &mut |next| {
                next.start(settings);
                next.turn(settings, Mode::Follow)
            }),
            (Some(_), SetAction::Nothing { .. }) => {
                go("a second", &mut |next| next.second(settings, true));
                if left.stale > 0 {
                    go("a second with stale readings", &mut |next| {
                        next.left.stale -= 1;
                        next.second(settings, false)
                    });
                }
                let limit = settings.members[0].limit;
                for target in [-limit, limit].into_iter().filter(|to| left.targets > 0 && *to != self.wanted)
                {
                    go("another target", &mut |next| {
                        (next.left.targets, next.wanted) = (left.targets - 1, target);
                        next.second(settings, true)
                    });
                }
            }
            (Some(_), _) => {
                go("done", &mut |next| next.done(settings));
                if left.losses > 0 && !matches!(self.action, SetAction::Keep(_)) {
                    go("lost", &mut |next| {
                        next.left.losses -= 1;
                        next.fails(settings)
                    });
                }
                if let Some(request) = self.request() {
                    if left.losses > 0 {
                        go("its answer is lost", &mut |next| {
                            next.left.losses -= 1;
                            next.arrives(request)?;
                            next.fails(settings)
                        });
                    }
                    if let Request::Values(content) = request
                        && left.losses > 0
                        && self.taking == CommitTrigger::Number
                    {
                        go("only the values arrive", &mut |next| {
                            next.left.losses -= 1;
                            let own = OwnWords { number: next.registers.own.number, ..content.own };
                            next.arrives(Request::Values(Content { own, ..content }))?;
                            next.fails(settings)
                        });
                    }
                    if left.holds > 0 && self.held.is_none() {
                        go("held", &mut |next| {
                            (next.left.holds, next.held) = (left.holds - 1, Some((request, 0)));
                            next.fails(settings)
                        });
                    }
                }
                if left.wires > 0 && self.action == SetAction::Acknowledge && self.wires.acknowledge {
                    go("the wire of the acknowledge is broken", &mut |next| {
                        next.left.wires -= 1;
                        // Lets the timeout pass.
                        (0..3).for_each(|_| next.pass(settings));
                        next.give(settings, &SetInput::Acknowledge(Some(false)))
                    });
                }
            }
        }
        if let Some((request, _)) = self.held {
            go("what was held arrives", &mut |next| {
                next.held = None;
                next.arrives(request)
            });
        }
        if left.kills > 0 && self.gateway.is_some() {
            go("killed", &mut |next| {
                next.left.kills -= 1;
                (next.gateway, next.action) = (None, SetAction::Nothing { until: NOW });
                Ok(())
            });
        }
        // A restart hidden by a write of the gateway cannot be detected if the control takes only the next number.
        let is_writing = !matches!(self.action, SetAction::Nothing { .. } | SetAction::Read);
        let is_hidden = self.program == Program::NextOnly && (is_writing || self.held.is_some());
        if left.restarts > 0 && !is_hidden {
            go("the control restarts", &mut |next| {
                next.left.restarts -= 1;
                next.registers = Content {
                    values: [Counts::ZERO; 2],
                    own: OwnWords { number: Some(0), ..OwnWords::default() },
                };
                (next.wires, next.number) = (Wires::default(), 0);
                (next.taken, next.is_excused, next.are_excused) = ([Counts::ZERO; 2], true, true);
                next.pairs.push([Counts::ZERO; 2]);
                Ok(())
            });
        }
    }

    /// Returns the request of the action, if it changes something.
    fn request(&self) -> Option<Request> {
        match &self.action {
            SetAction::Write { values, own, .. } => {
                Some(Request::Values(Content { values: [values[0].counts(), values[1].counts()], own: *own }))
            }
            SetAction::WriteOwn(own) => Some(Request::Values(Content {
                values: self.registers.values,
                own: OwnWords { number: self.registers.own.number, ..*own },
            })),
            SetAction::Raise => Some(Request::Strobe(true)),
            SetAction::Drop => Some(Request::Strobe(false)),
            SetAction::Nothing { .. } | SetAction::Keep(_) | SetAction::Read | SetAction::Acknowledge => None,
        }
    }

    /// Carries out and answers the exchange.
    fn done(&mut self, settings: &SetSettings) -> Broken {
        let request = self.request();
        if let Some(request) = request {
            self.is_allowed()?;
            self.arrives(request)?;
        }
        let input = match &self.action {
            SetAction::Keep(place) => {
                let place = *place;
                self.disk[place] = self.gateway.as_ref().map(|one| one.members()[place].state().kept());
                SetInput::Member { place, answer: OutputAnswer::OnDisk }
            }
            SetAction::Read => SetInput::Read {
                values: self.registers.values.to_vec(),
                number: self.registers.own.number.filter(|_| settings.has_number),
                beat: (settings.words != SetWords::None).then_some(self.registers.own.beat),
                asked: NOW,
            },
            SetAction::Write { .. } | SetAction::WriteOwn(_) => {
                SetInput::Sent { result: WriteResult::Done, left: NOW }
            }
            SetAction::Acknowledge => SetInput::Acknowledge(Some(self.wires.acknowledge)),
            SetAction::Raise | SetAction::Drop => SetInput::Strobe(StrobeResult::Done),
            SetAction::Nothing { .. } => return Ok(()),
        };
        self.give(settings, &input)
    }

    /// Loses the answer of the exchange.
    fn fails(&mut self, settings: &SetSettings) -> Broken {
        self.is_allowed()?;
        let input = match &self.action {
            SetAction::Read => SetInput::NoAnswer,
            SetAction::Write { .. } | SetAction::WriteOwn(_) => {
                SetInput::Sent { result: WriteResult::Unknown, left: NOW }
            }
            SetAction::Acknowledge => SetInput::Acknowledge(None),
            SetAction::Raise | SetAction::Drop => SetInput::Strobe(StrobeResult::Unknown),
            SetAction::Nothing { .. } | SetAction::Keep(_) => return Ok(()),
        };
        self.give(settings, &input)
    }

    /// Checks that a change is based on readings that are not too old.
    fn is_allowed(&self) -> Broken {
        let SetAction::Write { values, not_after, .. } = &self.action else { return Ok(()) };
        let changes = values.iter().any(|value| matches!(value, SetValue::New(_)));
        if changes && (self.order.is_none() || *not_after < NOW) {
            return Err(format!("{values:?} are sent on readings that are too old"));
        }
        Ok(())
    }

    /// Lets a request arrive at the control, and runs the control's program.
    fn arrives(&mut self, request: Request) -> Broken {
        match request {
            Request::Values(content) => {
                let before = std::mem::replace(&mut self.registers, content);
                for (before, now) in before.values.iter().zip(content.values) {
                    if (now - *before).abs() > Counts(1) && !self.is_excused {
                        return Err(format!("a register jumps from {before} to {now}"));
                    }
                }
                self.pairs.push(content.values);
                self.are_excused |= self.is_excused;
                if self.taking != CommitTrigger::Strobe && self.is_next(content.own.number) {
                    return self.takes();
                }
            }
            Request::Strobe(is_up) => {
                let has_risen = is_up && !self.wires.strobe;
                self.wires.strobe = is_up;
                if has_risen {
                    let number = self.registers.own.number;
                    if self.is_next(number) {
                        self.takes()?;
                        self.wires.acknowledge = true;
                    } else if self.program == Program::Another {
                        // The control acknowledges a set that it has taken already.
                        self.wires.acknowledge = true;
                    }
                }
                if !is_up {
                    self.wires.acknowledge = false;
                }
            }
        }
        Ok(())
    }

    /// Returns whether the program of the control takes a set with this number.
    fn is_next(&self, number: Option<u16>) -> bool {
        let Some(number) = number.filter(|_| self.has_number) else { return true };
        match self.program {
            Program::Another => number != self.number,
            Program::NextOnly => number == self.number.checked_add(1).unwrap_or(1),
        }
    }

    /// Makes the control use its register values.
    fn takes(&mut self) -> Broken {
        let before = std::mem::replace(&mut self.taken, self.registers.values);
        self.number = self.registers.own.number.unwrap_or(self.number);
        if !self.pairs.contains(&self.taken) {
            return Err(format!("the control takes half a set: {:?}", self.taken));
        }
        let jump = before.iter().zip(self.taken).map(|(before, now)| (now - *before).abs()).max();
        if jump > Some(Counts(1)) && !self.are_excused {
            return Err(format!("the control takes {:?} after {before:?}", self.taken));
        }
        self.are_excused = self.is_excused;
        Ok(())
    }

    /// Gives the gateway an input. If it requests nothing then, its turn ends.
    fn give(&mut self, settings: &SetSettings, input: &SetInput) -> Broken {
        let Some(gateway) = &mut self.gateway else { return Ok(()) };
        self.action = gateway.step(settings, input, NOW);
        if let SetAction::Nothing { .. } = self.action {
            self.action = gateway.step(settings, &SetInput::TurnEnds, NOW);
            if !matches!(self.action, SetAction::Nothing { .. }) {
                return Err("the turn has ended, and there is something to do".to_owned());
            }
        }
        let _ = gateway.take_faults();
        if matches!(input, SetInput::Read { .. }) && self.held.is_none() {
            self.is_excused = false;
        }
        self.events(settings);
        self.knows(settings)
    }

    /// Processes the events: the axes resume from their registers, and are disarmed if another client wrote to one.
    fn events(&mut self, settings: &SetSettings) {
        let Some(gateway) = &mut self.gateway else { return };
        for (place, member) in gateway.members_mut().iter_mut().enumerate() {
            for event in member.take_events().iter() {
                match event {
                    Event::TakeOver { .. } => self.guard[place] = member.held(&settings.members[place]),
                    Event::ForeignValue { .. } | Event::Question => self.armed[place] = false,
                    _ => {}
                }
            }
        }
    }

    /// Checks that the control has taken the register values if the gateway assumes it.
    fn knows(&self, settings: &SetSettings) -> Broken {
        let Some(gateway) = &self.gateway else { return Ok(()) };
        let is_quiet = matches!(self.action, SetAction::Nothing { .. }) && self.held.is_none();
        let is_settled = gateway.members().iter().all(|one| one.state().is_settled());
        if !is_quiet || !is_settled || self.are_excused || gateway.is_bound() {
            return Ok(());
        }
        let each = gateway.members().iter().zip(&settings.members);
        let verified: Vec<_> = each.map(|(one, settings)| one.held(settings)).collect();
        if verified == self.taken || verified != self.registers.values {
            return Ok(());
        }
        Err(format!("the control works with {:?}, and the gateway says {verified:?} is taken", self.taken))
    }

    /// Lets a second pass, without a step of the gateway.
    fn pass(&mut self, settings: &SetSettings) {
        let late = settings.members[0].late.as_secs();
        self.held = self.held.map(|(request, age)| (request, age + 1)).filter(|(_, age)| *age <= late);
        self.order = self.order.and_then(|order| order.checked_sub(1));
        let past = |moment: Moment| if moment == Moment::END { moment } else { moment.before(SECOND) };
        self.gateway = self.gateway.as_ref().map(|one| one.moved(past, Moment::default()));
    }

    /// Begins the next second with a decision. If the readings are stale, it keeps the offset.
    fn second(&mut self, settings: &SetSettings, is_fresh: bool) -> Broken {
        self.pass(settings);
        if is_fresh {
            self.order = Some(1);
        }
        let Some(gateway) = &self.gateway else { return Ok(()) };
        let each = gateway.members().iter().zip(&settings.members);
        let mut health = each.map(|(one, settings)| one.health(settings, Condition::Met));
        let is_well = health.all(|health| health == Some(OutputHealth::Verified));
        let mode = if is_fresh && is_well { Mode::Follow } else { Mode::Hold };
        self.turn(settings, mode)
    }

    /// Begins the turn of the set. An output that another client has disarmed is armed again after the next read.
    fn turn(&mut self, settings: &SetSettings, mode: Mode) -> Broken {
        let Some(gateway) = &self.gateway else { return Ok(()) };
        for (place, (member, settings)) in gateway.members().iter().zip(&settings.members).enumerate() {
            let shown = member.state().shown(settings);
            let is_known = shown.verified.is_some() && matches!(member.action(), Action::Nothing { .. });
            if !self.armed[place] && is_known {
                (self.armed[place], self.guard[place]) = (true, member.held(settings));
            } else if self.armed[place] && mode == Mode::Follow && shown.standing == ArmState::Armed {
                let target = if place == 0 { self.wanted } else { -self.wanted };
                let held = member.held(settings);
                let step = (target - self.guard[place]).clamp(Counts(-1), Counts(1));
                self.guard[place] = (self.guard[place] + step).clamp(held - Counts(1), held + Counts(1));
            }
        }
        let until = |left| NOW.after(SECOND * u32::try_from(left).unwrap());
        let not_after = self.order.map_or(NOW.before(SECOND), until);
        let members = (0..2).map(|place| {
            let target = if place == 0 { self.wanted } else { -self.wanted };
            let target = if mode == Mode::Follow { target } else { self.guard[place] };
            let decided =
                OutputDecision { offset: self.guard[place], target: Some(target), at: NOW, not_after, mode };
            let demand = Demand {
                armed: self.armed[place].then_some(Who::Person),
                interlock: Condition::Met,
                decision: self.armed[place].then_some(decided),
                restarts: 0,
                pauses: 0,
            };
            MemberDemand { demand, again_until: self.armed[place].then_some(not_after) }
        });
        let (members, beat) = (members.collect(), Beat::Counts);
        self.give(settings, &SetInput::Demand(SetDemand { members, control: 1, beat, is_leaving: false }))
    }

    /// Returns the world in a form in which equal worlds behave equally.
    pub(crate) fn canonical(&self, settings: &SetSettings) -> SetWorld {
        let one = &settings.members[0];
        let oldest = NOW.before(one.late + one.remembered + one.every * 3);
        let gateway = self.gateway.as_ref().map(|one| one.moved(|moment| moment.max(oldest), NOW));
        let mut pairs = self.pairs.clone();
        pairs.sort_unstable();
        pairs.dedup();
        SetWorld { gateway, pairs, ..self.clone() }
    }

    /// Returns the seconds until the control permanently uses the targets, if there are no more faults.
    pub(crate) fn runs_out(&self, settings: &SetSettings) -> Result<u64, String> {
        let mut world = self.clone();
        (world.held, world.left) = (None, SetBudget::default());
        let mut rested = 0;
        let one = &settings.members[0];
        let longest = 2 * one.late.as_secs() + 4 * one.limit.unsigned_abs() + 24;
        for second in 0..longest {
            if world.gateway.is_none() {
                world.start(settings);
                world.turn(settings, Mode::Follow)?;
            }
            for _ in 0..60 {
                if matches!(world.action, SetAction::Nothing { .. }) {
                    break;
                }
                world.done(settings)?;
            }
            if world.taken != [world.wanted, -world.wanted] || world.wires.strobe {
                rested = second + 1;
            }
            world.second(settings, true)?;
        }
        if rested == longest {
            return Err(format!("the set never comes to rest: {world:?}"));
        }
        Ok(rested)
    }
}
