//! Delivery of messages to a server, with retries and pauses.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::Duration;

use tokio::sync::watch;

use super::outbox::Outbox;
use super::post::{Failure, Post};
use crate::observe::events::Delivery;
use isotherm_core::explained::Cause;

/// Number of consecutive failed attempts with a new reason after which the new reason is reported.
const CHANGED_AFTER: u32 = 2;
/// Number of consecutive failed attempts after which the failure is reported.
const TOLD: u32 = 2;

/// Timeouts and retries of a delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// Time within which a server must accept a message.
    pub timeout: Duration,
    /// Pause after the first of consecutive failures. Each further pause is twice as long.
    pub first_pause: Duration,
    /// Maximum pause, unless the server requests a longer pause.
    pub longest_pause: Duration,
    /// Maximum number of attempts for a message.
    pub attempts: u32,
}

impl Default for Rules {
    /// Returns the default timeouts. With these timeouts, the first message is tried for a quarter of an hour.
    fn default() -> Rules {
        Rules {
            timeout: Duration::from_secs(10),
            first_pause: Duration::from_secs(1),
            longest_pause: Duration::from_secs(120),
            attempts: 12,
        }
    }
}

impl Rules {
    /// Returns the pause after this number of consecutive failures. The pause is partly random, so that many gateways
    /// do not connect to one server at the same time.
    fn pause(&self, failures: u32) -> Duration {
        let doubled = 2_u32.saturating_pow(failures.saturating_sub(1));
        let pause = self.first_pause.saturating_mul(doubled).min(self.longest_pause);
        let drawn = RandomState::new().build_hasher().finish() % 256;
        pause.mul_f64(0.75 + f64::from(u8::try_from(drawn).unwrap_or_default()) / 1024.0)
    }
}

/// Sends the messages of an outbox to a server, one after the other, until `stopped` is set and no message waits.
pub(super) async fn carry(
    outbox: &Outbox,
    server: &impl Post,
    rules: Rules,
    report: impl Fn(Delivery),
    mut stopped: watch::Receiver<bool>,
) {
    let (notify, to) = (&outbox.notify().name, outbox.notify().url.to_string());
    // Failures in a row, across messages.
    let (mut failures, mut told_cause, mut was_silent) = (0_u32, None, false);
    loop {
        let message = match outbox.take() {
            Some(message) => message,
            None => tokio::select! {
                message = outbox.next() => message,
                // A message may have been added in between.
                () = ends(&mut stopped) => match outbox.take() {
                    Some(message) => message,
                    None => return,
                },
            },
        };
        let mut attempt = 1;
        loop {
            let told = outbox.dropped();
            let body = message.body(outbox.notify().body.as_ref(), told);
            let posted = tokio::select! {
                biased;
                // After a timeout, a stop does not wait for the server again.
                () = ends(&mut stopped), if was_silent => return,
                posted = tokio::time::timeout(rules.timeout, server.post(&body)) => posted,
            };
            let Err(failure) = posted.unwrap_or(Err(Failure::Silent(rules.timeout))) else {
                was_silent = false;
                let attempts = u64::from(std::mem::take(&mut failures));
                if told_cause.take().is_some() {
                    report(Delivery::Back { notify: notify.clone(), to: to.clone(), attempts });
                }
                if let Some(count) = outbox.arrived(told) {
                    report(Delivery::Dropped { notify: notify.clone(), to: to.clone(), count });
                }
                break;
            };
            (failures, was_silent) = (failures.saturating_add(1), failure.is_silence());
            // A single failure is not reported if the next attempt succeeds.
            if (failures >= TOLD || failure.is_final())
                && Cause::is_news(&mut told_cause, failure.to_string(), CHANGED_AFTER)
            {
                report(Delivery::Failed { notify: notify.clone(), to: to.clone(), why: failure.to_string() });
            }
            if *stopped.borrow() {
                // The code that requested the stop counts the rest.
                return;
            }
            let is_given_up = failure.is_final() || attempt >= rules.attempts;
            if is_given_up {
                outbox.given_up();
            }
            // A server that rejects one message works, and may accept the next.
            if !failure.is_final() {
                let pause = rules.pause(failures).max(failure.pause().unwrap_or_default());
                tokio::select! {
                    () = tokio::time::sleep(pause) => {}
                    () = ends(&mut stopped) => {}
                }
            }
            if is_given_up {
                break;
            }
            attempt += 1;
        }
    }
}

async fn ends(stopped: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

#[cfg(test)]
mod tests;
