//! Writes offsets to one output, without a device. The example shows a read, a write, the verification, and a write
//! whose answer is lost.
//!
//! ```sh
//! cargo run -p isotherm-core --example output
//! ```
//!
//! The gateway uses this step function for an output on a bus. It passes a fact to the step function,
//! executes the action that the step returns, and passes the result as the next fact. In this example, a
//! number replaces the register of a device.

use std::time::Duration;

use isotherm_core::output::{Action, Fact, Rules, SavedOutput, Settings, State, Verify, Who, step};
use isotherm_core::quantity::{Counts, Moment};

const START: Moment = Moment::from_nanos(1_000_000_000_000);
const MILLI: Duration = Duration::from_millis(1);
const SECOND: Duration = Duration::from_secs(1);

fn main() {
    let mut desk = Desk::new();
    desk.give("the gateway starts", Fact::Look);
    desk.give("the profile arms the axis", Fact::Armed { by: Who::Policy });
    desk.decide("a decision requests 25 counts; one step is at most 10", Counts(25));
    desk.answer_is_lost = true;
    desk.decide("the next decision; the answer to its write is lost", Counts(25));
    desk.decide("the last decision that changes the register", Counts(25));
    desk.decide("the register holds the requested value: no write", Counts(25));
}

/// State of the output, and the number that replaces its register.
struct Desk {
    settings: Settings,
    state: State,
    now: Moment,
    register: Counts,
    /// Whether the next write is executed, but its answer is lost.
    answer_is_lost: bool,
}

impl Desk {
    fn new() -> Desk {
        let settings = Settings {
            step: Counts(10),
            limit: Counts(400),
            bias: Counts(0),
            range: (Counts(-32_768), Counts(32_767)),
            late: 30 * SECOND,
            remembered: 300 * SECOND,
            every: 10 * SECOND,
            refresh: None,
            is_shared: false,
            verify: Verify::Reading,
            applied: None,
            rules: Rules::default(),
        };
        // The last run ended in order, so none of its writes may still arrive.
        let kept = SavedOutput { in_order: true, ..SavedOutput::default() };
        let state = State::new(&settings, Some(&kept), START);
        Desk { settings, state, now: START, register: Counts(0), answer_is_lost: false }
    }

    /// Passes a decision to the output, ten seconds after the previous decision. The output may send the change within
    /// one second.
    fn decide(&mut self, what: &str, offset: Counts) {
        self.now = self.now.after(10 * SECOND);
        self.give(what, Fact::Decided { offset, target: None, not_after: self.now.after(SECOND) });
    }

    /// Passes a fact to the output, then executes the actions that the output requests, until it requests nothing.
    fn give(&mut self, what: &str, fact: Fact) {
        println!("\n{what}");
        let mut fact = fact;
        loop {
            self.now = self.now.after(MILLI);
            let action = step(&mut self.state, &self.settings, fact, self.now);
            println!("{:>8.3} s  {:<22} → {}", self.seconds(self.now), self.fact(fact), self.action(action));
            for event in self.state.take_events().iter() {
                println!("            event: {event:?}");
            }
            // Time before the request is sent, or after the last byte of a write was sent.
            let moment = self.now.after(MILLI / 2);
            fact = match action {
                Action::Nothing { .. } => return,
                Action::Read => Fact::Read { found: self.register, asked: moment },
                // A gateway waits for the disk here.
                Action::Keep => Fact::Kept,
                Action::Write { value, .. } => {
                    self.register = value;
                    match std::mem::take(&mut self.answer_is_lost) {
                        true => Fact::Unknown { left: moment },
                        false => Fact::Done { left: moment },
                    }
                }
            };
        }
    }

    fn fact(&self, fact: Fact) -> String {
        match fact {
            Fact::Decided { offset, not_after, .. } => {
                format!("decided {offset} until {:.1}", self.seconds(not_after))
            }
            Fact::Read { found, .. } => format!("read {found}"),
            Fact::Done { .. } => "done".to_owned(),
            Fact::Unknown { .. } => "unknown".to_owned(),
            other => format!("{other:?}"),
        }
    }

    fn action(&self, action: Action) -> String {
        match action {
            Action::Nothing { until } => format!("nothing until {:.3} s", self.seconds(until)),
            Action::Read => "read".to_owned(),
            Action::Keep => "save the state on disk".to_owned(),
            Action::Write { value, .. } => format!("write {value}"),
        }
    }

    fn seconds(&self, moment: Moment) -> f64 {
        moment.since(START).as_secs_f64()
    }
}
