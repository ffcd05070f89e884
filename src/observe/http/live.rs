//! Live stream of the status, with one message each second. The status is made and serialised once for all streams of
//! the whole status. A stream may also contain only a [page](StatusPage) of the status.
//!
//! The status is made on separate threads, because this takes long for a large machine, and no bus line may wait.

use std::convert::Infallible;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use axum::response::sse::{Event, Sse};
use tokio::sync::{Semaphore, watch};
use tokio::task::spawn_blocking;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt};

use crate::clock::Ticks;
use crate::observe::status::{GatewayApi, Status};
use crate::observe::status_pages::StatusPage;

const PERIOD: Duration = Duration::from_secs(1);
/// Time after which a browser reconnects when a stream has ended.
const RETRY: Duration = Duration::from_secs(2);

/// Source of the live streams. A task sends the status to all streams each second.
#[derive(Clone)]
pub(super) struct Live {
    source: Arc<dyn GatewayApi>,
    /// Receiver that is cloned for each stream. This original also counts as a receiver, so there is one receiver more
    /// than there are streams.
    latest: Arc<watch::Receiver<Option<Arc<Latest>>>>,
    places: Arc<Semaphore>,
}

/// Status of one second, which all streams share.
struct Latest {
    status: Status,
    whole: OnceLock<Arc<str>>,
}

impl Live {
    /// Starts the task that sends the status each second, to at most `streams` streams. Task and streams end when the
    /// sender of `stopped` is dropped.
    pub(super) fn start(source: Arc<dyn GatewayApi>, streams: usize, stopped: watch::Receiver<()>) -> Live {
        let (sender, latest) = watch::channel(None);
        tokio::spawn(tick(Arc::clone(&source), sender, stopped));
        Live { source, latest: Arc::new(latest), places: Arc::new(Semaphore::new(streams)) }
    }

    /// Returns a stream of the status, or of the page `page` of the status. The stream contains the present status,
    /// then a new status each second, as long as `may` returns `true`. A slow client misses some statuses, but always
    /// receives the newest. Returns `None` if the limit of streams is reached.
    pub(super) fn stream<May: Fn() -> bool + Send + 'static>(
        &self,
        may: May,
        page: Option<usize>,
    ) -> Option<Sse<impl Stream<Item = Result<Event, Infallible>> + use<May>>> {
        let place = self.places.clone().try_acquire_owned().ok()?;
        let mut latest = self.latest.as_ref().clone();
        latest.mark_unchanged();
        let present = tokio_stream::once(Arc::clone(&self.source)).then(move |source| present(source, page));
        let present = present.filter_map(|text| Some(event(&text?).retry(RETRY)));
        let rest = WatchStream::from_changes(latest)
            .take_while(move |_| may())
            .then(move |latest| text(latest, page))
            .filter_map(|text| Some(event(&text?)));
        Some(Sse::new(present.chain(rest).map(move |event| {
            // The permit is released when the stream is dropped.
            let _taken = &place;
            Ok(event)
        })))
    }
}

impl Latest {
    fn of(source: &dyn GatewayApi) -> Latest {
        Latest { status: source.status(), whole: OnceLock::new() }
    }

    /// Returns the whole status, or the given page of the status, as JSON.
    fn text(&self, page: Option<usize>) -> Arc<str> {
        match page {
            None => Arc::clone(self.whole.get_or_init(|| to_json(&self.status))),
            Some(number) => to_json(&StatusPage::of(&self.status, number)),
        }
    }
}

async fn tick(
    source: Arc<dyn GatewayApi>,
    sender: watch::Sender<Option<Arc<Latest>>>,
    mut stopped: watch::Receiver<()>,
) {
    let mut ticks = Ticks::every(PERIOD);
    loop {
        tokio::select! {
            () = ticks.next() => {}
            _ = stopped.changed() => {
                // The last status shows that the gateway stops.
                sender.send_replace(Some(Arc::new(Latest::of(source.as_ref()))));
                return;
            }
        }
        if sender.receiver_count() > 1 {
            let source = Arc::clone(&source);
            if let Ok(latest) = spawn_blocking(move || Latest::of(source.as_ref())).await {
                sender.send_replace(Some(Arc::new(latest)));
            }
        }
    }
}

async fn present(source: Arc<dyn GatewayApi>, page: Option<usize>) -> Option<Arc<str>> {
    spawn_blocking(move || Latest::of(source.as_ref()).text(page)).await.ok()
}

async fn text(latest: Option<Arc<Latest>>, page: Option<usize>) -> Option<Arc<str>> {
    let latest = latest?;
    spawn_blocking(move || latest.text(page)).await.ok()
}

fn to_json(status: &impl serde::Serialize) -> Arc<str> {
    serde_json::to_string(status).unwrap_or_default().into()
}

fn event(text: &str) -> Event {
    Event::default().event("status").data(text)
}
