//! Commands from the broker. Only measured errors are accepted, and only if the profile allows this. No message can
//! arm, disarm or move an axis.

use std::time::Duration;

use crate::observe::requester::{Channel, Requester};
use crate::observe::status::GatewayApi;
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::quantity::Moment;
use isotherm_plant::{Command, Outcome};

/// Minimum time between two accepted commands.
pub(super) const PAUSE: Duration = Duration::from_secs(1);
/// Minimum time between two reports of rejected messages. Each report contains their number.
const REPORT_EVERY: Duration = Duration::from_secs(60);

/// Executor of commands from the broker, at most one command in each [`PAUSE`].
#[derive(Debug)]
pub(super) struct Commands {
    /// Address of the broker. Events name it as the requester, because MQTT does not identify the publisher of a
    /// message.
    broker: String,
    last: Option<Moment>,
    reported: Option<Moment>,
    unreported: u64,
}

impl Commands {
    pub(super) fn from(broker: &str) -> Commands {
        Commands { broker: broker.to_owned(), last: None, reported: None, unreported: 0 }
    }

    /// Executes an allowed command, or reports why a command is rejected. `redelivered` is true if the broker delivers
    /// the message again.
    pub(super) fn take(&mut self, now: Moment, outcome: Outcome, redelivered: bool, source: &dyn GatewayApi) {
        match outcome {
            Outcome::Asked(Command::Measured { axis, report }) => {
                if self.last.is_some_and(|last| now.since(last) < PAUSE) {
                    self.refuse(now, "measured", "the previous command came less than a second ago", source);
                    return;
                }
                self.last = Some(now);
                let requester = Requester::new(Channel::Broker, self.broker.clone());
                // The result is an event in either case.
                let _ = source.measured(&axis, Some(MeasuredReport { redelivered, ..report }), &requester);
            }
            Outcome::Refused { command, why } => self.refuse(now, &command, &why, source),
        }
    }

    /// Rejects a retained message. Such a message may be old, and its sender does not wait for an answer.
    pub(super) fn refuse_retained(&mut self, now: Moment, topic: &str, source: &dyn GatewayApi) {
        let command = topic.rsplit('/').next().unwrap_or(topic).chars().take(40).collect::<String>();
        let why = "the message is retained: publish commands without the retain flag";
        self.refuse(now, &command, why, source);
    }

    fn refuse(&mut self, now: Moment, command: &str, why: &str, source: &dyn GatewayApi) {
        if self.reported.is_some_and(|reported| now.since(reported) < REPORT_EVERY) {
            self.unreported += 1;
            return;
        }
        self.reported = Some(now);
        let more = match std::mem::take(&mut self.unreported) {
            0 => String::new(),
            more => format!(" (and {more} more rejected messages since the last report)"),
        };
        let requester = Requester::new(Channel::Broker, self.broker.clone());
        source.turned_away(command, &requester, &format!("{why}{more}"));
    }
}
