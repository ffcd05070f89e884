//! What happens is posted to servers, as the profile's `[[notify]]` says: one JSON document a message, over HTTP.
//!
//! Each server has an [`Outbox`]. Whoever reports an event lays a message into it and goes on; where it is full, the oldest one goes.
//! A thread of its own, which no line and no page ever waits for, takes them out in their order. What does not arrive is tried
//! again after pauses that grow, a few times, and then given up. That a first one does not arrive is an event, that they arrive again
//! is another, and so is how many never did.
//!
//! # Layout
//! - `outbox`: the queue, and what is laid into it. `message`: the document.
//! - `post`, `answer`: one message on its way over TCP or TLS, what the server says, and what can go wrong.
//! - `courier`: when what is tried again.

use std::future::Future;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::sync::{oneshot, watch};
use tokio::task::JoinSet;
use tokio_rustls::rustls::ClientConfig;

use super::events::{Delivery, Event, EventListener, Happened};
use super::status::Source;
use isotherm_profile::{Notify, Profile};

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

/// How long the end of a run waits for what has not been posted yet.
const LAST_PATIENCE: Duration = Duration::from_secs(2);
/// Names that are looked up wait in a thread each: of more the next one waits for its turn.
const LOOKUPS: usize = 4;

/// Whom a server's certificate is compared with; a sentence where nobody is trusted.
pub type Trust = Result<Arc<ClientConfig>, String>;

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
        source: &Arc<dyn Source>,
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
            .max_blocking_threads(LOOKUPS)
            .build()?;
        let (stop, stopped) = watch::channel(false);
        let (over, ended) = oneshot::channel();
        let source = source.clone();
        let thread = std::thread::Builder::new().name("notify".to_owned()).spawn(move || {
            runtime.block_on(all(routes, rules, source, stopped));
            // A name that is still looked up holds up nobody.
            runtime.shutdown_background();
            // Nobody may wait for it any more.
            let _ = over.send(());
        })?;
        Ok(Some(Posting { stop, ended, _thread: thread }))
    }
}

/// The thread that posts.
#[derive(Debug)]
pub struct Posting {
    stop: watch::Sender<bool>,
    ended: oneshot::Receiver<()>,
    /// Nobody waits for it longer than [`Posting::finish`] does.
    _thread: JoinHandle<()>,
}

impl Posting {
    /// The gateway has ended: what waits is tried once more, within two seconds, or until `hurry` is ready.
    pub async fn finish(self, hurry: impl Future<Output = ()>) {
        self.stop.send_replace(true);
        tokio::select! {
            _ = self.ended => {}
            () = tokio::time::sleep(LAST_PATIENCE + LAST_PATIENCE / 4) => {}
            () = hurry => {}
        }
    }
}

/// Carries all messages, until it is told to stop and they have come to their end, or their time has.
async fn all(
    routes: Vec<(Arc<Outbox>, Server)>,
    rules: Rules,
    source: Arc<dyn Source>,
    mut stopped: watch::Receiver<bool>,
) {
    let outboxes: Vec<Arc<Outbox>> = routes.iter().map(|(outbox, _)| outbox.clone()).collect();
    let mut couriers = JoinSet::new();
    for (outbox, server) in routes {
        let (source, stopped) = (source.clone(), stopped.clone());
        couriers.spawn(async move {
            let report = |delivery| source.report(&Event::Delivery(delivery));
            courier::carry(&outbox, &server, rules, report, stopped).await;
        });
    }
    // An error means that nobody waits any more.
    let _ = stopped.wait_for(|stopped| *stopped).await;
    let over = async { while couriers.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(LAST_PATIENCE, over).await;
    for outbox in outboxes {
        let count = outbox.left();
        if count > 0 {
            let (notify, to) = (outbox.notify().name.clone(), outbox.notify().url.to_string());
            source.report(&Event::Delivery(Delivery::Dropped { notify, to, count }));
        }
    }
}
