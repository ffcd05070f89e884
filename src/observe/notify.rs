//! What happens is posted to servers, as the profile's `[[notify]]` says: one JSON document a message, over HTTP.
//!
//! Each server has an [`Outbox`]. Whoever reports an event lays a message into it and goes on; where it is full, the oldest one goes.
//! A thread of its own, which no line and no page ever waits for, takes them out in their order. What does not arrive is tried
//! again after pauses that grow, a few times, and then given up. That they do not arrive is an event, that they arrive again is another,
//! and so is how many never did.
//!
//! # Layout
//! - `outbox`: the queue, and what is laid into it. `message`: the document.
//! - `post`, `answer`: one message on its way over TCP or TLS, what the server says, and what can go wrong.
//! - `courier`: when what is tried again.

use std::future::Future;
use std::sync::Arc;
use std::thread::JoinHandle;

use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;
use tokio_rustls::rustls::ClientConfig;

use super::events::{Delivery, EventListener, Happened};
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

/// Whom a server's certificate is compared with; a sentence where nobody is trusted.
pub type Trust = Result<Arc<ClientConfig>, String>;

/// What becomes of messages is told so.
pub type Report = Arc<dyn Fn(Delivery) + Send + Sync>;

/// The outboxes of a profile, which fill from the first event on.
#[derive(Debug)]
pub struct Outboxes(Vec<Arc<Outbox>>);

impl Outboxes {
    /// One for each server.
    pub fn of(profile: &Profile, dry_run: bool) -> Outboxes {
        let machine = &profile.name;
        Outboxes(profile.notify.iter().map(|notify| Arc::new(Outbox::of(notify, machine, dry_run))).collect())
    }

    /// Who has to hear of every event; `None` where nobody is to be told.
    pub fn listener(&self) -> Option<EventListener> {
        let outboxes = self.0.clone();
        let listener = move |happened: Happened<'_>| outboxes.iter().for_each(|outbox| outbox.hear(happened));
        (!self.0.is_empty()).then(|| Arc::new(listener) as EventListener)
    }

    /// Empties them from now on; `trust` says by whom a server's certificate must be signed. Nothing where there are none.
    ///
    /// # Errors
    /// The system has no thread for it.
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
            // The names of servers are looked up in these: one that hangs holds up no other.
            .max_blocking_threads(self.0.len())
            .build()?;
        let (stop, stopped) = watch::channel(false);
        let (over, ended) = oneshot::channel();
        let couriers_report = report.clone();
        let thread = std::thread::Builder::new().name("notify".to_owned()).spawn(move || {
            runtime.block_on(all(routes, rules, couriers_report, stopped));
            // A name that is still looked up holds up nobody.
            runtime.shutdown_background();
            // Nobody may wait for it any more.
            let _ = over.send(());
        })?;
        Ok(Some(Posting { outboxes: self.0, report, stop, ended, _thread: thread }))
    }
}

/// The thread that posts.
pub struct Posting {
    outboxes: Vec<Arc<Outbox>>,
    report: Report,
    stop: watch::Sender<bool>,
    ended: oneshot::Receiver<()>,
    /// Nobody waits for it longer than [`Posting::finish`] does.
    _thread: JoinHandle<()>,
}

impl Posting {
    /// The gateway has ended: what waits is tried once more, for at most [`stop::MESSAGES`], or until `hurry` is ready. What has not
    /// arrived then is reported.
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

/// Carries all messages, until it is told to stop and they have come to their end, or their time has.
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
    // An error means that nobody waits any more.
    let _ = stopped.wait_for(|stopped| *stopped).await;
    let over = async { while couriers.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(stop::MESSAGES, over).await;
}

#[cfg(test)]
mod tests;
