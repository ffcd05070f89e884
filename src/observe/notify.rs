//! Delivery of events to the servers of `[[notify]]` over HTTP. Each message is one JSON document.
//!
//! Each server has an [`Outbox`]. Code that reports an event adds a message to the outbox without waiting. If
//! the outbox is full, the oldest message is dropped. A separate thread sends the messages in order. Neither
//! a bus line nor a web page waits for this thread. A failed message is sent again a few times, after growing
//! pauses, and then given up. Events report when deliveries begin to fail, when they succeed again, and how
//! many messages were lost.
//!
//! # Layout
//! - `outbox`: the queue, and the selection of events. `message`: the document.
//! - `post`, `answer`: sends one message over TCP or TLS, and reads the answer.
//! - `courier`: retries and pauses.

use std::future::Future;
use std::sync::Arc;
use std::thread::JoinHandle;

use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;
use tokio_rustls::rustls::ClientConfig;

use super::events::{Delivery, EventListener, ReportedEvent};
use isotherm_profile::{Notify, Profile, stop};

mod answer;
mod courier;
mod message;
mod outbox;
mod post;
mod token;

pub use courier::Rules;
pub use outbox::Outbox;
pub use post::{Failure, Post, Server};
pub use token::read as read_token;

/// TLS configuration with the trusted certificates. The error is the reason why no certificates can be trusted.
pub type Trust = Result<Arc<ClientConfig>, String>;

/// Function that receives the events about deliveries.
pub type Report = Arc<dyn Fn(Delivery) + Send + Sync>;

/// Outboxes of all servers of a profile. They collect messages from the first event on.
#[derive(Debug)]
pub struct Outboxes(Vec<Arc<Outbox>>);

impl Outboxes {
    /// Creates one outbox for each server of the profile.
    pub fn of(profile: &Profile, dry_run: bool) -> Outboxes {
        let machine = &profile.name;
        Outboxes(profile.notify.iter().map(|notify| Arc::new(Outbox::of(notify, machine, dry_run))).collect())
    }

    /// Returns the listener that passes events to the outboxes. `None` if the profile has no servers.
    pub fn listener(&self) -> Option<EventListener> {
        let outboxes = self.0.clone();
        let listener =
            move |happened: ReportedEvent<'_>| outboxes.iter().for_each(|outbox| outbox.receive(happened));
        (!self.0.is_empty()).then(|| Arc::new(listener) as EventListener)
    }

    /// Starts the thread that sends the messages. `trust` is the function that returns the trusted certificates for a
    /// server. Returns `None` if there are no servers.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn posted(
        self,
        report: Report,
        rules: Rules,
        trust: impl Fn(&Notify) -> Trust,
    ) -> std::io::Result<Option<Posting>> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let server = |outbox: &Arc<Outbox>| Server::of(outbox.notify(), trust(outbox.notify()));
        let routes: Vec<(Arc<Outbox>, Server)> =
            self.0.iter().map(|outbox| (outbox.clone(), server(outbox))).collect();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            // Threads for name lookups: one for each server, so that a slow lookup delays no other server.
            .max_blocking_threads(self.0.len())
            .build()?;
        let (stop, stopped) = watch::channel(false);
        let (over, ended) = oneshot::channel();
        let couriers_report = report.clone();
        let thread = std::thread::Builder::new().name("notify".to_owned()).spawn(move || {
            runtime.block_on(all(routes, rules, couriers_report, stopped));
            // A name lookup that has not ended must not delay the end.
            runtime.shutdown_background();
            // The receiver may be gone already.
            let _ = over.send(());
        })?;
        Ok(Some(Posting { outboxes: self.0, report, stop, ended, _thread: thread }))
    }
}

/// Running thread that sends the messages.
pub struct Posting {
    outboxes: Vec<Arc<Outbox>>,
    report: Report,
    stop: watch::Sender<bool>,
    ended: oneshot::Receiver<()>,
    /// Handle of the thread. Nothing joins the thread, because [`Posting::finish`] limits the wait for it.
    _thread: JoinHandle<()>,
}

impl Posting {
    /// Tries once more to send the waiting messages. Returns after [`stop::MESSAGES`] at most, or when `hurry` is
    /// ready. Messages that were not delivered by then are reported.
    pub async fn finish(self, hurry: impl Future<Output = ()>) {
        self.stop.send_replace(true);
        tokio::select! {
            biased;
            _ = self.ended => {}
            () = hurry => {}
            () = tokio::time::sleep(stop::MESSAGES) => {}
        }
        let left: Vec<Delivery> = self.outboxes.iter().filter_map(|outbox| outbox.all_dropped()).collect();
        left.into_iter().for_each(|dropped| (self.report)(dropped));
    }
}

/// Sends all messages until `stopped` is set. The remaining messages must then be sent within
/// [`stop::MESSAGES`].
async fn all(
    routes: Vec<(Arc<Outbox>, Server)>,
    rules: Rules,
    report: Report,
    mut stopped: watch::Receiver<bool>,
) {
    let mut couriers = JoinSet::new();
    for (outbox, server) in routes {
        let (report, stopped) = (report.clone(), stopped.clone());
        couriers.spawn(async move {
            courier::carry(&outbox, &server, rules, |delivery| report(delivery), stopped).await;
        });
    }
    // An error means that the sender is gone.
    let _ = stopped.wait_for(|stopped| *stopped).await;
    let over = async { while couriers.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(stop::MESSAGES, over).await;
}

#[cfg(test)]
mod tests;
