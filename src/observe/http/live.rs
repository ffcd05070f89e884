//! Live stream of the status, once a second. The status is serialised once for all open web pages.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::response::sse::{Event, Sse};
use tokio::sync::{Semaphore, watch};
use tokio::time::MissedTickBehavior;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

use crate::observe::status::GatewayApi;

const PERIOD: Duration = Duration::from_secs(1);
/// Time after which a browser connects again to an ended stream.
const RETRY: Duration = Duration::from_secs(2);

/// Source of the status streams.
#[derive(Clone)]
pub(super) struct Live {
    source: Arc<dyn GatewayApi>,
    /// Receiver that is cloned for each stream. It is one of the sender's receivers itself, so their number is one more
    /// than that of the streams.
    latest: Arc<watch::Receiver<Arc<str>>>,
    places: Arc<Semaphore>,
}

impl Live {
    /// Starts the task that sends the status each second, to at most `streams` streams. Task and streams end when the
    /// sender of `stopped` is dropped.
    pub(super) fn start(source: Arc<dyn GatewayApi>, streams: usize, stopped: watch::Receiver<()>) -> Live {
        let (sender, latest) = watch::channel(Arc::from(""));
        tokio::spawn(tick(Arc::clone(&source), sender, stopped));
        Live { source, latest: Arc::new(latest), places: Arc::new(Semaphore::new(streams)) }
    }

    /// Returns a stream of the status: the present one, then one each second, as long as `may` returns `true`. A slow
    /// client misses some, and receives the newest. Returns `None` if the limit of streams is reached.
    pub(super) fn stream<May: Fn() -> bool + Send + 'static>(
        &self,
        may: May,
    ) -> Option<Sse<impl Stream<Item = Result<Event, Infallible>> + use<May>>> {
        let place = self.places.clone().try_acquire_owned().ok()?;
        let first = event(&to_json(self.source.as_ref())).retry(RETRY);
        let mut latest = self.latest.as_ref().clone();
        latest.mark_unchanged();
        let rest = WatchStream::from_changes(latest).take_while(move |_| may()).map(|text| event(&text));
        Some(Sse::new(tokio_stream::once(first).chain(rest).map(move |event| {
            // The permit is released when the stream is dropped.
            let _taken = &place;
            Ok(event)
        })))
    }
}

async fn tick(
    source: Arc<dyn GatewayApi>,
    sender: watch::Sender<Arc<str>>,
    mut stopped: watch::Receiver<()>,
) {
    let mut ticks = tokio::time::interval(PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            _ = stopped.changed() => {
                // The last status shows that the gateway stops.
                sender.send_replace(to_json(source.as_ref()));
                return;
            }
        }
        if sender.receiver_count() > 1 {
            sender.send_replace(to_json(source.as_ref()));
        }
    }
}

fn to_json(source: &dyn GatewayApi) -> Arc<str> {
    serde_json::to_string(&source.status()).unwrap_or_default().into()
}

fn event(text: &str) -> Event {
    Event::default().event("status").data(text)
}
