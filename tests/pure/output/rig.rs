//! Test rig with one output and its register. The test decides the result of each write.

use std::time::Duration;

use isotherm_core::output::{Action, Event, Fact, SavedOutput, Settings, State, Who, step};
use isotherm_core::quantity::{Counts, Moment};

pub(crate) struct Rig {
    pub(crate) settings: Settings,
    pub(crate) state: State,
    pub(crate) action: Action,
    pub(crate) now: Moment,
    pub(crate) register: i64,
    pub(crate) disk: Option<SavedOutput>,
    pub(crate) reported: Vec<Event>,
}

impl Rig {
    /// Creates an armed output after an orderly stop. The register holds the value that is on disk.
    pub(crate) fn new(settings: Settings, kept: SavedOutput) -> Rig {
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

    /// Kills the process, and starts it again at once.
    pub(crate) fn kill(&mut self) {
        self.state = State::new(&self.settings, self.disk.as_ref(), self.now);
        self.arm();
    }

    /// Gives a fact, a millisecond after the last one.
    pub(crate) fn give(&mut self, fact: Fact) {
        self.now = self.now.after(Duration::from_millis(1));
        self.action = step(&mut self.state, &self.settings, fact, self.now);
        self.reported.extend(self.state.take_events().iter());
    }

    /// Executes the requested reads and writes to disk. Returns the value of the write that is requested then.
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

    /// Gives another decision. Returns the value of the write that it causes.
    pub(crate) fn want(&mut self, offset: i64) -> Option<i64> {
        let not_after = self.now.after(Duration::from_secs(1));
        self.give(Fact::Decided { offset: Counts(offset), target: None, not_after });
        self.settle()
    }

    /// Gives another decision with a target. Returns the value of the write that it causes.
    pub(crate) fn want_towards(&mut self, offset: i64, target: i64) -> Option<i64> {
        let not_after = self.now.after(Duration::from_secs(1));
        self.give(Fact::Decided { offset: Counts(offset), target: Some(Counts(target)), not_after });
        self.settle()
    }

    /// Carries out the requested write and answers it. Returns the value of the next write.
    pub(crate) fn done(&mut self) -> Option<i64> {
        self.register = self.write();
        self.give(Fact::Done { left: self.now });
        self.settle()
    }

    /// Carries out the requested write and loses the answer.
    pub(crate) fn answer_lost(&mut self) {
        self.register = self.write();
        self.give(Fact::Unknown { left: self.now });
    }

    /// Leaves the result of the requested write open, and does not carry it out now. Returns its value.
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

    /// Moves the register to this offset, one decision for each write.
    pub(crate) fn go(&mut self, offset: i64) {
        while self.want(offset).is_some() {
            assert_eq!(self.done(), None, "one decision is one change");
        }
        let base = self.state.kept().account.map_or(self.settings.bias, |account| account.base);
        assert_eq!(self.register, base.0 + offset);
    }

    /// Lets this number of seconds pass with the same decision. Returns the value of the first write.
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

    /// Returns whether a matching event has been reported.
    pub(crate) fn has_reported(&self, is_meant: impl Fn(&Event) -> bool) -> bool {
        self.reported.iter().any(is_meant)
    }

    /// Returns the operator offset and the gateway share in the ledger.
    pub(crate) fn parts(&self) -> (i64, i64) {
        let account = self.state.kept().account.unwrap();
        (account.base.0, account.share.0)
    }

    /// Returns whether another client was blamed for a change by the gateway.
    pub(crate) fn blames_others(&self) -> bool {
        self.has_reported(|event| event.switches_off() || matches!(event, Event::OperatorChanged { .. }))
    }
}
