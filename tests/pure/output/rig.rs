//! One output with its register at hand: a test says what becomes of each write.

use std::time::Duration;

use isotherm_core::output::{Action, Event, Fact, Kept, Settings, State, Who, step};
use isotherm_core::quantity::{Counts, Moment};

pub(crate) struct Rig {
    pub(crate) settings: Settings,
    pub(crate) state: State,
    pub(crate) action: Action,
    pub(crate) now: Moment,
    pub(crate) register: i64,
    pub(crate) disk: Option<Kept>,
    pub(crate) reported: Vec<Event>,
}

impl Rig {
    /// Armed, after a stop in order, where the register holds what the disk says.
    pub(crate) fn new(settings: Settings, kept: Kept) -> Rig {
        let now = Moment::from_nanos(1_000_000_000_000);
        let stood = kept.account.map_or(kept.stood, |account| Some(account.base + account.share));
        let mut rig = Rig {
            settings,
            state: State::new(&settings, Some(&kept), now),
            action: Action::Nothing { until: now },
            now,
            register: stood.unwrap_or(settings.bias).0,
            disk: Some(kept),
            reported: Vec::new(),
        };
        rig.arm();
        rig
    }

    fn arm(&mut self) {
        self.give(Fact::Look);
        assert_eq!(self.settle(), None);
        self.give(Fact::Armed { by: Who::Policy });
        assert_eq!(self.settle(), None);
    }

    /// The process is killed, and starts again at once.
    pub(crate) fn kill(&mut self) {
        self.state = State::new(&self.settings, self.disk.as_ref(), self.now);
        self.arm();
    }

    /// Each fact comes a millisecond after the one before.
    pub(crate) fn give(&mut self, fact: Fact) {
        self.now = self.now.after(Duration::from_millis(1));
        self.action = step(&mut self.state, &self.settings, fact, self.now);
        self.reported.extend(self.state.take_events().iter());
    }

    /// Reads and keeps as often as it asks for that; the write that it asks for then.
    pub(crate) fn settle(&mut self) -> Option<i64> {
        loop {
            match self.action {
                Action::Read => {
                    let asked = self.now.after(Duration::from_micros(500));
                    self.give(Fact::Read { found: Counts(self.register), asked });
                }
                Action::Keep => {
                    self.disk = Some(self.state.kept());
                    self.give(Fact::Kept);
                }
                Action::Write { value, .. } => return Some(value.0),
                Action::Nothing { .. } => return None,
            }
        }
    }

    /// Another decision; the write that it leads to.
    pub(crate) fn want(&mut self, offset: i64) -> Option<i64> {
        let not_after = self.now.after(Duration::from_secs(1));
        self.give(Fact::Decided { offset: Counts(offset), target: None, not_after });
        self.settle()
    }

    /// The same on the way to a target.
    pub(crate) fn want_towards(&mut self, offset: i64, target: i64) -> Option<i64> {
        let not_after = self.now.after(Duration::from_secs(1));
        self.give(Fact::Decided { offset: Counts(offset), target: Some(Counts(target)), not_after });
        self.settle()
    }

    /// The write that it asks for is carried out and answered; the write that comes then.
    pub(crate) fn done(&mut self) -> Option<i64> {
        self.register = self.write();
        self.give(Fact::Done { left: self.now });
        self.settle()
    }

    /// It is carried out, and the answer is lost.
    pub(crate) fn answer_lost(&mut self) {
        self.register = self.write();
        self.give(Fact::Unknown { left: self.now });
    }

    /// Nobody knows what becomes of it; for now nothing.
    pub(crate) fn held(&mut self) -> i64 {
        let value = self.write();
        self.give(Fact::Unknown { left: self.now });
        assert_eq!(self.settle(), None);
        value
    }

    fn write(&self) -> i64 {
        let Action::Write { value, .. } = self.action else { panic!("{:?} is no write", self.action) };
        value.0
    }

    /// Walks to where this is wanted.
    pub(crate) fn go(&mut self, offset: i64) {
        while self.want(offset).is_some() {
            assert_eq!(self.done(), None, "one decision is one change");
        }
        let base = self.state.kept().account.map_or(self.settings.bias, |account| account.base);
        assert_eq!(self.register, base.0 + offset);
    }

    /// This many seconds pass, and the same is wanted all the time; the first write that it asks for.
    pub(crate) fn seconds(&mut self, count: u64, offset: i64) -> Option<i64> {
        for _ in 0..count {
            self.now = self.now.after(Duration::from_secs(1));
            let write = self.want(offset);
            if write.is_some() {
                return write;
            }
        }
        None
    }

    /// Something told that looks like this.
    pub(crate) fn has_reported(&self, is_meant: impl Fn(&Event) -> bool) -> bool {
        self.reported.iter().any(is_meant)
    }

    /// The operator's part and ours, as the ledger has them.
    pub(crate) fn parts(&self) -> (i64, i64) {
        let account = self.state.kept().account.unwrap();
        (account.base.0, account.share.0)
    }

    /// Somebody was blamed for what we did ourselves.
    pub(crate) fn blames_others(&self) -> bool {
        self.has_reported(|event| event.switches_off() || matches!(event, Event::OperatorChanged { .. }))
    }
}
